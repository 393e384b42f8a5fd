"""Accuracy: comparison with the projection step of cromosim, if that package is installed."""

import importlib.util
import time
from collections.abc import Iterator

import numpy as np

from evac.base.arrays import FloatArray
from evac.evidence.accuracy.problems import STEP, ContactProblem, Law, contact_problem, snapshots, velocity_error
from evac.evidence.evidence import Evidence, Row
from evac.evidence.verdicts import at_least

#: cromosim projects in the Euclidean norm, which is that of inertia where all masses are equal, and of its own model.
INERTIAL = Law("NSM1 inertial, equal masses", "nsm1")
OVERDAMPED = Law("NSM1 overdamped", "nsm1", variant="overdamped")

#: Tolerances of evac [m]: the default and finer ones.
GOALS = tuple(10.0**-k for k in range(4, 11))
REPEATS = 9

#: Target: least ratio of the time of a step of cromosim to that of evac.
LEAST_RATIO = 20

#: Residual of the reference [m/s]: the overdamped problems are harder than those of `LAWS`.
PRECISION = 1e-7

SECTION = "Comparison with cromosim"


def run(evidence: Evidence) -> None:
    """Add one projection of a crowd at a door by cromosim and by evac, on the same problem in the same run."""
    if evidence.page_only:
        is_measured = "cromosim" in evidence.conditions()["versions"]
    else:
        is_measured = importlib.util.find_spec("cromosim") is not None
    if not is_measured:
        return
    rows = evidence.measured("cromosim", _rows, 100 if evidence.quick else 1_000, evidence.seed)
    for law in (INERTIAL, OVERDAMPED):
        least = min(row["cromosim / cold"] for row in rows if row["law"] == law.label)
        evidence.verdict(at_least(f"{law.label}: cromosim's time over evac's, cold", least, LEAST_RATIO, "", SECTION))
    evidence.show("peer", __name__, rows=rows)


def _rows(people: int, seed: int) -> Iterator[Row]:
    for kind, crowd in snapshots(people, seed).items():
        crowd.crowd.mass[:] = crowd.crowd.mass.mean()
        for law in (INERTIAL, OVERDAMPED):
            problem = contact_problem(crowd, law)
            yield {"people": people, "crowd": kind, "law": law.label, **compare(problem)}


def compare(problem: ContactProblem) -> Row:
    """Return contacts, times [ms] and errors [m] of both on one problem."""
    from cromosim import micro

    truth = problem.reference(PRECISION)
    c = problem.size
    contacts = problem.state.contacts
    # Unit vectors of cromosim point to the other person, but away from a wall.
    towards = np.where(contacts.other[:c, None] >= 0, -contacts.normal[:c], contacts.normal[:c])
    table = np.column_stack([contacts.body[:c], contacts.other[:c], contacts.bias[:c] * STEP, towards])
    discs = np.zeros((len(problem.free), 4))
    spans: list[float] = []
    percussions: FloatArray = np.zeros(0)
    for _ in range(REPEATS):
        start = time.perf_counter()
        _, _, percussions, _, _ = micro.projection(STEP, discs, table, problem.free)
        spans.append(time.perf_counter() - start)
    theirs = float(np.median(spans))
    error = STEP * float(np.hypot(*(np.asarray(percussions).reshape(-1, 2) - truth).T).max())
    cold, cold_error = _solved(problem, truth, GOALS[0], is_warm=False)
    warm, warm_error = _solved(problem, truth, GOALS[0], is_warm=True)
    equal, own_error = cold, cold_error
    for goal in GOALS[1:]:
        if own_error > error:
            equal, own_error = _solved(problem, truth, goal, is_warm=False)
    return {
        "contacts": c,
        "cromosim [ms]": 1e3 * theirs,
        "error [mm]": 1e3 * error,
        "evac, cold [ms]": 1e3 * cold,
        "cold: error [mm]": 1e3 * cold_error,
        "cromosim / cold": theirs / cold,
        "evac, warm [ms]": 1e3 * warm,
        "warm: error [mm]": 1e3 * warm_error,
        "cromosim / warm": theirs / warm,
        "evac, as accurate [ms]": 1e3 * equal,
        "cromosim / as accurate": theirs / equal,
    }


def _solved(problem: ContactProblem, truth: FloatArray, goal: float, *, is_warm: bool) -> tuple[float, float]:
    settings = problem.law.make().values()
    spans = []
    for _ in range(REPEATS):
        problem.start(is_warm)
        start = time.perf_counter()
        problem.solve(settings["solver"], goal / STEP, settings["iterations"])
        spans.append(time.perf_counter() - start)
    return float(np.median(spans)), velocity_error(problem, truth)
