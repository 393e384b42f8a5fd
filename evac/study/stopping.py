"""When a study has enough runs: a number of them, or an interval that is narrow enough.

Whoever looks at an interval after every run, and stops as soon as it is narrow, stops where it is narrow by chance, and
it covers the truth too seldom. Here a study looks a few times only. At each look it computes how many runs the interval
needs to become narrow enough, by its present width and the square root of the number of runs, makes these, at least
half as many again as it has, and looks again. The interval in the end is one of 96 %, so that it covers in 94 to 96 %
of stopped studies; docs/evidence/certainty has the measurement.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from evac.arrays import FloatArray
from evac.errors import ScenarioError
from evac.study.statistics import CONFIDENCE, Estimate, estimate, least_runs, percentile_of

#: Runs before the first look, where a percentile does not need more, and the most runs.
LEAST_RUNS = 20
MOST_RUNS = 1000

#: From one look to the next the number of runs grows by this factor at least.
GROWTH = 1.5

#: Of the intervals of a stopped study: what looking more than once takes away is put on before.
STOPPED_CONFIDENCE = 0.96


@dataclass(frozen=True)
class Rule:
    """How many runs a point gets.

    Parameters
    ----------
    least, most : int
        Runs; the same where their number is fixed.
    until : float or None
        Half the width of the interval over the statistic that is narrow enough; None for a fixed number.
    statistic : str
        See `evac.study.statistics.estimate`.
    repetitions : int
        Numbers of runs are multiples of it.
    """

    least: int
    most: int
    until: float | None = None
    statistic: str = "mean"
    repetitions: int = 1

    @property
    def confidence(self) -> float:
        """That of the intervals, so that they cover in 95 % of studies."""
        return CONFIDENCE if self.until is None else STOPPED_CONFIDENCE

    @property
    def first(self) -> int:
        """Runs before the first look."""
        return self._rounded(self.least)

    def estimate(self, times: FloatArray, populations: Sequence[int]) -> Estimate:
        """Return the statistic that decides."""
        return estimate(self.statistic, times, populations, self.confidence)

    def is_known(self, times: FloatArray, populations: Sequence[int]) -> bool:
        """Return whether the interval is narrow enough; of a fixed number of runs nothing is asked."""
        return self.until is None or self.estimate(times, populations).relative_half_width <= self.until

    def wanted(self, times: FloatArray, populations: Sequence[int]) -> int:
        """Return the number of runs of the next look; that of `times` where there is none.

        Parameters
        ----------
        times : (runs,) float64 [s]
            Of the runs 0, 1, ... at this look.
        populations : sequence of int
            Which population each is of.
        """
        runs = len(times)
        if self.until is None or runs >= self.most:
            return runs
        width = self.estimate(times, populations).relative_half_width
        if width <= self.until:
            return runs
        needed = runs * (width / self.until) ** 2 if math.isfinite(width) else 0.0
        return self._rounded(min(self.most, max(GROWTH * runs, needed)))

    def _rounded(self, runs: float) -> int:
        return math.ceil(runs / self.repetitions - 1e-9) * self.repetitions


def fixed(runs: int, repetitions: int = 1) -> Rule:
    """Return the rule of a fixed number of runs.

    Raises
    ------
    ScenarioError
        There are none.
    """
    _check(runs=runs, repetitions=repetitions)
    return Rule(runs, runs, repetitions=repetitions)


def until_known(
    until: float,
    statistic: str = "mean",
    least: int | None = None,
    most: int | None = None,
    repetitions: int = 1,
) -> Rule:
    """Return the rule that stops when a statistic is known to a share of itself.

    Raises
    ------
    ScenarioError
        A number is out of range, or there is no such statistic.
    """
    if not 0.0 < until < 1.0:
        raise ScenarioError(f"until must be a share between 0 and 1, such as 0.02 (2%), not {until:g}")
    of = percentile_of(statistic)
    smallest = LEAST_RUNS if of is None else max(LEAST_RUNS, math.ceil(1.1 * least_runs(of)))
    least = smallest if least is None else least
    most = max(MOST_RUNS, least) if most is None else most
    _check(least=least, most=most, repetitions=repetitions)
    if most < least:
        raise ScenarioError(f"most = {most} runs are fewer than least = {least}; make it greater")
    return Rule(least, most, until, statistic, repetitions)


def _check(**counts: int) -> None:
    for name, count in counts.items():
        if count < 1:
            raise ScenarioError(f"{name} must be at least 1, not {count}")
