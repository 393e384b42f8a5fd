"""The flow of the square room, the figures of the paper, classroom and school."""

import numpy as np
import pytest

from evac.evidence.evidence import Evidence
from evac.evidence.square_room import change, crowd_at, flow, start_positions
from evac.evidence.table3.classroom import median_last
from evac.evidence.table3.figures import draw_figure_2, draw_figure_3


def generator():
    return np.random.default_rng(0)


def test_flow_is_the_slope_of_the_regression_over_all_exits():
    sets = [
        np.sort(generator().uniform(0.0, 9.0, (7, 20)), axis=1),
        np.sort(generator().uniform(0.0, 7.0, (5, 20)), axis=1),
    ]
    pooled = np.concatenate([times.ravel() for times in sets])
    number = np.tile(np.arange(1, 21), 12)
    found = flow(sets, generator())
    assert found.pooled.value == pytest.approx(60.0 * np.polyfit(pooled, number, 1)[0], rel=1e-10)
    single = [60.0 * np.polyfit(times, np.arange(1, 21), 1)[0] for part in sets for times in part]
    assert found.mean.value == pytest.approx(np.mean(single), rel=1e-10)
    assert (found.runs, found.stopped) == (12, 0)


def test_interval_holds_the_flow_and_vanishes_where_all_sets_are_alike():
    even = np.tile(np.arange(1, 21) / 3.0, (4, 1))
    found = flow([even] * 5, generator())
    for estimate in (found.pooled, found.mean):
        assert (estimate.low, estimate.value, estimate.high) == pytest.approx((180.0, 180.0, 180.0))
    mixed = flow([even, 1.1 * even, 0.9 * even], generator())
    for estimate in (mixed.pooled, mixed.mean):
        assert estimate.low < estimate.value < estimate.high
        assert (estimate.low, estimate.high) == pytest.approx((180.0 / 1.1, 200.0), rel=1e-3)


def test_change_is_paired_on_the_runs_that_both_steps_have():
    random = generator()
    coarse = [np.sort(random.uniform(0.0, 9.0, (6, 20)), axis=1) for _ in range(5)]
    fine = [times[:2] / 1.05 for times in coarse]
    found = change(coarse, fine, generator())
    kept = [times[:2] for times in coarse]
    base = flow(kept, generator())
    assert (found.runs, found.stopped) == (10, 0)
    assert found.pooled.value == pytest.approx(0.05 * base.pooled.value)
    assert found.mean.value == pytest.approx(0.05 * base.mean.value)
    # The interval is that of the difference, far narrower than those of the flows themselves.
    assert found.mean.high - found.mean.low == pytest.approx(0.05 * (base.mean.high - base.mean.low))
    same = change(coarse, [times[:2] for times in coarse], generator())
    assert (same.pooled.low, same.pooled.value, same.pooled.high) == (0.0, 0.0, 0.0)


def test_positions_belong_to_the_set_and_parameters_to_the_run():
    first, again, other = start_positions(1, 0), start_positions(1, 0), start_positions(1, 1)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    one, two = crowd_at(first, 1, 0, 0), crowd_at(first, 1, 0, 1)
    assert np.array_equal(one.position, two.position)
    for name in ("radius", "mass", "tau", "speed"):
        assert not np.array_equal(getattr(one, name), getattr(two, name))
    assert one.speed.min() >= 1.5
    assert one.speed.max() <= 2.0
    apart = np.linalg.norm(first[:, None] - first[None], axis=2) + 9.0 * np.eye(20)
    assert apart.min() >= 0.5  # nobody overlaps, whatever radius up to 0.25 m a run draws


def test_figures_2_and_3_hold_the_values_of_the_paper(tmp_path):
    evidence = Evidence("table3", tmp_path)
    draw_figure_2(evidence)
    draw_figure_3(evidence)
    found = np.genfromtxt(tmp_path / "figure2.csv", delimiter=",", skip_header=1, usecols=range(1, 7))
    assert found == pytest.approx(
        np.array(
            [
                [0.224228, 0.220000, 0.000000, -0.422836, 0.000000, 1.065685],
                [0.224228, 0.220693, 0.692821, 0.000000, 0.000000, 1.065685],
            ]
        ),
        abs=1e-6,
    )
    rows = np.genfromtxt(tmp_path / "figure3.csv", delimiter=",", names=True)
    back = rows["back_at_95__of_its_velocity_after_s"]
    assert (np.diff(back) > 0.0).all()  # sooner for smaller tau


def test_a_blocked_run_is_endless_in_the_median():
    out, blocked = np.array([1.0, 4.0]), np.array([1.0, np.nan])
    assert median_last(np.array([out, out, blocked])) == 4.0
    assert median_last(np.array([out, blocked, blocked])) == np.inf
