"""Accuracy, part a: contact solvers on crowds at a door, error against run time."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.evidence.accuracy_data import add_data
from evac.evidence.accuracy_problems import (
    KINDS,
    LAWS,
    ContactProblem,
    contact_problem,
    default_solver,
    snapshots,
    velocity_error,
)
from evac.evidence.reference import PRECISION
from evac.evidence.report import Evidence, new_figure, reference_time
from evac.physics.bundles import FloatArray
from evac.physics.solvers import SOLVERS
from evac.registry import Registry

#: What is asked of a solver, in the unit of the law: m for NSM1, m/s for NSM2.
ASKED = tuple(10.0**-k for k in range(2, 11))

#: What the page compares.
GOALS = (1e-4, 1e-6, 1e-10)
RATIO_GOAL = 1e-6

STARTS = ("cold", "warm")


#: Every kind of crowd under every law.
PROBLEMS = tuple((kind, law) for kind in KINDS for law in LAWS)


@dataclass(frozen=True)
class Stage:
    """Crowds of one size: how long a solver may take for one solve [s], and what is asked of it."""

    people: int
    cap: float
    asked: tuple[float, ...] = ASKED


QUICK = (Stage(100, 0.02, ASKED[::2]),)
#: The largest crowds are asked for every second power of ten only: minutes.
FULL = (Stage(100, 0.1), Stage(1_000, 0.2), Stage(4_000, 0.6, ASKED[::2]), Stage(10_000, 1.0, ASKED[::2]))

#: A problem on which slow solvers are given longer, so that their ratio can be stated; cap [s].
LONG = {("settled", "NSM1", 4_000, "cold"): 5.0}


def run(evidence: Evidence) -> None:
    """Compute part a and add it to the page."""
    registry = Registry()
    default = default_solver(registry)
    evidence.heading("a. Contact solvers: error against run time")
    evidence.text(
        f"""Each problem is what a contact model solves in the sixth of its steps (h = 0.01 s) from a snapshot of a
        crowd at a 1 m door: arriving, settled against the closed door, and 0.05 s after it opens. Cold starts from
        no percussions, warm from those of the step before. The error is the greatest distance of the velocities
        found from those of an independent interior-point solver (Clarabel, checked to {PRECISION:g} m/s): times h, in
        metres, for NSM1, in m/s for NSM2. The residual that solvers stop at has the same units."""
    )
    evidence.text(
        """uzawa is the paper's solver: all percussions step along their gradient by 0.95 of the greatest fixed length.
        accelerated_gradient steps each by its own length and goes on along the last step (Nesterov's momentum).
        gauss_seidel puts one contact right after the other, outwards from the exit. conjugate_sweeps and
        conjugate_faces join sweeps there and back by conjugate gradients, the second on one set of pushing contacts
        at a time. accelerated_sweeps is gauss_seidel with Nesterov's momentum."""
    )
    rows: list[dict[str, Any]] = []
    for stage in QUICK if evidence.quick else FULL:
        found = _stage_rows(stage, evidence.seed, registry)
        rows += found
        evidence.plot(
            f"solvers_{stage.people}",
            draw(stage, found),
            f"{stage.people} people: error against the independent reference over the time of one solve, cold (full"
            " lines) and warm (dashed). Crosses: Clarabel. Lines end where the allowed time ends.",
        )
    evidence.table(
        "solvers_default",
        default_rows(rows, default),
        f"The default solver, {default}: time of one solve [ms] to residuals (cold, and warm to 1e-6), and the times of"
        " the others over it to 1e-6, cold: below 1 the default loses; with > where the other did not get there.",
    )
    largest = max(row["people"] for row in rows if row["crowd"] == "opened")
    evidence.finding(default_finding(rows, default), f"solvers_{largest}", f"Solvers on {largest} people")
    add_data(evidence, "solvers_to_goal", goal_rows(rows), "Times [ms] of all solvers to 1e-4, 1e-6 and 1e-10")
    add_data(evidence, "solvers", rows, "All solves, with iterations, residuals and errors")


