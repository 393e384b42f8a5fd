"""evac check."""

import json
import os
import re
import shutil
from pathlib import Path

import pytest

import evac
import evac_buildings
from evac.cli.main import main
from evac.results.ending import Stopped


def _lines(text, start):
    return [line.split() for line in text.splitlines() if line.strip().startswith(start)]


def test_shows_the_building_and_the_people(evac, capsys):
    assert evac("check", "primary_school") == 0
    out, err = capsys.readouterr()
    assert _lines(out, "ground")[0] == ["ground", "floor", "0.00", "162.5", "0", "level", "125"]
    assert _lines(out, "main_door")[0] == ["main_door", "ground", "1.8", "open"]
    assert _lines(out, "class_0a")[1][:3] == ["class_0a", "22", "ground"]
    assert "People: 136." in out
    assert out.count("30.5") == 2  # the steepest slope of each stair
    assert err == ""


COURSE = """
[[people]]
name = "late"
level = "room"
arrive = { times = [2.0, 5.0, 9.5] }

[[people]]
name = "post"
number = 1
level = "room"
leave = false

[[event]]
name = "shut"
time = 1.5
kind = "close"
target = "door"

[[event]]
time = 4.0
kind = "slow"
target = "room"
value = 0.5
"""


def test_shows_who_arrives_and_stays_and_the_events(evac, tmp_path, capsys):
    shutil.copytree(Path(evac_buildings.__file__).parent / "square_room", tmp_path / "room")
    case = tmp_path / "room" / "case.toml"
    case.write_text(case.read_text(encoding="utf-8") + COURSE, encoding="utf-8")
    assert evac("check", case) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for line in (
        "late room 3 people, 2.00 to 9.50 s",
        "post room they do not leave",
        "shut 1.5 s close door -",
        "- 4 s slow room 0.5",
    ):
        assert line in lines


def test_a_mesh_without_exits_shows_where_one_can_be(evac, tmp_path, capsys):
    mesh = tmp_path / "room.obj"
    mesh.write_text("v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nf 1 2 3 4\n")
    assert evac("check", mesh) == 2
    out, err = capsys.readouterr()
    assert re.search(r"floor z=0\.00 +floor", out)
    assert "Exits" not in out
    assert "room.obj: " in err
    assert 'segment = [[0.00, 0.00], [4.00, 0.00]], level = "floor z=0.00"' in err


def test_warns_of_doors_narrower_than_the_widest_person(evac, capsys):
    assert evac("check", "square_room", "--set", "people.people.radius=0.45") == 0
    (told,) = _lines(capsys.readouterr().out, "1   warning")
    assert told[2:8] == ["exits.door", "level", "'room'", "at", "(5.00,", "2.50)"]


def test_seconds_to_an_exit_are_what_a_person_alone_takes(evac, tmp_path, capsys):
    one = ["people.people.number=1", "people.people.speed=1.5", "people.people.tau=0.01", "output.animation=false"]
    assert evac("check", "square_room", "--set", *one) == 0
    (told,) = re.findall(r"people +1 +room +([\d.]+) to", capsys.readouterr().out)
    evac("run", "square_room", "--out", tmp_path / "r", "--set", *one)
    taken = json.loads((tmp_path / "r" / "summary.json").read_text())["last_out"]
    assert float(told) == pytest.approx(taken, abs=0.2)


PLAN = """
[[storeys]]
name = "ground"
wall = 0.1
polygons = [[[0, 0], [10, 0], [10, 10], [0, 10]], [[10, 0], [18, 0], [18, 10], [10, 10]]]
[[doors]]
name = "inner"
storey = "ground"
segment = [[9.95, 7], [10.1, 7.9]]
[[exits]]
name = "out"
storey = "ground"
segment = [[-0.2, 4], [-0.2, 5.2]]
"""


