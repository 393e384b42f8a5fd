"""Accuracy, part b: whole trajectories against the step, for each contact model and integrator of the drive."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.errors import ScenarioError
from evac.evidence.accuracy_data import add_data, order_of
from evac.evidence.report import Evidence, new_figure
from evac.evidence.scenes import FloatArray, Scene, one_direction, room
from evac.physics.bundles import make_crowd
from evac.physics.contact_model import ContactModel
from evac.registry import Registry
from evac.scenario.schema import SimulationSettings
from evac.scenario.tolerance import ERROR_PER_PATH

#: Everything is solved as far as it goes: what is left is the error of the step.
SOLVED = {"velocity_tolerance": 1e-11, "iterations": 20_000}

#: Label, plugin and parameters.
VARIANTS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("DEM", "dem", {"stiffness": 1.2e5}),
    ("NSM1 inertial", "nsm1", {**SOLVED, "gap_tolerance": 1e-12}),
    ("NSM1 overdamped", "nsm1", {**SOLVED, "gap_tolerance": 1e-12, "variant": "overdamped"}),
    ("NSM2, K_N = 0", "nsm2", {**SOLVED, "normal_dissipation": 0.0}),
    ("NSM2, K_N = 1e5", "nsm2", {**SOLVED, "normal_dissipation": 1e5}),
)

DRIVES = ("exponential", "explicit")

#: Each problem is started from so many places, parts of `SHIFT` [m] apart: where in a step a contact falls is chance.
PHASES = 4
SHIFT = 0.03

LARGEST = 0.04  # s

#: Below this an error is that of solver and rounding, not of the step [m].
EXACT = 1e-8
BOUNDS = (-8.0, -6.0, 8.0, 6.0)

#: Mass, radius, relaxation time and speed of the people here.
MASS, RADIUS, TAU, SPEED = 80.0, 0.22, 0.5, 1.5


@dataclass(frozen=True)
class Problem:
    """A problem whose solution means something.

    Attributes
    ----------
    name : str
    duration : float [s]
    scene : callable
        Scene by shift [m].
    exact : callable or None
        Positions (n, 2) at the end by (plugin, parameters, shift); None: computed with the smallest step.
    second_order : frozenset of (plugin, drive)
        Where theory promises order 2; elsewhere order 1.
    """

    name: str
    duration: float
    scene: Callable[[float], Scene]
    exact: Callable[[str, dict[str, Any], float], FloatArray] | None = None
    second_order: frozenset[tuple[str, str]] = frozenset()


def run(evidence: Evidence) -> None:
    """Compute part b and add it to the page."""
    registry = Registry()
    halvings, finest = (4, 8) if evidence.quick else (7, 11)
    steps = [LARGEST / 2**k for k in range(halvings)]
    evidence.heading("b. Trajectories: error against the step")
    evidence.text(
        f"""Error of the positions at the end of each problem (greatest over people, root mean square over {PHASES}
        shifted starts, because it is chance when in a step a contact falls). Free walk and wall hit are compared
        with their exact solutions, the others with the same model at a step of {LARGEST / 2**finest:.1e} s. Each
        model is compared with the limit of its own law: this is the error of the step, not the difference between
        laws. Steps that a model refuses are left out."""
    )
    rows = [
        row
        for problem in PROBLEMS
        for label, plugin, parameters in VARIANTS
        for row in measure(problem, label, plugin, parameters, steps, LARGEST / 2**finest, registry)
    ]
    evidence.table(
        "trajectory_orders",
        order_rows(rows),
        "Measured orders of convergence (slope over the five smallest steps) beside the theoretical ones, which hold"
        " while no contact begins or ends (when in a step a contact falls is chance, and the slope of five such errors"
        " scatters), and the error"
        " at h = 0.01 s. A dash: no error of the step.",
    )
    worst = max(rows, key=lambda row: row["error / (v h)"] * (row["h [s]"] < 0.0101))
    evidence.text(
        f"""In units of the path walked in a step, v h, the error is at most {worst["error / (v h)"]:.2g} at steps up to
        0.01 s ({worst["problem"]}, {worst["model"]}, {worst["drive"]}); the rule of --tolerance counts on
        {ERROR_PER_PATH:g}."""
    )
    evidence.plot(
        "trajectories_step", draw(rows, "h [s]"), "Errors over the step; full: exponential, dashed: explicit."
    )
    evidence.finding(drive_finding(rows), "trajectories_step", "Errors of positions over the step")
    evidence.plot("trajectories_time", draw(rows, "time [s]"), "The same errors over run time.")
    add_data(evidence, "trajectories", rows, "All errors")


def drive_finding(rows: Sequence[dict[str, Any]]) -> str:
    """Say which drive has the smaller errors at the default step, and how often."""
    settings = SimulationSettings()
    step = min({row["h [s]"] for row in rows}, key=lambda h: abs(h - settings.step))
    errors: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row["h [s]"] == step:
            errors.setdefault((row["problem"], row["model"]), {})[row["drive"]] = row["error [m]"]
    ratios = [pair["explicit"] / pair["exponential"] for pair in errors.values() if differ(pair)]
    better = sum(ratio > 1.0 for ratio in ratios)
    return (
        f"The default drive is {settings.driving} at h = {settings.step:g} s: of the {len(ratios)} problems and models"
        f" whose error depends on the drive, the exponential one has the smaller error in {better}, by a factor of"
        f" {np.median(ratios):.2g} in the median; part e shows what a smaller step would change in the flow, and cost."
    )


def differ(pair: dict[str, float]) -> bool:
    """Say whether both drives were run, and their errors differ by more than rounding."""
    return len(pair) == 2 and abs(pair["explicit"] - pair["exponential"]) > 1e-3 * max(pair.values()) + 1e-9


def measure(
    problem: Problem,
    label: str,
    plugin: str,
    parameters: dict[str, Any],
    steps: Sequence[float],
    finest: float,
    registry: Registry,
) -> list[dict[str, Any]]:
    """Return a row per drive and step: error, run time."""
    model = registry.get("contact_model", plugin)(**parameters)
    shifts = [SHIFT * k / PHASES for k in range(PHASES)]
    truths = []
    for shift in shifts:
        if problem.exact is not None:
            truths.append(problem.exact(plugin, parameters, shift))
        else:
            truths.append(walked(problem, model, shift, finest, "exponential")[0])
    rows = []
    for drive in DRIVES:
        for step in steps:
            try:
                model.check_scene(problem.scene(0.0).border(step, drive == "explicit"))
            except ScenarioError:
                continue
            found = [walked(problem, model, shift, step, drive) for shift in shifts]
            errors = [_distance(place, truth) for (place, _), truth in zip(found, truths, strict=True)]
            rows.append(
                {
                    "problem": problem.name,
                    "model": label,
                    "drive": drive,
                    "h [s]": step,
                    "error [m]": math.sqrt(float(np.mean(np.square(errors)))),
                    "error / (v h)": math.sqrt(float(np.mean(np.square(errors)))) / (_fastest(problem) * step),
                    "time [s]": float(np.median([span for _, span in found])),
                    "theory": 2 if (plugin, drive) in problem.second_order else 1,
                }
            )
    return rows


def walked(problem: Problem, model: ContactModel, shift: float, step: float, drive: str) -> tuple[FloatArray, float]:
    """Return the positions at the end (n, 2) [m] and the time it took [s]."""
    engine, crowd = problem.scene(shift).start()
    steps = round(problem.duration / step)
    start = time.perf_counter()
    # Ticks far apart: a person keeps its place in the list of bodies, and the warm start its memory.
    engine.advance(model, crowd, 0, steps, step, drive == "explicit", False)
    return crowd.position, time.perf_counter() - start


def _distance(places: FloatArray, truth: FloatArray) -> float:
    """Return the greatest distance of two sets of positions [m]."""
    return float(np.max(np.hypot(*(places - truth).T)))


def _fastest(problem: Problem) -> float:
    """Return the greatest speed that somebody wants or starts with [m/s]."""
    crowd = problem.scene(0.0).crowd
    return float(max(crowd.speed.max(), np.hypot(*crowd.velocity.T).max()))


def order_rows(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return measured and theoretical orders of every problem, model and drive."""
    table = []
    for name, model, drive in dict.fromkeys((row["problem"], row["model"], row["drive"]) for row in rows):
        here = [row for row in rows if (row["problem"], row["model"], row["drive"]) == (name, model, drive)]
        small = [row for row in here if row["error [m]"] > EXACT][-5:]
        at = [row["error [m]"] for row in here if math.isclose(row["h [s]"], 0.01)]
        table.append(
            {
                "problem": name,
                "model": model,
                "drive": drive,
                "measured order": order_of([r["h [s]"] for r in small], [r["error [m]"] for r in small])
                if len(small) > 2
                else None,
                "theory": here[0]["theory"],
                "error at h = 0.01 s [mm]": 1e3 * at[0] if at else None,
                "greatest error / (v h), h <= 0.01 s": max(r["error / (v h)"] for r in here if r["h [s]"] < 0.0101),
            }
        )
    return table


