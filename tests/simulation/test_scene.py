"""A scene that changes: an exit closes during a run, and everything derived from the building follows."""

import numpy as np
import pytest

import evac
from evac.base.errors import ScenarioError
from evac.building.model.links import building_at
from evac.physics.state import FIRM
from evac.simulation.simulation import Simulation
from tests.runs import assert_same_bits, two_doors


@pytest.fixture
def room(tmp_path):
    """Return a case of a room of 5 m by 4 m with the exits front and back."""
    more = {"simulation": {"duration": 60.0}, "behaviours": {"headway": {}, "route_choice": {}}}
    return evac.load(two_doors(tmp_path) | more)


def ticks(simulation, number):
    for _ in range(number):
        simulation.advance_tick()


def test_nobody_leaves_by_an_exit_that_has_closed(room):
    simulation = Simulation(room)
    ticks(simulation, 10)
    inside = simulation.population.crowd.level >= 0
    assert inside.sum() > 4
    version = simulation.scene.version
    simulation.scene.set_open("front", False)
    assert simulation.scene.version > version
    results = simulation.run()
    assert results.exit_status == 0
    assert (results.crowd.exit_used[inside] == 1).all()
    still = Simulation(room).run()
    assert set(still.crowd.exit_used.tolist()) == {0, 1}


def test_directions_are_those_of_the_building_as_it_is(room):
    simulation = Simulation(room)
    before = simulation.fields
    simulation.scene.set_open("front", False)
    closed = Simulation(room.change({"building.closed": ["front"]}))
    assert np.array_equal(simulation.fields.packed.direction, closed.fields.packed.direction)
    assert simulation.scene.world.fields is simulation.fields.packed
    simulation.scene.set_open("front", True)
    version = simulation.scene.version
    assert np.array_equal(simulation.fields.packed.direction, before.packed.direction)
    assert np.array_equal(simulation.scene.world.wall_open, Simulation(room).scene.world.wall_open)
    simulation.scene.set_open("front", True)
    assert simulation.scene.version == version


def test_a_group_whose_exits_are_all_closed_takes_any_other(room):
    case = room.change({"people.people.exits": ["front"], "behaviours.route_choice": False})
    simulation = Simulation(case)
    ticks(simulation, 10)
    inside = simulation.population.crowd.level >= 0
    simulation.scene.set_open("front", False)
    results = simulation.run()
    assert results.ended == "everybody out"
    assert inside.any()
    assert (results.crowd.exit_used[inside] == 1).all()
    with pytest.raises(ScenarioError, match=r"people\.people\.exits.*'front'.*building\.closed"):
        Simulation(case.change({"building.closed": ["front"]}))


def test_changes_are_kept_with_the_times_at_which_they_took_effect(room):
    simulation = Simulation(room)
    tick = room.simulation.tick
    simulation.scene.apply(evac.Change(5.5 * tick, "open", "back"))  # within a tick: at the beginning of the next one
    simulation.scene.apply(evac.Change(2 * tick, "close", "back"))
    simulation.scene.set_open("back", True)  # no effect
    ticks(simulation, 3)
    simulation.scene.set_open("front", False)
    ticks(simulation, 5)
    made = [evac.Change(k * tick, kind, what) for k, kind, what in [(2, "close", "back"), (3, "close", "front")]]
    expected = [*made, evac.Change(6 * tick, "open", "back")]
    assert [change.time for change in simulation.scene.changes] == pytest.approx([change.time for change in expected])
    assert [change.kind for change in simulation.scene.changes] == ["close", "close", "open"]
    results = simulation.run()
    assert list(results.changes) == simulation.scene.changes
    assert results.summary()["changes"] == [change.as_row() for change in results.changes]
    assert [
        building_at(simulation.scene.shared_scene.building, results.changes, k * tick).closed for k in (1, 2, 3, 6)
    ] == [
        frozenset(),
        {1},
        {0, 1},
        {0},
    ]


def test_a_recorded_change_is_made_again_with_the_people_who_stand_there_now(room):
    scene = Simulation(room).scene
    scene.apply(evac.Change(0.0, "close", "front", {"let_through": [3]}))
    assert scene.changes == [evac.Change(0.0, "close", "front")]


def test_a_change_after_the_last_tick_has_no_effect(room, tmp_path):
    """It would be in the results, but not in the trajectory, of which the last frame is written."""
    case = room.change({"simulation.duration": 1.0, "output.picture": False})
    simulation = Simulation(case, tmp_path)
    results = simulation.run(lambda progress: simulation.scene.set_open("front", progress.time < 0.5))
    recorded = evac.read_trajectory(tmp_path)
    assert [change.kind for change in results.changes] == ["close"]
    assert recorded.changes == tuple(results.changes)
    late = Simulation(case, tmp_path)
    results = late.run(lambda progress: late.scene.set_open("front", not late.ended))
    assert results.changes == evac.read_trajectory(tmp_path).changes == ()
    assert results.building.closed == frozenset()


@pytest.fixture
def gap():
    """Return a case of a hall with a gap of 0.45 m and a door in its middle, and an exit at either end."""
    hall = "POLYGON ((0 0, 12 0, 12 8, 0 8, 0 0), (6 0.45, 6 6.9, 6.1 6.9, 6.1 0.45, 6 0.45))"
    exits = [
        {"name": "east", "storey": "f", "segment": [[12, 0.5], [12, 1.7]]},
        {"name": "west", "storey": "f", "segment": [[0, 0.5], [0, 0.95]]},
    ]
    table = {
        "building": {"plan": {"storeys": [{"name": "f", "polygons": [hall]}], "exits": exits}},
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 60.0},
        "people": [{"name": "people", "number": 12, "level": "f"}],
        "behaviours": {"headway": {}},
    }
    return evac.load(table)


