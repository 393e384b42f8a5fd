"""The page on the standard tests: verdicts on each model, and what is left out."""

import csv

import pytest

from evac.evidence.evidence import Evidence
from evac.evidence.validation.page import QUICK_SUBJECTS, failed_tests, run, verdict_rows
from evac.standard.verify import TESTS


def test_a_model_fails_a_test_with_one_check():
    row = {"test": "RiMEA-2", "expected": "-", "by": "RiMEA"}
    rows = [
        {**row, "measured": "time [s]", "model": "DEM", "met": "yes"},
        {**row, "measured": "speed [m/s]", "model": "DEM", "met": "NO: 0.5"},
        {**row, "measured": "speed [m/s]", "model": "NSM2", "met": "yes"},
    ]
    assert failed_tests(rows) == {"DEM": ["RiMEA-2"], "NSM2": []}
    assert [(row["DEM"], row["NSM2"]) for row in verdict_rows(rows)] == [("yes", "-"), ("NO: 0.5", "yes")]


@pytest.mark.slow
def test_quick_run_writes_verdicts_and_what_is_left_out(tmp_path, monkeypatch):
    few = [test for test in TESTS if test.name in ("RiMEA-1", "RiMEA-2", "ISO-V")]
    monkeypatch.setattr("evac.evidence.validation.page.TESTS", few)
    run(Evidence("validation", tmp_path, quick=True))
    with (tmp_path / "verdicts.csv").open() as file:
        verdicts = list(csv.DictReader(file))
    for name in QUICK_SUBJECTS:
        assert [row[name] for row in verdicts] == ["yes"] * 4
    with (tmp_path / "left_out.csv").open() as file:
        assert [row["test"] for row in csv.DictReader(file)] == ["ISO-V"]
    page = (tmp_path / "README.md").read_text()
    run(Evidence("validation", tmp_path, page_only=True))
    assert (tmp_path / "README.md").read_text() == page