def draw(rows: Sequence[dict[str, Any]], across: str) -> Any:
    """Draw the errors of every problem over a column of the rows."""
    names = list(dict.fromkeys(row["problem"] for row in rows))
    models = [label for label, _, _ in VARIANTS]
    figure, axes = new_figure(10.5, 6.5, 2, 3, sharex=True, sharey=True)
    for axis, name in zip(np.ravel(axes), names, strict=True):
        for k, model in enumerate(models):
            for drive, style in zip(DRIVES, ("-", "--"), strict=True):
                line = [r for r in rows if (r["problem"], r["model"], r["drive"]) == (name, model, drive)]
                # What is exact to rounding is drawn at the bottom.
                axis.loglog(
                    [r[across] for r in line], [max(r["error [m]"], 1e-9) for r in line], style,
                    color=f"C{k}", marker=".", markersize=4, linewidth=1.1, label=f"{model}, {drive}",
                )  # fmt: skip
        axis.set_title(name, fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("h [s]" if across == "h [s]" else "run time [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("error of positions [m]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    return figure


def _scene(position: Any, velocity: Any = 0.0, extra: Any = None, walls: Any = (), **settings: Any) -> Scene:
    """Return people in a large room who all aim along x, or elsewhere with `extra` directions added."""
    settings = {"mass": MASS, "radius": RADIUS, "tau": TAU, "speed": SPEED, **settings}
    crowd = make_crowd(position, velocity, **settings)
    if extra is not None:
        crowd.extra_direction[:] = extra
    return Scene(BOUNDS, room(BOUNDS, walls), one_direction(BOUNDS), crowd)


def _free_walk(shift: float) -> Scene:
    return _scene([[-5.0 + shift, 0.0]])


def _free_walk_end(plugin: str, parameters: dict[str, Any], shift: float) -> FloatArray:
    duration = 2.0
    if parameters.get("variant") == "overdamped":
        return np.array([[-5.0 + shift + SPEED * duration, 0.0]])
    walked_length = SPEED * (duration - TAU * (1.0 - math.exp(-duration / TAU)))
    return np.array([[-5.0 + shift + walked_length, 0.0]])


#: The wall hit of the paper's fig. 2: relaxation so slow that there is no drive.
NO_DRIVE = 1e12
HIT_SPEED = math.sqrt(0.5)


def _wall_hit(shift: float) -> Scene:
    return _scene([[0.0, 0.5 + shift]], [[HIT_SPEED, -HIT_SPEED]], walls=[[-7.0, 0.0, 7.0, 0.0]], tau=NO_DRIVE)


def _wall_hit_end(plugin: str, parameters: dict[str, Any], shift: float) -> FloatArray:
    duration = 0.8
    if parameters.get("variant") == "overdamped":  # walks on as it wants, along the wall
        return np.array([[SPEED * duration, 0.5 + shift]])
    left = duration - (0.5 + shift - RADIUS) / HIT_SPEED
    if plugin == "dem":  # half a period of the spring, and back as fast as it came
        back = HIT_SPEED * (left - math.pi * math.sqrt(MASS / parameters["stiffness"]))
    else:
        spring = parameters.get("normal_dissipation", 0.0) / 2.0
        back = max(0.0, (spring - MASS) / (spring + MASS)) * HIT_SPEED * left
    return np.array([[HIT_SPEED * duration, RADIUS + back]])


def _pair(shift: float, offset: float) -> Scene:
    return _scene([[-1.0 + shift, 0.0], [1.0, offset]], [[SPEED, 0.0], [-SPEED, 0.0]], [[0.0, 0.0], [-2.0, 0.0]])


def _line(shift: float) -> Scene:
    return _scene(
        [[-0.6 - shift, 0.0], [0.0, 0.0], [2 * RADIUS, 0.0]], [[SPEED, 0.0], [0.0, 0.0], [0.0, 0.0]], tau=NO_DRIVE
    )


def _corridor(shift: float) -> Scene:
    """Return twelve people who press into a corridor 1.1 m wide."""
    places = np.array([[-0.55 * k - 0.8, 0.52 * j + 0.05 * (k % 2)] for k in range(4) for j in (-1, 0, 1)])
    places[:, 0] += shift
    walls = [[0.0, 0.55, 7.0, 0.55], [0.0, -0.55, 7.0, -0.55], [0.0, 0.55, 0.0, 5.0], [0.0, -5.0, 0.0, -0.55]]
    aim = np.column_stack([np.zeros(12), -0.6 * places[:, 1]])
    speed = 1.2 + 0.05 * np.arange(12)
    return _scene(places, 0.0, aim, walls, speed=speed)


PROBLEMS = (
    Problem("free walk", 2.0, _free_walk, _free_walk_end, frozenset({("nsm2", "exponential")})),
    Problem("wall hit", 0.8, _wall_hit, _wall_hit_end),
    Problem("head-on pair", 1.2, lambda shift: _pair(shift, 0.0)),
    Problem("oblique pair", 1.2, lambda shift: _pair(shift, 0.2)),
    Problem("three in line", 0.8, _line),
    Problem("corridor", 0.8, _corridor),
)
