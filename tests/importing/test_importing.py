"""Files become cases that run, with a report of everything assumed; folders that are not ours are left alone."""

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity

import evac
from evac import BuildingError, ScenarioError, import_building, read_building
from evac.building.model.findings import FINDING_KINDS
from evac.directions.build import least_spacing
from evac.importing.rooms import fill, find_openings, find_rooms

pytestmark = pytest.mark.usefixtures("unpictured")

ROOM = "POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0))"
#: Three rooms along a corridor, with walls of 0.1 m.
ROOMS = shapely.union_all([shapely.box(0, 0, 9, 2), *(shapely.box(3.05 * k, 2.1, 3.05 * k + 2.9, 6) for k in range(3))])


@pytest.fixture
def room(tmp_path):
    (tmp_path / "room.wkt").write_text(ROOM, encoding="utf-8")
    return tmp_path / "room.wkt"


@pytest.fixture
def house(tmp_path):
    plan = evac.Plan()
    plan.storey("ground", shapely.box(0, 0, 12, 6))
    plan.storey("first", shapely.box(0, 0, 12, 6), z=3.0)
    plan.storey("attic", shapely.box(0, 0, 4, 4), z=6.0)
    plan.exit("door", "ground", [(0, 3), (0, 4)])
    plan.area("office", "first", shapely.box(9, 0, 12, 6))
    plan.area("store", "first", shapely.box(9, 0, 9.5, 0.5))
    plan.obstacle("table", "first", shapely.box(10, 1, 11, 2))
    plan.stair("main", "ground", [(2, 1), (2, 2.5)], "first", length=6.0, direction=(1, 0))
    plan.write(tmp_path / "house.msh")
    return tmp_path / "house.msh"


def rooms_of_ground(*ground):
    """Return a building of one room of a given ground [m2] on each storey."""
    plan = evac.Plan()
    for number, area in enumerate(ground):
        plan.storey(f"{number}", shapely.box(0, 0, area / 2, 2), z=3.0 * number)
    return plan.building(need_exit=False)


def text_of(made, name):
    return (made.folder / name).read_text(encoding="utf-8")


def test_without_an_exit_openings_are_offered(room, tmp_path):
    made = import_building([room], tmp_path / "case")
    assert "exit" in made.fault
    assert [(one.number, one.width) for one in made.openings] == [(1, 6.0), (2, 6.0), (3, 4.0), (4, 4.0)]
    assert "| 3 | floor | 4.00 |" in text_of(made, "report.md")
    assert "# [[building.exits]]" in text_of(made, "case.toml")
    with pytest.raises(BuildingError, match="exit"):
        evac.run(evac.load(made.folder))


def test_rooms_of_a_use_have_one_group(tmp_path):
    plan = evac.Plan()
    plan.storey("ground")
    for k, use in enumerate(["office", "office", "hall", "hall", "store"]):
        plan.room(f"{k}", "ground", shapely.box(6 * k, 0, 6 * k + 6, 5), use=use)
    plan.exit("door", "ground", [(0, 2), (0, 3)])
    plan.write(tmp_path / "a.plan.toml")
    made = import_building([tmp_path / "a.plan.toml"], tmp_path / "case")
    assert [(room.name, room.number) for room in made.rooms] == [("0", 5), ("1", 5), ("2", 3), ("3", 3), ("4", 3)]
    case = evac.load(made.folder)
    assert {group.name: (group.use, group.area, group.number) for group in case.people} == {
        "office": ("office", None, 10), "hall": ("hall", None, 6), "4": (None, "4", 3),
    }  # fmt: skip


def test_the_chosen_openings_become_exits_and_the_case_runs(room, tmp_path):
    import_building([room], tmp_path / "case")
    made = import_building([room], tmp_path / "case", exits=[3], people=5)
    assert made.fault == ""
    results = evac.run(evac.load(made.folder))
    assert (results.evacuated, list(results.exits)) == (5, ["exit 3"])
    case = tomllib.loads(text_of(made, "case.toml"))
    assert "walking" in case["behaviours"]
    with pytest.raises(ScenarioError, match="1 to 4"):
        import_building([room], tmp_path / "case", exits=[5])


def test_inner_walls_are_no_openings():
    plan = evac.Plan()
    plan.storey("floor", list(ROOMS.geoms))
    for k in range(3):
        plan.door(f"{k}", "floor", [(3.05 * k + 1, 2), (3.05 * k + 2, 2)])
    openings = find_openings(plan.building(need_exit=False), ())
    assert len(openings) == 8
    hull = shapely.box(0, 0, 9, 6).exterior
    middles = [shapely.Point((one.segment[:2] + one.segment[2:]) / 2) for one in openings]
    assert all(hull.distance(middle) < 0.01 for middle in middles)


