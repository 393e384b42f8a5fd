"""Accuracy, part a: the fastest solver to a goal, by residual and by true error, and the relation of the two."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from evac.evidence.accuracy.reference import PRECISION
from evac.evidence.evidence import Row

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
            found = {solver: time_to(lines[solver, start], goal, measure) for solver in solvers}
            times = {solver: time for solver, time in found.items() if time is not None}
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
