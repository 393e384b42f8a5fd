"""Runs tick by tick: what a program does between ticks has the bits of a behaviour that does the same."""

import math
from contextlib import suppress

import numpy as np
import pytest

import evac

HALL = {
    "storeys": [{"name": "hall", "polygons": [[0, 0], [12, 0], [12, 6], [0, 6]]}],
    "exits": [
        {"name": "west", "storey": "hall", "segment": [[0, 2], [0, 4]]},
        {"name": "east", "storey": "hall", "segment": [[12, 2], [12, 4]]},
    ],
    "areas": [
        {"name": "start", "storey": "hall", "polygon": [[1, 1], [6, 1], [6, 5], [1, 5]]},
        {"name": "niche", "storey": "hall", "polygon": [[10, 0.5], [11.5, 0.5], [11.5, 1.5], [10, 1.5]]},
    ],
}
WEST = evac.Route(exits=("west",))
NICHE = evac.Route(area="niche")


def do(scene, time):
    """Act on people and doors at times; a program and a behaviour call this before the physics of a tick."""
    tick = round(10 * time)
    if tick == 5:
        scene.apply(evac.Change(time, "close", "west", {"value": "bodies"}))
        scene.people.crowd.start_time[:3] = 2.0
    if tick == 10:
        scene.send(scene.people_in([(0, 0), (4, 0), (4, 6), (0, 6)], "hall"), WEST)
        scene.send([20], NICHE)
    if tick in (10, 12):
        scene.add("late", (9.0, 3.0))
    if tick == 15:
        scene.remove(scene.people_in("people")[-2:])
        scene.apply(evac.Change(time, "open", "west"))
        scene.add("late")
    if tick == 40:
        scene.send([20], WEST)


class Same(evac.Behaviour):
    """Does the same."""

    name = "same"
    writes = ("start_time", "route")

    def routes(self):
        return WEST, NICHE

    def prepare(self, scene):
        self._scene = scene.scene

    def act(self, crowd, time):
        do(self._scene, time)

    def state(self):
        return {}


def case(**changes):
    people = [
        {"name": "late", "area": "niche", "arrive": {"reserve": 4}},
        {"name": "people", "area": "start", "number": 24, "exits": ["east"]},
    ]
    registry = evac.Registry()
    registry.add_class(Same)
    table = {"building": {"plan": HALL}, "people": people, "contact": {"model": "nsm2"}, **changes}
    return evac.load({**table, "simulation": {"duration": 30.0}}, registry=registry)


@pytest.fixture(scope="module")
def stepped():
    simulation = evac.Simulation(case(), routes=[WEST, NICHE], in_memory=True)
    while not simulation.ended:
        do(simulation.scene, simulation.time)
        simulation.advance_tick()
    return simulation


def test_a_program_has_the_bits_of_a_behaviour_that_does_the_same(stepped):
    behaving = evac.Simulation(case(behaviours={"same": {}}))
    results = behaving.run()
    for name, array in behaving.population.crowd.values().items():
        np.testing.assert_array_equal(getattr(stepped.population.crowd, name), array, err_msg=name)
    assert results.changes == stepped.results().changes
    np.testing.assert_array_equal(results.start_position, stepped.start_position)


def test_a_program_that_acts_when_behaviours_do_has_their_bits_where_ways_follow_the_crowd():
    ways = {"directions": {"quickest": {"period": 0.5}}}  # found again at the ticks of `do`, before behaviours act
    simulation = evac.Simulation(case(behaviours={"walking": {}}, **ways), routes=[WEST, NICHE])
    while not simulation.ended:
        simulation.advance_tick(lambda: do(simulation.scene, simulation.time))
    behaving = evac.Simulation(case(behaviours={"same": {}, "walking": {}}, **ways))
    behaving.run()
    for name, array in behaving.population.crowd.values().items():
        np.testing.assert_array_equal(getattr(simulation.population.crowd, name), array, err_msg=name)


