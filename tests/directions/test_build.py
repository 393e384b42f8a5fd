"""Travel times against geodesics by hand, continuity over portals, strategies, and ways that bodies can follow."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.building.reading import read_building
from evac.directions.build import build_fields
from evac.directions.routes import Route
from evac.errors import ScenarioError

ANY = (Route(),)
SLOPE = math.atan(3.0 / 4.0)  # cosine 0.8: 1.25 m along the slope per metre in plan
U_STAIR = Path(__file__).parents[3] / "shared" / "data" / "multi_level_u_stair.obj"


def positions_on(building, level, number, seed=0):
    """Return random positions on a level."""
    polygon = building.levels[level].polygon
    low, high = np.array(polygon.bounds).reshape(2, 2)
    found = np.random.default_rng(seed).uniform(low, high, (4 * number, 2))
    return found[shapely.contains_xy(polygon, *found.T)][:number]


def geodesics(positions, start, end, corners, blocked):
    """Return shortest distances to the segment from start to end round corners: visibility, independent of grids."""
    line = np.linspace(start, end, 301)

    def distances(point, targets):
        sight = shapely.linestrings(np.stack((np.broadcast_to(point, targets.shape), targets), axis=1))
        return np.where(shapely.intersects(sight, blocked), math.inf, np.linalg.norm(targets - point, axis=1))

    corners = np.array(corners, dtype=float)
    rest = np.array([distances(corner, line).min() for corner in corners])
    between = np.array([distances(corner, corners) for corner in corners])
    for _ in corners:
        rest = np.minimum(rest, (between + rest).min(axis=1))
    return np.array([min(distances(p, line).min(), (distances(p, corners) + rest).min()) for p in positions])


def along(portal, number=60):
    """Return points on a portal."""
    start, end = portal.segments[0].reshape(2, 2)
    return start + (np.arange(number) + 0.5)[:, None] / number * (end - start)


def crossing(links, level, step):
    """Return the first of links on a level that a step crosses."""
    for link in links:
        here = level in getattr(link, "levels", ()) or level == getattr(link, "level", None)
        if here and any(step.intersects(shapely.LineString(s.reshape(2, 2))) for s in link.segments):
            return link
    return None


def walk(fields, building, position, level, length=0.04, steps=4000, route=0):
    """Follow directions from a position; return the name of the exit reached and the way as (level, x, y)."""
    position = np.array(position, dtype=float)
    way = [(level, *position)]
    for _ in range(steps):
        new = position + length * fields.directions_at(level, position, route)[0]
        step = shapely.LineString([position, new])
        exit_ = crossing(building.exits, level, step)
        if exit_:
            return exit_.name, way
        portal = crossing(building.portals, level, step)
        if portal:
            behind = portal.levels[1] if level == portal.levels[0] else portal.levels[0]
            if shapely.intersects_xy(building.levels[behind].polygon, *new):
                level = behind
        position = new
        way.append((level, *position))
    return None, way


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


def test_directions_beside_walls(drawing):
    drawing.level((0, 0, 6, 5))
    drawing.exit("A", 0, (6, 2.6), (6, 3.8))
    building = drawing.build()
    fields = build_fields(building, ANY, clearance=0.0)
    x = np.linspace(0.5, 5.0, 40)
    beside = np.concatenate([np.column_stack((x, np.full(40, y))) for y in (0.02, 0.1, 0.2, 4.8, 4.98)])
    target = np.column_stack((np.full(200, 6.0), np.clip(beside[:, 1], 2.6, 3.8)))
    exact = (target - beside) / np.linalg.norm(target - beside, axis=1)[:, None]
    cosine = (fields.directions_at(0, beside, 0) * exact).sum(axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 2.0


@pytest.mark.parametrize("y", [2.0, 2.03, 2.05])
@pytest.mark.parametrize("thickness", [0.0, 0.03])
def test_a_wall_thinner_than_a_cell_holds(drawing, y, thickness):
    room = shapely.box(0, 0, 6, 5)
    drawing.level(room.difference(shapely.box(0, y, 4, y + thickness)) if thickness else room)
    if not thickness:
        drawing.wall(0, (0, y), (4, y))
    drawing.exit("A", 0, (0, 3), (0, 4))
    fields = build_fields(drawing.build(), ANY)
    exact = math.hypot(3.5, y - 1.5) + math.hypot(4.0, 3.0 - y)
    assert fields.travel_time_at(0, [[0.5, 1.5]], 0)[0] == pytest.approx(exact, abs=0.4)
    assert fields.travel_time_at(0, [[0.5, 1.5]], 0)[0] > exact - 0.05
    assert fields.directions_at(0, [[0.5, 1.5]], 0)[0, 0] > 0.9


@pytest.mark.parametrize("shift", np.linspace(0.0, 0.09, 4))
@pytest.mark.parametrize("width", [0.3, 0.5])
def test_a_narrow_door_between_thin_walls_stays_open(drawing, shift, width):
    drawing.level((0, 0, 6, 5))
    x, y = 3 + shift, 2 + shift
    drawing.wall(0, (x, 0), (x, y))
    drawing.wall(0, (x, y + width), (x, 5))
    drawing.exit("A", 0, (6, 2), (6, 3))
    building = drawing.build()
    fields = build_fields(building, ANY)
    exit_, way = walk(fields, building, (0.5, 0.5), 0)
    assert exit_ == "A"
    assert fields.travel_time_at(0, [[0.5, 0.5]], 0)[0] == pytest.approx(
        math.hypot(x - 0.5, y - 0.5) + 6 - x, abs=0.25
    )
    at_door = min(way, key=lambda place: abs(place[1] - x))
    assert at_door[2] == pytest.approx(y + width / 2, abs=0.1)


@pytest.mark.parametrize(("width", "kept"), [(0.5, 0.23), (0.82, 0.24), (1.2, 0.24)])
@pytest.mark.parametrize("start", [(2.6, 0.3), (2.6, 4.7), (0.5, 0.5), (1.5, 2.5)])
def test_ways_keep_clear_of_door_posts(drawing, width, kept, start):
    low, high = 2.5 - width / 2, 2.5 + width / 2
    wall = shapely.union(shapely.box(3, -1, 3.2, low), shapely.box(3, high, 3.2, 6))
    drawing.level(shapely.box(0, 0, 6, 5).difference(wall))
    drawing.exit("A", 0, (6, 0.5), (6, 1.5))
    building = drawing.build()
    exit_, way = walk(build_fields(building, ANY), building, start, 0)
    assert exit_ == "A"
    through = [place[1:] for place in way if 2.7 < place[1] < 3.5]
    assert shapely.distance(wall, shapely.points(through)).min() > kept


@pytest.mark.parametrize("width", [0.5, 0.82])
@pytest.mark.parametrize("start", [(4.75, 0.3), (4.75, 4.7), (1.0, 1.0)])
def test_ways_keep_clear_of_exit_posts(drawing, width, start):
    drawing.level((0, 0, 5, 5))
    posts = [(5, 2.5 - width / 2), (5, 2.5 + width / 2)]
    drawing.exit("A", 0, *posts)
    building = drawing.build()
    exit_, way = walk(build_fields(building, ANY), building, start, 0)
    assert exit_ == "A"
    distance = shapely.distance(shapely.points([place[1:] for place in way]), shapely.MultiPoint(posts))
    assert distance.min() > 0.2


def test_every_node_within_reach_points_somewhere(drawing):
    drawing.level(PLANS["pillar"][0])
    drawing.exit("A", 0, (6, 2.6), (6, 3.8))
    building = drawing.build()
    fields = build_fields(building, ANY)
    assert np.linalg.norm(fields.direction, axis=1) == pytest.approx(1.0)
    behind = fields.directions_at(0, [[6.15, 3.2], [6.05, 2.8]], 0)
    assert behind == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0]]), abs=0.15)
    assert fields.travel_time_at(0, [[5.95, 3.2], [6.05, 3.2]], 0) == pytest.approx([0.05, -0.05])


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


def test_a_stair_is_slower_up_and_as_long_for_the_shortest_route(drawing):
    drawing.level((0, 0, 6, 5))
    drawing.level((6, 2, 10, 3.5), uphill=(1, 0), slope=SLOPE)
    drawing.level((10, 0, 16, 5), z=3.0)
    drawing.portal(0, 1, (6, 2), (6, 3.5))
    drawing.portal(1, 2, (10, 2), (10, 3.5))
    drawing.exit("A", 2, (16, 2), (16, 3.5))
    routes = [Route(strategy=strategy) for strategy in ("fastest", "shortest", "comfortable")]
    fields = build_fields(drawing.build(), routes, speeds=(1.25, 0.5, 0.7), comfort=3.0)
    times = [fields.travel_time_at(0, [[3.0, 2.75]], route)[0] for route in range(3)]
    assert times == pytest.approx([9 / 1.25 + 5 / 0.5, 9 + 5, 9 / 1.25 + 3 * 5 / 0.5], abs=0.1)
    assert fields.lengths_at(0, [[3.0, 2.75]], 1)[0] == pytest.approx([9, 5, 0], abs=0.05)


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


def test_a_wide_portal_leads_to_two_exits(drawing):
    """The least time on the portal lies before one exit; the other must be found as well, two levels behind."""
    drawing.level((0, 0, 20, 3))
    drawing.level((0, 3, 20, 4))
    drawing.level((0, 4, 20, 6))
    drawing.portal(0, 1, (0, 3), (20, 3))
    drawing.portal(1, 2, (0, 4), (20, 4))
    drawing.exit("A", 2, (1, 6), (2, 6))
    drawing.exit("B", 2, (20, 4.2), (20, 5.2))
    fields = build_fields(drawing.build(), ANY)
    exact = [math.dist((1.5, 1), (1.5, 6)), math.dist((17, 1), (20, 4.2)), math.dist((8, 1), (2, 6))]
    assert fields.travel_time_at(0, [[1.5, 1.0], [17.0, 1.0], [8.0, 1.0]], 0) == pytest.approx(exact, abs=0.1)


def test_both_ends_of_a_flight_lead_out(drawing):
    drawing.level((0, 0, 4, 2), z=6.0)
    drawing.level((4, 0, 12, 2), uphill=(-1, 0), slope=SLOPE)
    drawing.level((12, 0, 16, 2))
    drawing.portal(0, 1, (4, 0), (4, 2))
    drawing.portal(1, 2, (12, 0), (12, 2))
    drawing.exit("top", 0, (0, 0), (0, 2))
    drawing.exit("bottom", 2, (16, 0), (16, 2))
    fields = build_fields(drawing.build(), ANY, speeds=(1.0, 0.5, 0.8))
    x = np.array([5.0, 6.5, 8.0, 11.0])
    up, down = 4 + (x - 4) * 1.25 / 0.5, 4 + (12 - x) * 1.25 / 0.8
    points = np.column_stack((x, np.ones(4)))
    assert fields.travel_time_at(1, points, 0) == pytest.approx(np.minimum(up, down), abs=0.05)
    assert np.sign(fields.directions_at(1, points, 0)[:, 0]) == pytest.approx(np.where(up < down, -1, 1))
    lengths = fields.lengths_at(1, points, 0)
    assert lengths[0] == pytest.approx([4, 1.25, 0], abs=0.1)
    assert lengths[3] == pytest.approx([4, 0, 1.25], abs=0.1)


def test_flights_side_by_side_do_not_leak(drawing):
    """A U stair whose flights share the line y = 2 in plan, 0 to 1.5 m and 1.5 to 3 m high."""
    slope = math.atan(1.5 / 4)
    drawing.level((0, 0, 4, 4), z=3.0)
    drawing.level((4, 0, 8, 2), uphill=(-1, 0), slope=slope)
    drawing.level((8, 0, 10, 4), z=1.5)
    drawing.level((4, 2, 8, 4), uphill=(1, 0), slope=slope)
    drawing.level((0, 0, 4, 4))
    for first, second, x, low in ((0, 1, 4, 0), (1, 2, 8, 0), (2, 3, 8, 2), (3, 4, 4, 2)):
        drawing.portal(first, second, (x, low), (x, low + 2))
    drawing.exit("A", 4, (0, 2), (0, 4))
    building = drawing.build()
    fields = build_fields(building, ANY, speeds=(1.0, 0.5, 1.0))
    stretch = 1 / math.cos(slope)
    exact = 4 + 4 * stretch + 4 * stretch + 4
    assert fields.travel_time_at(0, [[0.0, 1.99]], 0)[0] == pytest.approx(exact, abs=0.3)
    for start in ((2.0, 1.0), (0.5, 3.5)):
        assert walk(fields, building, start, 0)[0] == "A"
    for portal in building.portals:
        one, two = (fields.travel_time_at(level, along(portal), 0) for level in portal.levels)
        assert np.abs(one - two).max() < 0.2


@pytest.mark.skipif(not U_STAIR.exists(), reason="shared data absent")
def test_u_stair_of_a_mesh_leads_everybody_down_and_out():
    building = read_building(U_STAIR, exits=[{"name": "A", "segment": [[20, 2], [20, 3]], "z": 0.0}])
    fields = build_fields(building, ANY, speeds=(1.0, 0.5, 0.7))
    for portal in building.portals:
        one, two = (fields.travel_time_at(level, along(portal), 0) for level in portal.levels)
        assert np.abs(one - two).max() < 0.2
    for level in building.levels:
        for start in positions_on(building, level.index, 8, seed=level.index):
            exit_, way = walk(fields, building, start, level.index)
            assert exit_ == "A"
            levels, points = [place[0] for place in way], np.array([place[1:] for place in way])
            assert np.diff(fields.travel_time_at(levels, points, 0)).max() < 0.02


def test_floors_of_the_same_plan_do_not_interact(drawing):
    alone = type(drawing)()
    alone.level((0, 0, 6, 5))
    alone.exit("A", 0, (6, 1), (6, 2))
    drawing.level((0, 0, 6, 5))
    drawing.level(PLANS["pillar"][0], z=3.0)
    drawing.exit("A", 0, (6, 1), (6, 2))
    drawing.exit("B", 1, (0, 3), (0, 4))
    single, double = build_fields(alone.build(), ANY), build_fields(drawing.build(), (Route(), Route(("B",))))
    nodes = len(single.travel_time)
    assert np.array_equal(single.travel_time, double.travel_time[:nodes])
    assert np.array_equal(single.direction, double.direction[:nodes])
    assert double.field_of.tolist() == [[0, -1], [1, 2]]
    assert double.travel_time_at(0, [[1.0, 1.0]], 1)[0] == math.inf
    assert not double.directions_at(0, [[1.0, 1.0]], 1).any()


def test_a_pocket_without_a_way_out_has_no_time(drawing):
    drawing.level((0, 0, 6, 5))
    drawing.wall(0, (2, 0), (2, 5))
    drawing.exit("A", 0, (6, 1), (6, 2))
    fields = build_fields(drawing.build(), ANY)
    assert fields.field_of[0, 0] == 0
    assert fields.travel_time_at(0, [[1.0, 2.0], [4.0, 1.5]], 0) == pytest.approx([math.inf, 2.0])
    assert not fields.directions_at(0, [[1.0, 2.0]], 0).any()


def test_three_strategies_take_three_ways(drawing):
    """Two floors face each other across a gap; three ways lead over it, each farther off the straight line.

    Straight on a long steep stair (shortest), beside it a bridge that ends in 1 m of stair (fastest), at
    the far end a flat bridge (comfortable). By hand, round the corners of the ways:
    lengths 15.7, 18.1, 28.4 m; times 22.3, 19.1, 28.4 s; with stair time counted 8 times 115.7, 33.1, 28.4 s.
    """
    west = drawing.level((0, 0, 6, 20))
    east = drawing.level((10, 0, 16, 20))
    drawing.exit("A", east, (16, 2), (16, 3))
    steep = drawing.level((6, 2, 10, 3), uphill=(1, 0), slope=math.acos(0.6))
    drawing.portal(west, steep, (6, 2), (6, 3))
    drawing.portal(steep, east, (10, 2), (10, 3))
    ledge = drawing.level((6, 8, 9, 9))
    steps = drawing.level((9, 8, 10, 9), uphill=(1, 0), slope=math.radians(5))
    drawing.portal(west, ledge, (6, 8), (6, 9))
    drawing.portal(ledge, steps, (9, 8), (9, 9))
    drawing.portal(steps, east, (10, 8), (10, 9))
    bridge = drawing.level((6, 14, 10, 15))
    drawing.portal(west, bridge, (6, 14), (6, 15))
    drawing.portal(bridge, east, (10, 14), (10, 15))
    building = drawing.build()
    routes = [Route(strategy=strategy) for strategy in ("shortest", "fastest", "comfortable")]
    fields = build_fields(building, routes, speeds=(1.0, 0.5, 0.5), comfort=8.0)
    taken = []
    for route in range(3):
        exit_, way = walk(fields, building, (3.0, 2.5), west, route=route)
        assert exit_ == "A"
        taken.append({place[0] for place in way} - {west, east})
    assert taken == [{steep}, {ledge, steps}, {bridge}]
    start = np.array([[3.0, 2.5]])
    times = [fields.travel_time_at(west, start, route)[0] for route in range(3)]
    assert times == pytest.approx([15.67, 19.08, 28.41], abs=0.1)


def test_routes_with_exits_end_only_there(drawing):
    drawing.level((0, 0, 6, 5))
    drawing.exit("near", 0, (0, 1), (0, 2))
    drawing.exit("far", 0, (6, 1), (6, 2))
    building = drawing.build()
    fields = build_fields(building, (Route(), Route(("far",))))
    assert fields.travel_time_at(0, [[1.0, 1.5], [1.0, 1.5]], [0, 1]) == pytest.approx([1.0, 5.0])
    assert walk(fields, building, (1.0, 1.5), 0, route=1)[0] == "far"


def test_a_closed_portal_and_a_closed_exit_lead_nowhere(drawing):
    building = two_storeys(drawing)
    fields = build_fields(building, ANY, link_open=np.array([0, 1, 1], dtype=np.uint8))
    assert fields.field_of[:, 0].tolist() == [-1, 0, 1]
    fields = build_fields(building, ANY, link_open=np.array([1, 1, 0], dtype=np.uint8))
    assert fields.field_of[:, 0].tolist() == [-1, -1, -1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spacing": 0.0}, "directions.spacing"),
        ({"spacing": 1.0}, "exit 'A' is 1.00 m wide"),
        ({"clearance": -1.0}, "directions.clearance"),
        ({"order": 3}, "directions.order"),
        ({"comfort": 0.0}, "directions.comfort"),
        ({"speeds": (1.0, 0.0, 1.0)}, "reference speeds"),
    ],
)
def test_refuses_numbers_out_of_range(drawing, options, message):
    drawing.level((0, 0, 6, 5))
    drawing.exit("A", 0, (6, 1), (6, 2))
    with pytest.raises(ScenarioError, match=message):
        build_fields(drawing.build(), ANY, **options)


def test_refuses_routes_that_name_what_does_not_exist(drawing):
    drawing.level((0, 0, 6, 5))
    drawing.exit("north", 0, (6, 1), (6, 2))
    building = drawing.build()
    with pytest.raises(ScenarioError, match="did you mean 'north'"):
        build_fields(building, [Route(("nort",))])
    with pytest.raises(ScenarioError, match="did you mean 'fastest'"):
        build_fields(building, [Route(strategy="fast")])


def test_same_bits_again(drawing):
    building = two_storeys(drawing)
    first, second = (build_fields(building, ANY) for _ in range(2))
    assert np.array_equal(first.travel_time, second.travel_time)
    assert np.array_equal(first.direction, second.direction)
