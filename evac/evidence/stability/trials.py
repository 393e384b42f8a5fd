"""One trial of a contact model on a scene, and the verdict on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError
from evac.evidence import scenes
from evac.evidence.scenes import Scene
from evac.evidence.stability.theory import allowed_overlap, touching_pairs, wall_gaps
from evac.physics.contact.model import ContactModel
from evac.physics.state import Crowd
from evac.physics.tallies import MEASURES

RIGHT = "right"
HANDLED = "handled"
DEGRADED = "degraded"
BEYOND = "beyond theory"
REFUSED = "refused"
WRONG = "wrong"

#: All verdicts, best first; a trial that is `WRONG` is a defect.
VERDICTS = (RIGHT, HANDLED, DEGRADED, BEYOND, REFUSED, WRONG)

#: The contact models under trial: name in `scenes.MODELS`, and parameters.
VARIANTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "DEM": ("DEM", {}),
    "NSM1 inertial": ("NSM1 inertial", {}),
    "NSM1 overdamped": ("NSM1 overdamped", {}),
    "NSM2 K_N = 0": ("NSM2", {"normal_dissipation": 0.0}),
    "NSM2 K_N = 1e5": ("NSM2", {}),
    "NSM2 K_N = inf": ("NSM2", {"normal_dissipation": np.inf}),
}

#: DEM's stiffness in all trials except those that vary it [kg/s2].
STIFFNESS = 1.2e5

#: Overlap that counts as correct [m]: for NSM1 its tolerance, for the others one per cent of a body.
GAP_TOLERANCE = 1e-4
SMALL_OVERLAP = 2e-3

#: Counts that are part of every run, and contain no information on difficulties in steps.
ORDINARY = MEASURES | {"steps", "sub_steps", "list_builds", "contacts", "overlaps", "solves", "iterations"}

#: Counts of steps that failed; the other counts are of corrections.
FAILURES = (
    "unconverged_steps",
    "failed_position_corrections",
    "wall_crossings_prevented",
    "passes_prevented",
    "too_fast_steps",
    "elastic_fallbacks",
)

#: A centre may lie this far beyond a wall by rounding alone, in relation to the size of the coordinates.
ROUNDING = 1e-12

#: Least difference by which an overlap must exceed the reported one to count as concealed [m].
CONCEALED = 1e-4


@dataclass(frozen=True)
class Trial:
    """The outcome of a run."""

    model: ContactModel
    scene: Scene
    message: str  # why the run was refused or stopped; empty if it is complete
    time: FloatArray  # (f,) of the frames, the first at the start [s]
    position: FloatArray  # (f, n, 2) [m]
    velocity: FloatArray  # (f, n, 2) [m/s], the contact model's own
    crowd: Crowd  # at the end
    outside: int  # frames times people at which a centre was beyond an outer wall
    report: Mapping[str, float]  # the engine's sums

    def is_finite(self) -> bool:
        """Return whether all numbers of all frames are finite."""
        return bool(np.isfinite(self.position).all() and np.isfinite(self.velocity).all())

    def speed(self) -> FloatArray:
        """Return the speeds (f, n) [m/s]."""
        return np.asarray(np.hypot(self.velocity[..., 0], self.velocity[..., 1]))

    def handling(self) -> str:
        """Return the engine's counts of corrections and failures as text; empty if there are none."""
        counted = {key.replace("_", " "): count for key, count in self.report.items() if key not in ORDINARY}
        texts = [f"{count:.0f} {words}" for words, count in counted.items() if count]
        extra = self.report["sub_steps"] - self.report["steps"]
        return ", ".join([*texts, *([f"{extra:.0f} more sub-steps"] if extra > 0 else [])])


class Verdict(NamedTuple):
    """The verdict on a trial."""

    kind: str  # one of VERDICTS
    error: float  # in the unit of the bound; NaN if refused
    words: str  # by how much, how handled, or why refused


def make_model(variant: str, **parameters: Any) -> ContactModel:
    """Return a contact model by its name in `VARIANTS`, with additional or changed parameters."""
    name, given = VARIANTS[variant]
    return scenes.make_model(name, **{**given, **parameters})


