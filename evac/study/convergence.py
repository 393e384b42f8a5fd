"""Convergence measures of Ronchi, Reneke and Peacock: the change of averages by one more run.

The curve of a run consists of the times at which the first, second, ... person leaves; the average curve of j runs is
the mean of their curves. The measures compare the averages of j and of j - 1 runs. They decrease with the number of
runs even if the averages are far from the expected values, so they do not measure uncertainty; the intervals of
`evac.study.statistics` do.

References
----------
Ronchi, Reneke and Peacock: A method for the analysis of behavioural uncertainty in evacuation modelling. Fire
Technology 50 (2014) 1545-1571. The measures of curves are those of Peacock et al., Fire Safety Journal 33 (1999).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray

#: A study has settled if the measures are below these bounds for `CONSECUTIVE` runs in a row; our choice.
BOUNDS = {"TET": 0.01, "SD": 0.05, "ERD": 0.01, "EPC": 0.01, "SC": 0.01}
CONSECUTIVE = 10

#: Distance between the points of a curve joined by a secant, as a share of the people.
SECANT = 0.05


def convergence(curves: Iterable[FloatArray]) -> list[dict[str, Any]]:
    """Return the measures after 2, 3, ... complete runs.

    Parameters
    ----------
    curves : iterable of (people,) float64 [s]
        Ascending exit times of each complete run; only one curve at a time is kept in memory. The number of people can
        differ between runs to which they come at a rate: then a curve has as many points as the first one.
    """
    rows: list[dict[str, Any]] = []
    times: list[float] = []
    total = average = None
    before: tuple[float, float, float] | None = None
    deviation_before = 0.0
    for curve in curves:
        times.append(float(curve[-1]))
        if total is not None and len(curve) != len(total):
            curve = np.interp(np.linspace(0.0, 1.0, len(total)), np.linspace(0.0, 1.0, len(curve)), curve)
        total = curve.astype(np.float64) if total is None else total + curve
        j = len(times)
        new = total / j
        if j > 1 and average is not None:
            deviation = float(np.std(times, ddof=1))
            measures = compared(new, average)
            mean, mean_before = float(np.mean(times)), float(np.mean(times[:-1]))
            row: dict[str, Any] = {"runs": j, "TET": abs(mean - mean_before) / mean}
            row["SD"] = abs(deviation - deviation_before) / deviation if j > 2 and deviation else None
            for k, name in enumerate(("ERD", "EPC", "SC")):
                row[name] = abs(measures[k] - before[k]) if before is not None else None
            rows.append(row)
            before, deviation_before = measures, deviation
        average = new
    return rows


def compared(curve: FloatArray, other: FloatArray) -> tuple[float, float, float]:
    """Return Euclidean relative difference, Euclidean projection coefficient and secant cosine of two curves.

    With x and y the curves: ``|x - y| / |y|``, ``x . y / |y|^2``, and the cosine of the angle between the vectors of
    the secants ``x[i + s] - x[i]`` and ``y[i + s] - y[i]``. For equal curves they are 0, 1 and 1.
    """
    size = float(np.linalg.norm(other))
    s = max(1, round(SECANT * len(curve)))
    one, two = curve[s:] - curve[:-s], other[s:] - other[:-s]
    norms = float(np.linalg.norm(one) * np.linalg.norm(two))
    cosine = float(one @ two) / norms if norms else 1.0
    if not size:
        return 0.0, 1.0, cosine
    return float(np.linalg.norm(curve - other)) / size, float(curve @ other) / size**2, cosine


def settled(rows: Sequence[Mapping[str, Any]]) -> dict[str, int | None]:
    """Return, by measure, the number of runs at which it was below its bound `CONSECUTIVE` times in a row."""
    runs_by_name: dict[str, int | None] = {}
    for name, bound in BOUNDS.items():
        runs_by_name[name], streak = None, 0
        for row in rows:
            streak = streak + 1 if row[name] is not None and row[name] < bound else 0
            if streak == CONSECUTIVE:
                runs_by_name[name] = row["runs"]
                break
    return runs_by_name
