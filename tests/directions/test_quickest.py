"""Directions that follow the crowd: travel times at the speeds of its density, solved again where it has changed."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from evac.building.model.building import Door
from evac.case.schema import QuickestSettings
from evac.directions.build import build_fields
from evac.directions.density import THROUGH_DOORS
from evac.directions.march.waves import speed_at
from evac.directions.quickest import Quickest
from evac.directions.routes import Route

QUICKEST = Route((), "quickest")


def quickest_in(building, routes=(QUICKEST,), clearance=0.0, **settings):
    fields = build_fields(building, routes, clearance=clearance, speeds=(1.0, 0.5, 0.5))
    return Quickest(fields, QuickestSettings(**{"memory": 0.0, **settings}))


def update(quickest, people, level=0):
    """Update the routes for the first of 800 people, the others of whom have left; return the levels solved."""
    places, levels = np.zeros((800, 2)), np.full(800, -1, np.int32)
    places[: len(people)] = np.reshape(people, (-1, 2))
    levels[: len(people)] = level
    before = quickest.report()["levels_solved"]
    quickest.update(levels, places, np.zeros(800, np.int32), np.full(800, 0.2))
    return quickest.report()["levels_solved"] - before


def crowd_in(x1, y1, x2, y2, step=0.35):
    return np.array([(x, y) for x in np.arange(x1, x2, step) for y in np.arange(y1, y2, step)])


def test_the_speed_falls_with_the_density_as_in_weidmann_and_keeps_the_greatest_flow():
    found = [speed_at(rho, 0.05) for rho in (0.0, 1.0, 1.75, 3.5, 40.0)]
    one, busiest = (1.0 - np.exp(-1.913 * (1.0 / rho - 1.0 / 5.4)) for rho in (1.0, 1.75))
    assert found == pytest.approx([1.0, one, busiest, 0.5 * busiest, 0.05])


def test_a_uniform_density_prolongs_the_times_by_its_speed(corridor):
    places = np.column_stack([np.linspace(4.0, 8.0, 5), np.full(5, 0.9)])
    quickest = quickest_in(corridor, floor=0.6)
    update(quickest, [[6.0, 1.0]])
    empty = quickest.fields.travel_time_at(0, places, 0, 0.2)
    assert -np.diff(empty) == pytest.approx(np.diff(places[:, 0]), rel=1e-9)  # at 1 m/s
    update(quickest, crowd_in(0.0, 0.0, 12.1, 2.1, 0.8))
    full = quickest.fields.travel_time_at(0, places, 0, 0.2)
    assert np.diff(full) == pytest.approx(np.diff(empty) / 0.6, rel=1e-9)


def test_a_queue_lasts_as_long_as_its_people_need_to_pass_the_exit(drawing):
    drawing.exit("end", drawing.level((0.0, 0.0, 12.0, 4.0)), (12.0, 1.5), (12.0, 2.5))
    quickest, crowd, places = quickest_in(drawing.build()), crowd_in(3.0, 0.1, 12.0, 4.0), [[2.0, 2.0], [1.0, 2.0]]
    update(quickest, [*crowd, *places])
    empty = quickest.fields.uncongested.travel_time_at(0, np.array(places), 0, 0.2)
    tail, behind = quickest.fields.travel_time_at(0, np.array(places), 0, 0.2)
    assert tail == pytest.approx(len(crowd) / THROUGH_DOORS, rel=0.1)
    assert behind - tail == pytest.approx(empty[1] - empty[0], abs=0.5)


def test_people_on_their_way_to_an_exit_count_before_they_arrive(hall):
    quickest = quickest_in(hall, (Route(("left",), "quickest"),))
    crowd, last = crowd_in(4.0, 0.5, 12.0, 6.0, 1.0), np.array([[12.0, 5.0]])
    update(quickest, [*crowd, *last])
    empty, found = (of.travel_time_at(0, last, 0, 0.2)[0] for of in (quickest.fields.uncongested, quickest.fields))
    assert found > max(0.9 * len(crowd) / THROUGH_DOORS, empty + 10.0)


def test_a_door_within_a_level_holds_the_queue_before_it(drawing):
    wall = shapely.union_all([shapely.box(5.95, 0.0, 6.05, 1.5), shapely.box(5.95, 2.5, 6.05, 4.0)])
    level = drawing.level(shapely.box(0.0, 0.0, 12.0, 4.0) - wall)
    drawing.exit("end", level, (12.0, 0.0), (12.0, 4.0))
    building, crowd = drawing.build(), crowd_in(3.0, 0.1, 5.9, 3.9, 0.3)
    waits = []
    for doors in ((), (Door(0, "door", 0, np.array([6.0, 1.5, 6.0, 2.5]), 1.0),)):
        quickest = quickest_in(replace(building, doors=doors), clearance=0.25, floor=0.5)
        update(quickest, crowd)
        waits.append(quickest.fields.travel_time_at(0, np.array([[3.0, 2.0]]), 0, 0.2)[0])
    assert waits[1] > 0.8 * len(crowd) / THROUGH_DOORS > 2.0 * waits[0]


def test_without_a_crowd_the_times_are_those_of_the_empty_building(row):
    quickest = quickest_in(row)
    update(quickest, [])
    level, places = np.array([0, 0, 1, 2]), np.array([[1.0, 3.5], [6.0, 0.5], [12.0, 2.0], [20.0, 3.0]])
    wanted = quickest.fields.uncongested.travel_time_at(level, places, 0, 0.2)
    assert quickest.fields.travel_time_at(level, places, 0, 0.2) == pytest.approx(wanted, rel=0.02)
    along = quickest.fields.uncongested.directions_at(level, places, 0, 0.2)
    assert (quickest.fields.directions_at(level, places, 0, 0.2) * along).sum(axis=1).min() > 0.99


def test_without_a_crowd_the_posts_of_an_exit_are_given_the_same_clearance(hall):
    quickest = quickest_in(hall, clearance=0.25)
    update(quickest, [])
    places = np.array([(x, y) for x in np.arange(1.0, 4.0, 0.1) for y in np.arange(0.3, 1.5, 0.1)])
    one, other = (of.directions_at(0, places, 0, 0.2) for of in (quickest.fields, quickest.fields.uncongested))
    assert (one * other).sum(axis=1).min() > np.cos(np.radians(15.0))


def test_only_levels_that_have_changed_and_those_behind_them_are_solved(row):
    quickest, far = quickest_in(row), [[1.0, 1.0]]
    assert update(quickest, far) == 0  # as in the empty building
    first = [*far, *crowd_in(1.0, 1.0, 4.0, 3.0)]
    assert update(quickest, first, [0] * len(first)) == 1  # nothing leads through the first room
    middle = [*first, *crowd_in(11.0, 1.0, 13.0, 3.0)]
    levels = [0] * len(first) + [1] * (len(middle) - len(first))
    assert update(quickest, middle, levels) == 2
    last = [*middle, *crowd_in(20.0, 1.0, 23.0, 3.0)]
    assert update(quickest, last, levels + [2] * (len(last) - len(middle))) == 3
    update(quickest, last, levels + [2] * (len(last) - len(middle)))  # until the ways to the gates are those found
    assert update(quickest, last, levels + [2] * (len(last) - len(middle))) == 0


def test_what_nobody_needs_is_not_solved_until_somebody_does(row):
    quickest = quickest_in(row)
    update(quickest, [])
    crowd = [[22.0, 2.0]] * 4
    assert update(quickest, crowd, 2) == 1
    back = [*crowd, [1.0, 1.0]]
    assert update(quickest, back, [2] * len(crowd) + [0]) == 2


def test_a_crowd_at_one_exit_sends_others_to_the_other(hall):
    quickest, undecided = quickest_in(hall, clearance=0.25), [5.5, 4.0]
    update(quickest, [undecided])
    assert quickest.fields.directions_at(0, np.array([undecided]), 0, 0.2)[0, 0] < 0.0
    update(quickest, [undecided, *crowd_in(1.0, 0.2, 4.0, 3.0)])
    assert quickest.fields.directions_at(0, np.array([undecided]), 0, 0.2)[0, 0] > 0.0


def test_nobody_changes_the_exit_for_less_than_the_hesitation(hall):
    place, ways = np.array([[7.0, 3.0]]), []
    for hesitation in (0.0, 600.0):
        quickest = quickest_in(hall, hesitation=hesitation)
        update(quickest, place)
        update(quickest, [*place, *crowd_in(1.0, 0.2, 4.0, 3.0)])
        ways.append(quickest.fields.directions_at(0, place, 0, 0.2)[0, 0])
    assert ways[0] > 0.0 > ways[1]


def test_routes_with_other_strategies_stay_as_they_are(hall):
    quickest = quickest_in(hall, (QUICKEST, Route()))
    update(quickest, crowd_in(1.0, 0.2, 4.0, 3.0))
    place = np.array([[7.0, 3.0], [3.0, 2.0]])
    before = quickest.fields.uncongested
    for route, is_same in ((0, False), (1, True)):
        pairs = [(one.travel_time_at(0, place, route, 0.2)) for one in (quickest.fields, before)]
        assert (pairs[0] == pairs[1]).all() == is_same
    assert build_fields(hall, [Route()]).grids == ()


def test_wider_bodies_have_ways_of_their_own_in_a_crowd(drawing):
    walls = [shapely.box(5.95, 0.0, 6.05, 1.8), shapely.box(5.95, 2.25, 6.05, 3.0)]  # a gap of 0.45 m, a door of 1 m
    level = drawing.level(shapely.box(0.0, 0.0, 12.0, 4.0) - shapely.union_all(walls))
    drawing.exit("end", level, (12.0, 1.0), (12.0, 3.0))
    fields = build_fields(drawing.build(), [QUICKEST], narrowest=0.4, widest=0.5)
    quickest = Quickest(fields, QuickestSettings())
    quickest.update(
        np.zeros(2, np.int32), np.array([[5.5, 2.0], [2.0, 2.0]]), np.zeros(2, np.int32), np.array([0.2, 0.25])
    )
    slim, wide = (quickest.fields.travel_time_at(0, np.array([[5.5, 2.0]]), 0, radius)[0] for radius in (0.2, 0.25))
    assert wide > slim + 0.5
