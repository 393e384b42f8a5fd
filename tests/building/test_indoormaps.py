"""Indoor maps: IMDF as an archive and as one file, and OpenStreetMap, with doors, exits, levels and stairs."""

import json
from zipfile import ZipFile

import pytest
from shapely import box, to_geojson, transform
from shapely.geometry import GeometryCollection, LineString, Point, Polygon

from evac import BuildingError, import_building, read_building

#: Metres to degrees of latitude near the equator, and how much longer those of longitude are.
DEGREE, EAST = 110574.27, 111319.49 / 110574.27


def feature(shape, **properties):
    geometry = json.loads(to_geojson(transform(shape, lambda metres: metres / DEGREE)))
    top = {key: properties.pop(key) for key in ("id", "feature_type") if key in properties}
    return {"type": "Feature", "geometry": geometry, "properties": properties, **top}


def collection(*features):
    return json.dumps({"type": "FeatureCollection", "features": features})


def ground(building, storey):
    return sum(
        level.polygon.area for level in building.levels if level.kind == "floor" and level.name.startswith(storey)
    )


UNITS = [
    feature(box(0, 0, 20, 3), id="u1", feature_type="unit", category="walkway", level_id="g"),
    feature(box(0, 3, 10, 9), id="u2", feature_type="unit", category="room", level_id="g", name={"ja-JP": "機械室"}),
    feature(
        GeometryCollection([box(10, 3, 20, 9), LineString([(10, 3), (20, 3)])]),
        **{"id": "u3", "feature_type": "unit", "category": "room", "level_id": "g", "name": None},
    ),
    feature(box(2, 5, 3, 6), id="u4", feature_type="unit", category="elevator", level_id="g", name=None),
]
OPENINGS = [
    feature(LineString([(4, 3), (5, 3)]), id="o1", feature_type="opening", category="pedestrian", level_id="g"),
    feature(LineString([(14, 3), (15, 3)]), id="o2", feature_type="opening", category="pedestrian", level_id="g"),
    feature(LineString([(0, 1), (0, 2)]), id="o3", feature_type="opening", category="pedestrian", level_id="g"),
]
LEVEL = [feature(box(0, 0, 20, 9), id="g", feature_type="level", ordinal=0, name={"en": "Ground"})]


@pytest.mark.parametrize("is_archive", [True, False])
def test_imdf(tmp_path, is_archive):
    path = tmp_path / ("a.zip" if is_archive else "a.geojson")
    if is_archive:
        with ZipFile(path, "w") as archive:
            archive.writestr("manifest.json", "{}")
            for name, features in (("unit", UNITS), ("opening", OPENINGS), ("level", LEVEL)):
                archive.writestr(f"{name}.geojson", collection(*features))
    else:
        path.write_text(collection(*UNITS, *OPENINGS, *LEVEL))
    made = import_building([path], tmp_path / "case", people=9)
    assert (made.fault, made.missing) == ("", ())
    assert [level.name for level in made.building.levels] == ["Ground"]
    # The rooms have walls of 0.1 m, which the two doors open.
    assert ground(made.building, "Ground") == pytest.approx(20 * 9 - 0.1 * 20 - 0.1 * 5.95 + 2 * 0.1, rel=0.01)
    assert [way.width for way in made.building.exits] == [pytest.approx(1.0, abs=0.01)]
    assert any("機械室" in area.name for area in made.building.areas)


def test_units_of_stairs_above_each_other_are_a_stair(tmp_path):
    features = []
    for ordinal, level in ((0, "g"), (1, "h")):
        features += [
            feature(box(0, 0, 9, 9), id=level, feature_type="level", ordinal=ordinal, name={"en": f"L{ordinal}"}),
            feature(box(0, 0, 3, 9), id=f"{level}1", feature_type="unit", category="walkway", level_id=level),
            feature(box(8, 0, 12, 9), id=f"{level}2", feature_type="unit", category="walkway", level_id=level),
            feature(box(3, 4, 8, 5.5), id=f"{level}3", feature_type="unit", category="stairs", level_id=level),
        ]
    features.append(feature(LineString([(0, 1), (0, 2)]), id="o", feature_type="opening", level_id="g"))
    (tmp_path / "a.geojson").write_text(collection(*features))
    building = read_building(tmp_path / "a.geojson", need_exit=False)
    assert [sorted({portal.width for portal in building.portals}), len(building.stairs)] == [
        [pytest.approx(1.5, abs=0.01)],
        1,
    ]


