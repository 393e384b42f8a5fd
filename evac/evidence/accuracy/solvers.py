"""Accuracy, part a: contact solvers on crowds at a door, error against run time, and the fastest to a goal."""

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.evidence.accuracy.problems import (
    KINDS,
    LAWS,
    ContactProblem,
    contact_problem,
    default_solver,
    snapshots,
    velocity_error,
)
from evac.evidence.accuracy.reference import PRECISION
from evac.evidence.evidence import Evidence, Row, new_figure, reference_time
from evac.evidence.scenes import plugins
from evac.evidence.verdicts import all_of, reported

STARTS = ("cold", "warm")

#: Measures of a solve: the residual, on which solvers stop, and the true error.
MEASURES = ("residual", "error")

#: Goals that the page compares, in the unit of the law.
GOALS = (1e-4, 1e-6, 1e-10)
WIN_GOALS = (1e-4, 1e-6, 1e-8)

#: Errors below this multiple of the reference's precision are not attributed to the solver.
CLEAR = 100.0

#: Name of the reference among the solvers of the rows.
REFERENCE = "clarabel"


def solvers_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of the solvers that rows are about, in their order, without the reference."""
    return [name for name in dict.fromkeys(row["solver"] for row in rows) if name != REFERENCE]


def time_to(rows: Sequence[Row], goal: float, measure: str = "residual", **where: Any) -> float | None:
    """Return the time [s] after which residual or error is at most a goal, None if it is never reached.

    Rows are solves to decreasing tolerances. The time at which the goal was passed is interpolated logarithmically
    between the first solve beyond the goal and the one before it, so that a solver that iterates beyond its tolerance
    has neither an advantage nor a disadvantage.
    """
    before: tuple[float, float] | None = None
    for row in rows:
        if any(row[key] != value for key, value in where.items()):
            continue
        span, left = float(row["time [s]"]), max(float(row[measure]), 1e-300)
        if left > goal:
            before = span, left
        elif before is None:
            return span
        else:
            share = math.log(before[1] / goal) / math.log(before[1] / left)
            return float(before[0] * (span / before[0]) ** share)
    return None


def problems_of(rows: Sequence[Row]) -> list[Row]:
    """Return the keys of all problems in their order."""
    keys = dict.fromkeys((row["people"], row["crowd"], row["law"]) for row in rows)
    return [{"people": people, "crowd": crowd, "law": law} for people, crowd, law in keys]


def lines_of(rows: Sequence[Row], where: dict[str, Any]) -> dict[tuple[str, str], list[Row]]:
    """Return the solves of one problem by solver and start."""
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if all(row[key] == value for key, value in where.items()):
            lines.setdefault((row["solver"], row["start"]), []).append(row)
    return lines


def race_rows(rows: Sequence[Row], default: str) -> Iterator[Row]:
    """Return a row per problem, start, measure and goal: the fastest solver, and the default's time over its time."""
    solvers = solvers_of(rows)
    for where in problems_of(rows):
        lines = lines_of(rows, where)
        for start, measure, goal in itertools.product(STARTS, MEASURES, WIN_GOALS):
            reached = {solver: time_to(lines[solver, start], goal, measure) for solver in solvers}
            times = {solver: time for solver, time in reached.items() if time is not None}
            if times:
                first = min(times, key=lambda solver: times[solver])
                share = times[default] / times[first] if default in times else None
                head = {**where, "start": start, "by": measure, "goal": goal}
                yield {**head, "first": first, f"{default} / first": share}


def win_rows(races: Sequence[Row], solvers: Sequence[str], default: str) -> Iterator[Row]:
    """Return a row per start, measure and goal: problems on which each solver is fastest, and the default's loss."""
    for start, measure, goal in dict.fromkeys((race["start"], race["by"], race["goal"]) for race in races):
        here = [race for race in races if (race["start"], race["by"], race["goal"]) == (start, measure, goal)]
        shares = [race[f"{default} / first"] for race in here]
        reached = [share for share in shares if share is not None]
        yield {
            "start": start,
            "by": measure,
            "to": f"{goal:.0e}",
            "problems": len(here),
            **{solver: sum(race["first"] == solver for race in here) for solver in solvers},
            f"{default} / first: median": float(np.median(reached)) if reached else None,
            "greatest": max(reached, default=None),
            "never there": len(shares) - len(reached),
        }


