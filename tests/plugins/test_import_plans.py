"""Importers that return plans: WKT, GeoJSON and plan files."""

import json

import numpy as np
import pytest

import evac
from evac import BuildingError, read_building
from evac.building.model.findings import account
from evac.contract.registry import Registry, built_in

REGISTRY = Registry(builtins=built_in("importer"))


def building_of(path, text, importer=None, **parameters):
    path.write_text(text, encoding="utf-8")
    if not parameters:
        return read_building(path, need_exit=False)
    return REGISTRY.importer_for(path)(**parameters).read(path).building(need_exit=False)


ROOM = "POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))"


@pytest.mark.parametrize(
    ("text", "area"),
    [
        (ROOM, 12.0),
        ("POLYGON\n((0 0, 4 0,\n4 3, 0 3,\n0 0))\n", 12.0),
        ("GEOMETRYCOLLECTION (GEOMETRYCOLLECTION (POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))), POINT (1 1))", 12.0),
        (f"{ROOM}\n# a comment\nPOLYGON ((2 0, 6 0, 6 3, 2 3, 2 0))\n", 18.0),
        (f"SRID=25832;{ROOM}", 12.0),
        ("MULTIPOLYGON (((0 0, 4 0, 4 3, 0 3, 0 0), (1 1, 2 1, 2 2, 1 2, 1 1)))", 11.0),
        ("POLYGON Z ((0 0 5, 4 0 5, 4 3 5, 0 3 5, 0 0 5))", 12.0),
    ],
)
def test_wkt(tmp_path, text, area):
    building = building_of(tmp_path / "a.wkt", text)
    assert [(level.name, level.polygon.area) for level in building.levels] == [("floor", area)]


def test_elements_of_wkt_are_accounted_for(tmp_path):
    building = building_of(tmp_path / "a.wkt", f"{ROOM}\nPOINT (1 1)\nLINESTRING (0 0, 1 1)\nPOINT (2 2)")
    rows = {kind: (read, lost) for kind, read, lost, _ in account(building.findings)}
    assert rows == {"Polygon": (1, 0), "Point": (0, 2), "LineString": (0, 1)}


def test_options_of_wkt(tmp_path):
    text = "MULTIPOLYGON (((0 0, 4000 0, 4000 3000, 0 3000, 0 0)), ((4000 0, 8000 0, 8000 3000, 4000 3000, 4000 0)))"
    building = building_of(tmp_path / "a.wkt", text, unit=0.001, storey="ground", z=-3.5, wall=0.2)
    assert {level.z_min for level in building.levels} == {-3.5}
    assert [level.name for level in building.levels] == ["ground", "ground (2)"]
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(24.0 - 0.6)


def feature(kind, coordinates, of="Polygon", **properties):
    properties = {"kind": kind, **properties} if kind else properties
    return {"type": "Feature", "properties": properties, "geometry": {"type": of, "coordinates": coordinates}}


def rectangle(x1, y1, x2, y2):
    return [[[x1, y1], [x2, y1], [x2, y2], [x1, y2], [x1, y1]]]


def collection(*features):
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


def test_features_of_geojson(tmp_path):
    text = collection(
        feature("", rectangle(0, 0, 6, 4), name="hall"),
        feature("storey", rectangle(6.2, 0, 9, 4), level=0),
        feature("door", [[6.1, 1], [6.1, 2]], "LineString"),
        feature("", [[0, 1], [0, 2]], "LineString", name="main"),
        feature("area", rectangle(1, 1, 3, 3), name="stage"),
        feature("obstacle", rectangle(4, 1, 5, 2)),
        feature("storey", rectangle(0, 0, 9, 4), level=1, z=3.5),
    ).replace('"level": 0', '"level": "floor"')
    building = building_of(tmp_path / "a.geojson", text)
    assert [(level.name, level.z_min) for level in building.levels] == [("floor", 0.0), ("1", 3.5)]
    assert building.levels[0].polygon.area == pytest.approx(24.0 + 11.2 + 0.2 - 1.0)
    assert [way.name for way in building.exits] == ["main"]
    assert [area.name for area in building.areas] == ["stage"]


