"""Rooms that no way leads through are left out while nobody is in them, and taken in when somebody comes."""

import numpy as np
import pytest
import shapely

from evac.case.schema import QuickestSettings
from evac.directions.build import build_fields
from evac.directions.quickest import Quickest
from evac.directions.routes import Route

#: A corridor with the exit at its end and four rooms, the third of which is behind the second; places in each.
ROOMS = [(4.0 * k, 2.2, 4.0 * k + 3.8, 6.0) for k in range(4)]
DOORS = [(1.5, 1.9, 2.4, 2.3), (5.5, 1.9, 6.4, 2.3), (7.7, 3.5, 8.1, 4.4), (13.5, 1.9, 14.4, 2.3)]
CORRIDOR, PLACES = np.array([[1.0, 1.0], [9.0, 1.0], [2.0, 1.8]]), [[1.0, 4.0], [5.0, 4.0], [9.0, 4.0], [13.0, 4.0]]


@pytest.fixture
def quickest(drawing):
    floor = shapely.union_all([shapely.box(*part) for part in [(0.0, 0.0, 16.0, 2.0), *ROOMS, *DOORS]])
    drawing.exit("end", drawing.level(floor), (16.0, 0.5), (16.0, 1.5))
    fields = build_fields(drawing.build(), [Route((), "quickest")], clearance=0.25)
    return lambda: Quickest(fields, QuickestSettings(memory=0.0))


def update(quickest, *places):
    people = np.concatenate([np.reshape(place, (-1, 2)) for place in places])
    n = len(people)
    quickest.update(np.zeros(n, np.int32), people, np.zeros(n, np.int32), np.full(n, 0.2))


def times(quickest, places):
    return quickest.fields.travel_time_at(0, np.array(places), 0, 0.2)


def crowd(x, y):
    return [(x + 0.4 * k, y + 0.4 * m) for k in range(6) for m in range(3)]


def test_empty_rooms_are_left_out_but_not_those_on_the_way_of_people(quickest):
    one = quickest()
    before = times(one, PLACES)
    update(one, crowd(13.5, 0.5), PLACES[2])
    later = times(one, PLACES) > before + 1.0
    assert later.tolist() == [False, True, True, False]  # the second room leads from the third one to the corridor


def test_what_is_left_out_does_not_change_what_people_follow(quickest):
    some, all_of_it = quickest(), quickest()
    for one, far in ((some, []), (all_of_it, [PLACES[0], PLACES[3]])):
        update(one, crowd(13.5, 0.5), CORRIDOR, PLACES[2], *far)
    places = np.concatenate([CORRIDOR, PLACES[1:3]])
    for name in ("travel_time_at", "directions_at"):
        values = [getattr(one.fields, name)(0, places, 0, 0.2) for one in (some, all_of_it)]
        np.testing.assert_allclose(*values, rtol=0.0, atol=0.02 if name == "travel_time_at" else 1e-6)


def test_a_room_is_solved_when_somebody_comes_back(quickest):
    one, other = quickest(), quickest()
    update(one, crowd(13.5, 0.5))
    update(one, crowd(13.5, 0.5), PLACES[0])
    update(other, crowd(13.5, 0.5), PLACES[0])
    assert times(one, PLACES[:1]) == pytest.approx(times(other, PLACES[:1]), rel=0.05)
    assert times(one, PLACES[:1]) > times(quickest(), PLACES[:1]) + 1.0


def test_restored_columns_leave_out_the_same_rooms(quickest):
    one, other = quickest(), quickest()
    update(one, crowd(13.5, 0.5), PLACES[2])
    other.restore(one.state())
    for each in (one, other):
        update(each, crowd(12.5, 0.5), CORRIDOR)
        update(each, crowd(12.0, 0.5), PLACES[0])
    for name, values in one.state().items():
        if name != "seconds":
            np.testing.assert_array_equal(values, other.state()[name], name)
