"""Stairs that are drawn in plan: flights in lines, their arrow, and two flights side by side."""

import numpy as np
import pytest
import shapely

from evac.building.recover.drawings import doors_of, flights_of, plans_of, stairs_of, swing_of


def treads(number=9, going=0.28, width=1.2, at=(0.0, 0.0), turn=0.0):
    way = np.array([np.cos(turn), np.sin(turn)])
    lines = [[at + k * going * way, at + k * going * way + width * np.array([-way[1], way[0]])] for k in range(number)]
    return [shapely.LineString(line) for line in lines]


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.5])
def test_a_flight_is_a_row_of_equal_lines(turn):
    noise = [shapely.LineString([(0, y), (30, y)]) for y in (-2.0, 8.0)]
    (flight,) = flights_of([*treads(turn=turn), *treads(turn=turn), *noise])
    assert (flight.lines, flight.is_directed) == (9, False)
    assert np.hypot(*(flight.foot[1] - flight.foot[0])) == pytest.approx(1.2, abs=0.02)
    assert np.hypot(*(flight.head - flight.foot).mean(axis=0)) == pytest.approx(8 * 0.28, abs=0.02)


@pytest.mark.parametrize(
    "lines",
    [treads(number=4), treads(going=0.6), treads(width=5.0), treads(4) + treads(4, at=(1.3, 0.0)), []],
    ids=["few", "far apart", "wide", "irregular", "none"],
)
def test_other_lines_are_no_stair(lines):
    assert flights_of(lines) == []


@pytest.mark.parametrize("way", [1, -1])
def test_an_arrow_points_upwards(way):
    tip = (2.3, 0.6) if way == 1 else (-0.1, 0.6)
    shaft = shapely.LineString([(2.2 - tip[0], 0.6), tip])
    barbs = [shapely.LineString([tip, (tip[0] - 0.2 * way, 0.6 + off)]) for off in (-0.1, 0.1)]
    (flight,) = flights_of([*treads(), shaft, *barbs])
    assert flight.is_directed
    assert np.sign(flight.head[0, 0] - flight.foot[0, 0]) == way


def test_two_flights_side_by_side_turn_at_the_wall():
    flights = flights_of([*treads(at=(0.0, 0.0)), *treads(at=(0.0, 1.3))])
    walls = [shapely.LineString([(-1.4, -1), (-1.4, 4)]), shapely.LineString([(6, -1), (6, 4)])]
    (stair,) = stairs_of(flights, walls)
    assert stair.turn["direction"].tolist() == [-1.0, 0.0]
    assert (stair.turn["length"], stair.turn["landing"]) == (pytest.approx(2.24), pytest.approx(1.4))
    assert stair.foot[:, 0].tolist() == stair.head[:, 0].tolist() == [2.24, 2.24]


def test_plans_are_numbered_in_rows_wherever_they_begin():
    low = [(0, 40), (30, 49), (60, 31), (0, 0), (30, 9)]  # those of a row are not level with each other
    found = plans_of([shapely.box(x, y, x + 20, y + 15).exterior for x, y in np.array(low)[[4, 2, 0, 3, 1]]])
    assert [part.bounds[0] + 1.25 for part in found] == pytest.approx([x for x, _ in low])
    assert [part.bounds[1] + 1.25 for part in found] == pytest.approx([y for _, y in low])


@pytest.mark.parametrize(
    ("leaf", "hinge"),
    [
        ([(7.85, 7.0), (6.99, 6.767)], (7.85, 7.0)),  # its arc has another centre
        ([(7.464, 7.001), (6.984, 6.735)], (7.464, 7.001)),
        ([(6.984, 6.735), (6.984, 6.2)], (7.464, 7.001)),  # no leaf of this door: its end is not at a wall
    ],
)
def test_a_door_has_its_hinge_at_the_end_of_its_leaf(leaf, hinge):
    angles = np.radians(np.linspace(180.0, 209.0, 9))
    swing = swing_of(np.array([7.464, 7.001]) + 0.549 * np.column_stack([np.cos(angles), np.sin(angles)]))
    wall, leaf = shapely.LineString([(0, 7), (12, 7)]), shapely.LineString(leaf)
    doors, (used,) = doors_of([swing], [wall], [wall, leaf])
    assert doors == pytest.approx(np.array([[*hinge, 6.915, 7.001]]))
    assert used.sector.buffer(0.06).covers(leaf) == (leaf.coords[0] == hinge)