def test_lists_doors_and_what_was_assumed(evac, tmp_path, capsys):
    (tmp_path / "a.plan.toml").write_text(PLAN)
    assert evac("check", tmp_path / "a.plan.toml") == 0
    out, _ = capsys.readouterr()
    assert ["inner", "ground", "0.9"] in _lines(out, "inner")
    assumed = [line for line in out.splitlines() if "assumed" in line]
    assert [line.split()[:3] for line in assumed] == [["1", "assumed", "doors.inner"], ["2", "assumed", "exits.out"]]


def test_who_can_reach_only_a_refuge_is_named(evac, tmp_path, capsys):
    case = tmp_path / "case.toml"
    case.write_text("""
[building.plan]
storeys = [{ name = "low", polygons = [[[0, 0], [8, 0], [8, 2], [0, 2]]] },
           { name = "high", z = 2.4, polygons = [[[12, 0], [20, 0], [20, 2], [12, 2]]] }]
stairs = [{ name = "up", lower = "low", lower_edge = [[8, 0], [8, 1.5]], upper = "high", length = 4 }]
exits = [{ name = "door", storey = "low", segment = [[0, 0.5], [0, 1.5]] }]
areas = [{ name = "lobby", storey = "high", polygon = [[16, 0], [20, 0], [20, 2], [16, 2]] }]
[[people]]
name = "walkers"
number = 2
level = "high"
[[people]]
name = "wheels"
steepest = 0.1
positions = [[14, 1]]
level = "high"
[[place]]
name = "wait"
kind = "refuge"
area = "lobby"
[[event]]
time = 9.0
kind = "alarm"
[behaviours.response_time]
time = 1.0
begin = "cue"
[contact]
model = "nsm2"
""")
    assert evac("check", case) == 0
    out = capsys.readouterr().out
    assert "All can reach an exit but 1 of 'wheels', who can reach only a refuge." in out
    (walkers,) = (row for row in map(str.split, out.splitlines()) if row[:1] == ["walkers"])
    assert float(walkers[3]) <= float(walkers[5])  # unimpeded times of people who wait for an alarm


def states(path, capsys):
    """The status of `evac check`, and the first word of the state of each file that it lists."""
    status = main(["check", str(path)])
    found: dict[str, str] = {}
    for line in capsys.readouterr().out.splitlines()[4:]:
        name, _, state = line.strip().partition("  ")
        if line.startswith("   ") and line.strip():  # the state continues
            found[list(found)[-1]] += f" {line.strip()}"
        elif name:
            found[name] = state.strip()
    return status, found


def change(path, place):
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    settings = {"simulation.duration": 0.3, "output.picture": False, "output.every": 0.1}
    return evac.run(evac.load("square_room", settings), tmp_path_factory.mktemp("whole") / "r").folder


@pytest.mark.parametrize(
    ("name", "place", "words"),
    [
        ("", 0, ""),
        ("people.csv", 20, "damaged"),
        ("people.csv", None, "missing"),
        ("summary.json", 20, "damaged"),
        ("trajectory.evac", 20, "damaged"),
        ("trajectory.evac", -20, "damaged: .* complete up to 0.20 s"),
        ("trajectory.evac", None, "missing"),
        ("replay.html", 20, "damaged: .* evac replay"),
    ],
)
def test_a_result_is_verified_whole(result, tmp_path, capsys, name, place, words):
    folder = shutil.copytree(result, tmp_path / "r")
    if place is None:
        (folder / name).unlink()
    elif name:
        change(folder / name, place)
    status, found = states(folder, capsys)
    assert status == (2 if name else 0)
    assert found["egress.csv"] == "whole"
    if name:
        assert re.match(words, found[name])
    else:
        assert set(found.values()) == {"whole", "whole, complete up to 0.30 s"}


def test_a_result_is_whole_after_commands_that_add_files(result, tmp_path, capsys):
    folder = shutil.copytree(result, tmp_path / "r")
    for command in ("export", "replay"):
        assert main([command, str(folder)]) == 0
    capsys.readouterr()
    assert states(folder, capsys)[0] == 0


