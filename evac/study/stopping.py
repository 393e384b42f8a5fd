"""Stopping rules of a study: a fixed number of runs, or an interval that is narrow enough.

A rule that computes the interval after every run and stops as soon as it is narrow stops when it is narrow by chance,
so that the interval covers the true value too rarely. The rule here computes the interval only a few times. Each time
it estimates the required number of runs from the width of the interval, which decreases with the square root of that
number, and requests these runs, at least half as many again as there are. It stops as well if no further runs can make
the interval finite, because too many are blocked. The confidence level of the interval is
96 %, so that it covers the true value in 94 to 96 % of stopped studies (measured in docs/evidence/certainty).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import ScenarioError
from evac.base.parameters import check_types
from evac.study.statistics import CONFIDENCE, Estimate, estimate, least_runs, percentile_of

#: Number of runs before the interval is first computed, unless a percentile needs more; and the greatest number.
LEAST_RUNS = 20
MOST_RUNS = 1000

#: Greatest number of runs of a study, and of its points together; each takes some memory until the end.
MOST_OF_STUDY = 1_000_000

GROWTH = 1.5  #: Least factor by which the number of runs grows from one computation of the interval to the next.

#: Confidence level of the intervals in this rule, higher to compensate for computing them several times.
STOPPED_CONFIDENCE = 0.96


@dataclass(frozen=True)
class Rule:
    """The number of runs of a point."""

    least: int
    most: int
    until: float | None = None
    statistic: str = "mean"
    repetitions: int = 1

    @property
    def confidence(self) -> float:
        """Confidence level of the intervals, for a coverage of 95 % of studies."""
        return CONFIDENCE if self.until is None else STOPPED_CONFIDENCE

    @property
    def first(self) -> int:
        """Number of runs before the interval is first computed."""
        return self._rounded(self.least)

    def estimate(self, times: FloatArray, populations: Sequence[int]) -> Estimate:
        """Return the statistic on which the rule is based."""
        return estimate(self.statistic, times, populations, self.confidence)

    def is_known(self, times: FloatArray, populations: Sequence[int]) -> bool:
        """Return whether the interval is narrow enough; always true for a fixed number of runs."""
        return self.until is None or self.estimate(times, populations).relative_half_width <= self.until

    def is_open(self, times: FloatArray, populations: Sequence[int]) -> bool:
        """Return whether more runs can make the interval finite.

        They cannot if all runs so far failed or, for the mean, are blocked; if blocked runs are so frequent that even
        the lower bound of a percentile is infinite; and if the upper bound would be infinite after all further runs,
        even if none of them was blocked.
        """
        if percentile_of(self.statistic) is None or not np.isfinite(times).any():
            return bool(np.isfinite(times).any())
        further = np.arange(max(self.most - len(times), 0))
        names = np.append(populations[: len(times)], populations[len(times) - 1] + 1 + further // self.repetitions)
        best = self.estimate(np.append(times, np.full(len(further), np.nanmin(times))), names.tolist())
        return math.isfinite(best.relative_half_width) and not math.isinf(self.estimate(times, populations).low)

    def wanted(self, times: FloatArray, populations: Sequence[int]) -> int:
        """Return the number of runs at which the interval is computed next; that of the times (runs,) [s] to stop."""
        runs = len(times)
        if self.until is None or runs >= self.most:
            return runs
        width = self.estimate(times, populations).relative_half_width
        if width <= self.until or not (math.isfinite(width) or self.is_open(times, populations)):
            return runs
        needed = runs * (width / self.until) ** 2 if math.isfinite(width) else 0.0
        return self._rounded(min(self.most, max(GROWTH * runs, needed)))

    def _rounded(self, runs: float) -> int:
        return math.ceil(runs / self.repetitions - 1e-9) * self.repetitions


def rule_of(
    runs: int | None = None,
    until: float | None = None,
    statistic: str = "mean",
    least: int | None = None,
    most: int | None = None,
    repetitions: int = 1,
) -> Rule:
    """Return the rule of a fixed number of runs, or with `until` of a narrow interval; see `evac.repeat`."""
    check_types(runs=(runs, Integral | None), until=(until, Real | None), statistic=(statistic, str))
    check_types(least=(least, Integral | None), most=(most, Integral | None), repetitions=(repetitions, Integral))
    if until is None:
        if least is not None or most is not None:
            raise ScenarioError("least and most can be used only with until; give runs instead, or add until")
        runs = LEAST_RUNS if runs is None else runs
        _check(runs=runs, repetitions=repetitions)
        if runs % repetitions:
            whole = math.ceil(runs / repetitions) * repetitions
            raise ScenarioError(f"runs: {runs} is not a multiple of the {repetitions} repetitions; use {whole}")
        return Rule(runs, runs, repetitions=repetitions)
    if runs is not None:
        raise ScenarioError("runs cannot be used with until; bound the number of runs with least and most")
    if not 0.0 < until < 1.0:
        raise ScenarioError(f"until must be a share between 0 and 1, such as 0.02 (2 %), not {until:g}")
    of = percentile_of(statistic)
    smallest = LEAST_RUNS if of is None else max(LEAST_RUNS, math.ceil(1.1 * least_runs(of)))
    least = smallest if least is None else least
    most = max(MOST_RUNS, least) if most is None else most
    _check(least=least, most=most, repetitions=repetitions)
    if most < least:
        raise ScenarioError(f"most = {most} is less than least = {least}; increase it")
    return Rule(least, most, until, statistic, repetitions)


def _check(**counts: int) -> None:
    for name, count in counts.items():
        if not 1 <= count <= MOST_OF_STUDY:
            raise ScenarioError(f"{name} must be from 1 to {MOST_OF_STUDY}, not {count}")