def osm(*, door="yes", both="0;1"):
    return collection(
        feature(box(0, 0, 30, 4), indoor="corridor", level=both),
        feature(box(0, 4, 10, 10), indoor="room", level="0", name="shop"),
        feature(box(10, 4, 20, 10), indoor="room", level="1", name="office"),
        feature(Point(5, 4), door=door, level="0"),
        feature(Point(15, 4), door=door, level="1"),
        feature(Point(0, 2), entrance="main"),
        feature(LineString([(18, 2), (24, 2)]), highway="steps", level="0;1", width="1.2", incline="up"),
        feature(LineString([(2, 5), (2, 9)]), indoor="wall", level="0"),
        feature(Polygon([(40, 40), (50, 40), (50, 50)]), building="yes"),
    )


@pytest.mark.parametrize("both", ["0;1", "0-1", ["0", "1"], [0, 1.0]])
def test_openstreetmap_with_stairs_and_doors(tmp_path, both):
    (tmp_path / "a.geojson").write_text(osm(both=both))
    made = import_building([tmp_path / "a.geojson"], tmp_path / "case", people=9)
    assert (made.fault, made.missing) == ("", ())
    building = made.building
    assert len(building.stairs) == 1
    assert sorted({round(level.z_min) for level in building.levels if level.kind == "floor"}) == [0, 3]
    assert [(way.name, way.width) for way in building.exits] == [("0 door 2", pytest.approx(1.0))]
    assert len(building.levels) == 3
    assert ground(building, "0") == pytest.approx(30 * 4 + 60 - 6 * 1.2 - 0.5, rel=0.03)


@pytest.mark.parametrize("less", [0.00001, 0.01])
def test_the_wall_beside_a_stair_stays_that_leaves_slivers_of_its_stairwell(tmp_path, less):
    features = [feature(box(0, 0, 8, 2), indoor="corridor", level="0;1"), feature(Point(0, 1), entrance="main")]
    for level in ("0", "1"):
        features += [
            feature(box(0, 2, 3, 10), indoor="room", level=level),
            feature(box(3, 2, 8, 10), indoor="room", level=level),
            *(feature(Point(x, 2), door="yes", level=level) for x in (1.5, 5.5)),
        ]
    stair = LineString([(1.5, 4), (1.5, 9)])
    features.append(feature(stair, highway="steps", level="0;1", width=str(3 - 2 * less), incline="up"))
    (tmp_path / "a.geojson").write_text(collection(*features))
    building = read_building(tmp_path / "a.geojson")
    walls = 0.1 * (8 + 1.95 + 0.95) - 2 * 0.1  # along the corridor, before and behind the stair, without two doors
    assert ground(building, "0") == pytest.approx(EAST * (8 * 10 - 3 * 5 - walls), abs=0.1)


def test_levels_as_ranges_with_a_stair_through_all_of_them(tmp_path):
    features = [
        feature(box(0, 0, 30, 10), indoor="corridor", level="0", repeat_on="1-2"),
        feature(box(0, 10, 10, 20), indoor="room", level="1.0"),
        feature(box(10, 10, 20, 20), indoor="room", name="attic"),
        feature(box(4, 4, 10, 6), indoor="area", stairs="yes", level="0-2"),
        feature(LineString([(0, 1), (0, 2)]), entrance="main"),
        feature(Point(3, 3), door="yes", level="9"),
        feature(LineString([(20, 10), (30, 10), (30, 20)]), indoor="room", level="1", name="not closed"),
    ]
    (tmp_path / "a.geojson").write_text(collection(*features))
    made = import_building([tmp_path / "a.geojson"], tmp_path / "case", people=9)
    attic, line = made.missing  # 100 m2 of 1,000
    assert ("attic" in attic, "not closed" in line, len(made.building.stairs)) == (True, True, 2)
    assert sorted({level.z_min for level in made.building.levels if level.kind == "floor"}) == [0.0, 3.0, 6.0]
    left_out = [one.text for one in made.findings if one.kind == "left out"]
    assert ["on level '9'" in text for text in left_out] == [True]