def test_ways_through_outer_walls_are_the_first_openings():
    plan = evac.Plan()
    plan.storey(
        "floor", shapely.union_all([shapely.box(0, 0, 9, 6), shapely.box(4, -0.3, 5, 0), shapely.box(9, 0, 12, 3)])
    )
    first, second, *_ = find_openings(plan.building(need_exit=False), ())
    assert np.allclose(np.sort(first.segment), [-0.3, -0.3, 4.0, 5.0])
    assert second.width == pytest.approx(9.0)


def test_everything_in_a_file_is_kept(house, tmp_path):
    made = import_building([house], tmp_path / "case", density=0.05, partial=True)
    one, other = read_building(house), read_building(made.folder / "building.plan.toml")
    assert [(level.name, level.kind) for level in one.levels] == [(level.name, level.kind) for level in other.levels]
    assert [way.name for way in other.exits] == ["door"]
    assert {area.name: area.polygon.area for area in other.areas} == {
        area.name: area.polygon.area for area in one.areas
    }
    assert np.allclose(one.walls, other.walls)
    assert {room.name: room.number for room in made.rooms} == {"ground": 3, "office": 1, "store": 1, "attic": 0}
    assert '# [[people]]\n# name = "attic"' in text_of(made, "case.toml")
    levels = re.findall(r"^\| (\w+) \| (floor|stair) \| ([\d.]+) \|", text_of(made, "report.md"), re.MULTILINE)
    assert sorted(levels) == [
        *(("attic", "floor", "6.00"), ("first", "floor", "3.00"), ("ground", "floor", "0.00")),
        ("main", "stair", "0.00"),
    ]
    kinds = [finding.kind for finding in made.findings]
    assert kinds == sorted(kinds, key=FINDING_KINDS.index)
    assert made.fault.startswith(str(made.folder)) or made.fault == ""


def test_an_incomplete_building_is_refused_with_report_and_picture(house, tmp_path):
    import_building([house], tmp_path / "case", partial=True)
    made = import_building([house], tmp_path / "case")
    assert (made.is_accepted, len(made.missing)) == (False, 1)
    assert made.missing[0].startswith("1 of 3 storeys has no way out: 'attic'")
    assert not (made.folder / "case.toml").exists()
    assert (made.folder / "levels.png").exists()
    assert made.missing[0] in text_of(made, "report.md")
    again = import_building([house], tmp_path / "case", partial=True)
    assert again.is_accepted


def test_a_partial_import_is_a_quality_warning_of_every_run(house, tmp_path):
    made = import_building([house], tmp_path / "case", people=3, partial=True)
    case = evac.load(made.folder)
    assert case.building.missing == made.missing
    results = evac.run(case, tmp_path / "result")
    assert [made.missing[0] in one for one in results.quality_warnings] == [True]
    assert made.missing[0] in (tmp_path / "result" / "summary.json").read_text(encoding="utf-8")


def test_a_closet_without_a_door_leaves_the_building_whole(tmp_path):
    plan = evac.Plan()
    plan.storey("ground", [shapely.box(0, 0, 20, 10), shapely.box(20.1, 0, 21.5, 2)])
    plan.exit("door", "ground", [(0, 3), (0, 4)])
    plan.write(tmp_path / "a.msh")
    assert import_building([tmp_path / "a.msh"], tmp_path / "closet").missing == ()
    plan.obstacle("shelf", "ground", shapely.box(2, 0, 3, 10))
    plan.write(tmp_path / "a.msh")
    (text,) = import_building([tmp_path / "a.msh"], tmp_path / "shelf").missing
    assert text.startswith("172.8 m2 of ground (90 %)")


def test_people_are_divided_by_the_ground_of_the_rooms(house, tmp_path):
    made = import_building([house], tmp_path / "case", people=101)
    assert sum(one.number for one in made.rooms) == 101


def test_rooms_of_a_plan_have_the_people_that_they_state_or_the_load_of_their_use(tmp_path):
    plan = evac.Plan()
    plan.storey("ground")
    for k, given in enumerate(({"use": "office"}, {"use": "stair"}, {"people": 3}, {"use": "chapel"})):
        plan.room(f"{k}", "ground", shapely.box(6 * k, 0, 6 * k + 6, 6), **given)
    plan.exit("out", "ground", [(0, 1), (0, 3)])
    plan.write(tmp_path / "house.plan.toml")
    made = import_building([tmp_path / "house.plan.toml"], tmp_path / "case")
    assert {one.name: one.number for one in made.rooms} == {"0": 6, "1": 0, "2": 3, "3": 4}
    made = import_building([tmp_path / "house.plan.toml"], tmp_path / "other", density=0.5)
    assert {one.name: one.number for one in made.rooms} == {"0": 18, "1": 0, "2": 18, "3": 18}


