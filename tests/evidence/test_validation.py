"""The page on the standard tests: verdicts on each model, and what is left out."""

from evac.evidence.validation.page import failed_tests, verdict_rows


def test_a_model_fails_a_test_with_one_check():
    row = {"test": "RiMEA-2", "expected": "-", "by": "RiMEA"}
    rows = [
        {**row, "measured": "time [s]", "model": "DEM", "met": "yes"},
        {**row, "measured": "speed [m/s]", "model": "DEM", "met": "NO: 0.5"},
        {**row, "measured": "speed [m/s]", "model": "NSM2", "met": "yes"},
    ]
    assert failed_tests(rows) == {"DEM": ["RiMEA-2"], "NSM2": []}
    assert [(row["DEM"], row["NSM2"]) for row in verdict_rows(rows)] == [("yes", "-"), ("NO: 0.5", "yes")]
