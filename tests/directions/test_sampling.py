"""Sampling kernels on small grids by hand."""

import math

import numpy as np
import pytest

from evac.directions.fields import NO_CELL_WALLS, CellWalls, Fields, PackedFields
from evac.directions.routes import Route


def fields(travel_time, direction=None, walls=NO_CELL_WALLS):
    """Return the fields of one level whose nodes lie at whole metres, and of a level without a field."""
    travel_time = np.asarray(travel_time, dtype=float)
    if direction is None:
        direction = np.zeros((*travel_time.shape, 2))
    return Fields(
        (Route(),),
        PackedFields(
            origin=np.zeros((2, 2)),
            shape=np.array([travel_time.shape] * 2, dtype=np.int32),
            spacing=1.0,
            width=np.zeros(0),
            field_of=np.array([[0], [-1]], dtype=np.int32),
            offset=np.array([0], dtype=np.int64),
            direction=np.asarray(direction, dtype=float).reshape(-1, 2),
            travel_time=travel_time.ravel(),
            walls=walls,
        ),
    )


def test_travel_time_is_bilinear():
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij")
    found = fields(1 + 2 * x + 3 * y + x * y).travel_time_at(0, [[0.25, 0.5], [2.5, 1.75], [3.0, 2.0]], 0)
    assert found == pytest.approx([1 + 0.5 + 1.5 + 0.125, 1 + 5 + 5.25 + 4.375, 1 + 6 + 6 + 6])


def test_travel_time_leaves_out_nodes_without_a_way():
    one = fields([[1.0, math.inf], [3.0, math.inf], [math.inf, math.inf]])
    assert one.travel_time_at(0, [[0.5, 0.5], [0.25, 0.9], [1.5, 0.5], [1.0, 0.0]], 0) == pytest.approx([2, 1.5, 3, 3])
    assert one.travel_time_at(0, [[2.0, 0.5]], 0)[0] == math.inf
    assert one.travel_time_at(1, [[0.0, 0.0]], 0)[0] == math.inf


def test_directions_are_normalised_and_the_nearest_nodes_where_they_cancel():
    east, west, north = (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0)
    turning = fields(np.zeros((2, 2)), [[east, north], [east, north]])
    assert turning.directions_at(0, [[0.5, 0.5]], 0)[0] == pytest.approx([math.sqrt(0.5)] * 2)
    ridge = fields(np.zeros((2, 2)), [[west, west], [east, east]])
    assert ridge.directions_at(0, [[0.49, 0.5], [0.51, 0.5]], 0) == pytest.approx(np.array([west, east]))
    assert ridge.directions_at(0, [[0.5, 0.5]], 0)[0].tolist() == [1.0, 0.0]
    assert not ridge.directions_at(1, [[0.5, 0.5]], 0).any()
    left, right = (-0.8, 0.6), (1.0, 0.0)
    leaning = fields(np.zeros((2, 2)), [[left, (0.8, -0.6)], [right, west]])
    near = [[0.45, 0.49], [0.55, 0.49], [0.45, 0.51], [0.55, 0.51]]
    assert leaning.directions_at(0, near, 0).tolist() == [[-0.8, 0.6], [1.0, 0.0], [0.8, -0.6], [-1.0, 0.0]]


def in_one_cell(*walls):
    """Return walls of the cell between the nodes (0, 0) and (1, 1), each x1, y1, x2, y2."""
    return CellWalls(
        offset=np.zeros((2, 1), np.int32),
        cell=np.zeros(1, np.int64),
        start=np.array([0, len(walls)], np.int64),
        wall=np.array(walls, dtype=float),
        steepest=1.0,
    )


def test_nodes_behind_walls_do_not_count():
    east, west, north, south = (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)
    nodes = [[east, north], [west, south]]
    # The wall x = 0.5 hides two nodes from each side.
    halved = fields(np.zeros((2, 2)), nodes, in_one_cell((0.5, -1.0, 0.5, 2.0)))
    across = halved.directions_at(0, [[0.25, 0.5], [0.75, 0.5]], 0)
    assert across == pytest.approx(np.array([[1.0, 1.0], [-1.0, -1.0]]) * math.sqrt(0.5))
    # Between four walls no node is visible, and the nearest is used.
    low, high = 0.1, 0.9
    corners = [(low, low), (high, low), (high, high), (low, high)]
    box = in_one_cell(*((*corners[k - 1], *corners[k]) for k in range(4)))
    boxed = fields(np.zeros((2, 2)), nodes, box)
    near = [[0.3, 0.2], [0.2, 0.8], [0.7, 0.2], [0.8, 0.7]]
    assert boxed.directions_at(0, near, 0).tolist() == [list(east), list(north), list(west), list(south)]


def test_travel_times_behind_walls_do_not_count():
    halved = fields([[1.0, 2.0], [9.0, 10.0]], walls=in_one_cell((0.5, -1.0, 0.5, 2.0)))
    assert halved.travel_time_at(0, [[0.25, 0.5], [0.75, 0.25]], 0) == pytest.approx([1.5, 9.25])
