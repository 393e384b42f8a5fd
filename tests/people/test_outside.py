"""People who have left: how they walk on, what those behind them do, resumed runs, and flows through doors."""

import math

import numpy as np
import pytest
from shapely.geometry import box

from evac.analysis.lines import steady_flow
from evac.building.plan.plan import Plan
from evac.case.loading import load_case
from evac.people.outside import REACH, PeopleOutside
from evac.physics.state import make_crowd
from evac.simulation.shared import simulation_of
from tests.physics.scenes import make_building
from tests.validation.buildings import across, rectangle, write_case

DOOR = (2.0, -1.0, 2.0, 1.0)


def left_by(crowd, exit_used, exit_time, building, time=0.1):
    """Return the people outside, all of a crowd, who left in the tick of 0.1 s before a time."""
    crowd.exit_used[:], crowd.exit_time[:], crowd.level[:] = exit_used, exit_time, -1
    people = PeopleOutside(building, crowd)
    people.advance(np.arange(len(crowd.level), dtype=np.int32), time, 0.1)
    return people


def test_who_leaves_walks_on_from_the_line_along_its_normal():
    crowd = make_crowd([[2.01, 0.3]], [[1.2, 0.4]], speed=1.2)
    people = left_by(crowd, 0, 0.075, make_building(exits=[(0, DOOR)]))
    outside = people.arrays
    assert outside.level.tolist() == [0]
    assert outside.direction[0] == pytest.approx([1.0, 0.0], abs=1e-15)
    assert outside.position[0] == pytest.approx([2.0 + 0.025 * 1.2, 0.3])
    assert outside.velocity[0] == pytest.approx([1.2, 0.0])
    people.advance(np.empty(0, np.int32), 0.2, 0.1)
    assert outside.depth[0] == pytest.approx(0.125 * 1.2)
    assert outside.position[0] == pytest.approx([2.0 + 0.125 * 1.2, 0.3])


def test_speeds_approach_the_desired_one_exponentially():
    crowd = make_crowd([[2.0, 0.0]], [[0.5, 0.0]], speed=[[1.4, 0.3, 0.3]], tau=0.4)
    people = left_by(crowd, 0, 0.1, make_building(exits=[(0, DOOR)]))
    people.arrays.speed_factor[:] = 0.75
    people.advance(np.empty(0, np.int32), 0.3, 0.2)
    gone, wanted = math.exp(-0.2 / 0.4), 0.75 * 1.4
    assert people.arrays.velocity[0, 0] == pytest.approx(wanted + (0.5 - wanted) * gone, rel=1e-12)
    assert people.arrays.depth[0] == pytest.approx(0.2 * wanted + (0.5 - wanted) * 0.4 * (1.0 - gone), rel=1e-12)


def test_who_is_pushed_out_backwards_starts_from_a_standstill():
    people = left_by(make_crowd([[2.0, 0.0]], [[-0.5, 0.2]]), 0, 0.1, make_building(exits=[(0, DOOR)]))
    assert people.arrays.velocity.tolist() == [[0.0, 0.0]]


def test_who_is_2_m_behind_the_line_is_seen_no_longer():
    people = left_by(make_crowd([[2.0, 0.0]], [[1.0, 0.0]], speed=1.0), 0, 0.1, make_building(exits=[(0, DOOR)]))
    ticks = 0
    while people.arrays.level[0] >= 0:
        people.advance(np.empty(0, np.int32), 0.2 + 0.1 * ticks, 0.1)
        ticks += 1
    assert ticks == pytest.approx(REACH / 0.1, abs=1)
    people.advance(np.empty(0, np.int32), 3.0, 0.1)
    assert people.arrays.level.tolist() == [-1]


def test_each_walks_along_the_normal_of_the_piece_that_it_has_crossed():
    """An exit around a corner of the building, and another one on another level."""
    building = make_building(((-9.0, -9.0, 2.0, 9.0),) * 2, exits=[(0, DOOR), (1, (2.0, 5.0, -2.0, 5.0))])
    corner = building.exits[0]
    pieces = np.array([[2.0, -1.0, 2.0, 1.0], [2.0, 1.0, 0.0, 1.0]])
    building = type(building)(
        **{**building.__dict__, "exits": (type(corner)(**{**corner.__dict__, "segments": pieces}), building.exits[1])}
    )
    crowd = make_crowd([[2.01, 0.0], [1.0, 1.01], [0.0, 5.01]], [[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]], speed=1.0)
    outside = left_by(crowd, [0, 0, 1], 0.1, building).arrays
    assert outside.direction == pytest.approx(np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]), abs=1e-15)
    assert outside.position == pytest.approx(np.array([[2.0, 0.0], [1.0, 1.0], [0.0, 5.0]]), abs=1e-15)
    assert outside.level.tolist() == [0, 0, 1]


def corridor(length, *walkers, **changes):
    """Return a corridor along x, 2 m wide, with an exit at its end and walkers in its middle (x [m], speed [m/s])."""
    plan = Plan()
    plan.storey("floor", box(0.0, 0.0, length, 2.0))
    plan.exit("end", "floor", [(length, 0.0), (length, 2.0)])
    people = [
        {"name": f"person {k}", "positions": [[x, 1.0]], "level": "floor", "speed": speed}
        for k, (x, speed) in enumerate(walkers)
    ]
    case = {"building": plan, "people": people, "behaviours": {"headway": {}}, "contact": {"model": "nsm2"}}
    return load_case(case, changes)