@pytest.mark.parametrize("wall", [0.0, 0.2])
def test_doors_between_polygons_of_geojson_that_touch_are_in_walls(tmp_path, wall):
    door, rooms = feature("door", [[4, 1], [4, 2]], "LineString"), [rectangle(0, 0, 4, 3), rectangle(4, 0, 8, 3)]
    text = collection(*(feature("", one) for one in rooms), door)
    building = building_of(tmp_path / "a.geojson", text, wall=wall)
    # 24 m2 less the wall of 3 m, of which 1 m is a door; 0.1 m thick unless it is given.
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(24.0 - (wall or 0.1) * 2.0)
    assert any(one.kind == "assumed" and "walls of 0.1 m" in one.text for one in building.findings) == (not wall)


def test_degrees_become_metres(tmp_path):
    corners = np.array(rectangle(0, 0, 1, 1)[0]) * [1e-4, 2e-4] + [13.4, 52.5]
    building = building_of(tmp_path / "a.geojson", collection(feature("", [corners.tolist()])))
    # The length of a degree on the ellipsoid at 52.5 degrees: 67,906 m of longitude, 111,277 m of latitude.
    width, depth = np.ptp(building.vertices[:, :2], axis=0)
    assert (width, depth) == pytest.approx((6.7906, 22.2554), rel=1e-3)
    assert any(one.kind == "assumed" and "longitude" in one.text for one in building.findings)


def test_unknown_properties_are_refused_by_naming_them(tmp_path):
    with pytest.raises(BuildingError, match=r"properties colour, use, .*IMDF.*kind"):
        building_of(tmp_path / "a.geojson", collection(feature("", rectangle(0, 0, 4, 4), use="a", colour="b")))


def test_named_polygons_of_geojson_are_rooms(tmp_path):
    offices = [feature("", rectangle(4.0 * k, 0, 4.0 * k + 4.0, 3), name=name) for k, name in enumerate("abb")]
    (tmp_path / "a.geojson").write_text(collection(*offices), encoding="utf-8")
    plan = REGISTRY.importer_for(tmp_path / "a.geojson")(wall=0.1).read(tmp_path / "a.geojson")
    assert [room.name for room in plan.rooms] == ["a"]  # the others are not told apart by their name
    assert [level.polygon.area for level in plan.building(need_exit=False).levels] == pytest.approx(
        [11.85, 11.7, 11.85]
    )


@pytest.mark.parametrize(("side", "lost"), [(0.2, "left out"), (1.0, "missing")])
def test_features_of_unknown_kinds_are_accounted_for(tmp_path, side, lost):
    text = collection(
        feature("room", rectangle(0, 0, 4, 3), name="a"),
        feature("corridor", rectangle(4.2, 0, 8, 3), name="b"),
        feature("door", [[4.1, 1], [4.1, 1.4], [4.1, 1.9]], "LineString"),
        feature("handrail", [[5, 1], [6, 1]], "LineString"),
        feature("carpet", rectangle(5, 1, 5 + side, 1 + side)),
        feature("", [5, 1], "Point"),
    )
    building = building_of(tmp_path / "a.geojson", text)
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(4 * 3 + 3.8 * 3 + 0.2 * 0.9)
    kinds = {one.element: one.kind for one in building.findings if "is none of" in one.text}
    assert kinds == {"handrail": "left out", "carpet": lost, "point": "left out"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "JSON"),
        ("[]", "GeoJSON"),
        ('{"type": "FeatureCollection"}', "features"),
        ('{"type": "FeatureCollection", "features": []}', "feature"),
        (collection(feature("stoory", rectangle(0, 0, 1, 1))), "feature 1: .*'stoory'.*'storey'"),
        (collection(feature("", [[0, 0], [0, 1]], "LineString")), "ground"),
        (collection(feature("", rectangle(0, 0, 1, 1), z=1), feature("", rectangle(0, 0, 1, 1), z=2)), "one height z"),
        (collection(feature("", rectangle(0, 0, 1, 1), z="high")), "feature 1: z"),
        (collection(feature("", [[0, 0]])), "feature 1"),
    ],
)
def test_wrong_geojson_is_refused(tmp_path, text, message):
    with pytest.raises(BuildingError, match=rf"a\.geojson: .*{message}"):
        building_of(tmp_path / "a.geojson", text)


