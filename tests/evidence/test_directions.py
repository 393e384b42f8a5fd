"""The page on directions: what it measures, on small plans."""

import numpy as np
import pytest

from evac.evidence.directions.page import _fields, angles_between, l_corner, plain_directions


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
