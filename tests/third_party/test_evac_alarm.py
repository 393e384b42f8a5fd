"""Run where evac and this package are installed: `pip install tests/third_party && pytest tests/third_party`."""

import numpy as np
from evac_alarm import Alarm

import evac
from evac.conformance import check_plugin


def test_it_is_registered_by_its_entry_point():
    registry = evac.Registry()
    assert registry.behaviours["alarm"] is Alarm
    (row,) = [row for row in registry.provenance if row.plugin == "evac_alarm"]
    assert (row.source, row.origin, row.version) == ("distribution", "evac-alarm", "1.0.0")


def test_it_conforms():
    check_plugin(Alarm)


def test_people_near_the_alarm_set_off_first():
    case = evac.load("square_room", {"behaviours.alarm": {"x": 5.0, "y": 2.5, "speed": 2.0}})
    crowd = evac.Simulation(case).population.crowd
    np.testing.assert_allclose(crowd.start_time, np.hypot(crowd.position[:, 0] - 5.0, crowd.position[:, 1] - 2.5) / 2.0)
    assert evac.run(case).evacuated == 20
