"""Routes in smoke: people turn back where there is another way, and go through it where there is none."""

import numpy as np
import pytest

import evac
from evac.simulation.shared import simulation_of
from evac.simulation.simulation import Simulation
from tests.conditions.corridor import two_storeys
from tests.runs import assert_same_bits, run_ticks


def two_ways(*conditions, people=12, **changes):
    """Return a case of a room with a near exit and a far one, and areas before both."""
    plan = {
        "storeys": [{"name": "f", "polygons": [[[0, 0], [30, 0], [30, 6], [0, 6]]]}],
        "exits": [
            {"name": "near", "storey": "f", "segment": [[0, 2], [0, 4]]},
            {"name": "far", "storey": "f", "segment": [[30, 2], [30, 4]]},
        ],
        "areas": [
            {"name": "start", "storey": "f", "polygon": [[9, 1], [13, 1], [13, 5], [9, 5]]},
            {"name": "west", "storey": "f", "polygon": [[0, 0], [6, 0], [6, 6], [0, 6]]},
            {"name": "east", "storey": "f", "polygon": [[24, 0], [30, 0], [30, 6], [24, 6]]},
        ],
    }
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "people": [{"name": "p", "number": people, "area": "start", "speed": 1.2}],
        "conditions": list(conditions),
        "simulation": {"duration": 120.0},
    }
    return evac.load(table, changes)


def smoke(area, *values, times=None):
    values = {"extinction": values[0] if times is None else list(values)}
    return {"source": "prescribed", "area": area, "values": values, "times": times, "hold": True}


def exits_of(results):
    names = list(results.exits)
    return {names[used] for used in results.crowd.exit_used.tolist()}


def test_people_turn_back_in_front_of_smoke_if_there_is_another_way():
    simulation = simulation_of(two_ways(smoke("west", 2.0)))
    results = simulation.run()
    assert (results.ended, exits_of(results)) == ("everybody out", {"far"})
    assert results.conditions["routes"]["solves"] == 1


@pytest.mark.parametrize(("value", "used"), [(61.0, "far"), (59.0, "near")])
def test_heat_turns_people_back_as_smoke_does(value, used):
    hot = {"source": "prescribed", "area": "west", "values": {"extinction": 0.0, "temperature": value}}
    assert exits_of(simulation_of(two_ways(hot)).run()) == {used}
    radiation = hot | {"values": {"extinction": 0.0, "radiation": value / 24.0}}
    assert exits_of(simulation_of(two_ways(radiation)).run()) == {used}


def test_people_go_through_smoke_if_there_is_no_other_way():
    results = simulation_of(two_ways(smoke("west", 2.0), smoke("east", 2.0))).run()
    assert (results.ended, exits_of(results)) == ("everybody out", {"near"})
    only = simulation_of(two_ways(smoke("west", 2.0), **{"building.closed": ["far"]})).run()
    assert (only.ended, exits_of(only)) == ("everybody out", {"near"})


def test_thin_smoke_turns_nobody_back_but_counts_with_the_speed_that_it_leaves():
    assert exits_of(simulation_of(two_ways(smoke("west", 0.9))).run()) == {"near"}
    stated = {"smoke.visibility": 5.0}
    assert exits_of(simulation_of(two_ways(smoke("west", 0.9), **stated)).run()) == {"far"}
    off = {"smoke.routes": False}
    results = simulation_of(two_ways(smoke("west", 2.0), **off)).run()
    assert exits_of(results) == {"near"}
    assert results.conditions["routes"] is None


def test_travel_times_are_those_with_the_speeds_that_smoke_leaves():
    """In half the speed of everywhere, times are twice as long."""
    case = two_ways(
        {"source": "prescribed", "values": {"extinction": 0.5 * 0.706 / 0.057}}, **{"smoke.visibility": 0.0}
    )
    simulation = simulation_of(case)
    crowd = simulation.population.crowd
    place = crowd.level, crowd.position.copy(), crowd.route, crowd.contact_radius
    clear = simulation.fields.travel_time_at(*place)
    before = simulation.fields.directions_at(*place)
    simulation.advance_tick()
    np.testing.assert_allclose(simulation.fields.travel_time_at(*place), 2.0 * clear, rtol=0.05)
    assert (np.einsum("ij,ij->i", before, simulation.fields.directions_at(*place)) > 0.99).all()


def test_smoke_that_closes_one_of_two_ways_sends_people_to_the_other():
    case = two_ways(smoke("west", 0.0, 0.0, 3.0, times=[0, 2, 4]), **{"smoke.period": 1.0, "people.p.speed": 0.8})
    simulation = simulation_of(case)
    run_ticks(simulation, 20)
    towards = simulation.population.crowd.position[:, 0].mean()
    assert towards < 10.5
    results = simulation.run()
    assert "far" in exits_of(results)
    assert results.conditions["routes"]["solves"] == 1
    assert results.ended == "everybody out"


def test_a_door_that_closes_in_smoke_leaves_the_ways_of_smoke():
    event = {"kind": "close", "target": "far", "time": 3.0}
    case = two_ways(smoke("west", 2.0), event=[event])
    simulation = simulation_of(case)
    run_ticks(simulation, 29)
    assert simulation.population.crowd.position[:, 0].mean() > 12.0
    results = simulation.run()
    assert (results.ended, exits_of(results)) == ("everybody out", {"near"})


def test_lean_and_full_give_the_same_bits():
    case = two_ways(smoke("west", 0.0, 3.0, times=[0, 4]), **{"smoke.period": 1.0})
    one = run_ticks(simulation_of(case), 60)
    assert_same_bits(one, run_ticks(Simulation(case, full=True), 60))


def test_smoke_that_ends_at_a_stair_leaves_the_ways_round_its_posts_and_those_to_refuges():
    """Without the clearance beside the end of the smoke, a person stands at the post of the stair for ever."""
    plan = two_storeys() | {
        "areas": [{"name": "safe", "storey": "up", "polygon": [[10, 6], [12, 6], [12, 8], [10, 8]]}]
    }
    walker = {"name": "p", "level": "up", "positions": [[2, 6]], "speed": 1.3}
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "people": [{"name": "w", "preset": "wheelchair", "level": "up", "positions": [[1, 4]]}, walker],
        "place": [{"name": "r", "kind": "refuge", "area": "safe"}],
        "conditions": [{"source": "prescribed", "level": "up", "values": {"extinction": 3.0}}],
        "simulation": {"duration": 60.0},
    }
    results = simulation_of(evac.load(table)).run()
    assert results.ended == "everybody out or at a safe place"
    assert results.crowd.exit_time[0] < 25.0
    solved = results.conditions["routes"]
    assert solved["levels_solved"] > solved["solves"] > 0
