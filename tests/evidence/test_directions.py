"""The page on directions: what it measures, on small plans."""

import numpy as np
import pytest

from evac.evidence.directions.page import _fields, _march_rows, angles_between, l_corner, plain_directions, stair


def test_no_direction_counts_as_the_opposite_one():
    one = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    other = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    assert angles_between(one, other) == pytest.approx([90.0, 180.0, 0.0])


def test_plain_gradients_point_straight_where_no_wall_is_near():
    plan = l_corner(60, np.random.default_rng(0))
    fields = _fields(plan, 0.1, 2)
    clear = (plan.points[:, 0] > 3.0) & (plan.wall_distance > 0.5)
    assert clear.any()
    assert plain_directions(fields, plan)[clear, 0] == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_both_solvers_come_closer_to_exact_travel_times_on_finer_grids():
    """They are two solvers: the second does not have the errors of the first."""
    coarse, fine = _march_rows(stair(60, np.random.default_rng(0)), (0.1, 0.05))
    for name in ("scikit-fmm", "compiled"):
        assert 0.0 < fine[f"{name}, mean error [mm]"] < 0.75 * coarse[f"{name}, mean error [mm]"] < 20.0
    assert fine["compiled, mean error [mm]"] != fine["scikit-fmm, mean error [mm]"]
