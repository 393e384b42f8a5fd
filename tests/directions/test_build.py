"""Travel times against geodesics by hand, continuity over portals, strategies, and ways that bodies can follow."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import evac
from evac.base.change import Change
from evac.base.errors import ScenarioError
from evac.building.model.links import changed
from evac.directions.build import build_fields
from evac.directions.lengths import slowness_of
from evac.directions.march import marching
from evac.directions.routes import Route
from tests.directions.conftest import Drawing
from tests.directions.walks import along, geodesics, positions_on

ANY = (Route(),)
SLOPE = math.atan(3.0 / 4.0)  # cosine 0.8: 1.25 m along the slope per metre in plan


PLANS = {
    "rectangle": (shapely.box(0, 0, 6, 5), [(99, 99)]),
    "corner": (shapely.box(0, 0, 6, 5).difference(shapely.box(3, 0, 7, 2)), [(3, 2)]),
    "pillar": (
        shapely.box(0, 0, 6, 5).difference(shapely.box(3, 1.5, 4, 4)),
        [(3, 1.5), (4, 1.5), (4, 4), (3, 4)],
    ),
    "wall off the lattice": (
        shapely.box(0, 0, 6, 5).difference(shapely.box(2.97, 1.33, 3.12, 6)),
        [(2.97, 1.33), (3.12, 1.33)],
    ),
}


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("spacing", [0.2, 0.1, 0.05])
def test_travel_time_converges_to_the_geodesic(drawing, plan, spacing):
    polygon, corners = PLANS[plan]
    drawing.level(polygon)
    drawing.exit("A", 0, (6, 2.6), (6, 3.8))
    building = drawing.build()
    fields = build_fields(building, ANY, spacing=spacing)
    points = positions_on(building, 0, 200)
    blocked = shapely.box(-9, -9, 19, 19).difference(polygon.buffer(1e-9, join_style="mitre"))
    exact = geodesics(points, (6, 2.6), (6, 3.8), corners, blocked)
    error = np.abs(fields.travel_time_at(0, points, 0) - exact)
    assert error.max() < 2.0 * spacing
    assert error.mean() < 0.6 * spacing


def test_rectangle_at_any_angle(drawing):
    turn = shapely.affinity.rotate
    room = turn(shapely.box(0, 0, 6, 5), 17, origin=(0, 0))
    door = shapely.get_coordinates(turn(shapely.LineString([(6, 2.6), (6, 3.8)]), 17, origin=(0, 0)))
    drawing.level(room)
    drawing.exit("A", 0, *door)
    building = drawing.build()
    fields = build_fields(building, ANY, clearance=0.0)
    points = positions_on(building, 0, 500)
    line = shapely.LineString(door)
    exact = shapely.distance(line, shapely.points(points))
    assert np.abs(fields.travel_time_at(0, points, 0) - exact).mean() < 0.015
    inside = (exact > 0.5) & (shapely.distance(room.exterior, shapely.points(points)) > 0.2)
    targets = shapely.get_coordinates(shapely.shortest_line(shapely.points(points), line)).reshape(-1, 2, 2)[:, 1]
    exact_direction = (targets - points) / np.linalg.norm(targets - points, axis=1)[:, None]
    cosine = (fields.directions_at(0, points, 0) * exact_direction).sum(axis=1)[inside]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 0.8


def two_storeys(drawing):
    """Draw an upper floor, a straight stair 4 m long in plan, 1.5 m wide, and a lower floor with the exit."""
    drawing.level((0, 0, 6, 5), z=3.0)
    drawing.level((6, 2, 10, 3.5), uphill=(-1, 0), slope=SLOPE)
    drawing.level((10, 0, 16, 5))
    drawing.portal(0, 1, (6, 2), (6, 3.5))
    drawing.portal(1, 2, (10, 2), (10, 3.5))
    drawing.exit("A", 2, (16, 2), (16, 3.5))
    return drawing.build()


def test_time_and_lengths_over_a_stair_are_sums_of_straight_pieces(drawing):
    fields = build_fields(two_storeys(drawing), ANY, speeds=(1.0, 0.5, 0.7))
    level, points = [0, 1, 2], [[3.0, 2.75], [8.0, 2.75], [12.0, 2.75]]
    exact = [[9.0, 0.0, 5.0], [6.0, 0.0, 2.5], [4.0, 0.0, 0.0]]
    assert fields.lengths_at(level, points, 0) == pytest.approx(np.array(exact), abs=0.05)
    assert fields.travel_time_at(level, points, 0) == pytest.approx([9 + 5 / 0.7, 6 + 2.5 / 0.7, 4.0], abs=0.05)


def test_lengths_over_the_speeds_are_the_travel_time_at_every_node(drawing):
    fields = build_fields(two_storeys(drawing), ANY, speeds=(1.0, 0.5, 0.7))
    time = fields.lengths @ [1.0, 1.0 / 0.5, 1.0 / 0.7]
    has_way = np.isfinite(fields.packed.travel_time) & np.isfinite(time)
    assert has_way.sum() > 1000
    np.testing.assert_allclose(time[has_way], fields.packed.travel_time[has_way], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("ends", [((0, 1), (0, 1.8)), ((0, 1.2), (0, 2)), ((8, 1), (8, 1.8)), ((1, 0), (1.7, 0))])
@pytest.mark.parametrize("turn", [0.0, 33.0])
def test_wherever_there_is_a_travel_time_there_are_lengths(drawing, ends, turn):
    def turned(geometry):
        return shapely.affinity.rotate(geometry, turn, origin=(0, 0))

    line = turned(shapely.LineString(ends))
    drawing.level(turned(shapely.box(0, 0, 8, 6)).union(line.buffer(1e-9)) if turn else (0, 0, 8, 6))
    drawing.exit("A", 0, *shapely.get_coordinates(line))
    building = drawing.build()
    fields = build_fields(building, ANY)
    points = positions_on(building, 0, 4000)
    lengths = fields.lengths_at(0, points, 0)
    assert np.isfinite(lengths).all()
    np.testing.assert_allclose(lengths.sum(axis=1), fields.travel_time_at(0, points, 0), rtol=0.0, atol=1e-6)


def test_an_exit_on_a_stair_ends_a_way_on_the_stair(drawing):
    drawing.level((0, 0, 6, 5), z=3.0)
    drawing.level((6, 2, 10, 3.5), uphill=(-1, 0), slope=SLOPE)
    drawing.portal(0, 1, (6, 2), (6, 3.5))
    drawing.exit("A", 1, (10, 2), (10, 3.5))
    fields = build_fields(drawing.build(), ANY, speeds=(1.0, 0.5, 0.7))
    found = fields.lengths_at([1, 1], [[8.0, 2.75], [9.9, 2.75]], 0)
    np.testing.assert_allclose(found, [[0.0, 0.0, 2.5], [0.0, 0.0, 0.125]], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("uphill", "speed", "lengths"), [(1, 0.5, [9, 5, 0]), (-1, 0.7, [9, 0, 5])], ids=["up", "down"]
)
def test_a_stair_has_its_own_speeds_and_is_as_long_for_the_shortest_route(drawing, uphill, speed, lengths):
    drawing.level((0, 0, 6, 5))
    drawing.level((6, 2, 10, 3.5), uphill=(uphill, 0), slope=SLOPE)
    drawing.level((10, 0, 16, 5), z=3.0 * uphill)
    drawing.portal(0, 1, (6, 2), (6, 3.5))
    drawing.portal(1, 2, (10, 2), (10, 3.5))
    drawing.exit("A", 2, (16, 2), (16, 3.5))
    routes = [Route(strategy=strategy) for strategy in ("fastest", "shortest", "comfortable")]
    fields = build_fields(drawing.build(), routes, speeds=(1.25, 0.5, 0.7), comfort=3.0)
    times = [fields.travel_time_at(0, [[3.0, 2.75]], route)[0] for route in range(3)]
    assert times == pytest.approx([9 / 1.25 + 5 / speed, 9 + 5, 9 / 1.25 + 3 * 5 / speed], abs=0.1)
    assert fields.lengths_at(0, [[3.0, 2.75]], 1)[0] == pytest.approx(lengths, abs=0.05)


@pytest.mark.parametrize("spacing", [0.2, 0.1])
def test_time_is_continuous_over_portals(drawing, spacing):
    building = two_storeys(drawing)
    fields = build_fields(building, ANY, spacing=spacing, speeds=(1.0, 0.5, 0.7))
    for portal in building.portals:
        one, two = (fields.travel_time_at(level, along(portal), 0) for level in portal.levels)
        assert np.abs(one - two).max() < 2 * spacing / (0.8 * 0.5)


def test_a_floor_cut_in_two_has_the_uncut_times(drawing):
    pillar = shapely.box(2.5, 1, 3.5, 3)
    drawing.level(shapely.box(0, 0, 3, 5).difference(pillar))
    drawing.level(shapely.box(3, 0, 6, 5).difference(pillar))
    drawing.portal(0, 1, (3, 0), (3, 1))
    drawing.portal(0, 1, (3, 3), (3, 5))
    drawing.exit("A", 1, (6, 1.6), (6, 2.4))
    cut = drawing.build()
    whole = type(drawing)()
    whole.level(shapely.box(0, 0, 6, 5).difference(pillar))
    whole.exit("A", 0, (6, 1.6), (6, 2.4))
    uncut = whole.build()
    of_cut, of_uncut = (build_fields(building, ANY) for building in (cut, uncut))
    for level in (0, 1):
        points = positions_on(cut, level, 300)
        assert of_cut.travel_time_at(level, points, 0) == pytest.approx(of_uncut.travel_time_at(0, points, 0), abs=0.1)
        cosine = (of_cut.directions_at(level, points, 0) * of_uncut.directions_at(0, points, 0)).sum(axis=1)
        assert np.quantile(cosine, 0.05) > math.cos(math.radians(3))


def test_floors_of_the_same_plan_do_not_interact(drawing):
    alone = type(drawing)()
    alone.level((0, 0, 6, 5))
    alone.exit("A", 0, (6, 1), (6, 2))
    drawing.level((0, 0, 6, 5))
    drawing.level(PLANS["pillar"][0], z=3.0)
    drawing.exit("A", 0, (6, 1), (6, 2))
    drawing.exit("B", 1, (0, 3), (0, 4))
    single, double = build_fields(alone.build(), ANY), build_fields(drawing.build(), (Route(), Route(("B",))))
    nodes = len(single.packed.travel_time)
    assert np.array_equal(single.packed.travel_time, double.packed.travel_time[:nodes])
    assert np.array_equal(single.packed.direction, double.packed.direction[:nodes])
    assert double.packed.field_of.tolist() == [[0, -1], [1, 2]]
    assert double.travel_time_at(0, [[1.0, 1.0]], 1)[0] == math.inf
    assert not double.directions_at(0, [[1.0, 1.0]], 1).any()


def test_a_pocket_without_a_way_out_has_no_time(drawing):
    drawing.level((0, 0, 6, 5))
    drawing.wall(0, (2, 0), (2, 5))
    drawing.exit("A", 0, (6, 1), (6, 2))
    fields = build_fields(drawing.build(), ANY)
    assert fields.packed.field_of[0, 0] == 0
    assert fields.travel_time_at(0, [[1.0, 2.0], [4.0, 1.5]], 0) == pytest.approx([math.inf, 2.0])
    assert not fields.directions_at(0, [[1.0, 2.0]], 0).any()


def test_exits_beside_each_other_are_reached_each_by_its_own_route(drawing):
    room = drawing.level((0, 0, 8, 6))
    ends = {"A": (1.0, 1.9), "B": (2.0, 2.5), "C": (2.6, 3.0)}
    for name, (low, high) in ends.items():
        drawing.exit(name, room, (8, low), (8, high))
    fields = build_fields(drawing.build(), tuple(Route((name,)) for name in ends))
    for route, (low, high) in enumerate(ends.values()):
        places = [[8.0 - away, 0.5 * (low + high)] for away in (0.1, 2.0, 6.0)]
        assert fields.travel_time_at([0] * 3, places, [route] * 3) == pytest.approx([0.1, 2.0, 6.0], abs=1e-3)
        assert fields.directions_at([0] * 3, places, [route] * 3) == pytest.approx(np.array([[1.0, 0.0]] * 3), abs=1e-3)


def test_a_closed_portal_and_a_closed_exit_lead_nowhere(drawing):
    building = two_storeys(drawing)
    fields = build_fields(replace(building, closed=frozenset({0})), ANY)
    assert fields.packed.field_of[:, 0].tolist() == [-1, 0, 1]
    fields = build_fields(replace(building, closed=frozenset({2})), ANY)
    assert fields.packed.field_of[:, 0].tolist() == [-1, -1, -1]


def tower(storeys):
    """Return storeys of one room that are joined by stairs with a landing; the exit is on the lowest one."""
    drawing = Drawing()
    floors = [drawing.level((0, 0, 6, 4), z=3.0 * k) for k in range(storeys)]
    for k in range(storeys - 1):
        up = drawing.level((6, 0, 9, 2), uphill=(1.0, 0.0), slope=0.4636, z=3.0 * k)
        landing = drawing.level((9, 0, 11, 4), z=3.0 * k + 1.5)
        on = drawing.level((6, 2, 9, 4), uphill=(-1.0, 0.0), slope=0.4636 + 1e-15 * k, z=3.0 * k + 1.5)
        for one, other, x, y in (
            (floors[k], up, 6, 0),
            (up, landing, 9, 0),
            (landing, on, 9, 2),
            (on, floors[k + 1], 6, 2),
        ):
            drawing.portal(one, other, (x, y), (x, y + 2))
    drawing.exit("out", 0, (0, 1), (0, 3))
    return drawing.build()


def test_storeys_that_are_alike_are_marched_once_with_the_same_times(monkeypatch):
    counted, solve = [], marching.skfmm.travel_time
    monkeypatch.setattr(
        marching.skfmm, "travel_time", lambda *given, **more: counted.append(1) or solve(*given, **more)
    )
    few, many = (build_fields(tower(storeys), (Route(),)) and len(counted) for storeys in (5, 9))
    assert many - few <= few + 2
    shared = build_fields(tower(6), (Route(),)).packed
    monkeypatch.setattr(marching, "ALIKE", -1.0)
    alone = build_fields(tower(6), (Route(),)).packed
    np.testing.assert_allclose(shared.travel_time, alone.travel_time, rtol=1e-12)
    np.testing.assert_allclose(shared.direction, alone.direction, atol=1e-6)


def test_ground_behind_a_slit_has_times_and_does_not_change_those_before_it():
    """Two rooms joined by a door and by a slit that nobody fits through, and a third one behind another slit."""
    drawing = Drawing()
    rooms = [drawing.level((6 * k, 0, 6 * k + 6, 4)) for k in range(3)]
    drawing.portal(rooms[0], rooms[1], (6, 0.5), (6, 0.7))
    drawing.portal(rooms[0], rooms[1], (6, 2.5), (6, 3.5))
    drawing.portal(rooms[1], rooms[2], (12, 0.5), (12, 0.7))
    drawing.exit("out", 0, (0, 0.5), (0, 1.5))
    both = build_fields(drawing.build(), (Route(),), narrowest=0.4)
    without = build_fields(replace(drawing.build(), closed=frozenset({0, 2})), (Route(),), narrowest=0.4)
    level, places = np.array([1, 1, 2]), np.array([[7.0, 0.6], [9.0, 2.0], [15.0, 2.0]])
    times, known = (one.travel_time_at(level, places, 0) for one in (both, without))
    np.testing.assert_array_equal(times[:2], known[:2])
    assert np.isfinite(times[2])
    assert np.isinf(known[2])


def test_time_on_an_escalator_is_that_of_people_who_stand_unless_speeds_are_not_heeded():
    plan = evac.Plan()
    for k in range(2):
        plan.storey(f"s{k}", shapely.box(0, 0, 10, 6), z=3.0 * k)
    plan.stair("up", "s0", [(1.0, 0), (2.2, 0)], "s1", [(2.3, 0), (3.5, 0)], length=5.0, direction=(0, -1))
    still = plan.building(need_exit=False)
    flights = [level.index for level in still.levels if level.slope > 0.0]
    moving = replace(still, moving=frozenset((level, 0.4, 0.3) for level in flights))
    uses, shortest = np.array([1.0, 2.0, 1.5]), np.ones(3)
    expected = slowness_of(still, uses, Route())
    expected[flights] = 1.0 / 0.5
    np.testing.assert_allclose(slowness_of(moving, uses, Route()), expected)
    np.testing.assert_array_equal(slowness_of(moving, shortest, Route()), slowness_of(still, shortest, Route()))


def after(building, kind, what, value):
    return changed(building, Change(0.0, kind, what, {"value": value}))


def hall(*blocks):
    """Return a hall of 20 x 10 m with an exit to the right, two aisles of 1.6 m beside a block, and blocks in them."""
    plan = evac.Plan()
    block = shapely.box(6, 1.6, 14, 8.4)
    plan.storey("hall", shapely.box(0, 0, 20, 10) - shapely.union_all([block, *blocks]))
    plan.exit("out", "hall", [(20, 4), (20, 6)])
    aisle = shapely.box(7, 0, 13, 1.6)
    if aisle not in blocks:
        plan.area("aisle", "hall", aisle)
    return plan.building()


def times(building, points, route=0, **options):
    return build_fields(building, ANY, **options).travel_time_at(0, np.array(points, float), route)


def test_a_slow_area_takes_longer_by_its_share():
    plan = evac.Plan()
    plan.storey("corridor", shapely.box(0, 0, 20, 2))
    plan.exit("out", "corridor", [(20, 0), (20, 2)])
    plan.area("gravel", "corridor", shapely.box(8, 0, 12, 2))
    points, building = [(2.0, 1.0), (10.0, 1.0), (14.0, 1.0)], plan.building()
    assert times(after(building, "slow", "gravel", 0.5), points) == pytest.approx([22.0, 12.0, 6.0], abs=0.15)
    assert times(after(building, "slow", "gravel", 0.25), points) == pytest.approx([30.0, 16.0, 6.0], abs=0.4)
    fields = build_fields(after(building, "slow", "gravel", 0.5), ANY)
    np.testing.assert_allclose(fields.directions_at(0, np.array(points), 0), [[1.0, 0.0]] * 3, atol=1e-2)


def test_ways_lead_round_a_barred_area_as_if_it_were_no_ground():
    points = [(1.0, 0.8), (3.0, 5.0), (6.5, 0.8), (13.5, 0.8), (10.0, 9.2)]
    barred, without = after(hall(), "bar", "aisle", True), hall(shapely.box(7, 0, 13, 1.6))
    assert times(barred, points) == pytest.approx(times(without, points), abs=0.15)
    assert times(hall(), points)[0] < times(barred, points)[0] - 2.0
    inside = np.array([(8.0, 0.8), (12.0, 0.8)])
    directions = build_fields(barred, ANY).directions_at(0, inside, 0)
    assert (directions[:, 0] * [-1.0, 1.0] > 0.9).all()  # whoever is inside leaves by the nearest end


def test_a_barred_area_is_passed_where_there_is_no_other_way():
    building = after(hall(shapely.box(7, 8.4, 13, 10)), "bar", "aisle", True)
    points = np.array([(1.0, 0.8), (5.0, 0.8), (8.0, 0.8), (12.0, 0.8)])
    fields = build_fields(building, ANY)
    assert np.isfinite(fields.travel_time_at(0, points, 0)).all()
    directions = fields.directions_at(0, points, 0)
    assert (directions[:, 0] > 0.9).all()
    assert np.abs(np.diff(directions, axis=0)).max() < 0.15  # not along the edge of the area


@pytest.mark.parametrize(("towards", "left", "right"), [(None, 4.0, 8.0), ("right", 4.0, 22.0), ("left", 4.0, 8.0)])
def test_a_door_of_one_direction_is_passed_that_way(towards, left, right):
    plan = evac.Plan()
    plan.storey("floor", [shapely.box(0, 0, 5, 3), shapely.box(5.2, 0, 30, 3)])
    plan.area("left", "floor", shapely.box(0, 0, 5, 3))
    plan.area("right", "floor", shapely.box(5.2, 0, 30, 3))
    plan.door("door", "floor", [(5.1, 0.5), (5.1, 2.5)])
    for name, x in (("west", 0.0), ("east", 30.0)):
        plan.exit(name, "floor", [(x, 0), (x, 3)])
    building = plan.building()
    building = building if towards is None else after(building, "one_way", "door", towards)
    assert times(building, [(4.0, 1.5), (8.0, 1.5)]) == pytest.approx([left, right], abs=0.1)
    only = build_fields(building, [Route(exits=("east",))])
    from_left = only.travel_time_at(0, np.array([(4.0, 1.5)]), 0)
    assert from_left == pytest.approx([np.inf if towards == "left" else 26.0], abs=0.1)


def test_a_route_to_exits_that_cannot_be_reached_leads_anywhere_if_that_is_wanted(drawing):
    for level, (x, name) in enumerate(((0, "A"), (10, "B"))):
        drawing.level((x, 0, x + 8, 2))
        drawing.exit(name, level, (x, 0), (x, 2))
    building, routes = drawing.build(), [Route(exits=("B",)), Route(exits=("A",))]
    points = [(0, np.array([(5.0, 1.0)])), (1, np.array([(16.0, 1.0)]))]
    for anywhere, expected in ((False, [[np.inf, 6.0], [5.0, np.inf]]), (True, [[5.0, 6.0], [5.0, 6.0]])):
        fields = build_fields(building, routes, anywhere=anywhere)
        for route, row in enumerate(expected):
            found = [fields.travel_time_at(level, place, route)[0] for level, place in points]
            assert found == pytest.approx(row, abs=0.05)
    closed = replace(building, closed=frozenset([building.link_of(building.exits[0])]))
    assert build_fields(closed, routes).travel_time_at(*points[1], 1) == pytest.approx([6.0], abs=0.05)


@pytest.mark.parametrize(
    ("route", "options", "words"),
    [
        (Route(strategy="shortes"), {}, "unknown strategy 'shortes'; did you mean 'shortest'"),
        (Route(exits=("AA",)), {}, "a route leads to exit 'AA', which .* does not have; did you mean 'A'"),
        (Route(), {"spacing": 0.61}, "directions.spacing: exit 'A' is 1.2 m wide, less than two cells of 0.61 m"),
        (Route(), {"spacing": 1e-5}, "directions.spacing: 1e-05 m requires grids of .* nodes for 1 routes"),
    ],
)
def test_what_cannot_be_solved_is_told_by_its_key(drawing, route, options, words):
    drawing.level((0, 0, 6, 5))
    drawing.exit("A", 0, (6, 2.6), (6, 3.8))
    with pytest.raises(ScenarioError, match=words):
        build_fields(drawing.build(), [route], **options)
