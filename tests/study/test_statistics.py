"""Intervals against exact answers and true coverage; blocked runs; populations."""

import math

import numpy as np
import pytest
from scipy.stats import binom, norm, t

from evac.study.statistics import (
    deciding,
    difference,
    estimate,
    grouped_interval,
    least_runs,
    mean_interval,
    percentile,
    percentile_interval,
    share_interval,
    statistics,
    variation,
)


@pytest.mark.parametrize("of", [0, 5, 37.5, 50, 95, 100])
def test_a_percentile_is_that_of_numpy_as_long_as_times_are_finite(of):
    times = np.random.default_rng(1).lognormal(size=9)
    assert percentile(times, of) == pytest.approx(np.percentile(times, of), rel=1e-12)


def test_a_percentile_among_endless_runs_is_endless():
    times = np.array([3.0, math.inf, 1.0, 2.0, math.inf])
    assert [percentile(times, of) for of in (0, 25, 50, 51, 75, 100)] == [1.0, 2.0, 3.0, math.inf, math.inf, math.inf]


@pytest.mark.parametrize("of", [5.0, 50.0, 95.0])
def test_fewer_runs_than_least_runs_bound_no_percentile(of):
    assert least_runs(95.0) == 72
    least, share = least_runs(of), max(0.01 * of, 1.0 - 0.01 * of)
    assert binom.pmf(least, least, share) <= 0.025 < binom.pmf(least - 1, least - 1, share)
    times = np.random.default_rng(2).lognormal(size=least)
    assert np.isfinite(percentile_interval(times, of)).all()
    assert not np.isfinite(percentile_interval(times[1:], of)).all()


@pytest.mark.parametrize(("runs", "of"), [(10, 50), (30, 25), (72, 95), (99, 5)])
@pytest.mark.parametrize("law", ["lognormal", "exponential"])
def test_intervals_of_percentiles_cover_them(runs, of, law):
    rng = np.random.default_rng(3)
    samples = rng.lognormal(0.0, 0.1, (1000, runs)) if law == "lognormal" else rng.exponential(1.0, (1000, runs))
    many = rng.lognormal(0.0, 0.1, 10**6) if law == "lognormal" else rng.exponential(1.0, 10**6)
    true = np.percentile(many, of)
    low, high = np.array([percentile_interval(sample, of) for sample in samples]).T
    assert 0.925 <= np.mean((low <= true) & (true <= high)) <= 0.97


@pytest.mark.parametrize("n", [2, 5, 8, 20])
@pytest.mark.parametrize(("sigma", "least"), [(0.05, 0.92), (0.6, 0.90)])
def test_the_interval_of_a_mean_covers_it(n, sigma, least):
    """Log-normal samples, more skewed than times of egress are for sigma = 0.6; 95 % is asked for."""
    samples = np.random.default_rng(4).lognormal(0.0, sigma, (500, n))
    low, high = np.array([mean_interval(sample) for sample in samples]).T
    true = math.exp(0.5 * sigma**2)
    assert np.mean((low <= true) & (true <= high)) >= least


def test_blocked_runs_count_as_endless_and_are_told():
    times = np.concatenate([np.linspace(10.0, 12.0, 97), np.full(3, math.inf)])
    found = statistics(times)
    assert (found.runs, found.blocked, found.greatest) == (100, 3, math.inf)
    assert found.mean.runs == 97
    assert found.mean.value == pytest.approx(11.0)
    assert "3 of 100" in found.mean.note
    low, median, high = found.percentiles
    assert math.isfinite(median.high)
    assert low.note == median.note == ""
    assert math.isfinite(high.value)
    assert high.high == math.inf
    assert "3 of 100" in high.note
    assert high.relative_half_width == math.inf


def test_statistics_of_blocked_runs_alone():
    found = statistics(np.full(4, math.inf))
    assert found.blocked_share == 1.0
    assert math.isnan(found.mean.value)
    assert all(one.value == math.inf for one in found.percentiles)
    assert found.blocked_low == pytest.approx(0.025**0.25)


