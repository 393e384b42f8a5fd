"""The case of tests/broken, spoilt in many ways: one clear message, status 2, no traceback."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from evac.cli import main

BROKEN = Path(__file__).parent / "broken"
ROOM = "[[1.0, 0.5], [5.5, 0.5], [5.5, 3.5], [1.0, 3.5]]"
EXIT = """[[building.exits]]
name = "door"
segment = [[0.0, 1.5], [0.0, 2.5]]
z = 0.0
"""

#: How the sound case is spoilt, old text and new, and what the message must say: file, dotted key or place, and remedy.
REFUSED = {
    "area_too_small": (
        {"5.5": "2.3", "number = 5": "number = 200"},
        r"area_too_small/case\.toml: people\.visitors\.number: area 'room' on level 'floor z=0\.00': 200 people .* m2",
    ),
    "area_unknown": ({'area = "room"': 'area = "rooom"'}, r"people\.visitors\.area: .*'rooom'; .*'room'"),
    "exit_off_edge": (
        {"[0.0, 1.5], [0.0": "[3.0, 1.5], [3.0"},
        r"room\.obj: exit .door. .*exits\.door.*\(3\.00, 1\.50\).* level .floor z=0\.00..* edge ",
    ),
    "mesh_empty": ({"room.obj": "empty.obj"}, r"empty\.obj: "),
    "mesh_folded": ({"room.obj": "folded.obj"}, r"folded\.obj: .* edge \(6\.00, 0\.00, 0\.00\)"),
    "mesh_missing": ({"room.obj": "nowhere.obj"}, r"building\.mesh: .*nowhere\.obj"),
    "mesh_nan": ({"room.obj": "nan.obj"}, r"nan\.obj: vertex 3 .*\[6\.0, nan, 0\.0\]"),
    "mesh_overlapping": (
        {"room.obj": "spiral.obj"}, r"spiral\.obj: level 'floor z=0\.00' .* at \(\d\.\d+, \d\.\d+\)"
    ),
    "mesh_unreadable": ({"room.obj": "unreadable.obj"}, r"unreadable\.obj: .* line 3"),
    "mesh_vertical": ({"room.obj": "vertical.obj"}, r"vertical\.obj: .* building\.scale"),
    "no_exit": ({EXIT: ""}, r"room\.obj: .* \[\[building\.exits\]\]"),
    "no_way_out": (
        {"room.obj": "two_rooms.obj", ROOM: "[[8.5, 0.5], [11.5, 0.5], [11.5, 3.5], [8.5, 3.5]]"},
        r"people\.visitors: 5 of 5 .* at \(\d+\.\d+, \d\.\d+\) on level 'floor z=0\.00 \(2\)'",
    ),
    "not_finite": (
        {'area = "room"': 'area = "room"\nradius = nan\nspeed = inf', "30.0": "nan"},
        r"visitors\.radius: .*nan(.|\n)*visitors\.speed: .*inf(.|\n)*simulation\.duration: .*nan",
    ),
    "not_toml": ({'spoil"': "spoil"}, r"not_toml/case\.toml: .* line 1"),
    "plugin_broken": (
        {"[contact]": '[plugins]\nfiles = ["plugin.py"]\n\n[contact]'},
        r"a_module_that_is_nowhere.*plugin_broken/plugin\.py, line 3",
    ),
    "plugin_missing": (
        {"[contact]": '[plugins]\nfiles = ["nowhere.py"]\n\n[contact]'}, r"plugins\.files\.0: .*nowhere\.py"
    ),
    "position_outside": (
        {'number = 5\narea = "room"': "positions = [[3.0, 2.0], [7.0, 2.0]]\nz = 0.0"},
        r"people\.visitors\.positions\.1: \(7, 2\) .* z = 0 m",
    ),
    "stair_joins_nothing": (
        {"room.obj": "loose_stair.obj"},
        r"loose_stair\.obj: stair 'stair 1' at \(7\.50, 2\.00\), z = 0\.00 to 1\.50",
    ),
    "unknown_key": ({"duration": "duraton"}, r"simulation\.duraton: .*'duration'"),
}  # fmt: skip

#: What is wrong in a case that can be read: `evac check` shows the case, and the building unless that is it.
WRONG_BUILDING = {
    "exit_off_edge", "mesh_empty", "mesh_folded", "mesh_nan", "mesh_overlapping", "mesh_unreadable", "mesh_vertical",
    "no_exit", "stair_joins_nothing",
}  # fmt: skip
WRONG_PEOPLE = {"area_too_small", "area_unknown", "no_way_out", "position_outside"}

#: Bad input that can still be run: a warning, and an honest end.
SLOW = {'area = "room"': 'area = "room"\nradius = 0.25', "30.0": "30.0\nno_progress = 5.0"}
WARNED = {
    "narrow_door": (
        SLOW | {"[0.0, 2.5]]": "[0.0, 1.9]]"},
        r"warning: level 'floor z=0\.00' at \(0\.00, 1\.70\): exit 'door' .*0\.40 m.*0\.50 m",
    ),
    "narrow_neck": (
        SLOW | {"room.obj": "waist.obj", ROOM: "[[5.0, 0.5], [7.5, 0.5], [7.5, 3.5], [5.0, 3.5]]"},
        r"warning: level 'floor z=0\.00' at \(4\.[02]0, 2\.00\): .*0\.40 m.*0\.50 m",
    ),
}


@pytest.fixture
def spoilt(tmp_path):
    """Return a function that writes a case in a folder of its name."""

    def written(name, changes):
        folder = shutil.copytree(BROKEN, tmp_path / "cases" / name)
        text = (folder / "case.toml").read_text(encoding="utf-8")
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new)
        (folder / "case.toml").write_text(text, encoding="utf-8")
        return str(folder)

    return written


@pytest.mark.parametrize("name", sorted(REFUSED.keys() - {"plugin_broken"}))  # a plugin file is not run by a check
def test_is_refused_with_one_clear_message(name, spoilt, capsys):
    changes, message = REFUSED[name]
    assert main(["check", spoilt(name, changes)]) == 2
    out, err = capsys.readouterr()
    shown = ["case"] * (name in WRONG_BUILDING | WRONG_PEOPLE) + ["building", "Levels"] * (name in WRONG_PEOPLE)
    assert re.findall(r"^(case|building|Levels|People)\b", out, re.MULTILINE) == shown
    assert err.startswith("evac: ")
    assert re.search(message, err), err


def test_the_case_that_they_spoil_is_sound(capsys):
    assert main(["check", str(BROKEN)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", WARNED)
def test_people_who_cannot_move_are_reported_and_kept(name, spoilt, capsys, tmp_path):
    changes, message = WARNED[name]
    assert main(["run", spoilt(name, changes), "--out", str(tmp_path / "r")]) == 3
    err = capsys.readouterr().err
    assert re.search(message, err), err
    assert "5 of 5" in err
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["exit_status"] == 3
    assert [stuck["person"] for stuck in summary["stuck"]] == [0, 1, 2, 3, 4]
    assert all(0.0 < stuck["x"] < 8.0 and 0.0 < stuck["y"] < 4.0 for stuck in summary["stuck"])
    assert len((tmp_path / "r" / "people.csv").read_text().splitlines()) == 6


@pytest.mark.parametrize(
    ("command", "name"), [("run", "mesh_unreadable"), ("run", "plugin_broken"), ("explain", "no_way_out")]
)
def test_as_a_user_sees_it(command, name, spoilt, tmp_path):
    changes, message = REFUSED[name]
    words = [sys.executable, "-m", "evac", command, spoilt(name, changes)]
    process = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert "Traceback" not in process.stderr
    assert re.search(message, process.stderr), process.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["cases"]
    assert ("details are in" in process.stderr) == (name == "plugin_broken")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["run", "primary_shool"],
            "primary_shool: .*'primary_school'",
        ),
        (["run", "square_room", "--seed", "-1"], r"simulation\.seed: .*-1"),
        (["run", "square_room", "--set", "contact.model"], r"dotted\.key=value"),
        (["run", "square_room", "--plugin", "nowhere.py"], r"nowhere\.py"),
        (["check", "square_room", "--set", "people.people.exits=['dor']"], "'dor'; .*'door'"),
        (["export", "nowhere"], "nowhere: "),
        (["render", "nowhere"], "nowhere: "),
    ],
)
def test_bad_arguments_are_refused(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert re.search(message, capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []
