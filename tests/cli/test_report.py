"""The tables shown after a run tell what its summary holds."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from evac.cli.report import show_results

SUMMARY = {
    "title": "A house",
    "ended": "everybody out",
    "people": 5,
    "evacuated": 5,
    "last_out": 9.0,
    "simulated_time": 10.0,
    "steps": 1000,
    "seed": 7,
    "exits": {"door": {"people": 5, "last_out": 9.0, "width": 0.8, "flow": None, "flow_per_metre": None}},
    "stairs": {"main": {"people": 4, "greatest_number": 3, "last_left": 6.0}},
    "contact": {
        "model": "dem",
        "greatest_overlap": 0.0123,
        "mean_overlap": 0.0045,
        "greatest_residual": 2e-4,
        "unconverged_steps": 6,
        "steps": 1000,
        "contacts": 900,
        "hardened_contacts": 8,
        "too_fast_steps": 1,
        "too_stiff_steps": 2,
        "wall_crossings_prevented": 4,
        "greatest_speed": 3.0,
        "energy": {"driving_work": 100.0, "contact_dissipation": 30.0, "contact_creation": 5.0},
    },
    "wall_time": {"physics": 1.5, "recording": 0.5},
    "left_by_other_exits": 0,
    "stuck": [],
}


@pytest.fixture
def shown(capsys, tmp_path):
    """Show a summary; return its lines, divided at two spaces or more, and what is said on standard error."""

    def show(**changes):
        results = SimpleNamespace(
            summary=lambda: SUMMARY | changes,
            crowd=SimpleNamespace(level=np.array([-1, 0])),
            building=SimpleNamespace(levels=[SimpleNamespace(name="room")]),
        )
        show_results(results, Path(tmp_path))
        out, err = capsys.readouterr()
        return [re.split(r"\s{2,}", line.strip()) for line in out.splitlines()], err

    return show


def test_contact_is_told_in_millimetres_and_joules(shown):
    lines, _ = shown()
    first = next(k for k, line in enumerate(lines) if line[0] == "contact model")
    assert lines[first : first + 11] == [
        ["contact model", "dem"],
        ["greatest overlap", "12.3 mm"],
        ["mean overlap", "4.5 mm"],
        ["hardened contacts", "8 of 900"],
        ["greatest residual", "0.0002 m/s"],
        ["unconverged steps", "6 of 1000"],
        ["steps cut into smaller ones", "7 times; greatest speed 3 m/s"],
        ["work of driving", "100 J"],
        ["dissipated in contacts", "30 J"],
        ["created in contacts", "5 J"],
        ["balance: carried out or still in motion", "75 J"],
    ]


def test_places_and_phases_stand_under_their_heads(shown):
    lines, _ = shown()
    for head, row in (
        (
            ["exit", "people", "last out [s]", "width [m]", "flow [1/s]", "per metre [1/s/m]"],
            ["door", "5", "9", "0.8", "-", "-"],
        ),
        (["stair", "people", "greatest number", "last left [s]"], ["main", "4", "3", "6"]),
        (["phase", "s"], ["physics", "1.5"]),
    ):
        assert lines[lines.index(head) + 2] == row
    assert ["all", "2"] in lines


def test_who_left_by_another_exit_is_told(shown):
    assert shown()[1] == ""
    assert "2 people" in shown(left_by_other_exits=2)[1]


def test_with_people_left_the_last_time_is_that_of_those_who_are_out(shown):
    assert ["last out", "9.00 s"] in shown()[0]
    lines, err = shown(evacuated=4, ended="no progress")
    assert ["last out", "9.00 s, the last of those who are out; people left: 1"] in lines
    assert "1 of 5 people" in err
