"""The frame of the evidence pages: tables, pages, timings, processes."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from evac.cli import main
from evac.evidence import KINDS
from evac.evidence.command import COMMITTED, run_evidence, shown_in_reports, write_index
from evac.evidence.evidence import Evidence, new_figure
from evac.report.verification import evidence

LEAN, SCALING = "evac.evidence.lean.page", "evac.evidence.scaling.page"
PAGES = Path(__file__).parents[2] / "docs" / "evidence"


def figure_of(number):
    figure, axis = new_figure()
    axis.plot([1, 2], [3, number])
    return figure


def measured_rows(evidence, *values):
    return evidence.measured("values", lambda: [{"name": "a", "count": 3, "value": value} for value in values])


def test_rows_come_back_from_the_file_with_their_types(tmp_path):
    (first, second, third) = measured_rows(Evidence("lean", tmp_path), 1.0 / 3.0, None, np.inf)
    assert first == {"name": "a", "count": 3, "value": 1.0 / 3.0}
    assert isinstance(first["count"], int)
    assert (second["value"], third["value"]) == (None, np.inf)


def test_a_page_written_again_is_the_page_of_the_run_that_measured(tmp_path):
    pages = []
    for page_only in (False, True):
        evidence = Evidence("lean", tmp_path, seed=1 if page_only else 4, page_only=page_only)
        rows = measured_rows(evidence, 0.1, 0.2)
        assert evidence.seed == 4
        evidence.add(f"Values. {evidence.table('values', rows)}\n\n{evidence.plot('line', 'A line.', figure_of, 1)}")
        pages.append(evidence.write_page(LEAN).read_text())
        (tmp_path / "line.png").unlink(missing_ok=True)
    assert pages[0] == pages[1]
    assert not (tmp_path / "line.png").exists()  # drawn by the run that measures alone


@pytest.mark.parametrize("kind", KINDS)
def test_committed_pages_are_made_of_the_committed_tables(tmp_path, kind):
    """What `evac evidence KIND --page-only` writes; the last digits of derived tables depend on the processor."""
    earlier = shutil.copytree(PAGES / kind, tmp_path / kind)
    run_evidence(kind, tmp_path, page_only=True)
    for name in ("README.md", "run.json"):
        assert (earlier / name).read_text() == (PAGES / kind / name).read_text(), name


def test_committed_index_is_made_of_the_committed_pages(tmp_path):
    for kind in KINDS:
        (tmp_path / kind).mkdir()
        (tmp_path / kind / "run.json").write_text((PAGES / kind / "run.json").read_text())
    write_index(tmp_path)
    assert (tmp_path / "README.md").read_text() == (PAGES / "README.md").read_text()


def test_command_computes_the_kind_asked_for_and_prints_its_page(tmp_path, monkeypatch, capsys):
    def compute(evidence):
        evidence.add(f"Quick: {evidence.quick}.")
        evidence.write_page(LEAN)

    monkeypatch.setattr("evac.evidence.lean.page.run", compute)
    assert main(["evidence", "lean", "--quick", "--out", str(tmp_path)]) == 0
    page = tmp_path / "lean" / "README.md"
    assert capsys.readouterr().out.strip() == str(page)
    assert "Quick: True." in page.read_text()
    assert "evac evidence lean --quick" in (tmp_path / "README.md").read_text()


def test_installed_verdicts_equal_the_committed_ones():
    # `evac evidence KIND --page-only --out docs/evidence` writes them again.
    assert evidence() == shown_in_reports(COMMITTED)