def test_people_who_are_added_removed_and_sent_are_counted(stepped):
    results, crowd = stepped.results(), stepped.population.crowd
    late = next(group.rows for group in stepped.population.groups if group.name == "late")
    assert results.ended == "everybody out"
    assert (results.not_arrived, results.spare, results.exit_status) == (1, 1, 0)  # who stayed in the reserve
    assert results.answer.outcome.startswith("Everybody out: ")
    np.testing.assert_allclose(crowd.arrival_time[late[[0, 2, 3]]], [1.0, 1.5, np.nan])
    assert crowd.arrival_time[late[1]] > 1.2  # when the place was free again
    np.testing.assert_array_equal(stepped.start_position[late[:2]], [(9.0, 3.0)] * 2)
    removed = np.flatnonzero(np.isfinite(crowd.exit_time) & (crowd.exit_used < 0))
    np.testing.assert_array_equal(crowd.exit_time[removed], [1.5, 1.5])
    assert results.evacuated == 27
    assert sum(way["people"] for way in results.exits.values()) == 25
    assert crowd.exit_time[20] > 4.0
    assert crowd.exit_used[20] == [way.name for way in results.building.exits].index("west")
    there = np.isfinite(results.trajectory.position[:, removed[0], 0])
    assert results.trajectory.time[there].max() == 1.5


def test_results_of_people_without_an_exit_are_written_and_read(stepped, tmp_path):
    results = stepped.results()
    results.write(tmp_path)
    read = evac.read_results(tmp_path)
    assert read.evacuated == results.evacuated
    np.testing.assert_array_equal(read.crowd.exit_used, results.crowd.exit_used)


def test_a_run_that_was_interfered_with_goes_on_from_its_state_to_the_same_bits(stepped):
    again, halfway = evac.Simulation(case(), routes=[WEST, NICHE]), None
    while not again.ended:
        if again.step == 200:
            halfway = again.state()
            again = evac.Simulation(case(), routes=[WEST, NICHE])
            again.restore(halfway)
        do(again.scene, again.time)
        again.advance_tick()
    np.testing.assert_array_equal(again.population.crowd.exit_time, stepped.population.crowd.exit_time)


@pytest.mark.parametrize(("name", "value"), [("start_time", math.nan), ("speed", -1.0), ("route", 7), ("route", -1)])
def test_what_nobody_can_have_is_refused_with_the_array_and_the_person(name, value):
    simulation = evac.Simulation(case())
    simulation.advance_tick()
    getattr(simulation.population.crowd, name)[2] = value
    with pytest.raises(evac.SimulationError, match=rf"crowd\.{name}: .* person 2;"):
        simulation.advance_tick()


def written(simulation):
    """Return the names of the arrays of people that can be written."""
    names = set()
    for name, array in simulation.population.crowd.values().items():
        with suppress(ValueError):
            array[:] = array
            names.add(name)
    return names


def test_results_cannot_be_written_before_the_first_tick():
    simulation = evac.Simulation(case())
    initial = {"position", "velocity", "level", "radius", "contact_radius", "height", "mass", "tau", "group"}
    assert written(simulation) == {"start_time", "speed", "route"} | initial
    with pytest.raises(ValueError, match="read-only"):
        simulation.displacement_velocity[:] = 0.0


def test_what_is_written_between_ticks_is_heeded_or_refused():
    simulation = evac.Simulation(case())
    simulation.advance_tick()
    crowd = simulation.population.crowd
    assert written(simulation) == {"start_time", "speed", "route"}
    with pytest.raises(ValueError, match="read-only"):
        simulation.displacement_velocity[:] = 0.0
    crowd.speed[:] = 0.0
    before = crowd.position.copy()
    for _ in range(40):
        simulation.advance_tick()
    assert np.abs(crowd.velocity).max() < 1e-3
    assert np.abs(crowd.position - before).max() < 1.0
    simulation.stop()
    assert simulation.results().ended == "interrupted"
    with pytest.raises(ValueError, match="read-only"):
        simulation.advance_tick(lambda: crowd.speed_factor.fill(0.5))


@pytest.mark.parametrize(
    ("place", "call"),
    [
        ("people.people", lambda scene: scene.add("people")),
        ("people.late", lambda scene: scene.add("late", (20.0, 3.0))),
        ("people.late", lambda scene: [scene.add("late") for _ in range(5)]),
        ("no directions for fastest to west", lambda scene: scene.send([0], WEST)),
        ("'cellar'", lambda scene: scene.people_in("cellar")),
    ],
)
def test_what_cannot_be_done_is_an_error(place, call):
    with pytest.raises(evac.ScenarioError, match=place):
        call(evac.Simulation(case()).scene)


def test_recorders_cannot_change_the_scene():
    class Meddling(evac.Recorder):
        """Removes people."""

        name = "meddling"

        def record(self, simulation):
            simulation.scene.remove([5])

    own = case()
    own.registry.add_class(Meddling)
    with pytest.raises(evac.PluginError, match="read-only"):
        evac.Simulation(own.change({})).run()
