"""The picture of a study of several points: the evacuation time over a parameter."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from evac.base.arrays import FloatArray
from evac.pictures.pictures import new_plain_axes

#: Maximum number of lines that a legend names.
MOST_LINES = 12


def points_figure(
    title: str, parameters: Sequence[Mapping[str, Any]], middle: FloatArray, greatest: FloatArray, note: str
) -> Figure:
    """Return a figure of a statistic with its interval, and of a high percentile, over the last numeric parameter.

    Parameters
    ----------
    title : str
    parameters : sequence of mapping
        Values of the parameters at each point, by key.
    middle : (points, 3) float64 [s]
        Value of the statistic and bounds of its interval.
    greatest : (points,) float64 [s]
        The percentile.
    note : str
        What is drawn.
    """
    keys = list(dict.fromkeys(key for of_point in parameters for key in of_point))
    values = {key: [of_point.get(key) for of_point in parameters] for key in keys}
    numeric = [key for key in keys if all(map(_is_number, values[key])) and len(set(values[key])) > 1]
    along = numeric[-1] if numeric else None
    place = np.array(values[along] if along else range(len(parameters)), dtype=np.float64)
    figure, axes = new_plain_axes(title, along or "point", "evacuation time [s]", 0.6)
    lines: dict[str, list[int]] = {}
    for k, of_point in enumerate(parameters):
        name = ", ".join(f"{key} = {of_point.get(key)}" for key in keys if key != along) if along else ""
        lines.setdefault(name, []).append(k)
    middle, greatest = (np.where(np.isfinite(found), found, np.nan) for found in (middle, greatest))  # NaN leaves a gap
    for number, (name, members) in enumerate(lines.items()):
        rows = np.array(members)[np.argsort(place[members], kind="stable")]
        value, low, high = middle[rows].T
        bars = np.nan_to_num(np.abs([value - low, high - value]))
        colour = f"C{number % 10}"
        line = "o-" if along else "o"
        axes.errorbar(place[rows], value, bars, fmt=line, color=colour, capsize=3, label=name or None)
        axes.plot(place[rows], greatest[rows], "^", color=colour, markerfacecolor="none")
    if not along:
        labels = [", ".join(f"{key} = {value}" for key, value in of_point.items()) for of_point in parameters]
        axes.set_xticks(
            range(len(labels)), [textwrap.fill(label, 24) for label in labels], fontsize=7, rotation=30, ha="right"
        )
    axes.text(0.0, 1.01, note, transform=axes.transAxes, fontsize=8, color="#52606d")
    if any(lines) and len(lines) <= MOST_LINES:
        axes.legend(frameon=False, fontsize=8)
    return figure


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
