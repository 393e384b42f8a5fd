"""Plans become buildings: what joins, what is cut away, and what is refused with its name and place."""

import numpy as np
import pytest
import shapely
from shapely import box

import evac
from evac import BuildingError, Plan


def two_storeys(**options):
    plan = Plan(**options)
    plan.storey("ground", box(0, 0, 12, 6))
    plan.storey("first", box(0, 0, 12, 6), z=3.0)
    plan.exit("door", "ground", [(0, 3), (0, 4)])
    return plan


def widths(building):
    return [round(portal.width, 6) for portal in building.portals]


def levels(building):
    return {level.name: level for level in building.levels}


SQUARE = "POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0), (1 1, 2 1, 2 2, 1 2, 1 1))"
GEOJSON = {
    "type": "FeatureCollection",
    "features": [{"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(shapely.from_wkt(SQUARE))}],
}


@pytest.mark.parametrize(
    "shape",
    [
        SQUARE,
        shapely.from_wkt(SQUARE),
        GEOJSON,
        f"GEOMETRYCOLLECTION (GEOMETRYCOLLECTION ({SQUARE}), POINT (1 1))",
        [box(0, 0, 4, 3).difference(box(1, 1, 2, 2))],
        [[[0, 0], [4, 0], [4, 1], [0, 1]], "POLYGON ((0 1, 1 1, 1 3, 4 3, 4 1, 2 1, 2 2, 1 2, 0 2, 0 1))"],
    ],
)
def test_shapes_of_every_kind_are_a_storey(shape):
    plan = Plan()
    plan.storey("room", shape)
    (level,) = plan.building(need_exit=False).levels
    assert level.polygon.area == pytest.approx(11.0, abs=0.01 + 1.0 * isinstance(shape, list))
    assert level.name == "room"


def test_a_straight_stair_between_two_edges():
    plan = Plan()
    plan.storey("ground", box(0, 0, 10, 4))
    plan.storey("first", box(14, 0, 20, 4), z=2.0)
    plan.stair("main", "ground", [(10, 1), (10, 3)], "first", [(14, 3), (14, 1)])
    building = plan.building(need_exit=False)
    assert widths(building) == [2.0, 2.0]
    assert np.tan(building.levels[1].slope) == pytest.approx(0.5)
    assert building.stairs == {"main": (1,)}
    assert building.findings == ()


@pytest.mark.parametrize("landings", [1, 2])
def test_a_straight_stair_with_landings(landings):
    plan = Plan()
    plan.storey("ground", box(0, 0, 10, 4))
    plan.storey("first", box(22, 0, 30, 4), z=4.0)
    edges = [(10, 1), (10, 3)], "first", [(22, 1), (22, 3)]
    plan.stair("main", "ground", *edges, landing=1.5, landings=landings)
    building = plan.building(need_exit=False)
    kinds = [level.kind for level in building.levels]
    assert (kinds.count("landing"), kinds.count("flight")) == (landings, landings + 1)
    flats = [level for level in building.levels if level.kind == "landing"]
    assert all(level.polygon.area == pytest.approx(3.0) for level in flats)
    assert widths(building) == [2.0] * (2 * landings + 2)
    slopes = {round(level.slope, 5) for level in building.levels if level.kind == "flight"}
    assert len(slopes) == 1


def test_a_stair_from_one_edge_cuts_both_floors_for_headroom():
    plan = two_storeys()
    plan.stair("main", "ground", [(2, 1), (2, 2.5)], "first", length=6.0, direction=(1, 0))
    building = plan.building()
    floors = levels(building)
    # 2 m of headroom of 3 m: over two thirds of 6 m.
    assert floors["ground"].polygon.area == pytest.approx(72.0 - 1.5 * 4.0)
    assert floors["first"].polygon.area == pytest.approx(72.0 - 1.5 * 4.0)
    assert not floors["ground"].polygon.intersects(shapely.Point(3, 2))
    assert floors["first"].polygon.intersects(shapely.Point(3, 2))
    cuts = [one for one in building.findings if one.kind == "assumed"]
    assert [(one.level, "6.00 m2" in one.text) for one in cuts] == [("ground", True), ("first", True)]
    assert box(2, 1, 8, 2.5).contains(shapely.MultiPoint([one.place for one in cuts]))


@pytest.mark.parametrize(("turn", "y"), [("left", 2.7), ("right", 0.1)])
def test_a_u_shaped_stair_from_one_edge(turn, y):
    plan = two_storeys()
    plan.stair("main", "ground", [(8, 1.4), (8, 2.6)], "first", length=2.4, turn=turn, direction=(1, 0))
    building = plan.building()
    kinds = [level.kind for level in building.levels]
    assert (kinds.count("landing"), kinds.count("flight")) == (1, 2)
    landing = next(level for level in building.levels if level.kind == "landing")
    assert (landing.z_min, landing.polygon.area) == (1.5, pytest.approx(2.5 * 1.2))
    (head,) = [portal for portal in building.portals if building.level_named("first").index in portal.levels]
    assert sorted(head.segments[:, [1, 3]].ravel().tolist()) == pytest.approx([y, y + 1.2])


@pytest.mark.parametrize(("landing", "depth"), [(None, 1.2), (1.6, 1.6)])
def test_handrails_narrow_the_flights_and_leave_the_depth_of_landings(landing, depth):
    plan = two_storeys()
    given = {"length": 2.4, "turn": "left", "direction": (1, 0), "handrails": 0.1, "landing": landing}
    plan.stair("main", "ground", [(8, 1.4), (8, 2.6)], "first", **given)
    building = plan.building()
    (middle,) = (level for level in building.levels if level.kind == "landing")
    x1, y1, x2, y2 = middle.polygon.bounds
    assert (x2 - x1, y2 - y1) == pytest.approx((depth, 2.5 - 0.2))
    flights = [level.polygon for level in building.levels if level.kind == "flight"]
    assert [flight.area for flight in flights] == pytest.approx([2.4 * 1.0] * 2)
    assert flights[0].distance(flights[1]) == pytest.approx(0.1 + 0.2)


def test_a_u_shaped_stair_between_two_edges_of_different_depth():
    plan = Plan()
    plan.storey("ground", box(0, 0, 6, 6))
    plan.storey("first", box(0, 0, 7, 6), z=3.0)
    edges = [(6, 1), (6, 2)], "first", [(7, 2.1), (7, 3.1)]
    plan.stair("main", "ground", *edges, length=3.5, landing=1.5)
    building = plan.building(need_exit=False)
    flights = [level for level in building.levels if level.kind == "flight"]
    assert len({round(level.slope, 6) for level in flights}) == 1
    assert sorted(level.polygon.area for level in flights) == pytest.approx([2.5, 3.5])


def test_a_stair_of_any_shape_is_given_piece_by_piece():
    plan = Plan()
    plan.storey("ground", box(0, 0, 4, 4))
    plan.storey("first", box(6.5, 5, 12, 9), z=2.0)
    plan.flight("main", [(4, 1), (4, 2.5)], 0.0, [(6.5, 1), (6.5, 2.5)], 1.0)
    plan.landing("main", box(6.5, 1, 8, 2.5), 1.0)
    plan.flight("main", [(6.5, 2.5), (8, 2.5)], 1.0, [(6.5, 5), (8, 5)], 2.0)
    building = plan.building(need_exit=False)
    assert widths(building) == [1.5] * 4
    assert list(building.stairs) == ["main"]


def test_a_small_gap_at_the_end_of_a_stair_is_closed():
    plan = Plan()
    plan.storey("ground", box(0, 0, 9.94, 4))
    plan.storey("first", box(14, 0, 20, 4), z=2.0)
    plan.stair("main", "ground", [(10, 1), (10, 3)], "first", [(14, 1), (14, 3)])
    building = plan.building(need_exit=False)
    (gap,) = building.findings
    assert (gap.kind, gap.level, gap.place) == ("repaired", "ground", (10.0, 2.0))
    assert "0.060 m" in gap.text
    assert widths(building) == [2.0, 2.0]


def test_a_stair_wider_than_its_floor_is_warned_of():
    plan = Plan()
    plan.storey("ground", box(0, 0, 10, 2.5))
    plan.storey("first", box(14, 0, 20, 4), z=2.0)
    plan.stair("main", "ground", [(10, 1), (10, 3)], "first", [(14, 1), (14, 3)])
    building = plan.building(need_exit=False)
    (note,) = building.findings
    assert (note.kind, note.level) == ("warning", "ground")
    assert "1.50 of 2.00 m" in note.text


@pytest.mark.parametrize("x", [5.0, 5.1, 5.2])
def test_a_door_joins_two_rooms(x):
    plan = Plan()
    plan.storey("floor", [box(0, 0, 5, 4), box(5.2, 0, 9, 4)])
    plan.door("door", "floor", [(x, 1), (x, 2)])
    (level,) = plan.building(need_exit=False).levels
    assert level.polygon.area == pytest.approx(20.0 + 15.2 + 0.2)


def test_walls_between_rooms_that_touch():
    plan = Plan()
    plan.storey("floor", [box(0, 0, 5, 4), box(5, 0, 9, 4), box(0, 4, 9, 8)], wall=0.2)
    plan.door("a", "floor", [(5, 1), (5, 2)])
    plan.door("b", "floor", [(2, 4), (3, 4)])
    (level,) = plan.building(need_exit=False).levels
    assert level.polygon.bounds == (0.0, 0.0, 9.0, 8.0)
    assert level.polygon.area == pytest.approx(72.0 - 9.0 * 0.2 - (4.0 - 0.1) * 0.2 + 0.4)


@pytest.mark.parametrize("outside", ["exit", "opening"])
def test_a_door_to_the_outside(outside):
    plan = Plan()
    plan.storey("floor", box(0, 0, 5, 4))
    plan.door("front", "floor", [(5.2, 1), (5.2, 2)], outside=outside)
    surface = plan.surface()
    building = plan.building(need_exit=False)
    assert [(way.name, round(way.width, 6)) for way in building.exits] == [("front", 1.0)] * (outside == "exit")
    openings = [(name, np.asarray(ends).tolist()) for name, ends in surface.openings]
    assert openings == [("floor", [5.2, 1.0, 5.2, 2.0])] * (outside == "opening")


@pytest.mark.parametrize(
    ("segment", "width", "area"),
    [
        ([(0, 1), (0, 2)], 1.0, 20.0),  # on the outline
        ([(-0.1, 1), (-0.1, 2)], 1.0, 20.0),  # snapped to it
        ([(-0.3, 1), (-0.3, 2)], 1.0, 20.3),  # on the outer face of a wall
        ([(0, 3), (0, 4)], 1.0, 20.0),
    ],
)
def test_an_exit_is_put_on_the_outline(segment, width, area):
    plan = Plan()
    plan.storey("floor", box(0, 0, 5, 4))
    plan.exit("out", "floor", segment)
    building = plan.building()
    assert building.exits[0].width == pytest.approx(width)
    assert building.levels[0].polygon.area == pytest.approx(area)


def test_an_exit_as_a_polygon_is_cut_out():
    plan = Plan()
    plan.storey("floor", box(0, 0, 5, 4))
    plan.exit("inside", "floor", polygon=box(-1, 1, 0.5, 2))
    plan.exit("beside", "floor", polygon=box(5.1, 1, 6, 2))
    building = plan.building()
    assert [(way.name, round(way.width, 6)) for way in building.exits] == [("beside", 1.0), ("inside", 2.0)]
    assert building.levels[0].polygon.area == pytest.approx(19.5)


def test_areas_may_overlap_and_obstacles_are_cut_out_of_them():
    plan = Plan()
    plan.storey("floor", box(0, 0, 6, 4))
    plan.exit("out", "floor", [(0, 1), (0, 2)])
    plan.area("a", "floor", box(0, 0, 3, 4))
    plan.area("b", "floor", box(2, 0, 6, 4))
    plan.obstacle("table", "floor", box(2.2, 1, 2.8, 2))
    building = plan.building()
    assert {area.name: round(area.polygon.area, 6) for area in building.areas} == {"a": 11.4, "b": 15.4}
    assert [level.name for level in building.levels] == ["floor"]


def test_a_broken_outline_is_repaired_and_told():
    plan = Plan()
    plan.storey("floor", [(0, 0), (4, 0), (4, 3), (1, -1)])
    assert [(one.kind, one.level) for one in plan.findings] == [("repaired", "floor")]
    assert plan.building(need_exit=False).levels


def test_coordinates_far_from_the_origin_are_kept():
    plan = Plan()
    shift = np.array([458_000.123, 5_428_000.456])
    corners = np.array([(0, 0), (8, 0), (8, 4), (0, 4)])
    plan.storey("ground", corners + shift)
    plan.storey("first", corners + shift + (12, 0), z=3.0)
    ends = np.array([(0.0, 1.0), (0.0, 2.5)])
    plan.stair("main", "ground", ends + shift + (8, 0), "first", ends + shift + (12, 0))
    plan.exit("door", "ground", ends + shift)
    building = plan.building()
    assert widths(building) == pytest.approx([1.5, 1.5], abs=1e-5)
    assert building.warnings == ()


REFUSED = {
    "no storey": (lambda p: p.surface(), "storey"),
    "two of a name": (lambda p: p.storey("a", SQUARE) or p.storey("a", SQUARE), "two storeys named 'a'"),
    "no polygon": (lambda p: p.storey("a", "POINT (1 1)"), "storey 'a'.*no polygon"),
    "no WKT": (lambda p: p.storey("a", "POLYGON ((0 0, 1"), "storey 'a'.*WKT"),
    "not finite": (lambda p: p.storey("a", [(0, 0), (1, 0), (np.nan, 1)]), "storey 'a'.*finite"),
    "unknown storey": (lambda p: p.storey("ground", SQUARE) or p.exit("e", "grund", [(0, 0), (0, 1)]) or p.surface(),
                       "exit 'e'.*'grund'.*'ground'"),
    "short segment": (lambda p: p.exit("e", "a", [(0, 0), (0, 0)]), "exit 'e'.*segment"),
    "exit off the floor": (
        lambda p: p.storey("a", SQUARE) or p.exit("e", "a", [(7, 1), (7, 2)]) or p.surface(),
        r"exit 'e'.*\(7.00, 1.00\).*segment = \[\[4.0, 1.0\], \[4.0, 2.0\]\]",
    ),
    "exit through the floor": (
        lambda p: p.storey("a", SQUARE) or p.exit("e", "a", [(3, 1), (3, 2)]) or p.surface(), "exit 'e'.*through",
    ),
    "area off the floor": (
        lambda p: p.storey("a", SQUARE) or p.area("b", "a", box(5, 5, 6, 6)) or p.surface(), "area 'b'.*'a'",
    ),
    "door to nowhere": (
        lambda p: p.storey("a", SQUARE) or p.door("d", "a", [(9, 1), (9, 2)]) or p.surface(),
        r"door 'd'.*\(9.00, 1.00\)",
    ),
    "door with one room": (
        lambda p: p.storey("a", SQUARE) or p.door("d", "a", [(4, 1), (4, 2)]) or p.surface(), "door 'd'.*one side",
    ),
    "stair off its floor": (
        lambda p: p.storey("a", SQUARE)
        or p.storey("b", box(8, 0, 12, 3), z=3.0)
        or p.stair("s", "a", [(4, 1), (4, 2)], "b", [(7.5, 1), (7.5, 2)])
        or p.surface(),
        r"stair 's'.*upper edge.*\(7.50, 1.00\).*'b'.*upper_edge = \[\[8.0, ",
    ),
    "stair downwards": (
        lambda p: p.storey("a", SQUARE)
        or p.storey("b", box(8, 0, 12, 3), z=-3.0)
        or p.stair("s", "a", [(4, 1), (4, 2)], "b", [(8, 1), (8, 2)])
        or p.surface(),
        "stair 's'.*'a'.*'b'",
    ),
    "stair without end": (lambda p: p.stair("s", "a", [(4, 1), (4, 2)], "b"), "stair 's'.*length"),
    "stair inside a floor": (
        lambda p: p.storey("a", box(0, 0, 9, 9))
        or p.storey("b", box(0, 0, 9, 9), z=3.0)
        or p.stair("s", "a", [(4, 1), (4, 2)], "b", length=4.0)
        or p.surface(),
        "stair 's'.*both sides.*direction",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused_with_name_and_place(case):
    wrong, message = REFUSED[case]
    with pytest.raises(BuildingError, match=message):
        wrong(Plan())


def test_a_turned_flight_whose_edges_are_rounded_meets_its_floor():
    """Along its side, they overlap by less than a micrometre, which joins the parts where one is above the other."""
    turned = [(0.978148, -0.207912), (0.207912, 0.978148)]
    floor = shapely.transform(shapely.box(0, 0, 12, 4), lambda xy: np.round(xy @ turned, 3))
    plan = evac.Plan()
    plan.storey("ground", floor, 0.0)
    plan.storey("first", floor, 3.0)
    plan.flight("stair", [(1.956, -0.416), (2.206, 0.758)], 0.0, [(6.612, -1.405), (6.862, -0.232)], 3.0)
    assert len(plan.building(need_exit=False).portals) == 2


@pytest.mark.parametrize("far", [1e11, np.inf])
def test_a_segment_far_away_is_named_by_its_numbers(far):
    plan = Plan()
    with pytest.raises(BuildingError) as caught:
        plan.opening("floor", np.array([[far, 0.0], [far, 1.0]]))
    assert "array" not in str(caught.value)
    assert f"[[{far!r}, 0.0], [{far!r}, 1.0]]" in str(caught.value)


@pytest.mark.parametrize("width", [0.0, 1e-12])
def test_a_door_without_a_width_at_a_wall_is_refused(width):
    plan = Plan()
    with pytest.raises(BuildingError, match="width must be at least"):
        plan.door("door", "floor", {"rooms": ["hall", "shop"], "at": 2.5, "width": width})
