"""Runs in which people avoid the crowd, by the strategy "quickest"."""

import json

import numpy as np

import evac
from evac.simulation.shared import simulation_of
from evac.simulation.simulation import Simulation
from tests.runs import assert_same_bits, run_ticks

#: A hall with two storeys' worth of ways: a floor, a stair down, and an exit of 0.9 m beside one of 1.6 m farther away.
PLAN = {
    "storeys": [
        {"name": "low", "polygons": [[[0, 0], [12, 0], [12, 5], [0, 5]]]},
        {"name": "high", "z": 3.0, "polygons": [[[17, 0], [23, 0], [23, 5], [17, 5]]]},
    ],
    "stairs": [
        {
            "name": "stair",
            "lower": "low",
            "lower_edge": [[12, 1], [12, 3]],
            "upper": "high",
            "upper_edge": [[17, 1], [17, 3]],
        }
    ],
    "exits": [
        {"name": "near", "storey": "low", "segment": [[9, 0], [9.9, 0]]},
        {"name": "far", "storey": "low", "segment": [[1, 5], [2.6, 5]]},
    ],
    "areas": [
        {"name": "floor", "storey": "low", "polygon": [[6, 0], [12, 0], [12, 5], [6, 5]]},
        {"name": "above", "storey": "high", "polygon": [[18, 0], [23, 0], [23, 5], [18, 5]]},
    ],
}


def case_of(strategy="quickest", **changes):
    group = {"number": 40, "speed": 1.3, "strategy": strategy}
    table = {
        "building": {"plan": PLAN},
        "contact": {"model": "nsm2"},
        "behaviours": {"headway": {}},
        "directions": {"spacing": 0.2},
        "simulation": {"duration": 90.0},
        "output": {"picture": False, "replay": False},
        "people": [{"name": "a", "area": "floor", **group}, {"name": "b", "area": "above", **group, "number": 20}],
    }
    return evac.load(table, changes)


def test_more_people_take_the_wider_exit_although_it_is_farther(tmp_path):
    fastest, quickest = (evac.run(case_of(one), tmp_path / one) for one in ("fastest", "quickest"))
    assert quickest.exits["far"]["people"] > fastest.exits["far"]["people"] + 5
    assert quickest.last_out < 0.9 * fastest.last_out
    assert fastest.quickest is None
    summary = json.loads((tmp_path / "quickest" / "summary.json").read_text())
    found = evac.read_results(tmp_path / "quickest").quickest
    assert found == summary["quickest"]
    assert found["updates"] == 1 + int((quickest.time - 1e-6) // 2.0)
    assert found["levels_solved"] >= 3


def test_people_of_other_strategies_queue_at_the_gates_that_they_walk_to():
    """Whoever follows the crowd leaves the near exit to those who do not."""
    shares = []
    for number in (1, 40):
        case = case_of(**{"people.b.strategy": "fastest", "people.b.area": "floor", "people.b.number": number})
        results = simulation_of(case).run()
        near = results.crowd.exit_used == [exit_.name for exit_ in results.building.exits].index("near")
        shares.append(near[results.crowd.group == 0].mean())
    assert shares[1] < shares[0]


def test_a_change_between_two_updates_is_followed_at_once():
    simulation = simulation_of(case_of())
    simulation.scene.apply(evac.Change(3.3, "close", "far"))
    run_ticks(simulation, 33)
    quickest, updates = simulation.scene.quickest, simulation.scene.quickest.report()["updates"]
    run_ticks(simulation, 1)
    assert simulation.scene.quickest is not quickest
    assert simulation.scene.quickest.report()["updates"] == updates + 1
    inside = simulation.population.crowd.level == 0
    place, level = simulation.population.crowd.position[inside], np.zeros(inside.sum(), np.int32)
    before, now = (of.fields.travel_time_at(level, place, 0, 0.15) for of in (quickest, simulation.scene.quickest))
    assert (now > before + 1.0).any()


def test_groups_with_another_strategy_keep_their_travel_times():
    simulation = run_ticks(simulation_of(case_of(**{"people.b.strategy": "fastest"})), 60)
    fields, before = simulation.fields, simulation.scene.shared_scene.fields
    place = np.array([[9.0, 3.0]])
    differs = [
        (fields.travel_time_at(0, place, route, 0.2) != before.travel_time_at(0, place, route, 0.2)).any()
        for route in range(2)
    ]
    assert differs == [route.strategy == "quickest" for route in fields.routes]


def test_without_the_strategy_no_travel_time_follows_the_crowd():
    simulation = simulation_of(case_of("fastest"))
    assert simulation.scene.quickest is None
    times, before = (fields.packed.travel_time for fields in (simulation.fields, simulation.scene.shared_scene.fields))
    assert (times == before).all()
    assert not [key for key in simulation.state() if "quickest." in key]


def test_runs_in_the_same_scene_do_not_disturb_each_other():
    first = run_ticks(simulation_of(case_of()), 60)
    second = run_ticks(Simulation(case_of(), shared_scene=first.scene.shared_scene), 60)
    assert_same_bits(first, second)


def test_a_stair_opens_and_closes_and_the_density_stays():
    """The grids of its levels are larger while it is open."""
    case = case_of(**{"building.closed": ["stair"], "people.b.area": "floor"})
    one, other = simulation_of(case), simulation_of(case)
    for time, kind in ((2.0, "open"), (4.0, "close")):
        one.scene.apply(evac.Change(time, kind, "stair"))
    run_ticks(one, 45)
    other.restore(one.state())
    for simulation in (one, other):
        run_ticks(simulation, 30)
    assert_same_bits(one, other)
    assert one.run().ended == "everybody out"
