"""Lifts: the ideal motion of a car beside an independent integration, and lifts in plans and cases."""

import math

import numpy as np
import pytest
from shapely import box

import evac
from evac.base.change import Change
from evac.base.errors import BuildingError
from evac.building.model.lifts import CarState, Motion, cars_at
from evac.building.model.links import links_named


def integrated(motion, steps=400_000):
    """Distances over time of a car that applies the greatest jerk while limits allow, from rest to half of the way.

    At each time the car may still accelerate if it can then reach an acceleration of zero before the rated speed and
    before half of the distance; the second half of the way is the first one backwards.
    """
    low, high, half = 0.0, motion.speed, 0.5 * motion.distance
    for _ in range(200):  # the greatest speed with which the way to it and back fits into the distance
        speed = 0.5 * (low + high)
        rise = min(motion.acceleration / motion.jerk, math.sqrt(speed / motion.jerk))
        time = speed / (motion.jerk * rise) + rise
        low, high = (speed, high) if 0.5 * speed * time <= half else (low, speed)
    rise = min(motion.acceleration / motion.jerk, math.sqrt(low / motion.jerk))
    hold = low / (motion.jerk * rise) - rise
    corners = np.cumsum([0.0, rise, hold, rise])
    times = np.unique(np.concatenate([np.linspace(0.0, corners[-1], steps), corners]))
    middle = 0.5 * (times[1:] + times[:-1])
    jerk = motion.jerk * np.where(middle < corners[1], 1.0, np.where(middle < corners[2], 0.0, -1.0))
    step = np.diff(times)
    acceleration = np.concatenate([[0.0], np.cumsum(jerk * step)])
    speed = np.concatenate([[0.0], np.cumsum(acceleration[:-1] * step + 0.5 * jerk * step**2)])
    x = np.cumsum(speed[:-1] * step + 0.5 * acceleration[:-1] * step**2 + jerk * step**3 / 6.0)
    cruise = (half - x[-1]) / speed[-1]
    return times, np.concatenate([[0.0], x]), 2.0 * (corners[-1] + cruise)


@pytest.mark.parametrize(
    ("given", "stated"),
    [
        ((40.0, 2.5, 1.0, 1.2), 19.33),
        ((20.0, 2.5, 1.0, 1.2), 11.33),
        ((4.0, 2.5, 1.0, 1.2), 4.92),
        ((1.0, 2.5, 1.0, 1.2), 2.99),
        ((3.5, 1.0, 0.8, 1.0), 5.55),
        ((10.0, 0.63, 1.2, 0.8), 17.65),  # the rated speed is reached before the acceleration
        ((0.3, 0.63, 1.2, 0.8), None),
    ],
)
def test_the_motion_of_a_car_is_that_of_an_integration_in_all_regimes(given, stated):
    motion = Motion(*given)
    times, x, duration = integrated(motion)
    assert motion.duration == pytest.approx(duration, abs=1e-9)
    assert stated is None or motion.duration == pytest.approx(stated, abs=0.005)
    for k in np.linspace(1, len(times) - 1, 7).astype(int).tolist():
        assert motion.at(times[k]) == pytest.approx(x[k], abs=1e-9)
        assert motion.distance - motion.at(duration - times[k]) == pytest.approx(x[k], abs=1e-9)
    assert motion.at(duration + 1.0) == motion.distance
    speed = np.diff([motion.at(time) for time in np.linspace(0.0, duration, 2001)]) / (duration / 2000)
    assert speed.max() <= motion.speed + 1e-9


def test_regimes_are_continuous():
    for v, a, j in ((2.5, 1.0, 1.2), (0.63, 1.2, 0.8)):
        for border in ((a * a * v + v * v * j) / (a * j), 2.0 * a**3 / j**2):
            below, above = (Motion(border * (1.0 + sign * 1e-9), v, a, j).duration for sign in (-1, 1))
            assert below == pytest.approx(above, abs=1e-6)


def house(door=((10.2, 2.55), (10.2, 3.45)), **operation):
    plan = evac.Plan()
    for storey, z in (("ground", 0.0), ("first", 3.5), ("second", 7.0)):
        plan.storey(storey, box(0, 0, 10, 6), z=z)
    plan.exit("out", "ground", [(0, 2), (0, 4)])
    plan.lift("A", ["second", "ground", "first"], box(10.2, 2.2, 11.6, 3.8), [*door], operation=operation)
    return plan


