"""Statistics of the evacuation time over the runs of a study, with confidence intervals.

The evacuation time of a run is the time at which the last person leaves. It is infinite for a blocked run, in which
people are left inside, and NaN for a run that failed, which is not part of any statistic. Since the mean over all runs
would be infinite too, the mean of the complete runs and the share of blocked runs are given; a percentile is infinite
if too many runs are blocked. Where few runs decide the mean, it has no interval, and the median is to be preferred.

`variation` belongs to the scheme of the IMO, MSC.1/Circ.1533 (2016), annex 3, appendix 1, section 5: at least 500
simulations of a case, of 100 or more randomly generated populations, each repeated 5 times or more; the time to report
is higher than 95 % of all calculated times. If the repetitions vary little, 500 populations with one simulation each
may be used instead. In a repetition the same people (radius, height, mass, tau, speeds) start at other positions and
make other random decisions.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import ScenarioError, counted

CONFIDENCE = 0.95  #: Confidence level of the intervals.
PERCENTILES = (5.0, 50.0, 95.0)  #: Percentiles of the evacuation time in tables and summaries.

#: Number of resamples of a bootstrap, and their seed, which is fixed so that intervals depend only on the times.
RESAMPLES = 2000
BOOTSTRAP_SEED = 1533

LEAST_FOR_BOOTSTRAP = 8  #: Least number of values for a bootstrap; fewer values have too few distinct resamples.

#: Fewer values than that determine no interval of their mean if it reaches beyond 1 / WIDEST and WIDEST times the mean.
WIDEST = 2.0

SKEWED = 2.0  #: Skewness of complete runs above which the median is recommended instead of the mean.

MEDIAN = "percentile 50"

IMO_POPULATIONS, IMO_REPETITIONS = 100, 5  #: The scheme of the IMO.


@dataclass(frozen=True)
class Estimate:
    """A statistic of the evacuation time and its interval."""

    name: str  # "mean", or "percentile 95" for example
    value: float  # value and bounds of the interval [s]; infinite because of blocked runs, or NaN if undefined
    low: float
    high: float
    runs: int  # in the statistic
    note: str = ""  # why there is no interval, or the effect of blocked, long or few runs; often empty

    @property
    def text(self) -> str:
        """The value in words."""
        return time_text(self.value)

    def bounds(self, form: str = ".2f") -> str:
        """Return the interval in words, with bounds in a format; "open" where the runs do not determine it."""
        if math.isnan(self.low) and math.isnan(self.high):
            return ""
        low = "open" if math.isnan(self.low) else time_text(self.low, form)
        return f"{low} to {time_text(self.high, form) if math.isfinite(self.high) else 'open'}"

    def words(self, form: str = ".2f") -> str:
        """Return the value with its interval, in a format."""
        value, bounds = time_text(self.value, form), self.bounds(form)
        return f"{value} ({bounds})" if bounds else value

    def row(self, over: str) -> tuple[str, str, str, str]:
        """Return the name, value and interval in words, and over what, with the note."""
        return self.name, self.text, self.bounds(), f"{over}; {self.note}".removesuffix("; ")

    @property
    def has_interval(self) -> bool:
        """Whether both bounds are determined; they may be infinite."""
        return not (math.isnan(self.low) or math.isnan(self.high))

    @property
    def relative_half_width(self) -> float:
        """Half the width of the interval divided by the value; infinite if either is not finite."""
        half = 0.5 * (self.high - self.low)
        return half / self.value if math.isfinite(half) and math.isfinite(self.value) and self.value else math.inf


def time_text(value: float, form: str = ".2f") -> str:
    """Return a time [s] in a format; empty if undefined, and "not reached" if infinite."""
    return "" if math.isnan(value) else f"{value:{form}}" if math.isfinite(value) else "not reached"


@dataclass(frozen=True)
class Statistics:
    """Statistics of the runs of a point."""

    runs: int  # that did not fail
    blocked: int  # runs in which people are left inside
    failed: int
    blocked_share: float  # its exact interval is that of Clopper and Pearson
    blocked_low: float
    blocked_high: float
    least: float  # evacuation times [s]; the standard deviation is that of the complete runs, NaN for fewer than two
    greatest: float
    standard_deviation: float
    mean: Estimate  # of the complete runs
    percentiles: tuple[Estimate, ...]  # of all runs

    def __getitem__(self, name: str) -> Estimate:
        """Return the mean or a percentile by its name."""
        return next(estimate for estimate in (self.mean, *self.percentiles) if estimate.name == name)

    def as_row(self) -> dict[str, Any]:
        """Return the values as one flat row, including NaN and infinity."""
        row = {key: value for key, value in asdict(self).items() if key not in ("mean", "percentiles")}
        for estimate in (self.mean, *self.percentiles):
            name = estimate.name.replace(" ", "_")
            row |= {name: estimate.value, f"{name}_from": estimate.low, f"{name}_to": estimate.high}
        return row


def statistics(
    times: FloatArray, populations: Sequence[int] | None = None, confidence: float = CONFIDENCE
) -> Statistics:
    """Return the statistics of evacuation times (runs,) [s], infinite if people are left, NaN for failed runs.

    Runs with the same people are correlated: if there are fewer `populations`, given by their numbers, than runs, all
    intervals are those of a sample of populations.
    """
    failed = int(np.isnan(times).sum())
    ended = times[~np.isnan(times)]
    runs, complete, blocked = len(ended), ended[np.isfinite(ended)], int(np.isinf(ended).sum())
    low, high = share_interval(blocked, runs)
    return Statistics(
        runs=runs,
        blocked=blocked,
        failed=failed,
        blocked_share=blocked / runs if runs else math.nan,
        blocked_low=low,
        blocked_high=high,
        least=float(ended.min()) if runs else math.nan,
        greatest=float(ended.max()) if runs else math.nan,
        standard_deviation=float(complete.std(ddof=1)) if len(complete) > 1 else math.nan,
        mean=estimate("mean", times, populations, confidence),
        percentiles=tuple(estimate(percentile_name(of), times, populations, confidence) for of in PERCENTILES),
    )


def estimate(
    name: str, times: FloatArray, populations: Sequence[int] | None = None, confidence: float = CONFIDENCE
) -> Estimate:
    """Return one statistic with its interval."""
    of = percentile_of(name)
    has_ended = ~np.isnan(times)
    groups = None if populations is None else np.asarray(populations[: len(times)])[has_ended]
    if groups is not None and len(np.unique(groups)) == len(groups):
        groups = None
    times = times[has_ended]
    if not len(times):
        return Estimate(name, math.nan, math.nan, math.nan, 0)
    return _mean(times, groups, confidence) if of is None else _percentile(of, times, groups, confidence)


def percentile_name(of: float) -> str:
    """Return the name of a percentile, such as ``"percentile 95"``."""
    return f"percentile {of:g}"


def percentile_of(name: str) -> float | None:
    """Return the percentile of a statistic's name, None for the mean."""
    if name == "mean":
        return None
    word, _, number = name.partition(" ")
    try:
        of = float(number)
    except ValueError:
        of = math.nan
    if word != "percentile" or not 0.0 < of < 100.0:
        raise ScenarioError(f"unknown statistic {name!r}; use 'mean', or 'percentile 95' for example")
    return of


