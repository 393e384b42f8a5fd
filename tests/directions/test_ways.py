"""Ways that bodies can follow: round posts and corners, through doors, over stairs, to an exit."""

import math

import numpy as np
import pytest
import shapely

from evac.building.plan.plan import Plan
from evac.directions.build import build_fields
from evac.directions.density import Gates
from evac.directions.routefield import RouteField
from evac.directions.routes import Route
from evac.simulation.assembly import read_building
from tests.directions.walks import along, positions_on, walk
from tests.ustair import write_u_stair

ANY = (Route(),)
SLOPE = math.atan(3.0 / 4.0)  # cosine 0.8: 1.25 m along the slope per metre in plan


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


@pytest.mark.parametrize("shift", [0.0, 0.03])
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
    assert fields.travel_time_at(0, [[0.5, 0.5]], 0)[0] == pytest.approx(math.hypot(x - 0.5, y - 0.5) + 6 - x, abs=0.25)
    at_door = min(way, key=lambda place: abs(place[1] - x))
    assert at_door[2] == pytest.approx(y + width / 2, abs=0.1)


@pytest.mark.parametrize(("width", "kept"), [(0.5, 0.23), (0.82, 0.24), (1.2, 0.24)])
@pytest.mark.parametrize("start", [(2.6, 0.3), (0.5, 0.5)])
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


@pytest.mark.parametrize("clearance", [0.1, 0.22, 0.3])
@pytest.mark.parametrize("length", [0.2, 6.5])
def test_every_clearance_leads_everywhere(drawing, length, clearance):
    """The strip behind an exit begins before its last row of nodes, whether or not the exit is on a row."""
    drawing.level((0, 0, length, 1.4))
    drawing.exit("A", 0, (0, 0), (0, 1.4))
    building = drawing.build()
    fields = build_fields(building, ANY, clearance=clearance)
    positions = positions_on(building, 0, 50)
    directions = fields.directions_at(0, positions, 0)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    assert (directions[:, 0] < 0.0).all()
    assert (directions[np.abs(positions[:, 1] - 0.7) < 0.35, 0] < -0.95).all()
    assert fields.travel_time_at(0, positions, 0) == pytest.approx(positions[:, 0], abs=1e-6)


def test_an_exit_is_not_seen_through_the_wall_beside_it(drawing):
    drawing.level(shapely.box(0, 0, 6, 4).difference(shapely.box(2, 1, 7, 1.2)))
    drawing.exit("A", 0, (6, 0), (6, 1))
    fields = build_fields(drawing.build(), ANY)
    behind = [[6.0, 1.2], [5.95, 1.25], [5.9, 1.3]]
    expected = [math.dist(place, (2, 1.2)) + 0.2 + 4.0 for place in behind]
    assert fields.travel_time_at(0, behind, 0) == pytest.approx(expected, abs=0.05)


def test_every_node_within_reach_points_somewhere(drawing):
    drawing.level(shapely.box(0, 0, 6, 5).difference(shapely.box(3, 1.5, 4, 4)))
    drawing.exit("A", 0, (6, 2.6), (6, 3.8))
    building = drawing.build()
    fields = build_fields(building, ANY)
    assert np.linalg.norm(fields.packed.direction, axis=1) == pytest.approx(1.0)
    behind = fields.directions_at(0, [[6.15, 3.2], [6.05, 2.8]], 0)
    assert behind == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0]]), abs=0.15)
    assert fields.travel_time_at(0, [[5.95, 3.2], [6.05, 3.2]], 0) == pytest.approx([0.05, -0.05])


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


def test_u_stair_of_a_mesh_leads_everybody_down_and_out(tmp_path):
    building = read_building(
        write_u_stair(tmp_path / "u_stair.obj"), exits=[{"name": "A", "segment": [[20, 2], [20, 3]], "z": 0.0}]
    )
    fields = build_fields(building, ANY, speeds=(1.0, 0.5, 0.7))
    for portal in building.portals:
        one, two = (fields.travel_time_at(level, along(portal), 0) for level in portal.levels)
        assert np.abs(one - two).max() < 0.2
    for level in building.levels:
        for start in positions_on(building, level.index, 4, seed=level.index):
            exit_, way = walk(fields, building, start, level.index)
            assert exit_ == "A"
            levels, points = [place[0] for place in way], np.array([place[1:] for place in way])
            assert np.diff(fields.travel_time_at(levels, points, 0)).max() < 0.02


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


def test_lengths_of_ways_without_stairs_end_in_front_of_a_stair():
    plan = Plan()
    for name, height in (("ground", 0.0), ("first", 3.2)):
        plan.storey(name, shapely.box(0, 0, 12, 6), height)
    plan.stair("stair", "ground", [(2, 4.6), (2, 5.8)], "first", length=5.5, direction=(1, 0))
    plan.exit("back", "ground", [(12, 2), (12, 3.2)])
    route = Route(("back",), steepest=0.0834)
    fields = build_fields(plan.building(), (route,), clearance=0.4, narrowest=0.3, widest=0.3)
    assert fields.lengths_at(0, np.array([[4.0, 2.6]]), 0)[0] == pytest.approx([8, 0, 0], abs=0.05)


@pytest.mark.parametrize("strategy", ["fastest", "quickest"])
def test_ways_without_stairs_lead_off_a_stair_to_the_nearer_floor_and_not_onto_it(strategy):
    """Both floors have an exit; the landing of the stair belongs to it."""
    plan = Plan()
    for name, height in (("ground", 0.0), ("first", 4.0)):
        plan.storey(name, shapely.box(0, 0, 10, 6), height)
    plan.stair("stair", "ground", [(1, 0), (2.2, 0)], "first", [(2.3, 0), (3.5, 0)], length=3.0, direction=(0, -1))
    plan.exit("door", "ground", [(0, 2), (0, 4)])
    plan.exit("bridge", "first", [(10, 2), (10, 4)])
    building = plan.building()
    routes = [Route(strategy=strategy, steepest=0.0), Route(("door",), strategy=strategy, steepest=0.0)]
    fields = build_fields(building, routes, keep_grids=True)
    if strategy == "quickest":
        clear, fields, levels = fields, fields.with_own_directions(), {*range(len(building.levels))}
        for number in range(2):
            own = fields.packed.travel_time, fields.packed.direction
            RouteField(clear, *own, number, Gates(clear.grids[0].grids)).solve(levels, levels, is_first=True)
    lower, landing, upper = (one.index for one in building.levels if one.stair)
    places = {lower: (1.6, -2.5), upper: (2.9, -2.5), landing: (3.0, -3.5)}
    ahead = {level: fields.directions_at(level, np.array([place]), 0)[0] for level, place in places.items()}
    assert ahead[lower][1] > 0.9
    assert ahead[upper][1] > 0.9
    assert np.hypot(*ahead[landing]) == pytest.approx(1.0)
    first = building.level_named("first").index
    assert np.isinf(fields.travel_time_at(first, np.array([[5.0, 3.0]]), 1)[0])
    assert np.isinf(fields.travel_time_at(first, np.array([[2.9, 0.3]]), 1)[0])
    (time,) = fields.travel_time_at(first, np.array([[4.0, 3.0]]), 0)
    assert time == pytest.approx(6.0, abs=0.05)
