"""The verdicts that reports show are those of the committed evidence."""

from evac.evidence.command import COMMITTED, shown_in_reports
from evac.report.verification import evidence


def test_installed_verdicts_equal_the_committed_ones():
    # `evac evidence KIND --page-only --out docs/evidence` writes them again.
    assert evidence() == shown_in_reports(COMMITTED)
