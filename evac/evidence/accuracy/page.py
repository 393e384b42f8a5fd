"""Evidence of accuracy: work and precision, all alternatives in one run on the same problems."""

from evac.evidence.accuracy import fields, overlap, peer, rows, solvers, targets, trajectories
from evac.evidence.evidence import Evidence

#: The parts in the order of the page.
PARTS = (solvers, targets, rows, peer, trajectories, overlap, fields)


def run(evidence: Evidence) -> None:
    """Measure all parts and write the page."""
    for part in PARTS:
        part.run(evidence)
    evidence.write_page(
        "Accuracy: error against run time",
        "Examined: what contact solvers, steps, integrators, contact models and grids cost for the error they leave.",
    )
