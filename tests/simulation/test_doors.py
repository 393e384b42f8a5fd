"""Doors between rooms of one level close and open during a run, as exits and stairs do."""

import numpy as np
import pytest

import evac
from evac.physics.world import make_world
from evac.simulation.shared import simulation_of
from tests.runs import run_ticks


def flat(*events, **changes):
    """Return a case of two rooms with two doors between them, and the exit in the western one."""
    rooms = [[[0, 0], [6, 0], [6, 6], [0, 6]], [[6.2, 0], [12, 0], [12, 6], [6.2, 6]]]
    plan = {
        "storeys": [{"name": "f", "polygons": rooms}],
        "doors": [
            {"name": "near", "storey": "f", "segment": [[6.1, 1], [6.1, 2.2]]},
            {"name": "far", "storey": "f", "segment": [[6.1, 4.5], [6.1, 5.7]]},
        ],
        "exits": [{"name": "out", "storey": "f", "segment": [[0, 1], [0, 2.2]]}],
        "areas": [
            {"name": "east", "storey": "f", "polygon": [[6.5, 0.3], [11.7, 0.3], [11.7, 5.7], [6.5, 5.7]]},
            {"name": "west", "storey": "f", "polygon": [[0.3, 0.3], [5.7, 0.3], [5.7, 5.7], [0.3, 5.7]]},
        ],
    }
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 60.0, "no_progress": 8.0},
        "people": [{"name": "p", "number": 24, "area": "east"}],
        "event": [
            {"kind": kind, "target": what, "time": time} | ({"value": value[0]} if value else {})
            for time, kind, what, *value in events
        ],
    }
    return evac.load(table, changes)


def passages(simulation, at=6.1):
    """Run to the end; return who passes the line between the rooms: person, time and y of each passage."""
    crowd, found = simulation.population.crowd, []
    while not simulation.ended:
        before = crowd.position.copy()
        simulation.advance_tick()
        rows = np.flatnonzero((before[:, 0] > at) != (crowd.position[:, 0] > at))
        found += [(int(row), simulation.time, float(crowd.position[row, 1])) for row in rows]
    return found


def test_nobody_passes_a_closed_door_but_who_stood_in_it():
    simulation = simulation_of(flat((3.0, "close", "near")))
    found = passages(simulation)
    let_through = simulation.scene.changes[0].values["let_through"]
    late = {row for row, time, y in found if time > 3.1 and y < 3.0}
    assert len(let_through) > 0
    assert late == set(let_through) - {row for row, time, y in found if time <= 3.1}
    assert {row for row, *_ in found} == set(range(24))
    assert simulation.ended == "everybody out"
    assert simulation.results().report["greatest_overlap"] < 1e-4


def test_rooms_whose_doors_are_closed_are_left_when_one_opens():
    changes = (0.0, "close", "near"), (0.0, "close", "far"), (4.0, "open", "far")
    simulation = simulation_of(flat(*changes))
    found = passages(simulation)
    assert simulation.ended == "everybody out"
    assert min(time for _, time, _ in found) > 4.0
    assert all(y > 3.0 for *_, y in found)


@pytest.mark.parametrize("strategy", ["fastest", "quickest"])
def test_a_door_of_one_direction_is_passed_in_this_one_only(strategy):
    changes = {"people.p.strategy": strategy}
    ways, taken = {}, {}
    for value in (False, "west", "east"):
        simulation = simulation_of(flat((0.0, "one_way", "near", value), **changes))
        found = passages(simulation)
        assert simulation.ended == "everybody out"
        taken[value] = sum(y < 3.0 for *_, y in found)
        fields = simulation_of(flat(**changes)).fields if value is False else simulation.fields
        ways[value] = fields.travel_time_at(0, np.array([[6.6, 1.6], [11.0, 3.0], [5.6, 1.6]]), 0)
    assert taken["west"] > 5
    assert taken["east"] == 0
    assert ways["east"][0] > ways["west"][0] + 2.0
    if strategy == "fastest":
        assert ways["west"] == pytest.approx(ways[False], abs=0.1)
        assert ways["east"][2] == pytest.approx(ways["west"][2], abs=0.1)


def test_people_in_a_doorway_turn_round_when_it_gets_the_other_direction():
    simulation = simulation_of(flat((3.0, "one_way", "near", "east")))
    found = passages(simulation)
    late = {row for row, time, y in found if time > 3.01 and y < 3.0}
    assert simulation.ended == "everybody out"
    assert any(y < 3.0 for _, time, y in found if time < 3.0)
    assert all(sum(one == row and y < 3.0 for one, _, y in found) == 2 for row in late)  # through, and back
    assert simulation.results().report["greatest_overlap"] < 1e-4


