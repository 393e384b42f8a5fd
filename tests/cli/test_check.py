"""evac check."""

import json
import re
from pathlib import Path

import pytest

import evac
import evac_buildings
from evac.cli.main import main


def _lines(text, start):
    return [line.split() for line in text.splitlines() if line.strip().startswith(start)]


def test_shows_the_building_and_the_people(evac, capsys):
    assert evac("check", "primary_school") == 0
    out, err = capsys.readouterr()
    assert _lines(out, "ground")[0] == ["ground", "floor", "0.00", "162.5", "0", "125"]
    assert _lines(out, "main_door")[0] == ["main_door", "ground", "1.8", "open"]
    assert _lines(out, "class_0a")[1][:3] == ["class_0a", "22", "ground"]
    assert "People: 136." in out
    assert out.count("30.5") == 4
    assert err == ""


def test_people_who_arrive_have_no_level_and_no_time_at_the_start(evac, tmp_path, capsys):
    case = tmp_path / "case.toml"
    mesh = Path(evac_buildings.__file__).parent / "square_room" / "square_room.msh"
    case.write_text(
        f'[building]\nmesh = "{mesh}"\n[contact]\nmodel = "dem"\n'
        '[[people]]\nname = "late"\nlevel = "room"\narrive = { times = [3, 4] }\n'
        '[[people]]\nname = "early"\nlevel = "room"\nnumber = 2\n'
    )
    evac("check", str(case))
    shown = capsys.readouterr().out
    assert re.search(r"late +2 +they arrive +- +0\.2", shown)
    assert re.search(r"early +2 +room +\d+\.\d to", shown)


def test_shows_what_is_closed(evac, capsys):
    assert evac("check", "primary_school", "--set", 'building.closed=["upper"]') == 2
    assert "'second'" in capsys.readouterr().err


def test_takes_a_mesh_alone(evac, capsys):
    mesh = Path(evac_buildings.__file__).parent / "classroom" / "classroom.msh"
    assert evac("check", mesh) == 0
    out = capsys.readouterr().out
    assert _lines(out, "door")[0] == ["door", "classroom", "0.5", "open"]
    assert "People" not in out


def test_a_mesh_without_exits_shows_where_one_can_be(evac, tmp_path, capsys):
    mesh = tmp_path / "room.obj"
    mesh.write_text("v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nf 1 2 3 4\n")
    assert evac("check", mesh) == 2
    out, err = capsys.readouterr()
    assert re.search(r"floor z=0\.00 +floor", out)
    assert "Exits" not in out
    assert "room.obj: " in err
    assert 'segment = [[0.00, 0.00], [4.00, 0.00]], level = "floor z=0.00"' in err


def test_a_mesh_alone_has_no_keys_to_change(evac, capsys):
    mesh = Path(evac_buildings.__file__).parent / "classroom" / "classroom.msh"
    assert evac("check", mesh, "--seed", 3) == 2
    assert "--set and --seed" in capsys.readouterr().err


def test_warns_of_doors_narrower_than_the_widest_person(evac, capsys):
    assert evac("check", "square_room", "--set", "people.people.radius=0.45") == 0
    assert "level 'room' at (5.00, 2.50): exit 'door'" in capsys.readouterr().err


def test_an_importer_of_a_plugin_reads_the_file(evac, tmp_path, capsys):
    (tmp_path / "room.plan").write_text("6 4")
    (tmp_path / "reader.py").write_text(
        """
from evac import Importer, SurfaceMesh, hookimpl

evac_interface = 3

class RectangleImporter(Importer):
    name = "rectangle"
    suffixes = (".plan",)

    def read(self, path):
        x, y = map(float, path.read_text().split())
        points = [[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0], [0, 1, 0], [0, 2, 0]]
        return SurfaceMesh(points, [[0, 1, 2, 3]], {}, {"exit:way": [[4, 5]]})

@hookimpl
def evac_importers():
    return [RectangleImporter]
"""
    )
    assert evac("check", "room.plan", "--plugin", "reader.py") == 0
    assert _lines(capsys.readouterr().out, "way")[0] == ["way", "floor", "z=0.00", "1", "open"]


