"""Coverage of intervals: studies are drawn from many runs and compared with the statistic of all of them."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.distributions import generator_for
from evac.evidence.evidence import Row
from evac.study.statistics import CONFIDENCE, estimate, percentile, percentile_of
from evac.study.stopping import rule_of

Interval = tuple[float, float]

#: Resamples of the bootstraps that are compared with ours.
OTHER_RESAMPLES = 1000


class Drawn(NamedTuple):
    """A number of studies to be drawn: a task of one process."""

    # (runs,) or (populations, repetitions) float64 [s]: evacuation times that studies are drawn from, with replacement;
    # infinite where people are left. Of repetitions, populations are drawn.
    times: FloatArray
    statistic: str
    studies: int
    seed: int
    runs: int = 0  # number of runs, or of populations, of each study, if it is fixed
    until: float | None = None  # relative half-width at which a study stops
    method: str = "ours"  # `"ours"`, or one of `OTHERS`


def truth(times: FloatArray, statistic: str) -> float:
    """Return the statistic of all runs, which intervals should cover."""
    of = percentile_of(statistic)
    return float(times[np.isfinite(times)].mean()) if of is None else percentile(times.ravel(), of)


def covered(task: Drawn) -> Row:
    """Return the coverage of the intervals of studies, the sides on which they miss, and the numbers of runs."""
    wanted = truth(task.times, task.statistic)
    generator = generator_for(task.seed, "certainty", task.statistic, str(task.runs), str(task.until), task.method)
    below = above = none = 0
    runs, widths = [], []
    for _ in range(task.studies):
        low, high, count = _study(task, generator)
        runs.append(count)
        if math.isnan(low) or math.isnan(high):
            none += 1
            continue
        below += wanted < low
        above += wanted > high
        widths.append(0.5 * (high - low) / wanted)
    covering = task.studies - none
    return {
        "no interval [%]": 100.0 * none / task.studies,
        "covers [%]": 100.0 * (covering - below - above) / covering if covering else None,
        "truth below [%]": 100.0 * below / covering if covering else None,
        "truth above [%]": 100.0 * above / covering if covering else None,
        "half width, median [%]": 100.0 * float(np.median(widths)) if widths else None,
        "runs, median": float(np.median(runs)),
        "runs, 5 %": float(np.percentile(runs, 5)),
        "runs, 95 %": float(np.percentile(runs, 95)),
    }


def _study(task: Drawn, generator: np.random.Generator) -> tuple[float, float, int]:
    if task.times.ndim == 2:
        drawn = task.times[generator.integers(len(task.times), size=task.runs)]
        interval = estimate(task.statistic, drawn.ravel(), np.repeat(np.arange(task.runs), drawn.shape[1]).tolist())
        return interval.low, interval.high, task.runs
    if task.until is None:
        times = generator.choice(task.times, task.runs)
        return *_interval(task, times, generator), task.runs
    rule = rule_of(until=task.until, statistic=task.statistic)
    times = generator.choice(task.times, rule.most)
    if task.method != "ours":
        return _plain(task, times, LOOKING_FROM[task.method])
    runs, wanted = 0, rule.first
    while runs < wanted:
        runs = wanted
        wanted = rule.wanted(times[:runs], range(runs))
    interval = rule.estimate(times[:runs], range(runs))
    return interval.low, interval.high, runs


def _plain(task: Drawn, times: FloatArray, least: int) -> tuple[float, float, int]:
    """Compute the interval after every run, and stop when it is narrow enough for the first time."""
    assert task.until is not None
    for runs in range(least, len(times)):
        interval = estimate(task.statistic, times[:runs])
        if interval.relative_half_width <= task.until:
            break
    return interval.low, interval.high, runs


def _interval(task: Drawn, times: FloatArray, generator: np.random.Generator) -> Interval:
    if task.method == "ours":
        interval = estimate(task.statistic, times)
        return interval.low, interval.high
    finite = times[np.isfinite(times)]
    return OTHERS[task.method](finite if task.statistic == "mean" else times, task.statistic, generator)


def _student(times: FloatArray, statistic: str, generator: np.random.Generator) -> Interval:
    from scipy.special import stdtrit

    half = float(stdtrit(len(times) - 1, 0.5 + 0.5 * CONFIDENCE)) * float(times.std(ddof=1)) / math.sqrt(len(times))
    return float(times.mean()) - half, float(times.mean()) + half


def _percentile_bootstrap(times: FloatArray, statistic: str, generator: np.random.Generator) -> Interval:
    samples = times[generator.integers(len(times), size=(OTHER_RESAMPLES, len(times)))]
    of = percentile_of(statistic)
    with np.errstate(invalid="ignore"):
        values = samples.mean(axis=1) if of is None else np.percentile(samples, of, axis=1)
    values = np.sort(np.where(np.isnan(values), math.inf, values))
    tail = 50.0 * (1.0 - CONFIDENCE)
    return percentile(values, tail), percentile(values, 100.0 - tail)


def _bca_bootstrap(times: FloatArray, statistic: str, generator: np.random.Generator) -> Interval:
    from scipy.stats import bootstrap

    interval = bootstrap(
        (times,), np.mean, n_resamples=OTHER_RESAMPLES, confidence_level=CONFIDENCE, method="BCa", rng=generator
    ).confidence_interval
    return float(interval.low), float(interval.high)


#: Studies that look after every run, and from how many runs on.
LOOKING_FROM = {"a look after every run from 3 on": 3, "a look after every run from 20 on": 20}

#: Intervals that are compared with ours.
OTHERS: Mapping[str, Callable[[FloatArray, str, np.random.Generator], Interval]] = {
    "Student's t": _student,
    "percentile bootstrap": _percentile_bootstrap,
    "BCa bootstrap": _bca_bootstrap,
}