PLAN = """
[[storeys]]
name = "ground"
file = "ground.wkt"

[[storeys]]
name = "first"
z = 3.0
file = "first.geojson"
options = { unit = 0.001 }

[[stairs]]
name = "main"
lower = "ground"
lower_edge = [[4, 1], [4, 2.5]]
upper = "first"
length = 5
"""


@pytest.fixture
def plan_file(tmp_path):
    (tmp_path / "ground.wkt").write_text(ROOM, encoding="utf-8")
    shapes = feature("", rectangle(9000, 0, 14000, 3000)), feature("", [[14000, 1000], [14000, 2000]], "LineString")
    (tmp_path / "first.geojson").write_text(collection(*shapes), encoding="utf-8")
    (tmp_path / "house.plan.toml").write_text(PLAN, encoding="utf-8")
    return tmp_path / "house.plan.toml"


def test_a_plan_file_with_a_file_for_each_storey(plan_file):
    building = read_building(plan_file)
    assert [(level.name, round(level.polygon.area, 6)) for level in building.levels] == [
        ("ground", 12.0), ("main flight z=0.00..3.00", 7.5), ("first", 15.0),
    ]  # fmt: skip
    assert [(way.name, way.level) for way in building.exits] == [("exit 1", 2)]


def test_a_plan_in_a_case_reads_its_files_beside_it(plan_file):
    text = PLAN.replace("\n[[", "\n[[building.plan.")
    case = f'{text}\n[[people]]\nname = "people"\nlevel = "ground"\nnumber = 3\n[contact]\nmodel = "nsm2"\n'
    (plan_file.parent / "case.toml").write_text(case, encoding="utf-8")
    assert evac.run(evac.load(plan_file.parent)).evacuated == 3


def test_what_is_wrong_with_the_file_of_a_storey_is_told_with_both(plan_file):
    (plan_file.parent / "ground.wkt").write_text("POLYGON ((0 0", encoding="utf-8")
    with pytest.raises(BuildingError, match=r"house\.plan\.toml: storey 'ground': .*ground\.wkt"):
        read_building(plan_file)
    (plan_file.parent / "ground.wkt").unlink()
    with pytest.raises(BuildingError, match=r"house\.plan\.toml: storey 'ground': .*ground\.wkt: "):
        read_building(plan_file)


def test_the_line_of_a_plan_file_that_is_no_toml_is_quoted(tmp_path):
    path = tmp_path / "house.plan.toml"
    path.write_text("[[storeys]]\nname = open plan\n", encoding="utf-8")
    with pytest.raises(BuildingError, match=r'house\.plan\.toml: .*name = "open plan"'):
        evac.read_building(path)


def features_of(*features):
    rows = [
        {
            "type": "Feature",
            "properties": own,
            "geometry": {"type": kind, "coordinates": [place] if kind == "Polygon" else place},
        }
        for own, kind, place in features
    ]
    return json.dumps({"type": "FeatureCollection", "features": rows})


def square(x1, y1, x2, y2):
    return [[x1, y1], [x2, y1], [x2, y2], [x1, y2], [x1, y1]]


