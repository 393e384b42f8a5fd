"""Lines to rooms: gaps that are closed, doors where walls are interrupted, walls of one line and of two."""

import numpy as np
import pytest
import shapely
from shapely import LineString, box
from shapely.affinity import rotate

from evac.building.recover.linework import door_sides, faces_of, rooms_of

#: Two rooms of 4 m and 4 m by 3 m, with a door between them, one to the outside, and gaps of 5 and 3 cm.
SINGLE = [
    LineString([(0, 0), (4, 0), (4, 1)]),
    LineString([(4, 2), (4, 3), (0, 3), (0, 2)]),
    LineString([(0, 1), (0, 0.05)]),
    LineString([(4, 0), (8, 0), (8, 3), (4.03, 3)]),
]


def outlines(polygon):
    return [LineString(shapely.get_coordinates(ring)) for ring in shapely.get_rings(polygon)]


def test_walls_of_one_line():
    rooms = rooms_of(SINGLE, gap=0.1, door=2.5, wall=0.1)
    assert rooms.floor.area == pytest.approx(24.0 - 0.1 * 2.0)
    assert rooms.closed.tolist() == [[0.0, 0.0, 0.0, 0.05], [4.03, 3.0, 4.0, 3.0]]
    assert rooms.between.tolist() == [[4.0, 1.0, 4.0, 2.0]]
    assert rooms.openings.tolist() == [[0.0, 1.0, 0.0, 2.0]]
    assert len(rooms.loose) == 0
    assert not rooms.left_out


def test_walls_of_two_lines():
    rooms = [box(0.3, 0.3, 4.9, 5.7), box(5.0, 0.3, 9.7, 5.7)]
    doors = [box(4.9, 2, 5.0, 2.9), box(0, 2, 0.3, 3)]
    walls = box(0, 0, 10, 6).difference(shapely.union_all([*rooms, box(4.8, 2, 5.1, 2.9), box(-0.1, 2, 0.4, 3)]))
    found = rooms_of(outlines(walls), gap=0.1, door=2.5, wall=0.1)
    expected = shapely.union_all([*rooms, *doors])
    assert found.floor.symmetric_difference(expected).area < 1e-6
    np.testing.assert_allclose(found.between, [[4.95, 2.0, 4.95, 2.9]])
    np.testing.assert_allclose(found.openings, [[0.0, 2.0, 0.0, 3.0]])


@pytest.mark.parametrize("seed", range(12))
def test_rooms_and_doors_are_the_same_at_any_angle(seed):
    rng = np.random.default_rng(seed)
    angle, move = rng.uniform(0.0, 360.0), rng.uniform(-50.0, 50.0, 2)
    walls = box(0, 0, 10, 6).difference(shapely.union_all([box(0.3, 0.3, 9.7, 5.7), box(-0.1, 2, 0.4, 3)]))
    inner = LineString([(4.9, 5.7), (4.9, 1.3), (5.1, 1.3), (5.1, 5.7)])  # 1 m to the wall below
    single = LineString([(1, 0), (0, 0), (0, 4), (5, 4), (5, 0), (2, 0)])
    for lines, area, openings, between in (
        ([*outlines(walls), inner], 9.4 * 5.4 + 0.3 - 0.2 * 4.4, 1, 1),
        ([single], 20.0, 1, 0),
    ):
        turned = [rotate(line, angle, (0, 0)) for line in lines]
        found = rooms_of([shapely.transform(line, lambda xy: xy + move) for line in turned], 0.1, 2.5, 0.1)
        assert found.floor.geom_type == "Polygon"
        assert found.floor.area == pytest.approx(area, abs=0.01)
        assert (len(found.openings), len(found.between), len(found.closed)) == (openings, between, 0)
        for ends in (*found.openings, *found.between):
            assert np.hypot(*(ends[2:] - ends[:2])) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("off", [-0.15, -0.008, 0.0, 0.1, 0.2, 0.35])