def test_one_run_has_no_interval():
    found = statistics(np.array([7.0]))
    assert found.mean.value == 7.0
    assert math.isnan(found.mean.low)
    assert math.isnan(found.standard_deviation)


def test_the_interval_of_a_share_is_exact():
    low, high = share_interval(3, 20)
    assert binom.sf(2, 20, low) == pytest.approx(0.025)
    assert binom.cdf(3, 20, high) == pytest.approx(0.025)
    assert share_interval(0, 20)[0] == 0.0
    assert share_interval(20, 20)[1] == 1.0
    assert share_interval(0, 50) == pytest.approx((0.0, 1.0 - 0.025 ** (1 / 50)))
    assert share_interval(12, 50) == pytest.approx((0.13061, 0.38169), abs=1e-5)  # tabulated


def test_runs_of_the_same_people_are_no_sample_of_their_number():
    """Ten populations, five times the same: the interval is that of ten values, not of fifty."""
    values = np.random.default_rng(6).lognormal(0.0, 0.2, 10)
    times, populations = np.repeat(values, 5), np.repeat(np.arange(10), 5)
    mean = estimate("mean", times, populations)
    assert (mean.low, mean.high) == pytest.approx(mean_interval(values))
    median = estimate("percentile 50", times, populations)
    assert (median.low, median.high) == pytest.approx(percentile_interval(values, 50))
    assert "10 populations" in median.note
    assert not estimate("percentile 95", times, populations).has_interval  # of fifty runs, but of ten populations


@pytest.mark.parametrize(("groups", "of"), [(20, 50), (20, 90), (80, 95)])
@pytest.mark.parametrize("within", [0.05, 0.2])
def test_intervals_of_percentiles_over_populations_cover_them(groups, of, within):
    """Bounds that exist must cover; five repetitions of each population, which differ more or less."""
    rng = np.random.default_rng(7)
    between = rng.normal(0.0, 0.1, (600, groups, 1))
    times = np.exp(between + rng.normal(0.0, within, (600, groups, 5))).reshape(600, -1)
    true = math.exp(math.hypot(0.1, within) * norm.ppf(0.01 * of))
    names = np.repeat(np.arange(groups), 5)
    low, high = np.array([grouped_interval(sample, of, names) for sample in times]).T
    assert np.mean(low > true) <= 0.04
    assert np.mean(high < true) <= 0.04
    assert np.isnan(high).all() == (groups < least_runs(of))


@pytest.mark.parametrize("n", [2, 6, 30])
def test_one_outlier_decides_the_mean_and_the_median_is_preferred(n):
    times = np.append(np.random.default_rng(8).normal(61.0, 0.6, n), 400.0)
    found = statistics(times)
    assert not found.mean.has_interval
    assert f"1 run of {n + 1}" in found.mean.note
    assert ("percentile 50" in found.mean.note) == found["percentile 50"].has_interval == (n + 1 >= least_runs(50))


def test_few_runs_that_decide_are_counted():
    times = np.append(np.random.default_rng(9).normal(61.0, 0.6, 18), [120.0, 121.0])
    assert deciding(times, mean_interval(times)) == 2
    assert "2 runs of 20" in estimate("mean", times).note


@pytest.mark.parametrize("n", [3, 7, 8, 20])
def test_regular_samples_keep_the_interval_of_their_mean(n):
    samples = np.random.default_rng(10).normal(60.0, 3.0, (200, n))
    lost = [deciding(sample, mean_interval(sample)) for sample in samples]
    assert np.mean(np.array(lost) > 0) <= 0.06
    assert deciding(np.full(n, 0.1), mean_interval(np.full(n, 0.1))) == 0


