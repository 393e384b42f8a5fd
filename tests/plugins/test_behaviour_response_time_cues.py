"""Response by cue: alarms by zone, people who walk, and a field of another behaviour."""

import numpy as np
import pytest

import evac
from evac import Behaviour
from evac.base.errors import PluginError, ScenarioError
from evac.contract.registry import Registry
from evac.simulation.shared import simulation_of

#: Two rooms of one level, whose wall has a gap at its end.
ROOMS = "POLYGON ((0 0, 6 0, 6 4.8, 6.2 4.8, 6.2 0, 12 0, 12 6, 0 6, 0 0))"


class Smoke(Behaviour):
    """A field that rises at the places with x above 9 m from 2 s on."""

    name = "smoke"

    def prepare(self, scene):
        self.field = scene.level_field("smoke", "1/m", 0.5)
        self.x = self.field.cells[0].centres()[0]

    def act(self, crowd, time):
        self.field.on(0)[:] = (self.x > 9.0) * (time - 2.0)


def rooms(*events, **response):
    registry = Registry()
    registry.add_class(Smoke)
    places = [[2.0, 1.0], [4.0, 1.0], [4.0, 5.0], [8.0, 1.0], [10.0, 1.0]]
    table = {
        "building": {
            "plan": {
                "storeys": [{"name": "f", "polygons": [ROOMS]}],
                "exits": [{"name": "door", "storey": "f", "segment": [[0, 1], [0, 2.2]]}],
                "areas": [{"name": "east", "storey": "f", "polygon": [[7, 0], [12, 0], [12, 6], [7, 6]]}],
            }
        },
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 60.0},
        "people": [{"name": "all", "level": "f", "positions": places, "speed": 1.2}],
        "behaviours": {"smoke": {}, "response_time": {"time": 3.0, "begin": "cue"} | response},
        "event": list(events),
    }
    return evac.load(table, registry=registry)


ALARM = {"kind": "alarm", "target": "east", "time": 5.0}


def starts(case):
    simulation = simulation_of(case)
    simulation.run()
    return simulation.population.crowd.start_time.tolist()


def test_an_alarm_is_a_cue_for_those_in_its_place():
    assert starts(rooms(ALARM)) == pytest.approx([np.inf] * 3 + [8.0] * 2)
    assert starts(rooms({**ALARM, "value": 0.5})) == pytest.approx([np.inf] * 3 + [6.5] * 2)


def test_people_who_walk_are_a_cue_for_those_who_see_them():
    found = starts(rooms(ALARM, sees=3.0))
    assert found[3:] == pytest.approx([8.0, 8.0])
    assert all(8.0 + 3.0 < time < 25.0 for time in found[:3]), "they see those who come through the gap"
    assert starts(rooms(ALARM, sees=0.5))[0] == np.inf


def test_a_field_of_a_behaviour_is_a_cue_from_its_threshold_on():
    assert starts(rooms(fields={"smoke": 0.45})) == pytest.approx([np.inf] * 4 + [2.5 + 3.0], abs=0.11)
    with pytest.raises((PluginError, ScenarioError), match=r"'smok'.*'smoke'"):
        simulation_of(rooms(fields={"smok": 0.5})).run()
    with pytest.raises(PluginError, match=r"response_time\.fields"):
        simulation_of(rooms(fields={"smoke": "much"}))