def test_a_door_drawn_beside_its_wall_is_the_interruption_of_the_wall(off):
    walls = box(0, 0, 10, 6).difference(shapely.union_all([box(0.2, 0.2, 9.8, 5.8), box(4, -0.1, 5, 0.3)]))
    single = LineString([(4, 0), (0, 0), (0, 6), (10, 6), (10, 0), (5, 0)])
    for lines, area in ((outlines(walls), 9.6 * 5.6), ([single], 60.0)):
        found = rooms_of(lines, 0.1, 2.5, 0.1, [[4.0, 0.2 - off, 5.0, 0.2 - off]])
        assert found.floor.area == pytest.approx(area, abs=0.21)
        (door,) = [*found.outer, *found.openings]
        np.testing.assert_allclose(sorted(door[::2]), [4.0, 5.0], atol=1e-3)


def test_a_door_ends_at_a_corner_that_is_almost_opposite():
    lines = [LineString([(0, 0), (4.0006, 0), (8, 0), (8, 3), (0, 3), (0, 0)]), LineString([(4, 3), (4, 1)])]
    found = rooms_of([*lines, LineString([(4.0006, 0), (4.0006, -3), (9, -3)])], gap=0.1, door=2.5, wall=0.1)
    assert found.between.tolist() == [[4.0, 1.0, 4.0006, 0.0]]


def test_what_is_wider_than_a_door_is_none():
    assert rooms_of(SINGLE, gap=0.1, door=0.9, wall=0.1).floor.area == 0.0


def test_lines_that_close_doors_are_no_walls():
    doors = [[4, 1, 4, 2], [0, 1, 0, 2]]
    rooms = rooms_of(SINGLE, gap=0.1, door=0.0, wall=0.1, doors=doors)
    assert rooms.floor.area == pytest.approx(24.0 - 0.1 * 2.0)
    assert (len(rooms.doors), len(rooms.outer)) == (1, 1)


def test_a_wall_that_ends_in_a_room_is_one():
    rooms = rooms_of([*outlines(box(0, 0, 8, 6)), LineString([(4, 0), (4, 3)])], gap=0.1, door=0.0, wall=0.2)
    assert rooms.floor.area == pytest.approx(48.0 - 0.2 * 3.0)


def test_columns_and_small_faces_are_no_rooms():
    rooms = rooms_of([*outlines(box(0, 0, 8, 6)), *outlines(box(2, 2, 3, 3))], gap=0.1, door=0.0, wall=0.1)
    assert rooms.floor.area == pytest.approx(47.0, abs=0.5)
    (column,) = rooms.left_out
    assert column.area == 1.0


@pytest.mark.parametrize("gap", [0.02, 0.5])
def test_gaps_are_closed_up_to_what_is_said(gap):
    lines = [LineString([(0, 0), (5, 0), (5, 4)]), LineString([(4.9, 4), (0, 4), (0, 0.1)])]
    found = faces_of(lines, gap)
    assert len(found.faces) == len(found.closed) / 2 == (gap > 0.1)
    assert bool(len(found.loose)) == (gap < 0.1)


def test_an_overshoot_and_lines_drawn_twice_change_nothing():
    lines = [*outlines(box(0, 0, 5, 4)), LineString([(5, 0), (5.05, 0)]), LineString([(5, 3e-5), (0, 2e-5)])]
    found = faces_of(lines, 0.1)
    assert sum(face.area for face in found.faces) == pytest.approx(20.0, rel=1e-3)


def test_doors_have_as_many_sides_as_rooms_at_them():
    floor = shapely.union_all([box(0, 0, 5, 4), box(5.2, 0, 10, 4)])
    doors = {(2, 1, 2, 2): 0, (5.1, 1, 5.1, 2): 2, (10.1, 1, 10.1, 2): 1, (4.5, 2, 5.7, 2): 0, (0, 1, 0, 2): 1}
    assert door_sides(np.array([*doors], float), floor).tolist() == [*doors.values()]
