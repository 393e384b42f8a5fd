"""The measures of convergence against values computed by hand; the variation between populations."""

import math

import numpy as np
import pytest

from evac.study.convergence import BOUNDS, CONSECUTIVE, compared, convergence, settled
from evac.study.imo import variation


def test_curves_that_are_the_same_have_no_difference():
    curve = np.array([1.0, 2.0, 4.0])
    assert compared(curve, curve) == pytest.approx((0.0, 1.0, 1.0))


def test_measures_of_curves_by_hand():
    one, other = np.array([3.0, 4.0, 6.0]), np.array([3.0, 5.0, 6.0])
    difference, projection, cosine = compared(one, other)
    assert difference == pytest.approx(1.0 / math.sqrt(70.0))
    assert projection == pytest.approx(65.0 / 70.0)
    assert cosine == pytest.approx((1 * 2 + 2 * 1) / (math.sqrt(5.0) * math.sqrt(5.0)))


def test_measures_compare_the_averages_of_consecutive_numbers_of_runs():
    curves = [np.array([1.0, 2.0]), np.array([1.0, 4.0]), np.array([1.0, 3.0])]
    rows = convergence(curves)
    assert [row["runs"] for row in rows] == [2, 3]
    assert rows[0]["TET"] == pytest.approx(1.0 / 3.0)
    assert rows[0]["SD"] is rows[0]["ERD"] is None
    assert rows[1]["TET"] == 0.0
    assert rows[1]["SD"] == pytest.approx(abs(1.0 - math.sqrt(2.0)))
    before = compared(np.array([1.0, 3.0]), np.array([1.0, 2.0]))
    assert rows[1]["ERD"] == pytest.approx(before[0])


def test_a_study_settles_after_enough_small_changes():
    rows = [{"runs": k + 2, **dict.fromkeys(BOUNDS, 1.0 if k == 3 else 0.0)} for k in range(20)]
    assert settled(rows) == dict.fromkeys(BOUNDS, 5 + CONSECUTIVE)
    assert settled(rows[:10]) == dict.fromkeys(BOUNDS, None)


def test_curves_are_used_one_at_a_time():
    assert len(convergence(np.sort(np.random.default_rng(k).random(5)) for k in range(4))) == 3


def test_the_time_that_exceeds_95_percent_of_500():
    times = np.random.default_rng(1).permutation(500).astype(float)
    assert variation(times, np.arange(500) // 5).reported == 475.0
    assert np.sum(times < 475.0) == 475


def test_variation_between_and_within_populations():
    rng = np.random.default_rng(2)
    populations = np.arange(2000) // 5
    times = 10.0 + rng.normal(0.0, 0.5, 400)[populations] + rng.normal(0.0, 0.2, 2000)
    found = variation(times, populations)
    assert found.between == pytest.approx(0.5, rel=0.1)
    assert found.within == pytest.approx(0.2, rel=0.1)
    assert found.probability < 1e-6
    assert variation(rng.normal(10.0, 0.2, 2000), populations).probability > 1e-3
    assert variation(np.array([1.0, math.inf]), [0, 1]).reported == math.inf