def attempt(
    model: ContactModel,
    scene: Scene,
    step: float,
    duration: float,
    *,
    explicit: bool = False,
    every: float = 0.1,
    checked: bool = True,
) -> Trial:
    """Run a scene like a simulation: first the check of the step [s], which may refuse it if `checked`, then ticks.

    With `explicit` the drive is explicit Euler. `every` is the time between frames [s], rounded to whole steps, at
    least one.
    """
    engine, crowd = scene.start()
    frames = [(0.0, crowd.position.copy(), crowd.velocity.copy())]
    outside = 0
    message = ""
    per_frame = max(1, round(every / step))
    total = max(1, round(duration / step))
    try:
        if checked:
            model.check_scene(scene.border(step, explicit))
        for first in range(0, total, per_frame):
            steps = min(per_frame, total - first)
            engine.advance(model, crowd, first, steps, step, explicit, first + steps == total)
            frames.append(((first + steps) * step, crowd.position.copy(), crowd.velocity.copy()))
            outside += _outside(scene, crowd)
    except EvacError as error:
        message = str(error)
    time, position, velocity = (np.array(values) for values in zip(*frames, strict=True))
    return Trial(model, scene, message, time, position, velocity, crowd, outside, engine.report())


def _outside(scene: Scene, crowd: Crowd) -> int:
    x1, y1, x2, y2 = scene.room
    slack = ROUNDING * max(1.0, *(abs(bound) for bound in scene.room))
    x, y = crowd.position[crowd.level >= 0].T
    return int(np.sum((x < x1 - slack) | (x > x2 + slack) | (y < y1 - slack) | (y > y2 + slack)))


def judge(
    trial: Trial,
    measure: Callable[[Trial], float],
    right: float,
    tolerable: float,
    unit: str,
    is_reported: bool = False,
) -> Verdict:
    """Return the verdict on a trial by the error that `measure` returns if it ran to its end.

    The error is right up to `right`, and the method's own theory allows `tolerable`. With `is_reported` the engine's
    report holds the error itself, as it does the greatest overlap.
    """
    if not trial.is_finite():
        return Verdict(WRONG, np.nan, "not finite")
    if trial.outside:
        return Verdict(WRONG, np.nan, f"{trial.outside} times beyond a wall")
    if trial.message:
        return Verdict(REFUSED, np.nan, trial.message)
    error = measure(trial)
    handling = trial.handling()
    if not np.isfinite(error):
        return Verdict(WRONG, error, "error not finite")
    if error <= right:
        return Verdict(HANDLED if handling else RIGHT, error, handling)
    text = f"; {handling}" if handling else ""
    words = f"{error:.2g} {unit}, {error / right:.2g} times the bound{text}"
    if error <= tolerable:
        return Verdict(DEGRADED, error, words)
    if is_reported or any(trial.report.get(key, 0.0) for key in FAILURES):
        return Verdict(BEYOND, error, f"{words}; theory allows {tolerable:.2g} {unit}")
    return Verdict(WRONG, error, f"{error:.2g} {unit} and nothing tells of it")


def judge_overlap(variant: str, trial: Trial, step: float) -> Verdict:
    """Return the verdict on the greatest overlap of a run that starts without one."""
    tolerance = 1.001 * GAP_TOLERANCE
    allowed = allowed_overlap(variant, trial.scene, step, STIFFNESS, tolerance)
    right = tolerance if variant.startswith("NSM1") else SMALL_OVERLAP
    return judge(trial, greatest_overlap, right, allowed, "m", is_reported=True)


def deepest_overlap(scene: Scene, position: FloatArray) -> float:
    """Return the greatest overlap of bodies with each other and with walls [m], computed apart from the engine."""
    _, _, gap = touching_pairs(position, scene.crowd.radius)
    _, wall_gap = wall_gaps(scene, position)
    return float(max(0.0, -gap.min(initial=0.0), -wall_gap.min()))


def greatest_overlap(trial: Trial) -> float:
    """Return the greatest overlap [m] of all frames, infinite if the engine's report conceals it.

    The engine reports an overlap when a step starts from it, so the last frame may contain a deeper one; one that
    was removed immediately is reported by the count of position corrections.
    """
    frames = [deepest_overlap(trial.scene, position) for position in trial.position]
    reported = trial.report["greatest_overlap"]
    is_told = max(frames[:-1]) <= reported + CONCEALED or trial.report["position_corrections"] > 0
    return max(*frames, reported) if is_told else np.inf


def last_overlap(trial: Trial) -> float:
    """Return the greatest overlap [m] in the last frame."""
    return deepest_overlap(trial.scene, trial.position[-1])


def last_speed(trial: Trial) -> float:
    """Return the greatest speed [m/s] over the frames of the last second."""
    return float(trial.speed()[trial.time > trial.time[-1] - 1.0].max())