@pytest.mark.parametrize(("value", "have_come", "are_out"), [("in", True, False), ("out", False, True)])
def test_an_exit_of_one_direction_lets_people_in_or_out_only(value, have_come, are_out):
    late = {"name": "late", "arrive": {"times": [1.0, 1.0]}}
    people = [{"name": "p", "number": 3, "area": "west"}, late | {"arrive": late["arrive"] | {"exit": "out"}}]
    simulation = simulation_of(flat((0.0, "one_way", "out", value)).change({"people": people}))
    while not simulation.ended and simulation.time < 20.0:
        simulation.advance_tick()
    crowd = simulation.population.crowd
    rows = {group.name: group.rows for group in simulation.population.groups}
    assert np.isfinite(crowd.arrival_time[rows["late"]]).all() == have_come
    assert np.isfinite(crowd.exit_time[rows["p"]]).all() == are_out


def test_directions_and_world_are_those_of_a_building_with_the_door_closed():
    simulation = simulation_of(flat())
    simulation.scene.set_open("near", False)
    closed = simulation_of(flat(**{"building.closed": ["near"]}))
    assert np.array_equal(simulation.fields.packed.direction, closed.fields.packed.direction)
    assert np.array_equal(simulation.scene.world.wall_open, make_world(closed.building, closed.fields).wall_open)
    near, far = (simulation.fields.travel_time_at(0, np.array([[6.6, y]]), 0)[0] for y in (1.6, 5.1))
    assert near > far + 2.0


@pytest.mark.parametrize("model", ["nsm2", "dem"])
def test_other_models_stop_at_a_closed_door(model):
    changes = (0.0, "close", "near"), (0.0, "close", "far")
    simulation = simulation_of(flat(*changes, **{"contact.model": model, "simulation.duration": 10.0}))
    assert passages(simulation) == []


@pytest.mark.parametrize("clearance", [0.15, 0.25])
def test_no_way_leads_through_a_closed_door_whose_end_is_on_a_line_of_the_grid(clearance):
    rooms = [[[0, 0], [8, 0], [8, 2.6], [0, 2.6]], [[0, 2.8], [8, 2.8], [8, 5.3], [0, 5.3]]]
    plan = {
        "storeys": [{"name": "f", "polygons": rooms}],
        "doors": [
            {"name": "near", "storey": "f", "segment": [[2.0, 2.7], [3.0143, 2.7]]},
            {"name": "far", "storey": "f", "segment": [[5.0, 2.7], [5.9, 2.7]]},
        ],
        "exits": [{"name": "out", "storey": "f", "segment": [[0, 3.0], [0, 4.2]]}],
    }
    table = {
        "building": {"plan": plan, "closed": ["near"]},
        "contact": {"model": "dem"},
        "people": [{"name": "p", "positions": [[2.2, 2.4]], "level": "f"}],
        "directions": {"spacing": 0.2, "clearance": clearance},
    }
    fields = simulation_of(evac.load(table), will_run=False).fields
    assert fields.travel_time_at(0, np.array([[2.2, 2.4]]), 0)[0] == pytest.approx(8.1, abs=0.2)


@pytest.mark.parametrize("strategy", ["fastest", "quickest"])
def test_directions_lead_through_a_door_of_one_direction_on_a_coarse_grid(strategy):
    changes = {"directions.spacing": 0.25, "people.p.strategy": strategy}
    simulation = simulation_of(flat((0.0, "one_way", "near", "west"), (0.0, "close", "far"), **changes))
    run_ticks(simulation, 30)  # by which directions that follow the crowd are solved again
    for y in np.linspace(1.3, 1.9, 13):
        place, stuck = np.array([6.45, y]), set()
        while place[0] > 6.0:
            place = place + 0.02 * simulation.fields.directions_at(0, place[None], 0)[0]
            cell = (*np.round(place, 3).tolist(),)
            assert cell not in stuck
            stuck.add(cell)


def test_people_wait_behind_doors_that_are_closed_at_the_start_until_an_event_opens_one():
    closed = {"building.closed": ["near", "far"]}
    simulation = simulation_of(flat((4.0, "open", "near"), **closed))
    assert any("people.p" in line for line in simulation.warnings())
    assert simulation.run().ended == "everybody out"
    with pytest.raises(evac.ScenarioError, match=r"people\.p"):
        simulation_of(flat((4.0, "close", "near"), **closed))
