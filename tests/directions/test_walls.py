"""Thin walls, ground behind exits, exits that face several ways: directions and times stay on their side."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from evac.building.surface.places import add_obstacles
from evac.directions.build import build_fields, find_cell_walls
from evac.directions.fields import NO_CELL_WALLS
from evac.directions.raster.grids import build_grids
from evac.directions.routes import Route
from tests.directions.plans import follow, random_plan, shortest, starts
from tests.directions.walks import positions_on, walk

ANY = (Route(),)
CLEARANCE = 0.25


@pytest.mark.parametrize(
    ("x", "thickness", "spacing", "as_obstacle"),
    [(5.0, 0.1, 0.1, True), (5.0, 0.2, 0.2, False), (3.3, 0.1, 0.05, False)],
)
def test_a_wall_with_its_faces_on_nodes_holds(drawing, x, thickness, spacing, as_obstacle):
    wall = shapely.box(x, -1.0, x + thickness, 5.0)
    room = shapely.box(0.0, 0.0, 10.0, 6.0)
    drawing.level(room if as_obstacle else room.difference(wall))
    drawing.exit("A", 0, (10.0, 0.5), (10.0, 1.5))
    building = drawing.build()
    if as_obstacle:
        building = add_obstacles(building, [("wall", building.levels[0], shapely.box(x, 0.0, x + thickness, 5.0))], [])
    fields = build_fields(building, ANY, spacing=spacing)
    start = np.array([[x - 1.0, 2.0]])
    exact = math.hypot(1.0, 3.0) + thickness + math.hypot(10.0 - x - thickness, 3.5)
    assert fields.travel_time_at(0, start, 0)[0] == pytest.approx(exact, abs=3.0 * spacing)
    assert walk(fields, building, start[0], 0)[0] == "A"


def balcony(drawing, gap):
    """Return a hall with an exit in its northern wall, a gap behind it, and a balcony round the corner."""
    hall = shapely.box(0.0, 0.0, 10.0, 6.0)
    terrace = shapely.box(0.0, 6.0 + gap, 12.0, 9.0).union(shapely.box(11.0, 0.0, 12.0, 9.0))
    drawing.level(hall.union(terrace).union(shapely.box(9.5, 1.0, 11.5, 2.0)))
    drawing.exit("door", 0, (2.0, 6.0), (3.2, 6.0))
    return drawing.build()


@pytest.mark.parametrize("clearance", [0.0, CLEARANCE])
@pytest.mark.parametrize("gap", [0.03, 0.3, 1.0])
def test_ground_of_the_same_level_behind_an_exit_changes_nothing_before_it(drawing, gap, clearance):
    building = balcony(drawing, gap)
    fields = build_fields(building, ANY, clearance=clearance)
    points = np.array([[1.0, 3.0], [2.6, 5.5], [8.0, 1.0], [9.0, 5.0]])
    exact = np.hypot(points[:, 0] - np.clip(points[:, 0], 2.0, 3.2), 6.0 - points[:, 1])
    assert fields.travel_time_at(0, points, 0) == pytest.approx(exact, abs=0.05)
    for point in points if clearance else ():
        exit_, way = walk(fields, building, point, 0)
        assert exit_ == "door"
        assert 2.15 < way[-1][1] < 3.05
    # From the balcony the way leads round through the hall.
    outside = np.array([2.6, 7.0])
    inner = np.array([[11.0, 6.0 + gap], [11.0, 2.0], [10.0, 2.0], [3.2, 6.0]])
    exact = np.hypot(*np.diff(np.vstack([outside, inner]), axis=0).T).sum()
    assert fields.travel_time_at(0, [outside], 0)[0] == pytest.approx(exact, rel=0.03)
    if clearance:
        assert walk(fields, building, outside, 0, steps=6000)[0] == "door"


@pytest.mark.parametrize("turn", [0.0, 45.0])
@pytest.mark.parametrize("side", [0.3, 1.0])
def test_an_exit_all_round_a_hole_is_reached_from_every_side(drawing, side, turn):
    hole = shapely.affinity.rotate(shapely.box(5.0 - side / 2, 5.0 - side / 2, 5.0 + side / 2, 5.0 + side / 2), turn)
    drawing.level(shapely.box(0.0, 0.0, 10.0, 10.0).difference(hole))
    corners = shapely.get_coordinates(hole)
    for start, end in itertools.pairwise(corners):
        drawing.exit("hatch", 0, start, end)
    parts = np.concatenate([part.segments for part in drawing.exits])
    hatch = replace(drawing.exits[0], segments=parts, width=4.0 * side)
    drawing.exits[:] = [hatch]
    building = drawing.build()
    fields = build_fields(building, ANY)
    points = np.array([5.0, 5.0]) + 4.0 * np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0.1, 6.3, 12)])
    exact = shapely.distance(hole, shapely.points(points))
    assert fields.travel_time_at(0, points, 0) == pytest.approx(exact, abs=0.05)
    for point in points:
        assert walk(fields, building, point, 0)[0] == "hatch"


def test_two_exits_back_to_back_across_a_slot_are_both_used(drawing):
    slot = shapely.box(4.0, 1.0, 4.3, 6.0)
    drawing.level(shapely.box(0.0, 0.0, 8.0, 5.0).difference(slot))
    drawing.exit("west", 0, (4.0, 3.0), (4.0, 4.0))
    drawing.exit("east", 0, (4.3, 3.0), (4.3, 4.0))
    building = drawing.build()
    fields = build_fields(building, ANY)
    assert fields.travel_time_at(0, [[1.0, 3.5], [7.0, 3.5]], 0) == pytest.approx([3.0, 2.7], abs=0.02)
    assert [walk(fields, building, place, 0)[0] for place in ((1.0, 3.5), (7.0, 3.5))] == ["west", "east"]


@pytest.mark.parametrize("clearance", [0.0, CLEARANCE])
@pytest.mark.parametrize("thickness", [0.05, 0.08])
@pytest.mark.parametrize("x", [3.0, 3.05])
def test_beside_a_thin_wall_directions_are_those_of_the_own_side(drawing, x, thickness, clearance):
    wall = shapely.box(x, -1.0, x + thickness, 4.0)
    drawing.level(shapely.box(0.0, 0.0, 6.0, 5.0).difference(wall))
    drawing.exit("A", 0, (6.0, 0.5), (6.0, 1.5))
    fields = build_fields(drawing.build(), ANY, clearance=clearance)
    # West of the wall the way leads north, round its end, and off the wall; east of it south.
    least = 0.1 if clearance else 0.9
    y = np.linspace(1.9, 3.0, 23)
    for offset in (-0.09, -0.03, -0.003):
        west = np.column_stack([np.full(23, x + offset), y])
        assert (fields.directions_at(0, west, 0)[:, 1] > least).all()
        exact = 4.0 - y + thickness + math.hypot(6.0 - x - thickness, 2.5)
        assert fields.travel_time_at(0, west, 0) == pytest.approx(exact, abs=0.25)
        east = np.column_stack([np.full(23, x + thickness - offset), y])
        assert (fields.directions_at(0, east, 0)[:, 1] < 0.0).all()
        exact = np.hypot(6.0 - x - thickness, y - 1.5)
        assert fields.travel_time_at(0, east, 0) == pytest.approx(exact, abs=0.2)


@pytest.mark.parametrize("overlap", [0.0, 1e-3, 0.015])
@pytest.mark.parametrize("shift", [0.0, 0.03, 0.05])
def test_no_way_leads_through_a_point_or_a_gap_narrower_than_two_centimetres(drawing, overlap, shift):
    """Two rooms that meet at a corner; the way leads round through a corridor."""
    low = shapely.box(0.0, 0.0, 4.0, 4.0)
    high = shapely.box(4.0 - overlap, 4.0, 8.0, 8.0)
    corridor = shapely.box(4.0, 1.0, 7.0, 2.0).union(shapely.box(6.0, 1.0, 7.0, 4.0))
    ground = shapely.affinity.translate(shapely.union_all([low, high, corridor]), shift, shift)
    # A corner of the building away from it decides where the nodes are.
    drawing.level(ground.union(shapely.box(0.0, 0.0, 1.0, 1.0)))
    drawing.exit("A", 0, (8.0 + shift, 6.0), (8.0 + shift, 7.0))
    building = drawing.build()
    fields = build_fields(building, ANY)
    exact = math.hypot(0.5, 1.5) + 2.0 + math.hypot(2.0, 4.0 - shift)
    assert fields.travel_time_at(0, [[3.5 + shift, 3.5 + shift]], 0)[0] == pytest.approx(exact, abs=0.25)


@pytest.mark.parametrize("slit", [0.15, 0.3, 0.38])
@pytest.mark.parametrize("clearance", [0.0, CLEARANCE])
def test_a_slit_that_nobody_fits_through_is_taken_only_where_there_is_no_other_way(drawing, slit, clearance):
    """A partition with a slit below, and a door 3 m above or none."""
    start = (2.0, 0.5)
    slow = math.hypot(1.0, 0.5 - slit) + 0.1 + math.hypot(2.9, 0.2)
    for top in (3.0, 4.0):
        own = type(drawing)()
        own.level(shapely.box(0, 0, 6, 4).difference(shapely.box(3.0, slit, 3.1, top)))
        own.exit("A", 0, (6, 0.5), (6, 1.5))
        building = own.build()
        narrow, wide = (build_fields(building, ANY, clearance=clearance, narrowest=d) for d in (0.4, 0.1))
        assert wide.travel_time_at(0, [start], 0)[0] == pytest.approx(slow, abs=0.4)
        if clearance:
            exit_, way = walk(narrow, building, start, 0)
            assert exit_ == "A"
            highest = max(y for _, x, y in way if 2.9 < x < 3.2)
            assert (highest > 3.0) == (top < 4.0)
        if top < 4.0:
            exact = math.hypot(1.0, 2.5) + 0.1 + math.hypot(2.9, 1.5)
            assert narrow.travel_time_at(0, [start], 0)[0] == pytest.approx(exact, abs=0.2)


def test_cells_list_the_walls_through_them_and_none_along_their_edges(drawing):
    drawing.level((0.0, 0.0, 2.0, 1.0))
    drawing.wall(0, (0.55, 0.0), (0.55, 0.5))
    drawing.wall(0, (1.0, 0.3), (1.0, 0.6))
    drawing.wall(0, (1.2, 0.2), (1.5, 0.5))
    grids = build_grids(drawing.build(), 0.1, CLEARANCE)
    found = find_cell_walls([grids], 1, 1.0)
    (grid,) = grids.levels
    ix, iy = np.unravel_index(found.cell - found.offset[0, 0], grid.window.shape)
    corner = np.round(grid.window.origin + 0.1 * np.column_stack([ix, iy]), 6)
    upright = [(0.5, y) for y in (0.0, 0.1, 0.2, 0.3, 0.4)]
    diagonal = [(1.2, 0.2), (1.3, 0.3), (1.4, 0.4)]
    assert sorted(map(tuple, corner.tolist())) == sorted(upright + diagonal)
    assert np.diff(found.start).tolist() == [1] * 8


def test_without_walls_in_cells_samples_are_the_same_bits(drawing):
    drawing.level((0.0, 0.0, 6.0, 5.0))
    drawing.exit("A", 0, (6.0, 2.6), (6.0, 3.8))
    building = drawing.build()
    fields = build_fields(building, ANY)
    bare = replace(fields, packed=fields.packed.replace(walls=NO_CELL_WALLS))
    points = positions_on(building, 0, 2000)
    assert np.array_equal(fields.directions_at(0, points, 0), bare.directions_at(0, points, 0))
    assert np.array_equal(fields.travel_time_at(0, points, 0), bare.travel_time_at(0, points, 0))


def check_plan(drawing, seed):
    """Compare a random plan with visibility graphs of its polygon, whole and reduced by the clearance."""
    plan = random_plan(seed)
    drawing.level(plan.polygon)
    for index, ends in enumerate(plan.exits):
        drawing.exit(f"exit {index}", 0, *ends)
    fields = build_fields(drawing.build(), ANY, clearance=CLEARANCE)
    points = starts(plan, 20, 0.3, seed)
    whole, reduced = shortest(plan, points, 0.0), shortest(plan, points, CLEARANCE)
    time = fields.travel_time_at(0, points, 0)
    ways, blocked = follow(fields, plan, points)
    assert np.array_equal(np.isfinite(time), np.isfinite(whole))
    assert blocked == []
    assert np.array_equal(np.isfinite(ways), np.isfinite(whole))
    known = np.isfinite(reduced)
    time, whole, reduced, ways = time[known], whole[known], reduced[known], ways[known]
    assert (time > 0.98 * whole).all()
    assert (time < 1.02 * reduced).all()
    # Two per cent, or a cell on ways shorter than 5 m.
    assert (np.abs(ways - reduced) < np.maximum(0.02 * reduced, 0.1)).all()


@pytest.mark.parametrize("seed", range(3))
def test_random_plans_agree_with_their_visibility_graphs(drawing, seed):
    check_plan(drawing, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_two_hundred_random_plans_agree_with_their_visibility_graphs(drawing, seed):
    check_plan(drawing, seed)
