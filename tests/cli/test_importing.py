"""`evac import`, `evac new` and the picture of `evac check`, as a user calls them."""

import json
import tomllib
from pathlib import Path

import pytest
import shapely

from evac import Plan
from evac.contract.hooks import BASES

ROOM = "POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0))"


@pytest.fixture
def room(tmp_path):
    (tmp_path / "room.wkt").write_text(ROOM, encoding="utf-8")
    return "room.wkt"


def test_an_import_in_two_calls(evac, room, capsys, tmp_path):
    assert evac("import", room, "--out", "case") == 0
    out, err = capsys.readouterr()
    assert "Openings" in out
    assert "--exit" in err
    assert evac("import", room, "--out", "case", "--exit", "1,3", "--people", "7") == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "evac run case" in out
    assert evac("run", "case") == 0
    assert {path.name for path in (tmp_path / "case").iterdir()} == {
        "building.plan.toml", "case.toml", "levels.png", "report.md",
    }  # fmt: skip


def test_an_incomplete_building_is_refused_unless_it_is_wanted(evac, capsys, tmp_path):
    plan = Plan()
    for k in range(3):
        plan.storey(f"floor {k}", shapely.box(0, 0, 8, 5), z=3.0 * k)
    plan.exit("door", "floor 0", [(0, 1), (0, 2)])
    plan.write(tmp_path / "house.msh")
    assert evac("import", "house.msh", "--out", "case") == 2
    told = capsys.readouterr()
    first, *_ = told.out.splitlines()
    assert "building.plan.toml" in told.err  # where to add what is missing
    assert first == "incomplete: 2 of 3 storeys have no way out: 'floor 1', 'floor 2'"
    assert not (tmp_path / "case" / "case.toml").exists()
    assert evac("import", "house.msh", "--out", "case", "--partial") == 0
    assert capsys.readouterr().out.splitlines()[0] == first
    assert evac("run", "case") == 0
    assert first in capsys.readouterr().err.replace("the building is incomplete", "incomplete")


@pytest.fixture
def two_plans(tmp_path):
    """A drawing of two rooms side by side, of which the second one is larger."""
    drawing = pytest.importorskip("ezdxf").new()
    for x, width in ((0, 6), (20, 9)):
        corners = [(x, 1), (x, 0), (x + width, 0), (x + width, 4), (x, 4), (x, 2)]
        drawing.modelspace().add_lwpolyline(corners, dxfattribs={"layer": "walls"})
    drawing.saveas(tmp_path / "plans.dxf")


@pytest.mark.parametrize(
    ("words", "floors"),
    [(["--plan", "2"], "1, 36.0 m2"), (["--option", "plan=2,1"], "2, 60.0 m2"), ([], "2, 60.0 m2")],
)
def test_plans_of_a_drawing_are_chosen(evac, two_plans, words, floors, capsys):
    assert evac("import", "plans.dxf", "--out", "case", "--exit", "1", "--partial", *words) == 0
    assert floors in capsys.readouterr().out


def test_a_new_case_runs_at_once_and_is_not_overwritten(evac, capsys, tmp_path):
    assert evac("new", "mine") == 0
    assert evac("check", "mine") == 0
    assert evac("check", "mine/house.plan.toml") == 0
    assert capsys.readouterr().err == ""
    assert evac("run", "mine", "--set", "output.animation=false", "output.picture=false") == 0
    case = tomllib.loads((tmp_path / "mine" / "case.toml").read_text(encoding="utf-8"))
    assert {group["name"] for group in case["people"]} == {"visitors", "staff"}
    capsys.readouterr()
    assert evac("new", "mine") == 2
    assert "mine" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "preset"), [((), "measured"), (("--basis", "regulation"), "regulation")])
def test_new_cases_say_which_basis_walking_has(evac, room, tmp_path, words, preset):
    assert evac("new", "mine", *words) == 0
    assert evac("import", room, "--exit", "1", "--out", "read", *words) == 0
    for folder in ("mine", "read"):
        text = (tmp_path / folder / "case.toml").read_text(encoding="utf-8")
        assert tomllib.loads(text)["behaviours"]["walking"] == {"preset": preset}
        assert f'preset = "{preset}"  # {BASES[preset]}' in text


@pytest.mark.parametrize("ending", [".png", ".svg", ".pdf"])
def test_check_draws_the_levels(evac, ending, tmp_path):
    assert evac("check", "square_room", "--picture", f"levels{ending}") == 0
    assert (tmp_path / f"levels{ending}").stat().st_size > 1000


def test_the_picture_of_a_case_that_is_refused_is_drawn(evac, tmp_path):
    changes = ["people.people.number=2000"]
    assert evac("check", "square_room", "--picture", "levels.png", "--set", *changes) == 2
    assert (tmp_path / "levels.png").exists()


def test_errors_of_a_plan_are_printed_as_json_and_drawn(evac, capsys):
    plan = Plan()
    plan.storey("ground", [(0, 0), (9, 0), (9, 6), (0, 6)])
    plan.exit("out", "ground", [(0, 2), (0, 3)])
    plan.exit("far", "ground", [(30, 3), (30, 4)])
    plan.exit("off", "ground", [(40, 3), (40, 4)])
    plan.write("house.plan.toml")
    assert evac("check", "house.plan.toml", "--json", "--picture", "house.png") == 2
    printed = json.loads(capsys.readouterr().out)
    (error,) = [one for one in printed["findings"] if one["kind"] == "error"]
    assert (error["item"], error["storey"], error["place"]) == ("exits.far", "ground", [30.0, 3.5])
    assert [(one["item"], one["place"]) for one in error["others"]] == [("exits.off", [40.0, 3.5])]
    assert Path("house.png").exists()
    assert evac("check", "house.plan.toml") == 2
    assert "exit 'far'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--exit", "one"], "--exit one"),
        (["--exit", "1e400"], "--exit 1e400"),
        (["--exit", "1.5"], "--exit 1.5"),
        (["--z", "nan"], "--z nan"),
        (["--people", "0"], "--people"),
        (["--option", "unit"], "--option unit"),
        (["--option", "unit=-1"], "unit"),
        (["--z", "0,3"], "heights"),
        (["--exit", "9"], "exit 9"),
    ],
)
def test_wrong_arguments_are_named(evac, room, words, message, capsys):
    assert evac("import", room, "--out", "case", *words) == 2
    assert message in capsys.readouterr().err