@pytest.mark.parametrize("lines", [None, 0, 3, 8.5])
def test_a_manifest_that_is_missing_or_cut_is_told_and_the_rest_is_verified(result, tmp_path, capsys, lines):
    folder = shutil.copytree(result, tmp_path / "r")
    path = folder / "manifest.jsonl"
    if lines is None:
        path.unlink()
    else:
        whole = path.read_bytes().splitlines(keepends=True)
        path.write_bytes(b"".join(whole[: int(lines)]) + whole[int(lines)][: int(lines % 1.0 * 20)])
    status, found = states(folder, capsys)
    assert status == 2
    assert found["manifest.jsonl"].startswith("missing" if lines is None else "damaged")
    assert (found["trajectory.evac"], found["files together"]) == ("whole, complete up to 0.30 s", "whole")


def test_a_trajectory_that_is_cut_between_two_frames_is_not_that_of_the_run(result, tmp_path, capsys):
    folder = shutil.copytree(result, tmp_path / "r")
    path = folder / "trajectory.evac"
    change(path, -20)
    path.write_bytes(path.read_bytes()[: evac.read_trajectory(path).end])
    status, found = states(folder, capsys)
    assert status == 2
    assert re.match("damaged: .* 0.20 s, the run at 0.30 s", found["files together"])


def test_a_study_is_verified_and_its_tables_are_written_again(tmp_path, capsys):
    case, folder = evac.load("square_room", {"simulation.duration": 0.3}), tmp_path / "s"
    evac.repeat(case, 3, folder=folder)
    status, found = states(folder, capsys)
    assert (status, found["runs of the study"]) == (0, "whole, 3 runs")
    (folder / "egress.csv").unlink()
    change(folder / "statistics.csv", 20)
    status, found = states(folder, capsys)
    assert status == 2
    assert re.match("missing: .* --resume", found["egress.csv"])
    assert re.match("damaged: .* --resume", found["statistics.csv"])
    evac.repeat(case, 3, folder=folder, resume=True)
    assert states(folder, capsys)[0] == 0
    change(folder / "runs.arrows", -20)
    status, found = states(folder, capsys)
    assert status == 2
    assert re.match("damaged: .* --resume", found["runs of the study"])
    with pytest.raises(evac.EvacError, match=r"runs\.arrows"):
        evac.read_study(folder)
    evac.repeat(case, 3, folder=folder, resume=True)
    assert states(folder, capsys) == (0, found | dict.fromkeys(found, "whole") | {"runs of the study": "whole, 3 runs"})


def test_the_rows_of_a_stopped_study_are_counted(tmp_path, capsys):
    def stop(progress):
        if progress.done == 2:
            raise KeyboardInterrupt

    case = evac.load("square_room", {"simulation.duration": 0.3})
    with pytest.raises(KeyboardInterrupt):
        evac.repeat(case, 3, folder=tmp_path / "s", workers=1, progress=stop)
    folder = tmp_path / "s.running"
    for path in (folder, tmp_path / "s"):  # by the name of the result, too
        assert states(path, capsys)[1]["runs of the study"] == "whole, 2 runs"
    change(folder / "runs.arrows", -20)
    status, found = states(folder, capsys)
    assert status == 2
    assert re.match("damaged: .* 1 runs are whole, .* --resume", found["runs of the study"])


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("", 0),
        ("checkpoint.evac", 300),
        ("trajectory.evac", 20),
        pytest.param("trajectory.evac", None, marks=pytest.mark.skipif(os.name == "nt", reason="Windows has no FIFO")),
    ],
)
def test_a_checkpoint_is_verified_with_the_files_that_it_continues(tmp_path, capsys, name, place):
    def stop(progress):
        if progress.time >= 0.2:
            raise Stopped

    evac.run(evac.load("square_room"), tmp_path / "r", progress=stop, checkpoint=60)
    folder = next(tmp_path.glob("r*/checkpoint.evac")).parent
    if place is None:
        (folder / name).unlink()
        os.mkfifo(folder / name)
    elif name:
        change(folder / name, place)
    for path in (folder, folder / "checkpoint.evac"):
        status, found = states(path, capsys)
        assert status == (2 if name else 0)
        assert found["checkpoint.evac"].startswith("damaged" if name else "whole, at 0.2")
