"""Flows through exits: steady between the first and the last fifth."""

import numpy as np
import pytest

from evac.analysis.flows import exit_table, steady_flow
from tests.physics.scenes import make_building


def test_steady_flow_leaves_out_both_ends():
    times = np.concatenate([[0.0, 50.0], 100.0 + 0.5 * np.arange(6), [200.0, 300.0]])
    assert steady_flow(times) == pytest.approx(6 / (200.0 - 100.0))
    assert steady_flow(0.25 * np.arange(100)) == pytest.approx(4.0)
    assert np.isnan(steady_flow(np.array([1.0])))


def test_people_who_all_pass_at_once_have_no_flow():
    """A row of equal people who walk abreast through a wide exit."""
    assert np.isnan(steady_flow(np.full(25, 8.75)))
    building = make_building(exits=[(0, (0.0, 0.0, 0.0, 30.0))])
    table = exit_table(building, np.zeros(25, np.int32), np.full(25, 8.75))
    assert table["exit 0"] == {"people": 25, "last_out": 8.75, "width": 1.0, "flow": None, "flow_per_metre": None}


def test_each_exit_has_people_width_and_flow():
    building = make_building(exits=[(0, (0.0, 0.0, 0.0, 1.0)), (0, (5.0, 0.0, 5.0, 1.0)), (0, (9.0, 0.0, 9.0, 1.0))])
    wide = building.exits[1]
    building = type(building)(
        **{
            **building.__dict__,
            "exits": (building.exits[0], type(wide)(**{**wide.__dict__, "width": 2.0}), building.exits[2]),
        }
    )
    used = np.repeat(np.array([0, 1, -1], np.int32), [19, 25, 3])
    times = np.concatenate([np.arange(19.0)[::-1], 10.0 + 0.2 * np.arange(25.0)[::-1], np.full(3, np.nan)])
    table = exit_table(building, used, times)
    assert table["exit 0"] == {"people": 19, "last_out": 18.0, "width": 1.0, "flow": None, "flow_per_metre": None}
    assert table["exit 1"]["last_out"] == pytest.approx(14.8)
    assert (table["exit 1"]["flow"], table["exit 1"]["flow_per_metre"]) == pytest.approx((5.0, 2.5))
    assert table["exit 2"] == {"people": 0, "last_out": None, "width": 1.0, "flow": None, "flow_per_metre": None}
