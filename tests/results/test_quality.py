"""What a run's numbers say against it: each with a bound of its own, and nothing of a run that is all right."""

import re

import pytest

from evac.analysis.hydraulic import LABORATORY
from evac.results.quality import chatter_warning, contact_warnings, crushing_warning, flow_warnings
from evac.results.watch import Observation

ALL_RIGHT = {
    "model": "dem",
    "parameters": {"stiffness": 1.2e5},
    "steps": 100,
    "greatest_overlap": 0.1,
    "greatest_overlap_at": {"time": 3.21, "person": 7, "level": "hall", "x": 9.5, "y": 3.0},
    "promised_overlap": 0.1,
    "unconverged_steps": 0,
    "greatest_residual": 5e-4,
    "failed_position_corrections": 0,
    "failed_solves": 0,
    "energy": {"driving_work": 1000.0, "contact_dissipation": 400.0, "contact_creation": 410.0},
}
RIGID = ("stiff",)
PLACE = r"person 7 at \(9\.50, 3\.00\) on level 'hall'"


def test_nothing_is_said_of_a_run_that_is_all_right():
    assert contact_warnings(ALL_RIGHT, RIGID) == ()
    assert contact_warnings(ALL_RIGHT | {"greatest_overlap": 0.0, "greatest_overlap_at": None}, RIGID) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"greatest_overlap": 0.101}, f"Bodies .*100 mm.*'dem'.*t = 3\\.21 s, {PLACE}: 101 mm"),
        ({"unconverged_steps": 3, "greatest_residual": 0.25}, "3 of 100 steps .*0.25 m/s"),
        ({"failed_position_corrections": 7}, "7 times"),
        ({"energy": {**ALL_RIGHT["energy"], "contact_creation": 411.0}}, "411 J.*400 J"),
    ],
)
def test_each_number_has_a_warning_of_its_own_and_how_to_fix_it(change, words):
    (line,) = contact_warnings(ALL_RIGHT | change, RIGID)
    assert re.search(words, line)
    assert re.search("smaller simulation.step|check for", line)
    assert ("--set contact.model=stiff" in line) == ("greatest_overlap" in change)


@pytest.mark.parametrize("keepers", [None, ["walking", "headway"]])
def test_large_overlaps_are_told_with_people_period_place_and_remedies(keepers):
    seen = Observation(12, 2.0, 8.0, 4.0, 6.0, 7, 1, 9.5, 3.0, (0.155, 0.7))
    (line,) = contact_warnings(ALL_RIGHT | {"greatest_overlap": 0.155}, RIGID, keepers, seen)
    assert line.startswith("large overlaps: ")
    assert re.search(f"t = 2\\.0 and 8\\.0 s 12 people .*100 mm.*'dem'.*t = 3\\.21 s, {PLACE}: 155 mm", line)
    assert re.search(r"contact\.dem\.stiffness .* simulation\.step.*--set contact\.model=stiff", line)
    assert ("--set behaviours.walking={} or behaviours.headway={}" in line) == (keepers is not None)
    (line,) = contact_warnings(ALL_RIGHT | {"greatest_overlap": 0.155, "parameters": {}}, RIGID, keepers, seen)
    assert "stiffness" not in line


@pytest.mark.parametrize(("people", "who"), [(1, "1 person "), (12, "12 people ")])
def test_what_was_noticed_of_people_is_one_line_with_time_and_place(people, who):
    seen = Observation(people, 2.0, 8.0, 4.0, 6.0, 7, 1, 9.5, 3.0, (0.92, 0.19))
    line = chatter_warning(seen, ["cellar", "hall"], ["stiff"])
    assert re.search(f"t = 2\\.0 and 8\\.0 s {who}.*from 4\\.0 to 6\\.0 s, {PLACE}: .*0\\.19 m/s.*0\\.92 m/s", line)
    assert line.startswith("chattering contacts: ")
    assert "--set contact.model=stiff" in line
    pressed = Observation(people, 2.0, 8.0, 4.0, 6.0, 7, 1, 9.5, 3.0, (3140.0, 7850.0))
    line = crushing_warning(pressed, ["cellar", "hall"], ["gaps", "file"])
    assert re.search(f"t = 2\\.0 and 8\\.0 s {who}.*from 4\\.0 to 6\\.0 s, {PLACE}: 7\\.8 kN/m, 3\\.1 kN", line)
    assert "--set behaviours.gaps={} or behaviours.file={}" in line
    assert "behaviour" not in crushing_warning(pressed, ["cellar", "hall"], None)


def test_only_flows_beyond_measured_ones_have_a_warning_and_the_exit_is_named():
    flows = {"few": None, "slow": LABORATORY, "fast": 2.81}
    exits = {name: {"flow_per_metre": flow} for name, flow in flows.items()}
    (line,) = flow_warnings(exits, ["gaps"])
    assert line.startswith("flow higher than measured: ")
    assert re.search(r"2\.81 .*'fast'", line)
    assert "--set behaviours.gaps={}" in line
    (line,) = flow_warnings(exits, None)
    assert "behaviour" not in line
    assert "egress.csv" in line