def percentile(times: FloatArray, of: float) -> float:
    """Return a percentile of times, some of which may be infinite, with linear interpolation as `numpy.percentile`.

    It is infinite if one of the two interpolated values is.
    """
    ascending = np.sort(times)
    place = 0.01 * of * (len(ascending) - 1)
    return _between(ascending[math.floor(place)], ascending[math.ceil(place)], place - math.floor(place))


def percentile_interval(times: FloatArray, of: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the distribution-free interval [s] of a percentile from order statistics; NaN for a bound of too few runs.

    Each side misses the percentile with a probability of (1 - confidence) / 2, by the binomial distribution of the
    number of times below it; the bound is interpolated between order statistics, since the interval would otherwise be
    wider than necessary (Nyblom: Note on interpolated order statistics. Statistics and Probability Letters 14 (1992)
    129-131).
    """
    ascending = np.sort(times)
    low = -_upper(-ascending[::-1], 1.0 - 0.01 * of, confidence)
    return low, _upper(ascending, 0.01 * of, confidence)


def least_runs(of: float) -> int:
    """Return the least number of runs at which the extreme times bound a percentile with the required confidence."""
    share = max(0.01 * of, 1.0 - 0.01 * of)
    return math.ceil(math.log(0.5 * (1.0 - CONFIDENCE)) / math.log(share) - 1e-9)


def deciding(values: FloatArray, interval: tuple[float, float]) -> int:
    """Return the number of two or more values (n,) that decide their mean, so that its interval has no meaning, or 0.

    If resamples without the few extreme values are frequent, the bootstrap extends the interval beyond all values,
    where no mean of so many values lies, so that no sample could contradict it. The interval of fewer than
    `LEAST_FOR_BOOTSTRAP` values may extend beyond them, but only by the factor `WIDEST` from their mean.
    """
    mean = float(values.mean())
    least, greatest = mean / WIDEST, mean * WIDEST
    if len(values) >= LEAST_FOR_BOOTSTRAP:
        least, greatest = float(values.min()), float(values.max())
    rounding = 1e-9 * mean
    if least - rounding <= interval[0] and interval[1] <= greatest + rounding:
        return 0
    farthest = np.argsort(-np.abs(values - np.median(values)), kind="stable")
    squares = np.cumsum((values[farthest] - mean) ** 2)
    return int(np.searchsorted(squares, 0.5 * squares[-1])) + 1


def share_interval(count: int, total: int) -> tuple[float, float]:
    """Return the exact interval of a share after `count` of `total` trials (Clopper and Pearson, 1934)."""
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(betaincinv(count, total - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return low, high


def grouped_interval(
    times: FloatArray, of: float, groups: NDArray[Any], confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Return the interval of a percentile of runs of which those of the same group are correlated.

    One run of each group is a sample of independent values, for which `percentile_interval` holds. The bounds are
    the medians of those that the first, the second, ... run of each group gives; there are as many as every group has.
    They cover more often than required where runs of a group differ as much as others.
    """
    members = [times[groups == name] for name in np.unique(groups)]
    samples = [np.array([runs[k] for runs in members]) for k in range(min(map(len, members)))]
    low, high = np.median([percentile_interval(sample, of, confidence) for sample in samples], axis=0)
    return float(low), float(high)


def mean_interval(values: FloatArray, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the interval of the mean of two or more positive values.

    For `LEAST_FOR_BOOTSTRAP` or more values it is that of the studentised bootstrap: the mean minus quantiles of
    (m* - m) / s* over resamples, times s, with s the standard error. For samples as skewed as evacuation times it
    covers the mean in 94 to 95 % of studies, while the percentile and BCa bootstraps of ten values cover it in 90 %
    (docs/evidence/certainty). For fewer values it is that of a log-normal mean, from m / c to m c with
    c = exp(t sqrt(ln(1 + s^2 / m^2))) and t the quantile of Student's t distribution.

    References
    ----------
    Efron and Tibshirani: An Introduction to the Bootstrap. Chapman and Hall (1993), section 12.5.
    Buckland et al.: Introduction to Distance Sampling. Oxford University Press (2001), chapter 3, with t for z.
    """
    n, mean = len(values), float(values.mean())
    error = float(values.std(ddof=1)) / math.sqrt(n)
    if error <= 1e-12 * mean:  # all values are equal
        return mean, mean
    if n < LEAST_FOR_BOOTSTRAP:
        factor = math.exp(_student(n, confidence) * math.sqrt(math.log1p((error / mean) ** 2)))
        return mean / factor, mean * factor
    return _studentised(values, confidence)


def difference(
    before: FloatArray, after: FloatArray, populations: Sequence[int] | None = None, confidence: float = CONFIDENCE
) -> Estimate:
    """Return the mean difference ``after - before`` of pairs of complete runs (runs,) [s] with the same seeds.

    Its interval is that of the studentised bootstrap, for fewer than `LEAST_FOR_BOOTSTRAP` pairs Student's. As for a
    mean, there is none where few pairs decide it.
    """
    is_pair = np.isfinite(before) & np.isfinite(after)
    change = after[is_pair] - before[is_pair]
    left_out = len(is_pair) - len(change)
    notes = [f"without {counted(left_out, 'pair')} in which a run is blocked or failed"] if left_out else []
    if not len(change):
        return Estimate("difference", math.nan, math.nan, math.nan, 0, "; ".join(notes))
    sample, values = change, "pair"
    if populations is not None and len(np.unique(populations)) < len(is_pair):
        groups = np.asarray(populations)[is_pair]
        sample, values = np.array([change[groups == name].mean() for name in np.unique(groups)]), "population"
    low = high = math.nan
    if len(sample) == 1:
        notes.append(f"no interval for one {values}")
    elif np.ptp(sample) == 0.0:
        low = high = float(sample[0])
    elif len(sample) < LEAST_FOR_BOOTSTRAP:
        half = _student(len(sample), confidence) * float(sample.std(ddof=1)) / math.sqrt(len(sample))
        low, high = float(sample.mean()) - half, float(sample.mean()) + half
    else:
        low, high = _studentised(sample, confidence)
        if low < sample.min() or high > sample.max():
            low = high = math.nan
            notes.append(f"no interval, because few of {len(sample)} {values}s decide it")
    return Estimate("difference", float(change.mean()), low, high, len(change), "; ".join(notes))


def _studentised(values: FloatArray, confidence: float) -> tuple[float, float]:
    """Return the interval of the mean of values that are not all equal by the studentised bootstrap."""
    n, mean = len(values), float(values.mean())
    error, tail = float(values.std(ddof=1)) / math.sqrt(n), 0.5 * (1.0 - confidence)
    samples = values[_resamples(n)]
    errors = samples.std(axis=1, ddof=1) / math.sqrt(n)
    spread = errors > 1e-9 * error
    low, high = np.quantile((samples.mean(axis=1)[spread] - mean) / errors[spread], [tail, 1.0 - tail])
    return mean - float(high) * error, mean - float(low) * error


def _student(n: int, confidence: float) -> float:
    """Return the quantile of Student's t distribution for both bounds of a mean of n values."""
    from scipy.special import stdtrit

    return float(stdtrit(n - 1, 0.5 + 0.5 * confidence))


def _percentile(of: float, times: FloatArray, groups: NDArray[Any] | None, confidence: float) -> Estimate:
    """Return a percentile; with repetitions, its interval is that of a sample of populations."""
    value = percentile(times, of)
    notes, sample = [], "runs"
    if groups is None:
        low, high = percentile_interval(times, of, confidence)
    else:
        low, high = grouped_interval(times, of, groups, confidence)
        sample = "populations"
        notes.append(_populations_note(groups))
    if math.isnan(high) and math.isnan(low):
        notes.append(f"no {100 * CONFIDENCE:.0f} % interval below {least_runs(of)} {sample}")
    elif math.isnan(high) or math.isnan(low):
        side = "upper" if math.isnan(high) else "lower"
        notes.append(f"the {side} bound is open below {least_runs(of)} {sample}")
    if math.isinf(value):
        notes.append(f"not reached: {_blocked_note(times)}")
    elif math.isinf(high):
        notes.append(f"the interval is open: {_blocked_note(times)}")
    return Estimate(percentile_name(of), value, low, high, len(times), "; ".join(notes))


def _mean(times: FloatArray, groups: NDArray[Any] | None, confidence: float) -> Estimate:
    """Return the mean of the complete runs; with repetitions, its interval is that of a sample of populations."""
    is_complete = np.isfinite(times)
    complete = times[is_complete]
    doubts = [] if is_complete.all() else [_blocked_note(times)]
    if not len(complete):
        return Estimate("mean", math.nan, math.nan, math.nan, 0, "; ".join(doubts))
    sample, values, notes = complete, "run", []
    if groups is not None:
        groups = groups[is_complete]
        sample, values = np.array([complete[groups == name].mean() for name in np.unique(groups)]), "population"
        notes.append(_populations_note(groups))
    low = high = math.nan
    if len(sample) == 1:
        notes.append(f"no interval for one {values}")
    else:
        low, high = mean_interval(sample, confidence)
        if few := deciding(sample, (low, high)):
            low = high = math.nan
            verb = "decides" if few == 1 else "decide"
            doubts.append(f"no interval, because {counted(few, values)} of {len(sample)} {verb} it")
        elif (spread := sample.std()) and ((sample - sample.mean()) ** 3).mean() / spread**3 > SKEWED:
            doubts.append(f"skewed by long {values}s")
    if doubts and len(times) >= least_runs(50.0) and math.isfinite(percentile(times, 50.0)):
        doubts.append(f"prefer {MEDIAN}")
    return Estimate("mean", float(complete.mean()), low, high, len(complete), "; ".join([*notes, *doubts]))


def _blocked_note(times: FloatArray) -> str:
    blocked = int(np.isinf(times).sum())
    return f"{blocked} of {counted(len(times), 'run')} {'is' if blocked == 1 else 'are'} blocked"


def _populations_note(groups: NDArray[Any]) -> str:
    return f"interval from {len(np.unique(groups))} populations"


@lru_cache(maxsize=8)
def _resamples(n: int) -> NDArray[np.int64]:
    """Return the indices (RESAMPLES, n) of resamples of n values, always the same for the same n."""
    return np.random.default_rng(BOOTSTRAP_SEED).integers(n, size=(RESAMPLES, n))


def _upper(ascending: FloatArray, share: float, confidence: float = CONFIDENCE) -> float:
    """Return the upper bound of the quantile `share`, which it exceeds with a probability of (1 - confidence) / 2."""
    n, wanted = len(ascending), 0.5 * (1.0 + confidence)
    exceeds = _exceeding(n, share)  # probability that X(r), r = 1, ..., n, exceeds the quantile
    rank = int(np.searchsorted(exceeds, wanted, side="right")) - 1
    if exceeds[-1] < wanted:
        return math.nan
    if rank in (0, n):
        return float(ascending[max(rank - 1, 0)])
    below, above = wanted - exceeds[rank], exceeds[rank + 1] - wanted
    odds = rank * (1.0 - share) * above / ((n - rank) * share * below) if below > 0.0 else math.inf
    return _between(ascending[rank - 1], ascending[rank], 1.0 / (1.0 + odds))


@lru_cache(maxsize=256)
def _exceeding(n: int, share: float) -> FloatArray:
    """Return the probabilities (n + 1,) that the value of rank r exceeds a quantile: fewer than r values are below."""
    from scipy.special import bdtr

    return np.concatenate([[0.0], bdtr(np.arange(n, dtype=np.float64), n, share)])


def _between(lower: float, upper: float, share: float) -> float:
    """Interpolate linearly between two values, of which the upper or both may be infinite."""
    if share == 0.0 or lower == upper:
        return float(lower)
    return (
        float(lower + share * (upper - lower))
        if math.isfinite(lower) and math.isfinite(upper)
        else float(upper if math.isinf(upper) else lower)
    )


@dataclass(frozen=True)
class Variation:
    """Variation of the evacuation time between and within populations."""

    # least calculated time that is higher than 95 % of all calculated times [s]; infinite for a blocked run
    reported: float
    # standard deviations [s] by one-way analysis of variance over the complete runs; NaN if there are too few
    between: float
    within: float


def variation(times: FloatArray, populations: Sequence[int]) -> Variation:
    """Return what the scheme of the IMO requires, for times (runs,) [s] and the number of the population of each."""
    ascending = np.sort(times)
    reported = float(ascending[min(math.floor(0.95 * len(times)), len(times) - 1)])
    names = np.asarray(populations)
    groups = [times[(names == name) & np.isfinite(times)] for name in np.unique(names)]
    groups = [group for group in groups if len(group)]
    count = sum(map(len, groups))
    if len(groups) < 2 or count <= len(groups):
        return Variation(reported, math.nan, math.nan)
    mean = float(np.concatenate(groups).mean())
    free_between, free_within = len(groups) - 1, count - len(groups)
    square_between = sum(len(group) * (float(group.mean()) - mean) ** 2 for group in groups) / free_between
    square_within = sum(float(((group - group.mean()) ** 2).sum()) for group in groups) / free_within
    size = (count - sum(len(group) ** 2 for group in groups) / count) / free_between
    between = math.sqrt(max(0.0, (square_between - square_within) / size))
    return Variation(reported, between, math.sqrt(square_within))