def test_polygons_with_a_height_are_obstacles_and_exits_may_have_several_sides(tmp_path):
    text = features_of(
        ({"level": 1, "height": 0, "base_height": 0}, "Polygon", square(0, 0, 10, 8)),
        ({"level": 1, "height": 3, "base_height": 0}, "Polygon", square(4, 0, 4.2, 6)),
        ({"level": 1, "height": 3, "base_height": 2.2}, "Polygon", square(4, 6, 4.2, 8)),
        ({"level": 1}, "LineString", [[9, 0], [10, 0], [10, 1], [10, 2]]),
    )
    building = building_of(tmp_path / "a.geojson", text)
    assert building.levels[0].polygon.area == pytest.approx(80.0 - 0.2 * 6.0)
    assert [round(way.width, 6) for way in building.exits] == [3.0]


def test_nested_tags_corridors_and_levels_of_one_name(tmp_path):
    room = {"type": "way", "tags": {"buildingpart": "room"}, "relations": [{"reltags": {"level": "0"}}]}
    way = {"type": "way", "tags": {"highway": "footway"}, "relations": []}
    text = features_of((room, "Polygon", square(0, 0, 10, 8)), (way, "LineString", [[2, 2], [4, 2], [4, 5]]))
    building = building_of(tmp_path / "a.geojson", text, coordinates="plane")
    assert [(level.name, level.polygon.area) for level in building.levels] == [("0", pytest.approx(80.0))]
    levels = [
        ({"id": name, "ordinal": 0, "name": "Level 1"}, "Polygon", square(x, 0, x + 4, 3))
        for name, x in (("a", 0), ("b", 9))
    ]
    units = [
        ({"feature_type": "unit", "level_id": "a", "category": "room"}, "Polygon", square(0, 0, 4, 3)),
        ({"feature_type": "corridor", "level_id": "b", "category": None}, "Polygon", square(9, 0, 13, 3)),
    ]
    building = building_of(tmp_path / "b.geojson", features_of(*levels, *units), coordinates="plane")
    assert {level.name: level.z_min for level in building.levels} == {"Level 1": 0.0, "Level 1 (2)": 0.0}


def test_lines_without_a_kind_are_doors_between_rooms_and_exits_elsewhere(tmp_path):
    rooms = [square(0, 0, 20, 2), square(0, 2.1, 6, 8), square(6.1, 2.1, 20, 8)]
    lines = [[[3, 2.05], [4, 2.05]], [[10, 2.05], [11, 2.05]], [[0, 0.5], [0, 1.5]]]
    given = [({"RAUMNR": str(k)}, "Polygon", room) for k, room in enumerate(rooms)]
    building = building_of(
        tmp_path / "a.geojson", features_of(*given, *(({"fid": 1}, "LineString", one) for one in lines))
    )
    assert [way.width for way in building.doors] == [pytest.approx(1.0)] * 2
    assert [way.width for way in building.exits] == [pytest.approx(1.0)]
    assert len(building.levels) == 1


FAR_LINE = {"type": "LineString", "coordinates": [[2, 2], [1e308, 2], [4, 5]]}


@pytest.mark.parametrize(
    ("name", "text", "word"),
    [
        ("a.geojson", json.dumps(FAR_LINE), "feature 1"),
        ("a.wkt", "POLYGON ((0 0, 1e308 0, 4 5, 0 0))", "farther"),
        ("a.osm", "<osm><node id='7' lat='1e200' lon='8'/></osm>", "node 7"),
        (
            "a.xml",
            "<geometry><room id='0'><subroom id='1'><polygon><vertex px='0' py='1e99'/><vertex px='1' py='0'/>"
            "</polygon></subroom></room></geometry>",
            "two vertices",
        ),
        (
            "a.scenario",
            '{"scenario": {"topography": {"attributes": {"bounds": {"x": 0, "y": 0, "width": 1e300, "height": 9}}}}}',
            "topography",
        ),
    ],
)
def test_a_coordinate_at_which_geometry_loops_is_refused_by_its_place(tmp_path, name, text, word):
    with pytest.raises(BuildingError, match=word):
        building_of(tmp_path / name, text)
