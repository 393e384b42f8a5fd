"""The plan that an import writes can be edited, and importing again keeps it."""

import pytest

from evac import BuildingError, Plan, import_building, read_building
from evac.building.plan.plantable import plan_text, table_of

pytestmark = pytest.mark.usefixtures("unpictured")

#: Two rooms with a wall between them, and an upper storey without a stair.
ROOM, OTHER = [[0, 0], [8, 0], [8, 6], [0, 6]], [[8.2, 0], [14, 0], [14, 6], [8.2, 6]]


def write(path, *, door=3.0, upper=True):
    plan = Plan()
    plan.storey("ground", [ROOM, OTHER])
    if upper:
        plan.storey("first", ROOM, z=3.0)
    plan.door("door", "ground", [(8.1, door), (8.1, door + 1.0)])
    plan.exit("main", "ground", [(0, 3), (0, 4.2)])
    plan.area("office", "ground", OTHER)
    path.write_text(plan_text(table_of(plan)), encoding="utf-8")
    return path


def edit(folder, before, after):
    file = folder / "building.plan.toml"
    text = file.read_text(encoding="utf-8")
    assert before in text
    file.write_text(text.replace(before, after), encoding="utf-8")


STAIR = """
[[stairs]]
name = "new"
lower = "ground"
lower_edge = [[2, 1], [2, 2.2]]
upper = "first"
length = 5.0
direction = [1, 0]
"""


def test_what_an_import_lacks_is_added_to_its_plan(tmp_path):
    path = write(tmp_path / "a.plan.toml")
    made = import_building([path], tmp_path / "case", people=4)
    assert (made.is_accepted, (made.folder / "case.toml").exists()) == (False, False)
    file = made.folder / "building.plan.toml"
    text = file.read_text(encoding="utf-8").replace("[[doors]]", "# seen on site\n[[doors]]") + STAIR
    file.write_text(text, encoding="utf-8")
    path.unlink()  # it is not read again
    for _ in range(2):
        again = import_building([path], tmp_path / "case", people=4, exits=[1])
        assert (again.is_accepted, again.fault) == (True, "")
        assert list(again.building.stairs) == ["new"]
        warnings = [one.text.split()[:2] for one in again.findings if one.kind == "warning"]
        assert warnings == [["building.plan.toml", "has"], ["'exit", "1':"]]
        assert file.read_text(encoding="utf-8") == text
    file.unlink()
    write(path, upper=False)
    assert import_building([path], tmp_path / "case").building.stairs == {}


@pytest.mark.parametrize("name", ["a.plan.toml", "a.msh"])
def test_the_plan_gives_the_building_that_was_imported(tmp_path, name):
    plan = Plan()
    plan.storey("ground", ROOM)
    plan.storey("first", [[13, 0], [16, 0], [16, 6], [13, 6]], z=3.0)
    plan.flight("up", [(8, 1), (8, 2.5)], 0.0, [(10, 1), (10, 2.5)], 1.2)
    plan.flight("up", [(10, 1), (10, 2.5)], 1.2, [(13, 1.2), (13, 2.5)], 3.0)
    plan.exit("main", "ground", [[(0, 3), (0, 4.2)], [(0, 5), (0, 6)]])
    if name.endswith("msh"):
        plan.write(tmp_path / name)
    else:
        (tmp_path / name).write_text(plan_text(table_of(plan)), encoding="utf-8")
    made = import_building([tmp_path / name], tmp_path / "case")
    one, other = read_building(tmp_path / name), read_building(made.folder / "building.plan.toml")
    assert {level.name: round(level.polygon.area, 6) for level in one.levels} == {
        level.name: round(level.polygon.area, 6) for level in other.levels
    }
    assert [(way.name, way.width) for way in one.exits] == [(way.name, way.width) for way in other.exits]
    assert one.stairs == other.stairs


def test_an_opening_of_a_part_of_a_storey_becomes_an_exit_of_the_storey(tmp_path):
    plan = Plan()
    plan.storey("Level (1)", [ROOM, OTHER])
    plan.exit("main", "Level (1)", [(0, 3), (0, 4.2)])
    plan.opening("Level (1)", [(14, 3), (14, 4)])  # without a name
    path = tmp_path / "a.plan.toml"
    path.write_text(plan_text(table_of(plan)), encoding="utf-8")
    made = import_building([path], tmp_path / "case", partial=True)
    (number, *_) = [one.number for one in made.openings if one.level == "Level (1) (2)"]
    again = import_building([path], tmp_path / "case", exits=[number])
    assert (again.is_accepted, again.fault, len(again.building.exits)) == (True, "", 2)


def test_a_floor_that_slopes_has_no_plan_and_takes_no_edits_away(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    corners = "v 0 0 0\nv 8 0 0.1\nv 8 6 0.1\nv 0 6 0\nf 1 2 3 4\n"
    (tmp_path / "slope.obj").write_text(corners, encoding="utf-8")
    made = import_building([tmp_path / "slope.obj"], tmp_path / "case", exits=[1])
    (tmp_path / "case" / "case.toml").write_text((made.folder / "case.toml").read_text().replace("1200", "900"))
    again = import_building([tmp_path / "slope.obj"], tmp_path / "case", exits=[2])
    assert [one.kind for one in again.findings if "'exit 2'" in one.text] == ["warning"]
    (tmp_path / "case" / "case.toml").unlink()
    assert (made.fault, (made.folder / "building.msh").exists()) == ("", True)
    import_building([path], tmp_path / "case")
    assert not (made.folder / "building.msh").exists()


def test_a_changed_plan_that_is_wrong_is_named_and_stays(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    made = import_building([path], tmp_path / "case")
    edit(made.folder, "[[exits]]", "[[exits")
    with pytest.raises(BuildingError, match=r"case.building\.plan\.toml: .*invalid TOML"):
        import_building([path], tmp_path / "case")
    assert "[[exits\n" in (made.folder / "building.plan.toml").read_text(encoding="utf-8")
