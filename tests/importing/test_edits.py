"""The plan that an import writes can be edited, and importing again keeps the edits."""

import re
import tomllib

import pytest

from evac import Plan, ScenarioError, import_building, read_building
from evac.building.plan.plantable import table_of
from evac.importing.edits import plan_text

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
    file.write_text(file.read_text(encoding="utf-8") + STAIR, encoding="utf-8")
    again = import_building([path], tmp_path / "case", people=4)
    assert (again.is_accepted, again.fault) == (True, "")
    assert list(again.building.stairs) == ["new"]
    assert [one.text for one in again.findings if one.text.startswith("stair 'new' was added")]


def test_a_moved_door_and_a_deleted_area_stay_when_the_file_is_imported_again(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    made = import_building([path], tmp_path / "case", people=4)
    edit(made.folder, "[[8.1, 3.0], [8.1, 4.0]]", "[[8.1, 1.0], [8.1, 1.9]]")
    text = (made.folder / "building.plan.toml").read_text(encoding="utf-8")
    (made.folder / "building.plan.toml").write_text(re.sub(r"(?s)\n\[\[areas\]\].*", "", text), encoding="utf-8")
    write(path, door=4.0, upper=False)
    again = import_building([path], tmp_path / "case", people=4)
    (door,) = again.building.doors
    assert (door.width, again.building.areas) == (pytest.approx(0.9), ())
    told = [one.text for one in again.findings if "is kept" in one.text]
    assert sorted(text.split(" was ")[0] for text in told) == ["area 'office'", "door 'door'"]
    assert sum("although the file has another one now" in text for text in told) == 1


def test_edits_that_no_longer_fit_are_listed_and_the_others_kept(tmp_path):
    path = write(tmp_path / "a.plan.toml")
    made = import_building([path], tmp_path / "case", people=4)
    edit(made.folder, "[[8.1, 3.0], [8.1, 4.0]]", "[[8.1, 1.0], [8.1, 1.9]]")
    file = made.folder / "building.plan.toml"
    file.write_text(file.read_text(encoding="utf-8") + STAIR, encoding="utf-8")
    write(path, upper=False)
    again = import_building([path], tmp_path / "case", people=4)
    assert again.is_accepted
    assert [one.kind for one in again.findings if "no longer fits" in one.text] == ["warning"]
    assert again.building.doors[0].width == pytest.approx(0.9)
    text = file.read_text(encoding="utf-8")
    assert '# name = "new"' in text
    assert "stairs" not in tomllib.loads(text)


def test_comments_and_edits_that_did_not_fit_stay_in_the_plan(tmp_path):
    path = write(tmp_path / "a.plan.toml")
    file = import_building([path], tmp_path / "case", people=4).folder / "building.plan.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("[[doors]]", "# seen on site\n[[doors]]") + STAIR, encoding="utf-8")
    write(path, upper=False)
    for _ in range(2):
        import_building([path], tmp_path / "case", people=4)
        lines = file.read_text(encoding="utf-8").splitlines()
        assert [lines.count(one) for one in ("# seen on site", '# name = "new"')] == [1, 1]


def test_a_storey_goes_with_what_is_on_it_where_another_edit_no_longer_fits(tmp_path):
    path = write(tmp_path / "a.plan.toml")
    with_stair = path.read_text(encoding="utf-8") + STAIR
    path.write_text(with_stair, encoding="utf-8")
    made = import_building([path], tmp_path / "case", people=4)
    edit(made.folder, "[[8.1, 3.0], [8.1, 4.0]]", "[[8.1, 7.0], [8.1, 8.0]]")
    file = made.folder / "building.plan.toml"
    ground = re.sub(r'(?s)\[\[storeys\]\]\nname = "first".*?\n\n', "", file.read_text(encoding="utf-8"))
    file.write_text(re.sub(r"(?s)\[\[stairs\]\].*?\n\n", "", ground), encoding="utf-8")
    again = import_building([path], tmp_path / "case", people=4)
    assert [level.name for level in again.building.levels] == ["ground"]
    assert [one.text.split(" was ")[0] for one in again.findings if "no longer fits" in one.text] == ["door 'door'"]


def test_edits_stay_with_their_doors_if_the_file_has_one_more(tmp_path):
    def drawn(*doors):
        plan = Plan()
        plan.storey("ground", [ROOM, OTHER])
        for number, y in enumerate(doors, start=1):
            plan.door(f"door {number}", "ground", [(8.1, y), (8.1, y + 1.0)])
        plan.exit("main", "ground", [(0, 3), (0, 4.2)])
        path.write_text(plan_text(table_of(plan)), encoding="utf-8")

    path = tmp_path / "a.plan.toml"
    drawn(2.0, 4.0)
    made = import_building([path], tmp_path / "case")
    edit(made.folder, "[[8.1, 4.0], [8.1, 5.0]]", "[[8.1, 4.0], [8.1, 4.8]]")
    drawn(0.5, 2.0, 4.0)
    for _ in range(2):
        again = import_building([path], tmp_path / "case")
        doors = {door.name: (float(door.segment[1]), door.width) for door in again.building.doors}
        assert doors == {"door 1": (2.0, 1.0), "door 2": (4.0, pytest.approx(0.8)), "door 1 (2)": (0.5, 1.0)}


def test_a_wall_that_was_taken_away_stays_away_where_the_file_changes_other_rooms(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    made = import_building([path], tmp_path / "case")
    edit(made.folder, "polygons = [\n", 'polygons = [\n"POLYGON ((8 0, 8.2 0, 8.2 2, 8 2, 8 0))",\n')
    path.write_text(path.read_text(encoding="utf-8").replace("14 ", "16 "), encoding="utf-8")
    again = import_building([path], tmp_path / "case")
    assert again.building.levels[0].polygon.area == pytest.approx(8 * 6 + 7.8 * 6 + 0.2 * 2 + 0.2 * 1)
    assert [one for one in again.findings if "with what else the file has changed" in one.text]


def test_a_storey_is_added_as_a_file_or_as_text(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    made = import_building([path], tmp_path / "case")
    (made.folder / "roof").mkdir()
    (made.folder / "roof" / "deck.wkt").write_text("POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0))", encoding="utf-8")
    text = '\n[[storeys]]\nname = "deck"\nz = 6.0\nfile = "roof/deck.wkt"\n'
    text += '\n[[storeys]]\nname = "first"\nz = 3.0\npolygons = "POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0))"\n'
    with (made.folder / "building.plan.toml").open("a", encoding="utf-8") as file:
        file.write(text + STAIR)
    for _ in range(2):
        again = import_building([path], tmp_path / "case", partial=True)
        assert [(level.name, level.kind) for level in again.building.levels if level.kind == "floor"] == [
            ("ground", "floor"), ("first", "floor"), ("deck", "floor")
        ]  # fmt: skip
        assert not [one for one in again.findings if "no longer fits" in one.text]


def test_edits_are_not_taken_without_the_plan_that_they_changed(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    made = import_building([path], tmp_path / "case")
    (made.folder / "imported.plan.toml").unlink()
    with pytest.raises(ScenarioError, match=r"imported\.plan\.toml: is missing"):
        import_building([path], tmp_path / "case")


def test_openings_of_a_storey_that_was_deleted_are_still_listed(tmp_path):
    path = write(tmp_path / "a.plan.toml")
    made = import_building([path], tmp_path / "case", partial=True)
    text = (made.folder / "building.plan.toml").read_text(encoding="utf-8")
    ground = re.sub(r'(?s)\[\[storeys\]\]\nname = "first".*?\n\n', "", text)
    (made.folder / "building.plan.toml").write_text(ground, encoding="utf-8")
    again = import_building([path], tmp_path / "case", partial=True)
    assert [level.name for level in again.building.levels] == ["ground"]
    assert [one.level for one in again.openings] == [one.level for one in made.openings]
    assert "first" in {one.level for one in again.openings}


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
    edit(made.folder, "[[8.1, 3.0], [8.1, 4.0]]", "[[8.1, 1.0], [8.1, 1.9]]")
    with pytest.raises(ScenarioError, match="has been changed"):
        import_building([tmp_path / "slope.obj"], tmp_path / "case")
    assert "[8.1, 1.9]" in (made.folder / "building.plan.toml").read_text(encoding="utf-8")


def test_a_plan_that_is_no_toml_is_named(tmp_path):
    path = write(tmp_path / "a.plan.toml", upper=False)
    made = import_building([path], tmp_path / "case")
    edit(made.folder, "[[exits]]", "[[exits")
    with pytest.raises(Exception, match=r"building\.plan\.toml: invalid TOML"):
        import_building([path], tmp_path / "case")
    edit(made.folder, "[[exits", "[exits]")
    with pytest.raises(Exception, match=r"building\.plan\.toml: exits must be a list"):
        import_building([path], tmp_path / "case")


@pytest.mark.parametrize("wrong", ["z = 0.0\nheight = 3", 'z = "low"', 'z = 0.0\nfile = "../other.wkt"'])
def test_an_item_that_is_wrong_does_not_take_other_edits_away(tmp_path, wrong):
    path = write(tmp_path / "a.plan.toml", upper=False)
    (tmp_path / "other.wkt").write_text("POLYGON ((0 0, 9 0, 9 9, 0 0))", encoding="utf-8")
    made = import_building([path], tmp_path / "case")
    edit(made.folder, "[[8.1, 3.0], [8.1, 4.0]]", "[[8.1, 1.0], [8.1, 1.9]]")
    edit(made.folder, "z = 0.0", wrong)
    again = import_building([path], tmp_path / "case")
    assert [one.kind for one in again.findings if "storey 'ground'" in one.text] == ["warning"]
    assert again.building.doors[0].width == pytest.approx(0.9)
