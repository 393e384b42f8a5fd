"""Populations times repetitions: the scheme of the IMO's guidelines for passenger ships.

MSC.1/Circ.1533 (2016), annex 3, appendix 1, section 5, asks for at least 500 simulations of a case: at least 100
randomly generated populations, each repeated at least 5 times; the time to report is the one that exceeds 95 % of all
calculated ones. Where the repetitions vary little, 500 populations with one simulation each take their place. In a
repetition the same people (radius, mass, tau, speeds) start from other places and decide anew.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evac.arrays import FloatArray

POPULATIONS = 100
REPETITIONS = 5

#: Significance of the test whether populations differ by more than their repetitions do.
SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class Variation:
    """How much of the variance of the evacuation time is between populations, and how much within.

    Attributes
    ----------
    reported : float
        The time that exceeds 95 % of all calculated ones [s]: the least with that property, infinite where it falls
        among blocked runs.
    between, within : float
        Standard deviations [s] by one-way analysis of variance over the complete runs; NaN where it has too few.
    probability : float
        That populations which do not differ have such an F or a greater one.
    """

    reported: float
    between: float
    within: float
    probability: float


def variation(times: FloatArray, populations: Sequence[int]) -> Variation:
    """Return what the scheme asks of some runs.

    Parameters
    ----------
    times : (runs,) float64 [s]
        Infinite where people are left.
    populations : sequence of int
        Which population each run is of.
    """
    from scipy.special import fdtrc

    ascending = np.sort(times)
    reported = float(ascending[min(math.floor(0.95 * len(times)), len(times) - 1)])
    names = np.asarray(populations)
    groups = [times[(names == name) & np.isfinite(times)] for name in np.unique(names)]
    groups = [group for group in groups if len(group)]
    count = sum(map(len, groups))
    if len(groups) < 2 or count <= len(groups):
        return Variation(reported, math.nan, math.nan, math.nan)
    mean = float(np.concatenate(groups).mean())
    free_between, free_within = len(groups) - 1, count - len(groups)
    square_between = sum(len(group) * (float(group.mean()) - mean) ** 2 for group in groups) / free_between
    square_within = sum(float(((group - group.mean()) ** 2).sum()) for group in groups) / free_within
    size = (count - sum(len(group) ** 2 for group in groups) / count) / free_between
    between = math.sqrt(max(0.0, (square_between - square_within) / size))
    probability = float(fdtrc(free_between, free_within, square_between / square_within)) if square_within else 0.0
    return Variation(reported, between, math.sqrt(square_within), probability)