def factor_rows(rows: Sequence[Row], scales: dict[str, float]) -> Iterator[Row]:
    """Return a row per problem: the ratio of the true error to the residual, over all solves.

    ``scales`` are those of the laws: errors below the precision of the reference are left out.
    """
    for where in problems_of(rows):
        floor = CLEAR * PRECISION * scales[where["law"]]
        here = [
            row["error"] / row["residual"]
            for line in lines_of(rows, where).values()
            for row in line
            if row["error"] is not None and row["error"] > floor and row["residual"] > 0.0
        ]
        if here:
            yield {
                **where,
                "solves": len(here),
                "error / residual: median": float(np.median(here)),
                "least": min(here),
                "greatest": max(here),
            }


def goal_rows(rows: Sequence[Row]) -> Iterator[Row]:
    """Return the table of times to each residual, one column per solver [ms]."""
    solvers = solvers_of(rows)
    for where in problems_of(rows):
        lines = lines_of(rows, where)
        for start in STARTS:
            for goal in GOALS:
                times = {solver: time_to(lines[solver, start], goal) for solver in solvers}
                yield {
                    **where,
                    "contacts": lines[solvers[0], start][0]["contacts"],
                    "start": start,
                    "residual": f"{goal:.0e}",
                    **{solver: None if time is None else 1e3 * time for solver, time in times.items()},
                }


#: Tolerances that solvers stop at, in the unit of the law: m for NSM1, m/s for NSM2.
TOLERANCES = tuple(10.0**-k for k in range(2, 13))

#: Every kind of crowd under every law.
PROBLEMS = tuple((kind, law) for kind in KINDS for law in LAWS)


class Stage(NamedTuple):
    """Crowds of one size: how long a solver may take for one solve [s], and the tolerances it is given."""

    people: int
    cap: float
    tolerances: tuple[float, ...] = TOLERANCES


QUICK = (Stage(100, 0.02, TOLERANCES[::2]),)
#: The largest crowds are solved to every second power of ten only: minutes.
FULL = (Stage(100, 0.1), Stage(1_000, 0.2), Stage(4_000, 0.6, TOLERANCES[::2]), Stage(10_000, 1.0, TOLERANCES[::2]))

#: A problem on which slow solvers are given longer, so that their ratio can be stated; cap [s].
LONG = {("settled", "NSM1", 4_000, "cold"): 5.0}

SECTION = "a. Contact solvers: error against run time"


def run(evidence: Evidence) -> None:
    """Add part a to the page."""
    stages = QUICK if evidence.quick else FULL
    rows = evidence.measured("solvers", lambda: (row for stage in stages for row in _stage_rows(stage, evidence.seed)))
    default = default_solver()
    races = list(race_rows(rows, default))
    wins = list(win_rows(races, solvers_of(rows), default))
    factors = list(factor_rows(rows, {law.label: law.scale for law in LAWS}))
    _judge(evidence, wins, factors, default)
    evidence.show(
        "solvers", __name__, stages=stages, rows=rows, default=default, races=races, wins=wins, factors=factors
    )


def _judge(evidence: Evidence, wins: Sequence[Row], factors: Sequence[Row], default: str) -> None:
    by_error = [row for row in wins if row["by"] == "error"]
    for start in STARTS:
        here = [row for row in by_error if row["start"] == start]
        first, problems = sum(row[default] for row in here), sum(row["problems"] for row in here)
        evidence.verdict(
            all_of(f"{default} is the first to reach a true error, {start} start", first, problems, SECTION)
        )
    worst = max((row["greatest"] or 0.0 for row in by_error), default=0.0)
    evidence.verdict(reported("Its time divided by that of the first, maximum", f"{worst:.3g}", "1", SECTION))
    medians = [row["error / residual: median"] for row in factors]
    text = f"{min(medians):.2g} to {max(medians):.2g}, at most {max(row['greatest'] for row in factors):.2g}"
    evidence.verdict(reported("True error over residual, median of a problem", text, "-", SECTION))