def test_an_interval_that_is_given_lies_within_reach_of_the_runs():
    """No bound below zero, and from eight runs on none beyond the runs, however heavy their tail is."""
    for n in (3, 5, 8, 12, 30):
        for sample in np.random.default_rng(11).pareto(1.0, (100, n)) + 0.01:
            found = estimate("mean", sample)
            if found.has_interval:
                assert found.low > 0.0
                assert n < 8 or (sample.min() <= found.low <= found.high <= sample.max())


def test_skewed_and_blocked_studies_are_told():
    regular = np.linspace(60.0, 64.0, 40)
    skewed = np.append(regular, [70.0, 75.0, 78.0, 80.0])
    assert estimate("mean", regular).note == ""
    assert "skewed" in estimate("mean", skewed).note
    assert "percentile 50" in estimate("mean", skewed).note
    assert "percentile 50" in estimate("mean", np.append(regular, math.inf)).note


@pytest.mark.parametrize("n", [4, 10, 30])
def test_the_interval_of_a_difference_covers_it(n):
    rng, covered = np.random.default_rng(12), []
    for _ in range(300):
        before = rng.lognormal(2.0, 0.1, n)
        found = difference(before, before - 0.2 + rng.normal(0.0, 0.3, n))
        covered.append(found.low <= -0.2 <= found.high)
    assert np.mean(covered) >= 0.92


def test_pairs_with_a_blocked_or_failed_run_have_no_difference():
    before = np.array([1.0, 2.0, math.inf, 4.0, 5.0])
    after = np.array([1.5, 2.6, 3.0, math.nan, 5.4])
    found = difference(before, after)
    assert (found.runs, found.value) == (3, pytest.approx(0.5))
    assert "2 pairs" in found.note
    assert difference(before[2:4], after[2:4]).runs == 0
    assert difference(np.ones(9), np.ones(9)).low == 0.0


def test_one_pair_that_decides_a_difference_leaves_no_interval():
    after = 60.0 + np.append(np.random.default_rng(13).normal(0.0, 0.5, 10), 340.0)
    assert not difference(np.full(11, 60.0), after).has_interval


def test_failed_runs_are_in_no_statistic():
    times = np.linspace(10.0, 12.0, 20)
    found = statistics(np.insert(times, 3, math.nan))
    assert (found.runs, found.failed) == (20, 1)
    assert repr((found.mean, found.percentiles)) == repr((statistics(times).mean, statistics(times).percentiles))
    assert math.isnan(statistics(np.full(2, math.nan)).mean.value)


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
    assert variation(np.array([1.0, math.inf]), [0, 1]).reported == math.inf


def test_a_difference_of_pairs_of_several_populations_is_one_of_their_means():
    """Three populations of two pairs each: Student's interval of three means, without the pair that is blocked."""
    before = np.array([10.0, 10.0, 20.0, 20.0, 30.0, 30.0, 40.0])
    after = before + np.array([1.0, 3.0, 2.0, 4.0, 6.0, 4.0, np.nan])
    found = difference(before, after, [0, 0, 1, 1, 2, 2, 2])
    means = np.array([2.0, 3.0, 5.0])
    half = t.ppf(0.975, 2) * means.std(ddof=1) / math.sqrt(3)
    assert (found.value, found.runs) == (pytest.approx(20.0 / 6.0), 6)
    assert [found.low, found.high] == pytest.approx([means.mean() - half, means.mean() + half])
    assert found.note == "without 1 pair in which a run is blocked or failed"
    one = difference(before[:2], after[:2], [5, 5])
    assert (math.isnan(one.low), one.note) == (True, "no interval for one population")
    pairs = difference(before[:6], after[:6])
    half = t.ppf(0.975, 5) * np.std([1.0, 3.0, 2.0, 4.0, 6.0, 4.0], ddof=1) / math.sqrt(6)
    assert [pairs.low, pairs.high] == pytest.approx([20.0 / 6.0 - half, 20.0 / 6.0 + half])
    same = difference(before[:2], before[:2] + 1.5)
    assert (same.low, same.value, same.high) == (1.5, 1.5, 1.5)
