"""Accuracy, part e: the rule of `evac run --tolerance`, checked on scenes that were not used to derive it."""

import time
from typing import Any

import numpy as np

from evac.arrays import FloatArray
from evac.evidence.accuracy.data import STYLES
from evac.evidence.models import MODELS, model_overrides
from evac.evidence.report import MODEL_COLOURS, Evidence, new_figure
from evac.evidence.verdicts import all_of
from evac.scenario.case import Case
from evac.scenario.loading import load_case
from evac.scenario.tolerance import ERROR_PER_PATH, LONGEST, RELAXATION, SHORTEST, SOLVER_SHARE, settings_for
from evac.simulation import Simulation

#: The checked cases and when [s]: people meet each other, walls, posts and desks; later they begin to jam.
CASES = (("square_room", 0.75), ("square_room", 1.5), ("classroom", 0.75), ("classroom", 1.5))

#: The reference's step is the smallest one divided by this.
FINER = 8


SECTION = "e. The rule of --tolerance, on scenes it was not found on"


def run(evidence: Evidence) -> None:
    """Add part e to the page."""
    tolerances = (1e-2, 3e-3) if evidence.quick else (1e-2, 3e-3, 1e-3)
    cases = CASES[:2] if evidence.quick else CASES
    rows = evidence.measured(
        "tolerance",
        lambda: [
            row for name, duration in cases for model in MODELS for row in _check(name, duration, model, tolerances)
        ],
    )
    judge(evidence, rows)
    evidence.heading(SECTION)
    evidence.text(
        f"""`evac run --tolerance` takes the step h = tolerance / ({ERROR_PER_PATH:g} v), v the greatest speed that
        somebody wants or starts with, at most {LONGEST:g} s and shortened to a divisor of the tick; steps below
        {SHORTEST:g} s are refused. A model's own tolerances become {SOLVER_SHARE:g} of the tolerance for gaps [m], and
        {SOLVER_SHARE:g} of it per {RELAXATION:g} s for velocities [m/s], at most the default."""
    )
    evidence.text(
        f"""Here the rule is applied to shipped cases that part b does not use. The error is the distance to the
        positions at a step, and at tolerances of the solver, {FINER} times smaller than the smallest, for everybody
        still inside at the end. The rule controls the error of the step, not what a crowd in contact makes of it:
        small differences grow there from collision to collision."""
    )
    caption = "Full: median error, dashed: greatest; the rule holds below the black line."
    evidence.plot("tolerance", lambda: draw(rows), caption)
    evidence.data("tolerance", rows, "Errors of positions [mm] over the tolerance")


def judge(evidence: Evidence, rows: list[dict[str, Any]]) -> None:
    """Add the verdicts: runs in which everybody is within the tolerance, and people who are."""
    kept = [row["greatest error [mm]"] <= row["tolerance [mm]"] for row in rows]
    evidence.verdict(all_of("Runs in which everybody keeps the tolerance", sum(kept), len(kept), SECTION))
    people = sum(row["people"] for row in rows)
    within = round(sum(row["share within"] * row["people"] for row in rows))
    evidence.verdict(all_of("People within the tolerance, all runs", within, people, SECTION))


def _check(name: str, duration: float, model: str, tolerances: tuple[float, ...]) -> list[dict[str, Any]]:
    """Return a row per tolerance."""
    case = load_case(name).change(model_overrides(model) | {"output.animation": False, "output.picture": False})
    finest = settings_for(case, tolerances[-1])
    exact = finest | {"simulation.step": finest["simulation.step"] / FINER}
    exact |= {key: value / FINER for key, value in finest.items() if key.endswith("tolerance")}
    truth, inside, _ = walked(case.change(exact), duration)
    rows = []
    for tolerance in tolerances:
        chosen = settings_for(case, tolerance)
        places, still, span = walked(case.change(chosen), duration)
        both = inside & still
        error = np.hypot(*(places - truth)[both].T)
        rows.append(
            {
                "case": name,
                "until [s]": duration,
                "model": model,
                "tolerance [mm]": 1e3 * tolerance,
                "h [s]": chosen["simulation.step"],
                "median error [mm]": 1e3 * float(np.median(error)),
                "greatest error [mm]": 1e3 * float(error.max()),
                "share within": float(np.mean(error <= tolerance)),
                "people": int(both.sum()),
                "time [s]": span,
            }
        )
    return rows


def walked(case: Case, duration: float) -> tuple[FloatArray, np.ndarray, float]:
    """Return positions (n, 2) [m], who is inside, and the CPU time of the ticks [s] after `duration` seconds."""
    simulation = Simulation(case)
    simulation.recording.recorders = []
    start = time.process_time()
    while simulation.time < duration - 1e-9 and not simulation.ended:
        simulation.advance_tick()
    crowd = simulation.population.crowd
    return crowd.position.copy(), crowd.level >= 0, time.process_time() - start


def draw(rows: list[dict[str, Any]]) -> Any:
    """Draw error over tolerance, a panel per case."""
    cases = list(dict.fromkeys((row["case"], row["until [s]"]) for row in rows))
    figure, axes = new_figure(3.4 * len(cases) + 1.0, 4.2, 1, len(cases), sharey=True, squeeze=False)
    for axis, case in zip(axes[0], cases, strict=True):
        for model, (marker, size, width) in zip(MODELS, STYLES, strict=False):
            line = [row for row in rows if (row["case"], row["until [s]"]) == case and row["model"] == model]
            across = [row["tolerance [mm]"] for row in line]
            for key, style in (("median error [mm]", "-"), ("greatest error [mm]", "--")):
                axis.loglog(
                    across, [row[key] for row in line], style, color=MODEL_COLOURS[model], marker=marker,
                    markersize=size, markerfacecolor="none", linewidth=width, label=f"{model}, {key[:-11]}",
                )  # fmt: skip
        axis.loglog(across, across, color="black", linewidth=1.0)
        axis.set_title("{}, {:g} s".format(*case), fontsize=9)
        axis.set_xlabel("tolerance [mm]")
    axes[0, 0].set_ylabel("error of positions [mm]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(MODELS), fontsize=8)
    return figure
