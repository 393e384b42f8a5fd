"""When studies stop; the certainty page of the evidence measures the coverage of their intervals."""

import math

import numpy as np

from evac.study.stopping import GROWTH, rule_of

ALONE = range(10**6)


def test_a_fixed_number_of_runs_looks_at_nothing():
    rule = rule_of(7)
    assert (rule.first, rule.wanted(np.full(7, math.inf), ALONE)) == (7, 7)
    assert rule.is_known(np.full(7, math.inf), ALONE)


def test_a_study_stops_when_its_interval_is_narrow_enough():
    times = np.random.default_rng(1).lognormal(2.0, 0.08, 2000)
    rule = rule_of(until=0.02)
    runs, looks = rule.first, [rule.first]
    while (wanted := rule.wanted(times[:runs], ALONE)) > runs:
        assert wanted >= GROWTH * runs
        runs = wanted
        looks.append(runs)
    assert rule.is_known(times[:runs], ALONE)
    assert not rule.is_known(times[: looks[-2]], ALONE)
    assert 50 < runs < 200


def test_the_required_runs_increase_with_the_square_of_the_width():
    times = np.random.default_rng(5).lognormal(2.0, 0.08, 20)
    width = rule_of(until=0.5).estimate(times, ALONE).relative_half_width
    assert [rule_of(until=width / share).wanted(times, ALONE) for share in (1.1, 2.0, 3.0)] == [30, 80, 180]


def test_no_more_runs_than_the_most_are_wanted():
    times = np.random.default_rng(2).lognormal(0.0, 2.0, 60)
    rule = rule_of(until=0.01, most=60)
    assert rule.wanted(times[:20], ALONE) == 60
    assert rule.wanted(times, ALONE) == 60
    assert not rule.is_known(times, ALONE)


def test_a_percentile_without_an_interval_wants_more_runs():
    rule = rule_of(until=0.05, statistic="percentile 95", least=10)
    assert rule.wanted(np.linspace(1.0, 2.0, 10), ALONE) > 10
    assert rule_of(until=0.05, statistic="percentile 95").first == 80


def test_a_study_stops_when_its_interval_cannot_become_finite():
    """A percentile among the blocked runs, or one whose runs have too often been blocked for the greatest number."""
    times = np.linspace(1.0, 2.0, 80)
    rule = rule_of(until=0.05, statistic="percentile 95")
    often, seldom = times.copy(), times.copy()
    often[::4], seldom[:5] = math.inf, math.inf
    assert rule.wanted(often, ALONE) == 80
    assert not rule.is_open(often, ALONE)
    assert rule.wanted(seldom, ALONE) > 80
    assert rule_of(until=0.05, statistic="percentile 95", most=90).wanted(seldom, ALONE) == 80
    assert rule_of(until=0.05).wanted(np.full(20, math.inf), ALONE) == 20
    assert rule_of(until=0.05).wanted(np.full(20, math.nan), ALONE) == 20


def test_numbers_of_runs_are_whole_populations():
    rule = rule_of(until=0.001, least=7, most=50, repetitions=5)
    assert rule.first == 10
    assert rule.wanted(np.random.default_rng(3).lognormal(size=10), np.arange(10) // 5) % 5 == 0