def _stage_rows(stage: Stage, seed: int) -> Iterator[Row]:
    crowds = snapshots(stage.people, seed)
    for kind, law in PROBLEMS:
        problem = contact_problem(crowds[kind], law)
        start = time.process_time()
        truth = problem.reference()
        duration = time.process_time() - start
        head = {"people": stage.people, "crowd": kind, "law": law.label, "contacts": problem.size, "unit": law.unit}
        row = {"tolerance": None, "time [s]": duration, "iterations": None, "residual": None, "error": None}
        yield {**head, "start": "cold", "solver": REFERENCE, **row, "reference run [s]": reference_time(3)}
        for solver in plugins().solvers:
            for first in STARTS:
                cap = LONG.get((kind, law.label, stage.people, first), stage.cap)
                # Tolerances that are, as velocities, not below the precision of the reference.
                tolerances = tuple(
                    tolerance for tolerance in stage.tolerances if tolerance > 0.99 * PRECISION * law.scale
                )
                for row in measure(problem, truth, solver, first == "warm", cap, tolerances):
                    yield {**head, "start": first, "solver": solver, **row, "reference run [s]": None}


def measure(
    problem: ContactProblem,
    truth: FloatArray,
    solver: str,
    is_warm: bool,
    cap: float,
    tolerances: Sequence[float] = TOLERANCES,
) -> Iterator[Row]:
    """Solve to ever smaller residuals until one is not reached within `cap` seconds; one row each."""
    limit = affordable(problem, solver, cap)
    for tolerance in tolerances:
        duration, iterations, left = median_solve(problem, solver, is_warm, tolerance / problem.law.scale, limit)
        row = {"tolerance": tolerance, "time [s]": duration, "iterations": iterations}
        yield row | {"residual": left * problem.law.scale, "error": velocity_error(problem, truth)}
        if left * problem.law.scale > tolerance:
            break


def affordable(problem: ContactProblem, solver: str, cap: float) -> int:
    """Return the number of iterations that take about `cap` seconds of CPU time; also compiles."""
    few, spans = 20, {}
    for iterations in (few, few, 5 * few):  # the first compiles; what a solve costs before its iterations drops out
        problem.start(False)
        start = time.process_time()
        problem.solve(solver, 0.0, iterations)
        spans[iterations] = time.process_time() - start
    each = max(spans[5 * few] - spans[few], 1e-6) / (4 * few)
    return max(few, int(cap / each))


def median_solve(
    problem: ContactProblem, solver: str, is_warm: bool, tolerance: float, limit: int
) -> tuple[float, int, float]:
    """Return median CPU time of up to five solves [s], iterations and residual; slow solves are made fewer times."""
    spans: list[float] = []
    while len(spans) < 5 and sum(spans) < 0.05:
        problem.start(is_warm)
        start = time.process_time()
        iterations, residual = problem.solve(solver, tolerance, limit)
        spans.append(time.process_time() - start)
    return float(np.median(spans)), iterations, residual


def draw(stage: Stage, rows: Sequence[Row]) -> Any:
    """Draw error over time: a row of panels per law, a column per kind of crowd."""
    width, height = 3.4 * len(KINDS) + 1.2, 2.3 * len(LAWS)
    figure, axes = new_figure(width, height, len(LAWS), len(KINDS), sharex=True, squeeze=False)
    for r, law in enumerate(LAWS):
        for c, kind in enumerate(KINDS):
            axis = axes[r, c]
            where = stage.people, law.label, kind
            here = [row for row in rows if (row["people"], row["law"], row["crowd"]) == where]
            for k, solver in enumerate(solvers_of(rows)):
                for first, style in zip(STARTS, ("-", "--"), strict=True):
                    line = [row for row in here if row["solver"] == solver and row["start"] == first]
                    spans, errors = [1e3 * row["time [s]"] for row in line], [row["error"] for row in line]
                    look = {"color": f"C{k}", "marker": ".", "markersize": 4, "linewidth": 1.1}
                    axis.loglog(spans, errors, style, label=f"{solver}, {first}", **look)
            for row in here:
                if row["solver"] == REFERENCE:
                    axis.axvline(1e3 * row["time [s]"], color="black", linestyle=":", linewidth=1.1, label="Clarabel")
            # The reference cannot tell errors below its own.
            axis.set_ylim(bottom=PRECISION * law.scale)
            axis.set_title(f"{law.label}, {kind}, {here[0]['contacts']} contacts", fontsize=8)
            axis.tick_params(labelsize=7)
        axes[r, 0].set_ylabel(f"error [{here[0]['unit']}]", fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("CPU time of one solve [ms]", fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=7)
    return figure