def test_without_doors_rooms_that_touch_are_open_to_each_other(tmp_path):
    (tmp_path / "a.geojson").write_text(osm(door="no"))
    building = read_building(tmp_path / "a.geojson")
    assert len([level for level in building.levels if level.kind == "floor"]) == 2
    assert any("open to each other" in one.text for one in building.findings)


def test_a_map_with_nothing_to_walk_in_is_refused(tmp_path):
    (tmp_path / "a.geojson").write_text(collection(feature(box(0, 0, 9, 9), indoor="level", level="0")))
    with pytest.raises(BuildingError, match="no room, corridor or unit"):
        read_building(tmp_path / "a.geojson")


def test_openstreetmap_xml(tmp_path):
    corners = [(0, 0), (20, 0), (20, 4), (0, 4), (5, 4), (0, 2), (0, 10), (10, 10), (10, 4), (1, 5), (2, 5), (2, 6)]
    more = {5: ("door", "hinged", "level", "0", "width", "80 cm"), 6: ("entrance", "main")}
    lines = []
    for number, (x, y) in enumerate(corners, start=1):
        own = more.get(number, ())
        tags = "".join(f"<tag k='{k}' v='{v}'/>" for k, v in zip(own[::2], own[1::2], strict=True))
        lines.append(f"<node id='{number}' lon='{x / DEGREE}' lat='{y / DEGREE}'>{tags}</node>")
    ways = {1: [1, 2, 3, 9, 5, 4, 6, 1], 2: [4, 5, 9, 8, 7, 4], 3: [10, 11, 12, 10], 4: [1, 99]}
    for number, refs in ways.items():
        tags = "<tag k='indoor' v='corridor'/><tag k='level' v='0'/>" if number == 1 else ""
        lines.append(f"<way id='{number}'>{''.join(f'<nd ref={chr(39)}{ref}{chr(39)}/>' for ref in refs)}{tags}</way>")
    lines.append(
        "<relation id='1'><member type='way' ref='2' role='outer'/><member type='way' ref='3' role='inner'/>"
        "<tag k='type' v='multipolygon'/><tag k='indoor' v='room'/><tag k='level' v='0'/></relation>"
        "<node id='90' action='delete' lat='0' lon='1'><tag k='entrance' v='yes'/></node>"
    )
    (tmp_path / "a.osm").write_text(f"<osm version='0.6'>{''.join(lines)}</osm>")
    building = read_building(tmp_path / "a.osm")
    assert [door.width for door in building.doors] == [pytest.approx(0.8, abs=0.01)]
    assert [way.width for way in building.exits] == [pytest.approx(1.0, abs=0.01)]
    whole = 20 * 4 + 10 * 6 - 0.5 - 0.1 * 10 + 0.1 * 0.8  # with a triangle and a wall, which the door opens
    assert ground(building, "0") == pytest.approx(whole * 1.00674, abs=0.02)  # of degrees at the equator
    (tmp_path / "a.osm").write_text("<gpx/>")
    with pytest.raises(BuildingError, match="not OpenStreetMap XML"):
        read_building(tmp_path / "a.osm")


@pytest.mark.parametrize("number", ["nan", "inf", "x", ""])
def test_a_node_of_openstreetmap_without_a_place_is_refused_by_its_number(tmp_path, number):
    text = f"<osm><node id='7' lon='{number}' lat='0'><tag k='entrance' v='yes'/></node></osm>"
    (tmp_path / "a.osm").write_text(text)
    with pytest.raises(BuildingError, match="node 7: lon"):
        import_building([tmp_path / "a.osm"], tmp_path / "case")