def walk_of_the_last(case, seconds):
    """Return position along x and speed of the second person at each tick, and how many were outside."""
    simulation, found = simulation_of(case), []
    while simulation.time < seconds:
        simulation.advance_tick()
        crowd = simulation.population.crowd
        outside = np.count_nonzero(simulation.outside.arrays.level >= 0)
        found.append((crowd.position[1, 0], simulation.displacement_velocity[1, 0], outside))
    return np.array(found).T


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_a_follower_walks_as_if_the_ground_went_on(model):
    """As long as the slow one is up to 2 m behind the exit at 7 m; the time gap is that of 2 m."""
    changes = {"contact.model": model, "behaviours.headway.time_gap": 2.5}
    place, speed, outside = walk_of_the_last(corridor(7.0, (4.0, 0.7), (1.0, 1.4), **changes), 7.4)
    there, as_fast, _ = walk_of_the_last(corridor(20.0, (4.0, 0.7), (1.0, 1.4), **changes), 7.4)
    assert np.count_nonzero(outside == 1) > 25
    assert (outside[-25:] == 1).all()
    assert place[-1] < 7.0
    assert place == pytest.approx(there, abs=1e-6)
    assert speed == pytest.approx(as_fast, abs=1e-6)
    assert speed[-1] < 0.8


def test_two_outside_keep_their_distance():
    """The fast one, which leaves behind the slow one, stays behind it outside; a third one is still inside."""
    simulation = simulation_of(corridor(5.0, (3.0, 0.7), (1.5, 1.4), (0.5, 0.1)))
    both, apart = 0, []
    while not simulation.ended:
        simulation.advance_tick()
        outside = simulation.outside.arrays
        if (outside.level[:2] >= 0).all():
            both += 1
            apart.append(outside.position[0, 0] - outside.position[1, 0])
    assert both > 10
    assert apart[-1] == pytest.approx(0.3 + 0.7, abs=0.02)


def test_at_the_foot_of_a_stair_people_walk_on_at_their_flat_speed_and_are_followed(tmp_path):
    faces = [rectangle(-4, 0, 0, 2, 2.0), rectangle(0, 0, 4, 2, 2.0, 0.0)]
    places = (-1.0, 0.5), (-1.8, 0.9)
    people = [{"positions": [[x, 1.0]], "z": 2.0, "speed": 1.0, "speed_down": down} for x, down in places]
    sections = {"behaviours.headway": {"time_gap": 3.0}, "contact.model": "nsm2"}
    simulation = simulation_of(write_case(tmp_path, faces, [("foot", across(4, 0, 2), 0.0)], people, (), sections))
    crowd, outside, factors = simulation.population.crowd, simulation.outside.arrays, []
    while crowd.level[0] >= 0 or outside.level[0] >= 0:
        simulation.advance_tick()
        if crowd.level[0] < 0 <= crowd.level[1] and outside.level[0] >= 0:
            factors.append(crowd.speed_factor[1])
            assert outside.velocity[0, 0] <= 1.0
    assert outside.velocity[0] == pytest.approx([1.0, 0.0], abs=0.05)
    assert factors[0] < 0.9
    assert factors == sorted(factors)


def hall(seed, depth, width=1.2, **changes):
    """Return a room of 70 people with a door, and an exit at the door or beyond ground of a depth behind it [m]."""
    plan, low, high = Plan(), 2.5 - width / 2, 2.5 + width / 2
    ground = [box(0.0, 0.0, 6.0, 5.0), box(6.0, low, 6.2, high)]
    plan.storey("floor", [*ground, box(6.2, 0.0, 6.2 + depth, 5.0)] if depth else ground[:1])
    plan.area("room", "floor", box(0.0, 0.0, 6.0, 5.0))
    plan.exit("end", "floor", [(6.2 + depth, 0.0), (6.2 + depth, 5.0)] if depth else [(6.0, low), (6.0, high)])
    people = [{"name": "all", "number": 70, "area": "room", "speed": {"uniform": [0.97, 1.62]}}]
    case = {"building": plan, "people": people, "behaviours": {"headway": {}}, "contact": {"model": "nsm2"}}
    return load_case(case, {"simulation.seed": seed, **changes})


def flow(seed, depth):
    """Return the steady flow through the door [1/s]."""
    simulation = simulation_of(hall(seed, depth))
    crowd = simulation.population.crowd
    passed = np.full(len(crowd.level), np.nan)
    while not simulation.ended:
        simulation.advance_tick()
        passed[np.isnan(passed) & ((crowd.position[:, 0] >= 6.0) | (crowd.level < 0))] = simulation.time
    return steady_flow(np.sort(passed))


def test_the_flow_through_a_door_is_that_with_ground_behind_it():
    """Three runs each; without those who have left the exit at the door passes half as many more."""
    at_the_door, beyond = (np.mean([flow(seed, depth) for seed in (1, 2, 3)]) for depth in (0.0, 2.5))
    assert at_the_door == pytest.approx(beyond, rel=0.1)


def test_without_behaviours_that_keep_distances_nobody_is_kept():
    simulation = simulation_of(hall(1, 0.0, behaviours={}))
    assert simulation.outside is None
    assert not any(key.startswith("outside.") for key in simulation.state())
    assert [row.state for row in simulation.plan if row.part == "people outside"] == ["out"]
    kept = simulation_of(hall(1, 0.0))
    assert [row.state for row in kept.plan if row.part == "people outside"] == ["in"]
