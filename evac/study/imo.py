"""Populations times repetitions: the scheme of the IMO's guidelines for passenger ships.

MSC.1/Circ.1533 (2016), annex 3, appendix 1, section 5, requires at least 500 simulations of a case: at least 100
randomly generated populations, each repeated at least 5 times; the time to report is higher than 95 % of all
calculated times. If the repetitions vary little, 500 populations with one simulation each may be used instead. In a
repetition the same people (radius, height, mass, tau, speeds) start at other positions and make other random decisions.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evac.base.arrays import FloatArray

POPULATIONS = 100
REPETITIONS = 5


@dataclass(frozen=True)
class Variation:
    """Variation of the evacuation time between and within populations.

    Attributes
    ----------
    reported : float
        Least calculated time that is higher than 95 % of all calculated times [s]; infinite for a blocked run.
    between, within : float
        Standard deviations [s] by one-way analysis of variance over the complete runs; NaN if there are too few.
    probability : float
        p value of the F test: probability of such an F or a greater one if the populations do not differ.
    """

    reported: float
    between: float
    within: float
    probability: float


def variation(times: FloatArray, populations: Sequence[int]) -> Variation:
    """Return the quantities that the scheme requires.

    Parameters
    ----------
    times : (runs,) float64 [s]
        Evacuation times; infinite if people are left.
    populations : sequence of int
        Number of the population of each run.
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
