"""Accuracy, part b: whole trajectories against the step, for each contact model and integrator of the drive."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import ScenarioError
from evac.case.schema import SimulationSettings
from evac.evidence.evidence import MODEL_COLOURS, Evidence, Row, new_figure
from evac.evidence.scenes import Scene, plugins
from evac.evidence.verdicts import all_of, at_most, reported
from evac.physics.contact.model import ContactModel
from evac.physics.scenes import one_direction, room
from evac.physics.state import make_crowd

DRIVES = ("exponential", "explicit")

#: Marker, marker size and line width of each line, such that lines on top of each other remain visible.
STYLES = (("o", 9.0, 4.0), ("s", 6.5, 2.6), ("^", 5.5, 1.8), ("D", 4.0, 1.3), (".", 4.0, 0.8))

#: Errors below this are due to solver and rounding, not to the step [m].
EXACT = 1e-8

#: Orders that differ by no more than this count as equal.
CLOSE = 0.3


def order_of(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Return the measured order of convergence: the slope of log error over log step, least squares."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def colour_of(variant: str) -> str:
    """Return the colour of the contact model that a label such as ``"NSM2, K_N = 0"`` begins with."""
    return next(colour for model, colour in MODEL_COLOURS.items() if variant.startswith(model))


def order_rows(rows: Sequence[Row]) -> Iterator[Row]:
    """Return measured and theoretical orders of every problem, model and drive."""
    for name, model, drive in dict.fromkeys((row["problem"], row["model"], row["drive"]) for row in rows):
        here = [row for row in rows if (row["problem"], row["model"], row["drive"]) == (name, model, drive)]
        small = [row for row in here if row["error [m]"] > EXACT][-5:]
        at = [row["error [m]"] for row in here if math.isclose(row["h [s]"], 0.01)]
        yield {
            "problem": name,
            "model": model,
            "drive": drive,
            "theory": here[0]["theory"],
            "measured order": _slope(small) if len(small) > 2 else None,
            "over the last halving": _slope(small[-2:]) if len(small) > 2 else None,
            "error at h = 0.01 s [mm]": 1e3 * at[0] if at else None,
            "greatest error / (v h), h <= 0.01 s": max(r["error / (v h)"] for r in here if r["h [s]"] < 0.0101),
        }


def _slope(rows: Sequence[Row]) -> float:
    return order_of([row["h [s]"] for row in rows], [row["error [m]"] for row in rows])


def orders_off(table: Sequence[Row]) -> list[Row]:
    """Return the rows whose measured orders are not the theoretical ones."""
    known = [row for row in table if row["measured order"] is not None]
    return [row for row in known if abs(row["measured order"] - row["theory"]) > CLOSE]


def drives_compared(rows: Sequence[Row]) -> tuple[int, int]:
    """Return the number of problems and models with a smaller error of the exponential drive at the default step.

    The second number counts all whose error depends on the drive.
    """
    step = min({row["h [s]"] for row in rows}, key=lambda h: abs(h - SimulationSettings().step))
    errors: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row["h [s]"] == step:
            errors.setdefault((row["problem"], row["model"]), {})[row["drive"]] = row["error [m]"]
    pairs = [pair for pair in errors.values() if differ(pair)]
    return sum(pair["explicit"] > pair["exponential"] for pair in pairs), len(pairs)


def differ(pair: dict[str, float]) -> bool:
    """Return whether both drives were run, and their errors differ by more than rounding."""
    return len(pair) == 2 and abs(pair["explicit"] - pair["exponential"]) > 1e-3 * max(pair.values()) + 1e-9


def draw(rows: Sequence[Row], across: str) -> Any:
    """Draw the errors of every problem over a column of the rows; those of rounding are named, not drawn."""
    names = list(dict.fromkeys(row["problem"] for row in rows))
    models = list(dict.fromkeys(row["model"] for row in rows))
    figure, axes = new_figure(11.0, 7.5, 2, 3, sharex=True, sharey=True)
    handles = {}
    for axis, name in zip(np.ravel(axes), names, strict=False):
        exact = []
        for model, (marker, size, width) in zip(models, STYLES, strict=False):
            here = [row for row in rows if (row["problem"], row["model"]) == (name, model)]
            if max(row["error [m]"] for row in here) <= EXACT:
                exact.append(model)
            for drive, style in zip(DRIVES, ("-", "--"), strict=True):
                line = [row for row in here if row["drive"] == drive and row["error [m]"] > EXACT]
                (drawn,) = axis.loglog(
                    [row[across] for row in line], [row["error [m]"] for row in line], style,
                    color=colour_of(model), marker=marker, markersize=size, markerfacecolor="none", linewidth=width,
                )  # fmt: skip
                handles[f"{model}, {drive}"] = drawn
        handles["rounding"] = axis.axhline(EXACT, color="0.6", linewidth=1.0, linestyle=":")
        if exact:
            axis.annotate("exact: " + ", ".join(exact), (0.02, 0.02), xycoords="axes fraction", fontsize=7, va="bottom")
        axis.set_title(name, fontsize=9)
    axes[0, 0].set_ylim(bottom=0.1 * EXACT)
    for axis in axes[-1]:
        axis.set_xlabel("h [s]" if across == "h [s]" else "CPU time [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("error of positions [m]")
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=8)
    return figure


#: Bound of the error of positions over the path of a step, v h, for steps of at most 0.01 s.
ERROR_PER_PATH = 2.5

#: Contacts are solved to rounding precision, so that only the error of the step remains.
SOLVED = {"velocity_tolerance": 1e-11, "iterations": 20_000}

#: Label, plugin and parameters.
VARIANTS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("DEM", "dem", {"stiffness": 1.2e5}),
    ("NSM1 inertial", "nsm1", {**SOLVED, "gap_tolerance": 1e-12}),
    ("NSM1 overdamped", "nsm1", {**SOLVED, "gap_tolerance": 1e-12, "variant": "overdamped"}),
    ("NSM2, K_N = 0", "nsm2", {**SOLVED, "normal_dissipation": 0.0}),
    ("NSM2, K_N = 1e5", "nsm2", {**SOLVED, "normal_dissipation": 1e5}),
)

#: Mass, radius, relaxation time and speed of the people here.
MASS, RADIUS, TAU, SPEED = 80.0, 0.22, 0.5, 1.5

LARGEST = 0.04  # s

#: Number of start positions of each problem (quick, full), spread over the distance that two people approach in a
#: step [m], because the time of a contact within a step is random. Golden section fractions are used, since rational
#: fractions would be multiples of small steps, so that all starts would be equivalent.
PHASES = 4, 64
SPREAD = 2.0 * SPEED * LARGEST
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)

BOUNDS = (-8.0, -6.0, 8.0, 6.0)


class Motion(NamedTuple):
    """A motion with a known or converging end."""

    name: str
    duration: float  # [s]
    scene: Callable[[float], Scene]  # scene by shift [m]
    # positions (n, 2) at the end by (plugin, parameters, shift); None: computed with the smallest step
    exact: Callable[[str, dict[str, Any], float], FloatArray] | None = None
    # frozenset of (model, drive): where theory promises order 2; elsewhere order 1
    second_order: frozenset[tuple[str, str]] = frozenset()


SECTION = "b. Trajectories: error against the step"


def run(evidence: Evidence) -> None:
    """Add part b to the page."""
    finest = LARGEST / 2 ** (8 if evidence.quick else 10)
    shifts = shifts_of(PHASES[0] if evidence.quick else PHASES[1])
    rows = evidence.measured("trajectories", _rows, shifts, 4 if evidence.quick else 7, finest)
    orders = list(order_rows(rows))
    off = orders_off(orders)
    known = sum(row["measured order"] is not None for row in orders)
    question = f"Orders of convergence within {CLOSE:g} of the theoretical ones"
    evidence.verdict(all_of(question, known - len(off), known, SECTION))
    worst = max(row["error / (v h)"] for row in rows if row["h [s]"] < 0.0101)
    evidence.verdict(at_most("Error divided by the path of a step, h <= 0.01 s", worst, ERROR_PER_PATH, "v h", SECTION))
    better, number = drives_compared(rows)
    question = "Problems in which the default, exponential drive has the smaller error"
    evidence.verdict(reported(question, f"{better} of {number}", "-", SECTION))
    evidence.show("trajectories", __name__, rows=rows, finest=finest, shifts=shifts, known=orders, off=off)


def _rows(shifts: Sequence[float], halvings: int, finest: float) -> list[Row]:
    steps = [LARGEST / 2**k for k in range(halvings)]
    return [
        row
        for problem in PROBLEMS
        for label, plugin, parameters in VARIANTS
        for row in measure(problem, label, plugin, parameters, shifts, steps, finest)
    ]


def shifts_of(number: int) -> list[float]:
    """Return shifts of the start [m], evenly spread over every step."""
    return [SPREAD * math.modf(0.5 + k * GOLDEN)[0] for k in range(number)]


def measure(
    problem: Motion,
    label: str,
    plugin: str,
    parameters: dict[str, Any],
    shifts: Sequence[float],
    steps: Sequence[float],
    finest: float,
) -> Iterator[Row]:
    """Return a row per drive and step: error over all shifts, CPU time."""
    model = plugins().get("contact_model", plugin)(**parameters)
    if problem.exact is not None:
        truths = [problem.exact(plugin, parameters, shift) for shift in shifts]
    else:
        truths = [walked(problem, model, shift, finest, "exponential")[0] for shift in shifts]
    for drive in DRIVES:
        for step in steps:
            try:
                model.check_scene(problem.scene(0.0).border(step, drive == "explicit"))
            except ScenarioError:
                continue
            walks = [walked(problem, model, shift, step, drive) for shift in shifts]
            errors = [np.hypot(*(place - truth).T).max() for (place, _), truth in zip(walks, truths, strict=True)]
            crowd = problem.scene(0.0).crowd
            path = float(max(crowd.speed.max(), np.hypot(*crowd.velocity.T).max())) * step
            error = math.sqrt(float(np.mean(np.square(errors))))
            yield {
                "problem": problem.name,
                "model": label,
                "drive": drive,
                "h [s]": step,
                "error [m]": error,
                "error / (v h)": error / path,
                "worst start / (v h)": float(max(errors)) / path,
                "time [s]": float(np.median([span for _, span in walks])),
                "theory": 2 if (label, drive) in problem.second_order else 1,
            }


def walked(problem: Motion, model: ContactModel, shift: float, step: float, drive: str) -> tuple[FloatArray, float]:
    """Return the positions at the end (n, 2) [m] and the CPU time that it took [s]."""
    engine, crowd = problem.scene(shift).start()
    engine.load(model)
    steps = round(problem.duration / step)
    start = time.process_time()
    # Long ticks, so that the order of bodies does not change and the warm start is kept.
    engine.advance(model, crowd, 0, steps, step, drive == "explicit", False)
    return crowd.position, time.process_time() - start


def _scene(position: Any, velocity: Any = 0.0, extra: Any = None, walls: Any = (), **settings: Any) -> Scene:
    """Return people in a large room who all head along x, or elsewhere with `extra` directions added."""
    settings = {"mass": MASS, "radius": RADIUS, "tau": TAU, "speed": SPEED, **settings}
    crowd = make_crowd(position, velocity, **settings)
    if extra is not None:
        crowd.extra_direction[:] = extra
    return Scene(BOUNDS, room(BOUNDS, walls), one_direction(BOUNDS), crowd)


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
    places = np.array([[-0.55 * k - 0.8, 0.52 * j + 0.05 * (k % 2)] for k in range(4) for j in (-1, 0, 1)])
    places[:, 0] += shift
    walls = [[0.0, 0.55, 7.0, 0.55], [0.0, -0.55, 7.0, -0.55], [0.0, 0.55, 0.0, 5.0], [0.0, -5.0, 0.0, -0.55]]
    aim = np.column_stack([np.zeros(12), -0.6 * places[:, 1]])
    speed = 1.2 + 0.05 * np.arange(12)
    return _scene(places, 0.0, aim, walls, speed=speed)


#: DEM's steps are those of the leapfrog method where nobody is accelerated at the start.
LEAPFROG = frozenset({("DEM", "exponential")})
UNDRIVEN = LEAPFROG | {("DEM", "explicit")}
MIDPOINT = frozenset({("NSM2, K_N = 0", "exponential"), ("NSM2, K_N = 1e5", "exponential")})

PROBLEMS = (
    Motion("free walk", 2.0, lambda shift: _scene([[-5.0 + shift, 0.0]]), _free_walk_end, MIDPOINT),
    Motion("wall hit", 0.8, _wall_hit, _wall_hit_end, UNDRIVEN),
    Motion("head-on pair", 1.2, lambda shift: _pair(shift, 0.0), None, LEAPFROG),
    Motion("oblique pair", 1.2, lambda shift: _pair(shift, 0.2), None, LEAPFROG | {("NSM1 inertial", "exponential")}),
    Motion("three in line", 0.8, _line, None, UNDRIVEN),
    Motion("corridor", 0.8, _corridor),
)