@pytest.mark.parametrize(("density", "people"), [(0.1, [1, 1, 2, 3]), (0.2, [1, 3, 4, 5])])
def test_numbers_of_people_are_rounded_to_the_nearest_but_no_room_is_empty(density, people):
    building = rooms_of_ground(4.0, 13.0, 18.0, 27.0)
    rooms = fill(building, find_rooms(building), None, density, {})
    assert [room.number for room in rooms] == people
    areas = [replace(room, key="area") for room in rooms]
    rooms = fill(building, areas, None, density, {areas[0].name: 7.6, areas[1].name: 0.0})
    assert [room.number for room in rooms] == [8, 0, *people[2:]]


def test_people_who_are_left_after_division_go_where_the_remainder_is_largest():
    building = rooms_of_ground(4.0, 10.0, 18.0)
    for people, numbers in ((8, [1, 3, 4]), (16, [2, 5, 9]), (3, [0, 1, 2])):
        rooms = fill(building, find_rooms(building), people, 0.1, {})
        assert [room.number for room in rooms] == numbers


def test_several_files_are_storeys(tmp_path):
    for name in ("ground", "first"):
        (tmp_path / f"{name}.wkt").write_text(ROOM, encoding="utf-8")
    files = [tmp_path / "ground.wkt", tmp_path / "first.wkt"]
    made = import_building(files, tmp_path / "case", exits=[1], people=4)
    assert [(level.name, level.z_min) for level in made.building.levels] == [("ground", 0.0), ("first", 3.0)]
    assert [one.kind for one in made.findings if one.level == "first"].count("assumed") == 1
    made = import_building(files, tmp_path / "other", z=[-1.0, 2.5], exits=[1], people=4)
    assert [level.z_min for level in made.building.levels] == [-1.0, 2.5]
    with pytest.raises(ScenarioError, match="heights"):
        import_building(files, tmp_path / "third", z=[1.0])


def test_options_reach_importer_and_building_and_are_written_down(tmp_path):
    (tmp_path / "mm.wkt").write_text("POLYGON ((0 0, 6000 0, 6000 4000, 0 4000, 0 0))", encoding="utf-8")
    options = {"unit": 0.001, "storey": 'ground "0"', "weld": 0.002}
    made = import_building([tmp_path / "mm.wkt"], tmp_path / "case", options=options, exits=[1], people=3)
    assert made.building.levels[0].polygon.area == pytest.approx(24.0)
    assert "unit = 0.001" in text_of(made, "case.toml")
    assert "weld = 0.002" in text_of(made, "case.toml")
    assert evac.run(evac.load(made.folder)).evacuated == 3
    with pytest.raises(ScenarioError, match=r"'untit'.*'unit'"):
        import_building([tmp_path / "mm.wkt"], tmp_path / "case", options={"untit": 1})


def test_the_scale_of_a_mesh_is_applied_once(tmp_path):
    lines = ["v 0 0 0", "v 6000 0 0", "v 6000 4000 0", "v 0 4000 0", "f 1 2 3 4"]
    (tmp_path / "mm.obj").write_text("\n".join(lines), encoding="utf-8")
    made = import_building([tmp_path / "mm.obj"], tmp_path / "case", options={"scale": 0.001}, exits=[1], people=3)
    assert made.building.levels[0].polygon.area == pytest.approx(24.0)
    assert made.fault == ""


def test_folders_that_are_not_ours_and_cases_that_are_changed_are_left_alone(room, tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "thesis.txt").write_text("years of work", encoding="utf-8")
    with pytest.raises(ScenarioError, match="own"):
        import_building([room], tmp_path / "own")
    made = import_building([room], tmp_path / "case")
    (made.folder / "case.toml").write_text("title = 'mine'", encoding="utf-8")
    for _ in range(2):
        again = import_building([room], tmp_path / "case")
        assert [one.text for one in again.findings if "case.toml" in one.text]
    assert text_of(made, "case.toml") == "title = 'mine'"