def test_people_too_wide_for_a_gap_or_an_exit_take_another_and_go_on_to_the_same_bits(gap):
    """Behind a closure too, and in a scene that runs share."""
    shared = Simulation(gap, will_run=False).scene.shared_scene
    one, other = Simulation(gap, shared_scene=shared), Simulation(gap)
    ticks(one, 10)
    one.scene.set_open("west", False)
    ticks(one, 10)
    one.scene.set_open("west", True)
    other.restore(one.state())
    assert one.fields.packed.width.tolist() == other.fields.packed.width.tolist() == pytest.approx([0.45], abs=2e-6)
    results = [simulation.run() for simulation in (one, other)]
    assert_same_bits(one, other)
    assert results[0].exit_status == 0
    wide = one.population.crowd.radius > 0.225
    assert 0 < wide.sum() < 12
    assert (results[0].crowd.exit_used[wide] == 0).all()
    assert (results[0].crowd.exit_used[~wide] == 1).any()


@pytest.fixture
def corridor():
    """Return a case of two people 3 m from the west end of a corridor with an exit at either end."""
    exits = [
        {"name": "west", "storey": "f", "segment": [[0, 0.5], [0, 1.7]]},
        {"name": "east", "storey": "f", "segment": [[20, 0.5], [20, 1.7]]},
    ]
    storey = {"name": "f", "polygons": ["POLYGON ((0 0, 20 0, 20 2, 0 2, 0 0))"]}
    table = {
        "building": {"plan": {"storeys": [storey], "exits": exits}},
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 60.0, "no_progress": 5.0},
        "people": [{"name": "people", "level": "f", "positions": [[3.0, 1.0], [5.0, 1.0]]}],
    }
    return evac.load(table)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param([(3.0, "close", "west")], id="a longer way"),
        pytest.param([(0, "close", "west"), (0, "close", "east"), (15.0, "open", "east")], id="an opening to come"),
    ],
)
def test_a_run_goes_on_where_a_change_of_the_scene_leaves_a_way(corridor, changes):
    simulation = Simulation(corridor)
    for change in changes:
        simulation.scene.apply(evac.Change(*change))
    results = simulation.run()
    assert results.ended == "everybody out"
    assert results.exits["east"]["people"] > 0


def test_a_run_ends_where_no_change_is_to_come_in_time(corridor):
    simulation = Simulation(corridor)
    for change in [(0, "close", "west"), (0, "close", "east"), (60.0, "open", "east")]:
        simulation.scene.apply(evac.Change(*change))
    assert simulation.run().ended == "no progress"


def test_people_wait_before_a_link_that_is_closed_for_bodies_alone(room):
    """A turnstile at the only exit that the group uses: no field is solved again, and nobody looks for another way."""
    case = room.change({"people.people.exits": ["front"], "behaviours.route_choice": False})
    simulation, resumed = Simulation(case), Simulation(case)
    fields, crowd, scene = simulation.fields, simulation.population.crowd, simulation.scene
    scene.apply(evac.Change(0.0, "close", "front", {"value": "bodies"}))
    ticks(simulation, 40)
    assert (crowd.level == 0).all()
    assert np.hypot(*(crowd.position - (5.0, 1.75)).T).max() < 3.0  # they have come before it
    for _ in range(4):  # it opens for a tick in every two seconds
        out = int((crowd.level < 0).sum())
        scene.set_open("front", True)
        ticks(simulation, 1)
        scene.apply(evac.Change(scene.time, "close", "front", {"value": "bodies"}))
        ticks(simulation, 19)
        assert (crowd.level < 0).sum() - out <= 3  # as many as stand side by side on its line of 1.5 m
    assert 4 <= (crowd.level < 0).sum() < 16
    assert (crowd.exit_used[crowd.level < 0] == 0).all()
    assert scene.fields is fields
    assert (scene.version, scene.ways_version) == (9, 0)
    assert not scene.building.is_open(scene.building.exits[0])
    assert scene.building.for_ways.is_open(scene.building.exits[0])
    resumed.restore(simulation.state())
    for one in (simulation, resumed):
        one.scene.set_open("front", True)
        ticks(one, 5)
    assert_same_bits(simulation, resumed)
    scene.set_open("front", False)
    assert scene.ways_version == 1


def test_ways_lead_round_who_stands_firm(tmp_path):
    people = [{"name": "people", "positions": [[3.6, 1.75], [2.9, 1.75]], "level": "floor z=0.00", "exits": ["front"]}]
    ahead = []
    for firmness in (1.0, FIRM):
        simulation = Simulation(evac.load(two_doors(tmp_path) | {"people": people, "behaviours": {"walking": {}}}))
        with simulation.population.writable():
            simulation.population.crowd.firmness[0] = firmness
        simulation.scene.follow_crowd(0, 0.1)
        ahead.append(simulation.scene.fields.directions_at([0], np.array([[3.3, 1.75]]), [0], 0.2)[0, 0])
    assert ahead == pytest.approx([1.0, -1.0], abs=0.1)  # 0.3 m behind somebody who stands firm, one steps back