def test_a_lift_is_a_room_for_each_stop_from_bottom_to_top_whose_doors_are_closed(tmp_path):
    building = house(speed=2.5, capacity=8).building()
    (lift,) = building.lifts
    assert lift.storeys == ("ground", "first", "second")
    assert [building.levels[room].name for room in lift.rooms] == ["A ground", "A first", "A second"]
    assert {building.levels[room].kind for room in lift.rooms} == {"car"}
    assert lift.heights == (0.0, 3.5, 7.0)
    doors = [door for own in lift.doors for door in own]
    assert [building.portals[door].width for door in doors] == pytest.approx([0.9] * 3)
    assert building.closed == {*doors} == building.for_ways.lift_doors.keys()
    assert not building.warnings  # the upper storeys are reached by lift
    assert [name for name, _ in building.storeys] == ["ground", "first", "second"]
    assert [ride.name for ride in building.rides] == ["A: ground - first", "A: first - second"]
    assert lift.back == pytest.approx((11.35, 3.0), abs=0.02)  # in the middle of the wall opposite to the door
    house(speed=2.5, capacity=8).write(tmp_path / "house.plan.toml")
    read = evac.read_building(tmp_path / "house.plan.toml")
    assert read.lifts == building.lifts
    given = evac.read_building(tmp_path / "house.plan.toml", lifts={"A": {"discharge": "first", "wait": 0.0}})
    own = given.lifts[0]
    assert (own.operation.speed, own.discharge, own.start) == (2.5, 1, 1)
    assert {(jump.start, jump.end) for jump in given.jumps} == {
        (f"A {start}", f"A {end}")
        for first in ("ground", "second")
        for start, end in ((first, "first"), ("first", first))
    }
    assert own.delay(2) == pytest.approx(3.0 + 0.5 + Motion(3.5, 2.5, 0.8, 1.0).duration + 2.0)


def built(plan, table):
    for lift in table["lifts"]:
        plan.lift(**lift)
    return plan.building()


def test_a_lift_within_a_floor_is_walled_off():
    plan = evac.Plan()
    plan.storey("ground", box(0, 0, 10, 6))
    plan.storey("first", box(0, 0, 10, 6), z=3.0)
    plan.exit("out", "ground", [(0, 2), (0, 4)])
    plan.lift("A", ["ground", "first"], box(4, 2, 5.6, 3.6), [(4, 2.3), (4, 3.2)])
    building = plan.building()
    floor = building.level_named("ground")
    assert floor.polygon.area == pytest.approx(60.0 - 1.9 * 1.9 + 0.9 * 0.15)
    assert sorted(portal.width for portal in building.portals) == pytest.approx([0.9, 0.9])


@pytest.mark.parametrize(
    ("change", "key", "word"),
    [
        ({"storeys": ["ground"]}, "lift 'A'", "at least two"),
        ({"storeys": [["ground"], "first"]}, "lift 'A'", "at least two"),
        ({"storeys": ["ground", "attic"]}, "lift 'A'", "attic"),
        ({"door": [(10.9, 2.6), (10.9, 3.4)]}, "lift 'A'", "outline"),
        ({"door": [(11.6, 2.6), (11.6, 3.4)]}, "lift 'A'", "no floor"),
        ({"operation": {"sped": 1.0}}, "operation.sped", "speed"),
        ({"operation": {"discharge": "attic"}}, "operation.discharge", "attic"),
    ],
)
def test_lifts_that_cannot_be_are_refused_with_their_key(change, key, word):
    given = {
        "storeys": ["ground", "first"],
        "polygon": box(10.2, 2.2, 11.6, 3.8),
        "door": [(10.2, 2.6), (10.2, 3.4)],
    }
    plan = house()
    plan.lifts.clear()
    table = {"lifts": [{"name": "A"} | given | change]}
    with pytest.raises(evac.BuildingError) as raised:
        built(plan, table)
    assert key in str(raised.value)
    assert word in str(raised.value)


def test_lifts_on_the_same_ground_are_refused():
    plan = house()
    plan.lift("B", ["ground", "first"], box(10.2, 3.0, 11.6, 4.6), [(10.2, 3.3), (10.2, 4.2)])
    with pytest.raises(evac.BuildingError, match="lift 'B': it overlaps lift 'A'"):
        plan.building()


def test_a_case_names_lifts_of_its_building_only():
    with pytest.raises(evac.BuildingError, match=r"building\.lifts\.B"):
        house().building(lifts={"B": {"capacity": 4}})


def test_cars_are_where_their_trips_take_them():
    building = house(speed=2.5, capacity=8, start_delay=0.5).building()
    (lift,) = building.lifts

    def trip(time, what, *storeys):
        return Change(time, "lift", "A", {"value": (what, *storeys)})

    other = Change(0.5, "close", "out", {})
    trips = [trip(1.0, "leaves", "ground", "second"), other, trip(20.0, "arrives from", "ground", "second")]
    motion = lift.motion(0, 2)
    for after in (0.0, 0.4, 0.5, 1.0, 3.0, motion.duration + 0.5):
        (car,) = cars_at(building, trips, 1.0 + after)
        assert car.level == lift.rooms[0]
        assert car.rise == pytest.approx(motion.at(after - 0.5) if after > 0.5 else 0.0)
    assert cars_at(building, trips, 21.0) == [CarState(lift.rooms[2], 0.0, False)]
    opened = [*trips, trip(22.0, "opens at", "second")]
    assert [cars_at(building, opened, time)[0].is_open for time in (22.0, 22.1)] == [False, True]
    (down,) = cars_at(building, [trip(0.0, "leaves", "second", "first")], 100.0)
    assert (down.level, down.rise) == (lift.rooms[2], pytest.approx(-3.5))


def test_a_door_of_a_lift_is_not_closed_by_itself():
    building = house(speed=2.5, capacity=8).building()
    door = building.portals[building.lifts[0].doors[0][0]].name
    with pytest.raises(BuildingError, match="lift 'A'"):
        links_named(building, door)
