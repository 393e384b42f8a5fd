"""Evidence of accuracy: work and precision, all alternatives in one run on the same problems."""

from evac.evidence.accuracy import overlap, peer, siconos, solvers, targets, trajectories
from evac.evidence.evidence import Evidence


def run(evidence: Evidence) -> None:
    """Measure all parts and write the page."""
    solvers.run(evidence)
    targets.run(evidence)
    targets.run_rows(evidence)
    for part in (peer, siconos, trajectories, overlap):
        part.run(evidence)
    evidence.write_page(__name__)
