"""Verdicts: met, not met and by how much, undecided, reported only."""

import math

import pytest

from evac.evidence.verdicts import (
    MET,
    NOT_MET,
    REPORTED,
    UNDECIDED,
    all_of,
    anchor,
    at_least,
    at_most,
    reported,
    surely_at_most,
    verdict_table,
    within,
)


@pytest.mark.parametrize(
    ("finding", "verdict"),
    [
        (at_most("a", 150.0, 150.0), MET),
        (at_most("a", 300.0, 150.0), f"{NOT_MET}: 2 times the bound"),
        (at_most("a", 0.5, 0.0), f"{NOT_MET}: 0.5 beyond the bound"),
        (at_least("a", 150.0, 300.0), f"{NOT_MET}: 0.5 times the bound"),
        (at_least("a", 300.0, 300.0), MET),
        (at_least("a", None, 300.0), f"{NOT_MET}: no measurement"),
        (at_most("a", math.nan, 300.0), f"{NOT_MET}: no measurement"),
        (all_of("a", 5, 5), MET),
        (all_of("a", 3, 5), f"{NOT_MET} in 2"),
        (all_of("a", 0, 0), f"{NOT_MET}: no case"),
        (within("a", 10.0, 9.0, 11.0, 11.0), MET),
        (within("a", 10.0, 9.0, 11.0, 20.0), f"{NOT_MET}: -50 %"),
        (surely_at_most("a", -3.0, 1.5, 5.0), MET),
        (surely_at_most("a", -4.0, 1.5, 5.0), UNDECIDED),
        (surely_at_most("a", -10.0, 1.5, 5.0), f"{NOT_MET}: 2 times the bound"),
        (reported("a", "10"), REPORTED),
    ],
)
def test_verdict_follows_from_measured_and_wanted(finding, verdict):
    assert finding["verdict"] == verdict


def test_table_links_each_question_to_its_section():
    rows = [at_most("time | run [s]", 1.0, 2.0, "s", "b. Times: all (h)"), reported("more", "5")]
    lines = verdict_table(rows, "page.md").splitlines()
    assert lines[2] == r"| [time \| run [s]](page.md#b-times-all-h) | 1 s | at most 2 s | met |"
    assert lines[3].startswith("| more | 5 |")


def test_anchor_is_that_of_github():
    assert anchor("f. The rule of --tolerance, on `scenes`") == "f-the-rule-of---tolerance-on-scenes"
