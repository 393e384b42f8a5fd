"""Nodes of a lattice: which lie near a box, and which a wall between walkable nodes takes."""

import numpy as np
import pytest
import shapely

from evac.directions.lattice import SLACK, Lattice, walkable_nodes

ROOM = shapely.box(0.0, 0.0, 4.0, 3.0)


@pytest.mark.parametrize("bounds", [(1.0, 0.5, 1.0, 2.0), (0.33, 0.71, 2.9, 1.4), (-5.0, 1.0, 9.0, 1.0)])
def test_a_box_holds_the_nodes_between_its_corners(bounds):
    window = Lattice((0.0, 0.0), 0.1).window(ROOM.bounds, 2)
    x, y = window.coordinates()
    near = (x >= bounds[0] - 1e-6) & (x <= bounds[2] + 1e-6) & (y >= bounds[1] - 1e-6) & (y <= bounds[3] + 1e-6)
    found = np.zeros(window.shape, dtype=bool)
    found[window.box(np.array(bounds[:2]) - 1e-6, np.array(bounds[2:]) + 1e-6)] = True
    assert np.array_equal(found, near)


@pytest.mark.parametrize("bounds", [(-3.0, 0.0, -2.0, 3.0), (9.0, 9.0, 9.5, 9.5), (0.52, 0.52, 0.58, 0.58)])
def test_a_box_without_nodes_is_empty(bounds):
    window = Lattice((0.0, 0.0), 0.1).window(ROOM.bounds, 2)
    assert np.zeros(window.shape)[window.box(np.array(bounds[:2]), np.array(bounds[2:]))].size == 0


def test_nodes_on_a_wall_inside_a_room_are_not_walkable_and_those_beside_it_are():
    walls = np.array([[1.0, 0.5, 1.0, 2.0], [2.0, 0.5, 3.0, 1.5]])
    window = Lattice((0.0, 0.0), 0.1).window(ROOM.bounds, 2)
    nodes, _ = walkable_nodes(window, ROOM, walls)
    x, y = window.coordinates()
    inside = shapely.intersects_xy(shapely.buffer(ROOM, 1e-9), x, y)
    on_wall = shapely.dwithin(shapely.multilinestrings(walls.reshape(-1, 2, 2)), shapely.points(x, y), SLACK)
    assert on_wall.sum() == 16 + 11
    assert not (nodes & on_wall).any()
    far = ~shapely.dwithin(shapely.multilinestrings(walls.reshape(-1, 2, 2)), shapely.points(x, y), 0.1 + SLACK)
    assert np.array_equal(nodes & far, inside & far)
