"""Accuracy, part a: solvers on a crowd in rows, by residual only, since the reference is not precise enough there."""

from collections.abc import Iterator

from evac.evidence.accuracy.problems import LAWS, contact_problem, default_solver
from evac.evidence.accuracy.snapshots import door_crowd
from evac.evidence.accuracy.targets import CAP, seconds_to
from evac.evidence.evidence import Evidence, Row
from evac.evidence.models import COARSE, plugins
from evac.evidence.verdicts import all_of

#: Residuals, in the unit of the law.
GOALS = (1e-4, 1e-6)

PEOPLE, QUICK_PEOPLE = 4_000, 100


SECTION = "Crowds in rows"


def run(evidence: Evidence) -> None:
    """Add every solver under every law on people in rows who close up to the page."""
    people = QUICK_PEOPLE if evidence.quick else PEOPLE
    rows = evidence.measured("solvers_rows", _rows, people, evidence.seed)
    ahead = sum(row["first"] == default_solver() for row in rows)
    evidence.verdict(all_of("Default solver is the first on crowds in rows", ahead, len(rows), SECTION))
    evidence.show("rows", __name__, people=people, rows=rows)


def _rows(people: int, seed: int) -> Iterator[Row]:
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
