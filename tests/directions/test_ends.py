"""Ends with a cost and jumps with a time: travel times beside exact distances, as marched and as solved again."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from evac.building.model.building import Area, Jump
from evac.building.model.links import isolated_parts, levels_reaching
from evac.directions.build import build_fields
from evac.directions.density import Gates
from evac.directions.routefield import RouteField
from evac.directions.routes import Route
from tests.directions.walks import positions_on

SPACING, ANY = 0.1, Route((), "quickest")


def solved(building, route=ANY, **settings):
    """Return the fields of a building by scikit-fmm, and as the compiled march solves them."""
    fields = build_fields(building, [route], spacing=SPACING, **settings)
    packed = fields.packed.replace(travel_time=fields.packed.travel_time.copy())
    column = RouteField(fields, packed.travel_time, packed.direction.copy(), 0, Gates(fields.grids[0].grids))
    column.write({*range(len(building.levels))})
    return fields, replace(fields, packed=packed)


def away(points, place):
    return np.hypot(*(points - place).T)


def middle(building, name):
    return shapely.maximum_inscribed_circle(building.area_named(name).polygon).coords[0]


def area(name, level, x, y):
    return Area(name, level, shapely.box(x - 0.5, y - 0.5, x + 0.5, y + 0.5))


def assert_exact(fields, level, points, exact, tolerance):
    for one, mean in zip(fields, (0.6, 0.9), strict=False):  # a compiled march begins within a cell of an exit
        error = np.abs(one.travel_time_at(level, points, 0) - exact)
        assert error.max() < 2.0 * tolerance
        assert error.mean() < mean * tolerance


@pytest.mark.parametrize("cost", [0.0, 4.0, 30.0])
@pytest.mark.parametrize("clearance", [0.0, 0.25])
def test_an_exit_with_a_cost_is_as_far_as_the_sum(hall, cost, clearance):
    building = replace(hall, costs=frozenset({("right", cost)}))
    points = positions_on(building, 0, 300)
    to_left, to_right = (
        shapely.distance(shapely.LineString(e.segments.reshape(2, 2)), shapely.points(points)) for e in building.exits
    )
    exact = np.minimum(to_left, to_right + cost)
    assert_exact(solved(building, clearance=clearance)[:1], 0, points, exact, SPACING)
    if clearance == 0.0:
        assert_exact(solved(building, clearance=clearance), 0, points, exact, SPACING)
    far = np.array([[15.0, 3.0]])
    along = build_fields(building, [Route()], spacing=SPACING).directions_at(0, far, 0)[0]
    assert (along[0] < -0.9) == (cost > 12.0)  # who stands beside a costly exit goes to the other


def test_a_place_with_a_cost_and_the_only_exit_of_a_route(hall):
    building = replace(hall, areas=(area("refuge", 0, 8.0, 3.0),), costs=frozenset({("refuge", 7.0), ("left", 3.0)}))
    points = positions_on(building, 0, 200)
    exact = 7.0 + away(points, middle(building, "refuge"))
    assert_exact(solved(building, Route((), "quickest", area="refuge"), clearance=0.0), 0, points, exact, SPACING)
    left = shapely.distance(shapely.LineString([(2.0, 0.0), (3.0, 0.0)]), shapely.points(points))
    assert_exact(solved(building, Route(("left",), "quickest"), clearance=0.0), 0, points, 3.0 + left, SPACING)


@pytest.fixture
def storeys(drawing):
    """Three storeys that only jumps join, with an exit on the lowest one."""
    for k in range(3):
        drawing.level((0.0, 0.0, 20.0, 8.0), z=3.0 * k)
    drawing.exit("out", 0, (0.0, 2.0), (0.0, 4.0))
    building = drawing.build()
    lobbies = [area(f"lobby {k}", k, 16.0, 4.0) for k in range(3)]
    return replace(building, areas=(*lobbies, area("other", 2, 3.0, 4.0)))


def test_a_jump_adds_its_time_and_the_way_beyond_it(storeys):
    jumps = {Jump("lobby 2", "lobby 1", 9.0), Jump("lobby 1", "lobby 0", 5.0), Jump("other", "lobby 0", 20.0)}
    building = replace(storeys, jumps=frozenset(jumps))
    assert levels_reaching(building, building.exits) == {0, 1, 2}
    assert not isolated_parts(building)
    fields = solved(building, clearance=0.0)
    out, lobby = shapely.LineString([(0.0, 2.0), (0.0, 4.0)]), middle(building, "lobby 0")
    beyond = shapely.distance(out, shapely.Point(lobby))
    points = positions_on(building, 0, 200)
    assert_exact(fields, 0, points, shapely.distance(out, shapely.points(points)), SPACING)
    first = 5.0 + beyond + away(points, lobby)
    assert_exact(fields, 1, points, first, SPACING)
    second = np.minimum(14.0 + beyond + away(points, lobby), 20.0 + beyond + away(points, middle(building, "other")))
    assert (second < 14.0 + beyond + away(points, lobby)).any()
    assert_exact(fields, 2, points, second, SPACING)
    assert np.isinf(solved(replace(building, jumps=frozenset()), clearance=0.0)[0].travel_time_at(2, points, 0)).all()


def test_a_jump_is_a_short_cut_only_where_it_saves_time(row):
    """Three rooms in a row: a jump from the first to the last one, beside the way through the portals."""
    building = replace(row, areas=(area("near", 0, 2.0, 2.0), area("far", 2, 20.0, 2.0)))
    points = positions_on(building, 0, 200)
    walked = build_fields(building, [Route()], spacing=SPACING, clearance=0.0).travel_time_at(0, points, 0)
    for time in (3.0, 12.0, 40.0):
        jumping = replace(building, jumps=frozenset({Jump("near", "far", time)}))
        exact = np.minimum(walked, time + 4.0 + away(points, middle(building, "near")))
        assert (exact < walked).any() == (time < 20.0)
        assert_exact(solved(jumping, clearance=0.0), 0, points, exact, SPACING)


def test_a_level_that_is_solved_alone_takes_the_times_beyond_its_jump(storeys):
    building = replace(storeys, jumps=frozenset({Jump("lobby 2", "lobby 0", 9.0), Jump("lobby 1", "other", 5.0)}))
    fields = build_fields(building, [Route((), "quickest")], spacing=SPACING)
    levels = {0, 1, 2}

    def column():
        time, direction = fields.packed.travel_time.copy(), fields.packed.direction.copy()
        return RouteField(fields, time, direction, 0, Gates(fields.grids[0].grids))

    alone, together = column(), column()
    density = np.where(alone.waves.level_of == 2, 3.0, 0.0)
    assert alone.slow_down(density, levels, 0.05) == together.slow_down(density, levels, 0.05) == {2}
    assert alone.solve({2}, levels, is_first=True) == 2  # and the level from which a jump leads to it
    assert together.solve(levels, levels, is_first=True) == 3
    assert alone.waves.time == pytest.approx(together.waves.time, abs=1e-9)
    crowded = alone.waves.time[(alone.waves.level_of == 1) & np.isfinite(alone.waves.time)]
    assert crowded.min() > column().waves.time[(alone.waves.level_of == 1)].min() + 5.0


def test_an_exit_with_ground_close_behind_it_is_where_its_ways_end(drawing):
    drawing.level(shapely.union_all([shapely.box(0, 0, 5, 4), shapely.box(5.05, 0, 10, 4)]))
    drawing.exit("through the wall", 0, (5, 1), (5, 3))
    drawing.exit("right", 0, (10, 0), (10, 4))
    building = drawing.build()
    points = positions_on(building, 0, 300)
    left = points[:, 0] < 5.0
    above = np.maximum(np.abs(points[:, 1] - 2.0) - 1.0, 0.0)
    exact = np.where(left, np.hypot(5.0 - points[:, 0], above), 10.0 - points[:, 0])
    for one in solved(building, clearance=0.0):
        assert np.abs(one.travel_time_at(0, points, 0) - exact)[~left].max() < 2.0 * SPACING
        assert np.abs(one.travel_time_at(0, points, 0) - exact)[left].max() < 3.0 * SPACING
