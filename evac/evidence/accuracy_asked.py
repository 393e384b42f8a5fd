"""Accuracy, part a: what was asked of the default solver, on several crowds: one alone is chance by a factor of two."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from evac.evidence.accuracy_problems import LAWS, ContactProblem, Law, contact_problem, default_solver, snapshots
from evac.evidence.accuracy_solvers import affordable, median_solve
from evac.evidence.report import Evidence, claim
from evac.registry import Registry

PEOPLE = 4_000

#: Crowds, of the seeds from that of the evidence on.
CROWDS = 5

#: From a cold start, on a kind of crowd under a law to a residual: the least ratio of a solver's time to the default's.
LEAST_RATIOS: tuple[tuple[str, Law, float, str, float], ...] = (
    ("settled", LAWS[0], 1e-6, "gauss_seidel", 30.0),
    ("settled", LAWS[0], 1e-6, "uzawa", 60.0),
    ("arriving", LAWS[0], 1e-4, "gauss_seidel", 10.0),
    *(("settled", law, 1e-6, "gauss_seidel", 30.0) for law in LAWS[1:]),
)

#: And the longest that the default may take to a small residual on a settled crowd under NSM1 [m], [ms].
SMALL, LONGEST = 1e-10, 300.0

#: A solver is given so long for one solve; one that does not get there counts for as long as it was given [s].
CAP = 5.0


def run(evidence: Evidence) -> None:
    """Measure and add the table to the page; not in a quick run, for it takes minutes."""
    if evidence.quick:
        return
    registry = Registry()
    default = default_solver(registry)
    ratios: list[list[float]] = [[] for _ in LEAST_RATIOS]
    smalls: list[float] = []
    for seed in range(evidence.seed, evidence.seed + CROWDS):
        crowds = snapshots(PEOPLE, seed, registry)
        for found, (kind, law, goal, solver, _) in zip(ratios, LEAST_RATIOS, strict=True):
            problem = contact_problem(crowds[kind], law, registry)
            found.append(seconds_to(problem, solver, goal) / seconds_to(problem, default, goal))
        smalls.append(1e3 * seconds_to(contact_problem(crowds["settled"], LAWS[0], registry), default, SMALL))
    rows = [
        _row(f"{kind}, {law.label}, to {goal:g} {law.unit}: {solver} / {default}", "at least", asked, found)
        for found, (kind, law, goal, solver, asked) in zip(ratios, LEAST_RATIOS, strict=True)
    ]
    rows.append(_row(f"settled, {LAWS[0].label}, to {SMALL:g} m: {default} [ms]", "at most", LONGEST, smalls))
    evidence.table(
        "solvers_asked",
        rows,
        f"What was asked of the default solver from a cold start, on {PEOPLE} people: times of others over its own, on"
        f" {CROWDS} crowds of different seeds. Measured is the median; which crowd it is makes up to a factor of two.",
    )


def seconds_to(problem: ContactProblem, solver: str, goal: float) -> float:
    """Return the time of a cold solve to a residual in the unit of the law, or as long as the solver was given [s]."""
    limit = affordable(problem, solver, CAP)
    return median_solve(problem, solver, False, goal / problem.law.scale, limit)[0]


def _row(what: str, bound: str, asked: float, found: Sequence[float]) -> dict[str, Any]:
    return {**claim(what, bound, asked, float(np.median(found))), "least": min(found), "greatest": max(found)}