def test_seconds_to_an_exit_are_what_a_person_alone_takes(evac, tmp_path, capsys):
    one = ["people.people.number=1", "people.people.speed=1.5", "people.people.tau=0.01", "output.animation=false"]
    assert evac("check", "square_room", "--set", *one) == 0
    (told,) = re.findall(r"people +1 +room +([\d.]+) to", capsys.readouterr().out)
    evac("run", "square_room", "--out", tmp_path / "r", "--set", *one)
    taken = json.loads((tmp_path / "r" / "summary.json").read_text())["last_out"]
    assert float(told) == pytest.approx(taken, abs=0.2)


STEEP = """
v 0 0 0
v 5 0 0
v 5 4 0
v 0 4 0
v 6 0 3
v 6 4 3
v 12 0 3
v 12 4 3
f 1 2 3 4
f 2 5 6 3
f 5 7 8 6
"""

STEEP_CASE = """
[building]
mesh = "steep.obj"
[[building.exits]]
name = "e"
segment = [[0, 1], [0, 2]]
z = 0.0
[[people]]
name = "a"
positions = [[10, 2]]
z = 3.0
[contact]
model = "nsm2"
"""


def test_an_error_brings_the_warnings_that_may_be_its_cause(evac, tmp_path, capsys):
    (tmp_path / "steep.obj").write_text(STEEP)
    (tmp_path / "case.toml").write_text(STEEP_CASE)
    assert evac("check", tmp_path / "case.toml") == 2
    out, error = capsys.readouterr()
    assert "people.a" in error
    assert out.count("floor z=0.00") == 2  # among the levels, and as the exit's
    assert "warning: " in error
    assert "50 degrees" in error


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
    assumed = [line for line in _lines(out, "assumed") if "ground" in " ".join(line)]
    assert len(assumed) == 2
    assert any("'out'" in " ".join(line) for line in assumed)
    assert any("'inner'" in " ".join(line) for line in assumed)


GAP = """
[[building.plan.storeys]]
name = "f"
polygons = ["{ground}"]
[[building.plan.exits]]
name = "x"
storey = "f"
segment = [[12, 0.5], [12, 1.7]]
[[people]]
name = "slim"
level = "f"
positions = [[1, 1]]
radius = 0.2
[[people]]
name = "wide"
level = "f"
positions = [[2, 1], [2, 2]]
radius = 0.25
[contact]
model = "nsm2"
"""


ROUND = "POLYGON ((0 0, 12 0, 12 8, 0 8, 0 0), (6 0.45, 6 6.9, 6.1 6.9, 6.1 0.45, 6 0.45))"
APART = "POLYGON ((0 0, 12 0, 12 8, 6.1 8, 6.1 0.45, 6 0.45, 6 8, 0 8, 0 0))"


@pytest.mark.parametrize(("ground", "warnings"), [(ROUND, 1), (APART, 2)])
def test_warns_of_a_gap_that_some_fit_through_and_of_people_without_another(evac, tmp_path, capsys, ground, warnings):
    case = tmp_path / "case.toml"
    case.write_text(GAP.format(ground=ground))
    assert evac("check", case) == 0
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert len(lines) == warnings
    assert "0.45 m wide, a wall for 2 of 3 people" in lines[0]
    times = {row[0]: row[3:] for row in (_lines(out, "slim")[0], _lines(out, "wide")[0])}
    assert ("All can reach an exit" in out) == (warnings == 1)
    if warnings == 2:
        assert "people.wide: 2 of 2 people (0.50 m wide)" in lines[1]
        assert "inf" in times["wide"][0]


@pytest.mark.parametrize("name", ["", "people.csv", "summary.json", "trajectory.evac"])
def test_a_result_is_verified_whole(tmp_path, capsys, name):
    evac.run(evac.load("square_room", {"simulation.duration": 0.3, "output.picture": False}), tmp_path / "r")
    if name:
        data = bytearray((tmp_path / "r" / name).read_bytes())
        data[20] ^= 1
        (tmp_path / "r" / name).write_bytes(data)
    assert main(["check", str(tmp_path / "r")]) == (2 if name else 0)
    lines = capsys.readouterr().out.splitlines()
    assert name in {line.split()[0] for line in lines if "damaged" in line} | ({""} if not name else set())
    assert any(line.split()[:2] == ["egress.csv", "whole"] for line in lines)