def _stage_rows(stage: Stage, seed: int, registry: Registry) -> list[dict[str, Any]]:
    """Measure all solvers on all problems of one size."""
    rows = []
    crowds = snapshots(stage.people, seed, registry)
    for kind, law in PROBLEMS:
        problem = contact_problem(crowds[kind], law, registry)
        start = time.perf_counter()
        truth = problem.reference()
        duration = time.perf_counter() - start
        head = {"people": stage.people, "crowd": kind, "law": law.label, "contacts": problem.size, "unit": law.unit}
        rows.append(
            {
                **head,
                "start": "cold",
                "solver": "clarabel",
                "asked": None,
                "time [s]": duration,
                "iterations": None,
                "residual": None,
                "error": None,
                "reference run [s]": reference_time(3),
            }
        )
        for solver in SOLVERS:
            for first in STARTS:
                cap = LONG.get((kind, law.label, stage.people, first), stage.cap)
                for row in measure(problem, truth, solver, first == "warm", cap, stage.asked):
                    rows.append({**head, "start": first, "solver": solver, **row, "reference run [s]": None})
    return rows


def measure(
    problem: ContactProblem, truth: FloatArray, solver: str, is_warm: bool, cap: float, asked: Sequence[float] = ASKED
) -> list[dict[str, Any]]:
    """Solve to ever smaller residuals until one is not reached within `cap` seconds; one row each."""
    limit = affordable(problem, solver, cap)
    rows = []
    for goal in asked:
        duration, iterations, found = median_solve(problem, solver, is_warm, goal / problem.law.scale, limit)
        rows.append(
            {
                "asked": goal,
                "time [s]": duration,
                "iterations": iterations,
                "residual": found * problem.law.scale,
                "error": velocity_error(problem, truth),
            }
        )
        if rows[-1]["residual"] > goal:
            break
    return rows


def affordable(problem: ContactProblem, solver: str, cap: float) -> int:
    """Return the number of iterations that take about `cap` seconds; also compiles."""
    few, spans = 20, {}
    for iterations in (few, few, 5 * few):  # the first compiles; what a solve costs before its iterations drops out
        problem.start(False)
        start = time.perf_counter()
        problem.solve(solver, 0.0, iterations)
        spans[iterations] = time.perf_counter() - start
    each = max(spans[5 * few] - spans[few], 1e-6) / (4 * few)
    return max(few, int(cap / each))


def median_solve(
    problem: ContactProblem, solver: str, is_warm: bool, tolerance: float, limit: int
) -> tuple[float, int, float]:
    """Return median time of up to five solves [s], iterations and residual; slow solves are made fewer times."""
    spans: list[float] = []
    while len(spans) < 5 and sum(spans) < 0.05:
        problem.start(is_warm)
        start = time.perf_counter()
        iterations, found = problem.solve(solver, tolerance, limit)
        spans.append(time.perf_counter() - start)
    return float(np.median(spans)), iterations, found


def time_to(rows: Sequence[dict[str, Any]], goal: float, **where: Any) -> float | None:
    """Return the time [s] of the row that reached a goal, None if none did."""
    for row in rows:
        if row["asked"] == goal and row["residual"] <= goal and all(row[key] == value for key, value in where.items()):
            return float(row["time [s]"])
    return None


