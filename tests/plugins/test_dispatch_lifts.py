"""Dispatchers: which call a car serves next, in the order that each promises, and in runs."""

from pathlib import Path

import pytest

import evac
from evac.conformance import check_plugin
from evac.contract.registry import Registry
from evac.people.dispatcher import Car, StopCall
from evac.simulation.shared import simulation_of
from tests.simulation.test_lifts import case, group, tower

REGISTRY = Registry()
STOREYS = ("s0", "s1", "s2", "s3", "s4", "s5")


def order(name, stop=0, **values):
    """The order in which a car serves all storeys if it serves one after the other."""
    dispatcher, calls, found = REGISTRY.dispatchers[name](**values), [*range(1, 6)], []
    while calls:
        car = Car("car", STOREYS, tuple(3.0 * k for k in range(6)), stop, 0, 10)
        stop = dispatcher.next_stop(car, tuple(StopCall(k, 1, 0.0) for k in calls), 0.0)
        if stop is None:
            break
        found.append(stop)
        calls.remove(stop)
    return found


def test_calls_are_served_in_the_order_that_a_dispatcher_promises():
    assert order("top_down") == [5, 4, 3, 2, 1]
    assert order("nearest_call", stop=3) == [3, 2, 1, 4, 5]
    assert order("shuttle", storey="s4") == [4]
    assert order("priority", storeys=["s2", "s4"]) == [2, 4, 5, 3, 1]
    assert order("fire_floors_first", fire="s3") == [3, 4, 5, 2, 1]
    assert order("fire_floors_first", fire="s2", beside=1) == [2, 3, 1, 5, 4]


@pytest.mark.parametrize("name", list(REGISTRY.dispatchers))
def test_dispatchers_conform(name):
    check_plugin(REGISTRY.dispatchers[name])


def test_the_dispatcher_of_the_page_conforms_and_has_at_most_40_lines(tmp_path):
    page = (Path(__file__).parents[2] / "docs/lifts.md").read_text(encoding="utf-8")
    text = page.split("```python\n")[1].split("```")[0]
    assert text.count("\n") <= 40
    file = tmp_path / "longest_wait.py"
    file.write_text(text, encoding="utf-8")
    registry = Registry([file])
    check_plugin(registry.dispatchers["longest_wait"])


def test_storeys_are_served_in_the_order_of_a_case():
    people = [group(2, f"s{k}") for k in range(1, 5)]
    scene = case(
        tower((0.0, 3.0, 6.0, 9.0, 12.0), capacity=4),
        people,
        "nsm1",
        **{"dispatchers.priority": {"storeys": ["s3", "s1"]}},
    )
    simulation = simulation_of(scene)
    assert simulation.run().ended == "everybody out"
    served = simulation.lifts.trips[:, 2].astype(int).tolist()
    assert [*dict.fromkeys(served)] == [3, 1, 4, 2]


def test_a_dispatcher_that_sends_a_car_where_nobody_calls_is_named(tmp_path):
    file = tmp_path / "wrong.py"
    file.write_text(
        "from evac import Dispatcher\nevac_interface = 3\nclass Wrong(Dispatcher):\n    '''Wrong.'''\n"
        "    name = 'wrong'\n    def next_stop(self, car, calls, time):\n        return 17\n"
    )
    table = {"building": tower(), "people": [group(1, "s1")], "contact": {"model": "nsm1"}}
    table["dispatchers"] = {"wrong": {}}
    simulation = simulation_of(evac.load(table, plugin_files=[file]))
    with pytest.raises(evac.PluginError, match=r"wrong.*17"):
        simulation.run()
    two = {"dispatchers.top_down": {}, "dispatchers.nearest_call": {}}
    scene = case(tower(), [group(1, "s1")], **two)
    with pytest.raises(evac.ScenarioError, match="dispatchers"):
        simulation_of(scene)
