"""Nodes of a lattice: which lie near a box, and which a wall between walkable nodes takes."""

import numpy as np
import pytest
import shapely

from evac.directions.raster.lattice import SLACK, Lattice, walkable_nodes, wall_distance

ROOM = shapely.box(0.0, 0.0, 4.0, 3.0)


@pytest.mark.parametrize("bounds", [(1.0, 0.5, 1.0, 2.0), (0.33, 0.71, 2.9, 1.4), (-5.0, 1.0, 9.0, 1.0)])
def test_a_box_holds_the_nodes_between_its_corners(bounds):
    window = Lattice((0.0, 0.0), 0.1).window(ROOM.bounds, 2)
    x, y = window.coordinates()
    near = (x >= bounds[0] - 1e-6) & (x <= bounds[2] + 1e-6) & (y >= bounds[1] - 1e-6) & (y <= bounds[3] + 1e-6)
    found = np.zeros(window.shape, dtype=bool)
    found[window.box(np.array(bounds[:2]) - 1e-6, np.array(bounds[2:]) + 1e-6)] = True
    assert np.array_equal(found, near)


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


def random_walls(seed, count=12):
    """Return segments of which some are along the grid or through its nodes."""
    generator = np.random.default_rng(seed)
    walls = generator.uniform(-0.5, 4.5, (count, 4))
    walls[::3] = np.round(walls[::3], 1)
    walls[1::4, 2] = walls[1::4, 0]
    return walls


@pytest.mark.parametrize("seed", range(5))
def test_the_distance_of_nodes_from_walls_is_that_of_shapely_up_to_the_reach(seed):
    walls, window = random_walls(seed), Lattice((0.0, 0.0), 0.1).window(ROOM.bounds, 2)
    nodes = np.random.default_rng(seed).uniform(size=window.shape) < 0.7
    distance = shapely.distance(
        shapely.points(*window.coordinates()), shapely.multilinestrings(shapely.linestrings(walls.reshape(-1, 2, 2)))
    )
    some = np.argwhere(nodes)
    np.testing.assert_array_equal(wall_distance(window, some, walls, 0.35), np.minimum(distance[nodes], 0.35))
    assert (wall_distance(window, some, np.zeros((0, 4)), 0.35) == 0.35).all()


@pytest.mark.parametrize("reach", [0.0, 0.1, 0.77])
def test_nodes_around_lines_hold_all_that_are_within_reach(reach):
    window = Lattice((0.0, 0.0), 0.1).window(ROOM.bounds, 2)
    lines = shapely.linestrings(random_walls(1, 3).reshape(-1, 2, 2))
    near = shapely.dwithin(shapely.multilinestrings(lines), shapely.points(*window.coordinates()), reach)
    marked = window.around(lines, reach)
    assert (marked | ~near).all()
    assert not marked.all()


def test_links_are_crossed_where_lines_meet():
    """Segments off the nodes: each link is crossed if shapely says so, at the place that shapely finds."""
    segments = np.random.default_rng(7).uniform(0.0, 3.0, (6, 4))
    window = Lattice((0.0, 0.0), 0.5).window((0.0, 0.0, 3.0, 3.0), 1)
    x, y = window.coordinates()
    for segment in segments:
        line = shapely.LineString(segment.reshape(2, 2))
        for axis in (0, 1):
            found = fractions(window.crossed_links(segment[None], axis, touching=False))
            for i, j in np.ndindex(window.shape):
                end = (x[i, j] + 0.5 * (axis == 0), y[i, j] + 0.5 * (axis == 1))
                point = line.intersection(shapely.LineString([(x[i, j], y[i, j]), end]))
                place = np.nan if point.is_empty else 2.0 * (point.x - x[i, j] + point.y - y[i, j])
                assert found.get((i, j), np.nan) == pytest.approx(place, abs=1e-9, nan_ok=True)
    for axis in (0, 1):
        together = window.crossed_links(segments, axis, touching=True)
        last = fractions(window.crossed_links(segments[-1:], axis, touching=True))
        assert last.items() <= fractions(together).items()
        ahead = np.subtract(together.far, together.near).T
        assert (ahead == ([1, 0] if axis == 0 else [0, 1])).all()


def fractions(links):
    """Return where links are crossed by their near ends, each of which is there once."""
    found = dict(zip(zip(*map(np.ndarray.tolist, links.near), strict=True), links.fraction.tolist(), strict=True))
    assert len(found) == len(links.fraction)
    return found


def test_a_part_of_a_window_has_the_nodes_of_a_box():
    window = Lattice((0.3, 0.7), 0.1).window(ROOM.bounds, 2)
    segments = np.array([[1.0, 0.5, 1.2, 2.0], [2.0, 0.5, 3.0, 1.5]])
    box = window.box_around(segments, 0.25)
    part = window.part(box)
    every, some = np.stack(window.coordinates(), axis=-1), np.stack(window.coordinates(box), axis=-1)
    np.testing.assert_array_equal(some, every[box])
    np.testing.assert_array_equal(window.places(np.argwhere(np.ones(window.shape))), every.reshape(-1, 2))
    assert part.shape == some.shape[:2]
    assert part.origin == pytest.approx(some[0, 0])
    lines = shapely.multilinestrings(segments.reshape(-1, 2, 2))
    near = shapely.dwithin(lines, shapely.points(every), 0.25)
    assert near[box].sum() == near.sum() > 0
    beyond = window.box_around(segments + 100.0, 0.25)
    assert window.part(beyond).shape == (0, 0)
