"""Evidence of accuracy: work and precision, all alternatives in one run on the same problems."""

from evac.evidence.accuracy import (
    egress,
    fields,
    headroom,
    overlap,
    peer,
    rows,
    solvers,
    targets,
    tolerance,
    trajectories,
)
from evac.evidence.report import Evidence

#: The parts in the order of the page.
PARTS = (
    solvers,
    targets,
    headroom,
    rows,
    peer,
    trajectories,
    overlap,
    fields,
    egress,
    tolerance,
)


def run(evidence: Evidence) -> None:
    """Compute all parts and write the page."""
    evidence.text(
        """What each alternative costs for the error it leaves: contact solvers, steps and integrators, contact models,
        grids of travel times, egress statistics; and the rule by which `evac run --tolerance` chooses."""
    )
    for part in PARTS:
        part.run(evidence)
    evidence.write_page("Accuracy: error against run time")