@pytest.mark.parametrize("scale", [1.0, 0.001])
def test_openings_that_an_importer_names_come_before_outer_edges(tmp_path, scale):
    ground = shapely.affinity.scale(shapely.from_wkt(ROOM), 1 / scale, 1 / scale, origin=(0, 0))
    line = {"type": "LineString", "coordinates": [[6.0 / scale, 1.0 / scale], [6.0 / scale, 2.0 / scale]]}
    features = [
        {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(ground)},
        {"type": "Feature", "properties": {"kind": "opening"}, "geometry": line},
    ]
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    options = {"scale": scale}
    made = import_building([tmp_path / "a.geojson"], tmp_path / "case", exits=[1], people=2, options=options)
    assert [one.width for one in made.openings] == pytest.approx([1.0])
    assert np.allclose(np.sort(made.openings[0].segment), [1.0, 2.0, 6.0, 6.0])
    assert (made.fault, made.building.exits[0].width) == ("", pytest.approx(1.0))


@pytest.mark.parametrize("name", ['Saal "Blau"', 'A101 12"', "back\\", "a\nb", "n" * 5000, "\x01", "\ud800"])
def test_rooms_of_any_name_are_imported_and_run(name, tmp_path):
    square = [[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]]
    shapes = [({}, "Polygon", [square]), ({"kind": "area", "name": name}, "Polygon", [square])]
    shapes.append(({"kind": "exit", "name": name}, "LineString", [[0, 1], [0, 2]]))
    features = [
        {"type": "Feature", "properties": of, "geometry": {"type": kind, "coordinates": at}} for of, kind, at in shapes
    ]
    (tmp_path / "p.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    made = import_building([tmp_path / "p.geojson"], tmp_path / "case", people=3)
    assert made.fault == ""
    assert [room.name for room in made.rooms] == list(made.building.exits[0].name.splitlines())
    results = evac.run(evac.load(made.folder, {"output.animation": True}), tmp_path / "r")
    assert results.evacuated == 3
    assert (tmp_path / "r" / "animation.pvd").is_file()


def test_wide_buildings_get_a_spacing_with_which_they_run(room, tmp_path, monkeypatch):
    monkeypatch.setattr("evac.directions.build.MOST_BYTES", 300_000.0)
    made = import_building([room], tmp_path / "case", exits=[1])
    assert not made.fault
    spacing = tomllib.loads(text_of(made, "case.toml"))["directions"]["spacing"]
    assert spacing == np.ceil(100.0 * least_spacing(made.building, 1)) / 100.0 > 0.1
    assert [one.kind for one in made.findings if f"{spacing:g} m" in one.text] == ["assumed"]
    assert import_building([room], tmp_path / "fine", exits=[1], spacing=0.05).fault
    neck = "POLYGON ((0 0, 6 0, 6 4, 3.1 4, 3.1 0.45, 3 0.45, 3 4, 0 4, 0 0))"  # which some are too wide for
    room.write_text(neck, encoding="utf-8")
    made = import_building([room], tmp_path / "neck", exits=[3])
    assert tomllib.loads(text_of(made, "case.toml"))["directions"]["spacing"] > spacing


def test_a_case_that_runs_with_its_own_spacing_only_can_be_run(tmp_path):
    plan = evac.Plan()
    plan.storey("ground", shapely.box(0, 0, 6, 4))
    plan.exit("exit", "ground", [(0, 1), (0, 1.9)])
    plan.write(tmp_path / "room.plan.toml")
    made = [import_building([tmp_path / "room.plan.toml"], tmp_path / f"{w}", spacing=w) for w in (0.3, 0.5)]
    assert not made[0].fault
    assert "directions.spacing: exit 'exit'" in made[1].fault


def test_a_failed_import_leaves_nothing_in_the_way(room, tmp_path, monkeypatch):
    def fail(*given):
        raise BuildingError("fails")

    import_building([room], tmp_path / "old", people=5)
    before = {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr("evac.importing.importing.find_openings", fail)
        for name in ("new", "old"):
            with pytest.raises(BuildingError, match="fails"):
                import_building([room], tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {"room.wkt", "old"}
    assert {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()} == before
    import_building([room], tmp_path / "new", exits=[1])
    assert {path.name for path in (tmp_path / "new").iterdir()} == set(before)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"density": 1e308}, "density"),
        ({"density": float("nan")}, "density"),
        ({"options": {"weld": 1e308}}, "weld"),
        ({"options": {"scale": float("inf")}}, "scale"),
    ],
)
def test_numbers_beyond_any_building_are_refused(room, tmp_path, given, words):
    with pytest.raises(ScenarioError, match=words):
        import_building([room], tmp_path / "case", **given)
    assert not (tmp_path / "case").exists()
