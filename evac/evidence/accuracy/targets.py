"""Accuracy, part a: targets of the default solver, on several crowds, since single crowds vary by a factor of two.

And all solvers on a crowd in rows, by residual only, since the reference is not precise enough there.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from evac.evidence.accuracy.problems import LAWS, ContactProblem, contact_problem, default_solver, door_crowd, snapshots
from evac.evidence.accuracy.solvers import affordable, median_solve
from evac.evidence.evidence import Evidence, Row
from evac.evidence.scenes import COARSE, plugins
from evac.evidence.verdicts import MET, all_of, at_least, at_most

#: Numbers of people; the one of a quick run, of people in rows.
PEOPLE, QUICK_PEOPLE = 4_000, 100

#: Number of crowds, with consecutive seeds from that of the evidence on.
CROWDS = 5

#: Under every law, cold, on a kind of crowd to a residual: the least ratio of a solver's time to the default's.
LEAST_RATIOS = (
    ("settled", 1e-6, "gauss_seidel", 30.0),
    ("settled", 1e-6, "uzawa", 60.0),
    ("arriving", 1e-4, "gauss_seidel", 10.0),
)

#: And the longest that the default may take to a small residual on a settled crowd [ms].
SMALL, LONGEST = 1e-10, 300.0

#: Time limit of one solve, which also counts as the time of a solve that does not reach the goal [s].
CAP = 5.0

#: Residuals to which people in rows are solved, in the unit of the law.
GOALS = (1e-4, 1e-6)

ROWS = "Crowds in rows"
SECTION = "Targets of the default solver"


def run(evidence: Evidence) -> None:
    """Add the table to the page, except in a quick run, since it takes minutes."""
    if evidence.quick:
        return
    rows = evidence.measured("solvers_targets", _rows, evidence.seed)
    evidence.verdict(all_of(SECTION, sum(row["verdict"] == MET for row in rows), len(rows), SECTION))
    evidence.show("targets", __name__, rows=rows)


def _rows(first_seed: int) -> list[Row]:
    default = default_solver()
    measured: dict[tuple[str, str, float], list[float]] = {}
    for seed in range(first_seed, first_seed + CROWDS):
        crowds = snapshots(PEOPLE, seed)
        for law in LAWS:
            problems = {kind: contact_problem(crowds[kind], law) for kind in ("settled", "arriving")}
            for kind, goal, solver, least in LEAST_RATIOS:
                problem = problems[kind]
                ratio = seconds_to(problem, solver, goal) / seconds_to(problem, default, goal)
                what = f"{kind}, {law.label}, to {goal:g} {law.unit}: {solver} / {default}"
                measured.setdefault((what, "at least", least), []).append(ratio)
            what = f"settled, {law.label}, to {SMALL:g} {law.unit}: {default} [ms]"
            span = 1e3 * seconds_to(problems["settled"], default, SMALL)
            measured.setdefault((what, "at most", LONGEST), []).append(span)
    return [_row(*target, ratios) for target, ratios in measured.items()]


def seconds_to(problem: ContactProblem, solver: str, goal: float) -> float:
    """Return the time of a cold solve to a residual in the unit of the law, or the time limit [s]."""
    limit = affordable(problem, solver, CAP)
    return median_solve(problem, solver, False, goal / problem.law.scale, limit)[0]


def _row(what: str, side: str, bound: float, ratios: Sequence[float]) -> Row:
    median = float(np.median(ratios))
    finding = (at_least if side == "at least" else at_most)(what, median, bound)
    return {
        "what": what,
        "wanted": finding["wanted"],
        "measured": median,
        "verdict": finding["verdict"],
        "least": min(ratios),
        "greatest": max(ratios),
    }


def run_rows(evidence: Evidence) -> None:
    """Add every solver under every law on people in rows who close up to the page."""
    people = QUICK_PEOPLE if evidence.quick else PEOPLE
    rows = evidence.measured("solvers_rows", _in_rows, people, evidence.seed)
    ahead = sum(row["first"] == default_solver() for row in rows)
    evidence.verdict(all_of("Default solver is the first on crowds in rows", ahead, len(rows), ROWS))
    evidence.show("rows", __name__, people=people, rows=rows)


def _in_rows(people: int, seed: int) -> Iterator[Row]:
    crowd = door_crowd("in rows", people, seed, plugins().get("contact_model", "nsm1")(**COARSE))
    for law in LAWS:
        problem = contact_problem(crowd, law)
        for goal in GOALS:
            spans = {solver: seconds_to(problem, solver, goal) for solver in plugins().solvers}
            shown = {
                solver: f"> {1e3 * CAP:.3g}" if span > 0.9 * CAP else f"{1e3 * span:.3g}"
                for solver, span in spans.items()
            }
            first = min(spans, key=spans.__getitem__)
            yield {"law": law.label, "contacts": problem.size, "to": f"{goal:g} {law.unit}", **shown, "first": first}
