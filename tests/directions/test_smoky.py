"""Directions in smoke: travel times at the speeds that it leaves, which other runs in the building do not see."""

import numpy as np
import pytest

from evac.directions.build import build_fields
from evac.directions.routes import Route
from evac.directions.smoky import Smoky


def test_smoke_prolongs_the_times_by_the_speed_that_it_leaves_and_changes_no_other_run(row):
    clear = build_fields(row, [Route()], keep_grids=True)
    before = clear.packed.travel_time.copy()
    level, places = np.array([0, 1, 2]), np.array([[2.0, 2.0], [12.0, 2.0], [20.0, 2.0]])
    times = clear.travel_time_at(level, places, 0, 0.2)
    smoky = Smoky(clear, clear)
    assert smoky.solve({0, 1, 2}, np.full(clear.grids[0].grids.size, 0.5)) == 3
    assert smoky.fields.travel_time_at(level, places, 0, 0.2) == pytest.approx(2.0 * times, rel=0.05)
    np.testing.assert_array_equal(clear.packed.travel_time, before)
    share = np.full(clear.grids[0].grids.size, 0.5)
    share[smoky.fields.grids[0].grids.levels[2].packed] = 1.0
    assert smoky.solve({2}, share) > 0  # the smoke on the last level is gone
    found = smoky.fields.travel_time_at(level, places, 0, 0.2)
    assert np.argmin(found / times) == 2
