"""Every folder of tests/broken: one clear message, status 2, no traceback."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from evac.cli import main

BROKEN = Path(__file__).parent / "broken"

#: What the message must say: file, dotted key or place, and what to do.
REFUSED = {
    "area_too_small": r"area_too_small/case\.toml: people\.visitors\.number: area 'room' on level 'floor z=0\.00': "
    r"200 people .* m2",
    "area_unknown": r"people\.visitors\.area: .*'rooom'; .*'room'",
    "exit_off_edge": r"room\.obj: exit .door. .*exits\.door.*\(3\.00, 1\.50\).* level .floor z=0\.00..* edge ",
    "mesh_empty": r"empty\.obj: ",
    "mesh_folded": r"folded\.obj: .* edge \(6\.00, 0\.00, 0\.00\)",
    "mesh_missing": r"building\.mesh: .*nowhere\.obj",
    "mesh_nan": r"nan\.obj: vertex 3 .*\[6\.0, nan, 0\.0\]",
    "mesh_overlapping": r"spiral\.obj: level 'floor z=0\.00' .* at \(\d\.\d+, \d\.\d+\)",
    "mesh_unreadable": r"unreadable\.obj: .* line 3",
    "mesh_vertical": r"vertical\.obj: .* building\.scale",
    "negative": r"people\.visitors\.mass: .* 0, got -80",
    "no_exit": r"room\.obj: .* \[\[building\.exits\]\]",
    "no_way_out": r"people\.visitors: 5 of 5 .* at \(\d+\.\d+, \d\.\d+\) on level 'floor z=0\.00 \(2\)'",
    "not_finite": r"visitors\.radius: .*nan(.|\n)*visitors\.speed: .*inf(.|\n)*simulation\.duration: .*nan",
    "not_toml": r"not_toml/case\.toml: .* line 1",
    "plugin_broken": r"a_module_that_is_nowhere.*plugin_broken/plugin\.py, line 3",
    "plugin_missing": r"plugins\.files\.0: .*nowhere\.py",
    "position_outside": r"people\.visitors\.positions\.1: \(7, 2\) .* z = 0 m",
    "stair_joins_nothing": r"loose_stair\.obj: stair 'stair 1' at \(7\.50, 2\.00\), z = 0\.00 to 1\.50",
    "tick_of_no_steps": r"simulation\.tick: 0\.1 s .* simulation\.step 0\.03 s; .* 0\.09",
    "unknown_behaviour": r"behaviours\.respons_time: .*'response_time'",
    "unknown_distribution": r"people\.visitors\.radius: .*'unifrom'; .*'uniform'",
    "unknown_key": r"simulation\.duraton: .*'duration'",
    "unknown_model": r"contact\.model: .*'nsm3'; .*'nsm2'",
    "unknown_strategy": r"people\.visitors\.strategy: .*'fastet'; .*'fastest'",
}

#: What is wrong in a case that can be read: `evac check` shows the case, and the building unless that is it.
WRONG_BUILDING = {
    "exit_off_edge", "mesh_empty", "mesh_folded", "mesh_nan", "mesh_overlapping", "mesh_unreadable", "mesh_vertical",
    "no_exit", "stair_joins_nothing",
}  # fmt: skip
WRONG_PEOPLE = {"area_too_small", "area_unknown", "no_way_out", "position_outside"}

#: Bad input that can still be run: a warning, and an honest end.
WARNED = {
    "narrow_door": r"warning: level 'floor z=0\.00' at \(0\.00, 1\.70\): exit 'door' .*0\.40 m.*0\.50 m",
    "narrow_neck": r"warning: level 'floor z=0\.00' at \(4\.[02]0, 2\.00\): .*0\.40 m.*0\.50 m",
}


def test_every_folder_is_tested():
    folders = {path.parent.name for path in BROKEN.glob("*/case.toml")}
    assert folders == {*REFUSED, *WARNED, "sound"}


@pytest.mark.parametrize("name", sorted(REFUSED.keys() - {"plugin_broken"}))  # a plugin file is not run by a check
def test_is_refused_with_one_clear_message(name, capsys):
    assert main(["check", str(BROKEN / name)]) == 2
    out, err = capsys.readouterr()
    shown = ["case"] * (name in WRONG_BUILDING | WRONG_PEOPLE) + ["building", "Levels"] * (name in WRONG_PEOPLE)
    assert re.findall(r"^(case|building|Levels|People)\b", out, re.MULTILINE) == shown
    assert err.startswith("evac: ")
    assert re.search(REFUSED[name], err), err


def test_the_case_that_they_spoil_is_sound(capsys):
    assert main(["check", str(BROKEN / "sound")]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", WARNED)
def test_people_who_cannot_move_are_reported_and_kept(name, capsys, tmp_path):
    assert main(["run", str(BROKEN / name), "--out", str(tmp_path)]) == 3
    err = capsys.readouterr().err
    assert re.search(WARNED[name], err), err
    assert "5 of 5" in err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["exit_status"] == 3
    assert [stuck["person"] for stuck in summary["stuck"]] == [0, 1, 2, 3, 4]
    assert all(0.0 < stuck["x"] < 8.0 and 0.0 < stuck["y"] < 4.0 for stuck in summary["stuck"])
    assert len((tmp_path / "people.csv").read_text().splitlines()) == 6


@pytest.mark.parametrize(
    ("command", "name"), [("run", "mesh_unreadable"), ("run", "plugin_broken"), ("explain", "no_way_out")]
)
def test_as_a_user_sees_it(command, name, tmp_path):
    words = [sys.executable, "-m", "evac", command, str(BROKEN / name)]
    process = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert process.returncode == 2
    assert "Traceback" not in process.stderr
    assert re.search(REFUSED[name], process.stderr), process.stderr
    assert list(tmp_path.iterdir()) == []
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