def goal_rows(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the table of times to each goal, one column per solver [ms]."""
    table = []
    problems = dict.fromkeys((row["people"], row["crowd"], row["law"], row["contacts"]) for row in rows)
    for people, crowd, law, contacts in problems:
        for first in STARTS:
            for goal in GOALS:
                times = {
                    solver: time_to(rows, goal, people=people, crowd=crowd, law=law, start=first, solver=solver)
                    for solver in SOLVERS
                }
                table.append(
                    {
                        "people": people,
                        "crowd": crowd,
                        "contacts": contacts,
                        "law": law,
                        "start": first,
                        "residual": f"{goal:.0e}",
                        **{solver: None if found is None else 1e3 * found for solver, found in times.items()},
                    }
                )
    return table


def draw(stage: Stage, rows: Sequence[dict[str, Any]]) -> Any:
    """Draw error over time: a row of panels per law, a column per kind of crowd."""
    figure, axes = new_figure(
        3.4 * len(KINDS) + 1.2, 2.3 * len(LAWS), len(LAWS), len(KINDS), sharex=True, squeeze=False
    )
    for r, law in enumerate(LAWS):
        for c, kind in enumerate(KINDS):
            axis = axes[r, c]
            here = [row for row in rows if row["law"] == law.label and row["crowd"] == kind]
            for k, solver in enumerate(SOLVERS):
                for first, style in zip(STARTS, ("-", "--"), strict=True):
                    line = [row for row in here if row["solver"] == solver and row["start"] == first]
                    axis.loglog(
                        [1e3 * row["time [s]"] for row in line],
                        [max(row["error"], 1e-12) for row in line],
                        style,
                        color=f"C{k}",
                        marker=".",
                        markersize=4,
                        linewidth=1.1,
                        label=f"{solver}, {first}",
                    )
            # Clarabel's own error is below the precision it is checked to.
            library = [1e3 * row["time [s]"] for row in here if row["solver"] == "clarabel"]
            axis.loglog(library, [1e-11] * len(library), "x", color="black", label="Clarabel")
            axis.set_title(f"{law.label}, {kind}, {here[0]['contacts']} contacts", fontsize=8)
            axis.tick_params(labelsize=7)
        axes[r, 0].set_ylabel(f"error [{here[0]['unit']}]", fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("time of one solve [ms]", fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=7)
    return figure


def default_rows(rows: Sequence[dict[str, Any]], default: str) -> list[dict[str, Any]]:
    """Return a row per problem: times of the default solver, and those of the others over it."""
    table = []
    for people, crowd, law in dict.fromkeys((row["people"], row["crowd"], row["law"]) for row in rows):
        where = {"people": people, "crowd": crowd, "law": law}
        times = {f"{goal:.0e}": time_to(rows, goal, solver=default, start="cold", **where) for goal in GOALS}
        times["1e-06, warm"] = time_to(rows, RATIO_GOAL, solver=default, start="warm", **where)
        ours = time_to(rows, RATIO_GOAL, solver=default, start="cold", **where)
        row: dict[str, Any] = {**where, **{goal: None if t is None else f"{1e3 * t:.3g}" for goal, t in times.items()}}
        for solver in (*SOLVERS, "clarabel"):
            if solver != default:
                row[f"{solver} / {default}"] = _ratio(rows, solver, ours, where)
        table.append(row)
    return table


def default_finding(rows: Sequence[dict[str, Any]], default: str) -> str:
    """Say in how many problems the default solver is the fastest, and where it loses most."""
    problems = list(dict.fromkeys((row["people"], row["crowd"], row["law"]) for row in rows))
    lost: list[tuple[float, str]] = []
    for people, crowd, law in problems:
        where = {"people": people, "crowd": crowd, "law": law, "start": "cold"}
        found = {solver: time_to(rows, RATIO_GOAL, solver=solver, **where) for solver in SOLVERS}
        times = {solver: time for solver, time in found.items() if time is not None}
        fastest = min(times, key=lambda solver: times[solver])
        if fastest != default:
            share = times[default] / times[fastest] if default in times else np.inf
            lost.append((share, f"{fastest} takes 1/{share:.2g} of its time for {people} people, {crowd}, {law}"))
    words = f"; at worst {max(lost)[1]}" if lost else ""
    return (
        f"The default solver is {default}: of the {len(SOLVERS)} solvers it is the fastest to a residual of"
        f" {RATIO_GOAL:g} from a cold start in {len(problems) - len(lost)} of {len(problems)} problems{words}."
    )


def _ratio(rows: Sequence[dict[str, Any]], solver: str, ours: float | None, where: dict[str, Any]) -> str:
    """Return the time of another solver over that of the default."""
    if ours is None:
        return "-"
    reached = time_to(rows, RATIO_GOAL, solver=solver, start="cold", **where)
    if solver == "clarabel" or reached is None:
        spent = _spent(rows, solver, start="cold", **where)
        return f"{'' if solver == 'clarabel' else '> '}{spent / ours:.2g}"
    return f"{reached / ours:.2g}"


def _spent(rows: Sequence[dict[str, Any]], solver: str, **where: Any) -> float:
    """Return the longest time that a solver was given on a problem [s]."""
    return max(
        float(row["time [s]"])
        for row in rows
        if row["solver"] == solver and all(row[key] == value for key, value in where.items())
    )
