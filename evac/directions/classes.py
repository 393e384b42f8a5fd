"""Classes of bodies: two bodies are of different classes if there is a gap that only the narrower one fits through."""

from typing import NamedTuple

import numpy as np

from evac.building.model.building import Building
from evac.building.model.narrow import gaps_between_walls

#: Greatest number of classes; where more would be needed, widths are rounded down further.
MOST_CLASSES = 8

#: Steps to which widths of gaps are rounded down, tried in turn [m], and the rounding error of a width [m].
STEPS, ROUNDING = (1e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5), 1e-6


class BodyClass(NamedTuple):
    """Bodies that fit through the same gaps."""

    width: float  # greatest width of a body of the class below [m]
    barred: float  # gaps narrower than this are walls for the class [m]


def find_classes(building: Building, narrowest: float, widest: float) -> tuple[BodyClass, ...]:
    """Return the classes above that of the narrowest body; none if there is no gap between the two widths [m]."""
    if not narrowest < widest:
        return ()
    links = [link for level in building.levels for link in building.links_of(level.index) if building.is_open(link)]
    gaps = [gaps_between_walls(building, level, widest) for level in building.levels]
    across = [np.hypot(*(gap[:, 2:] - gap[:, :2]).T) for gap in gaps]
    widths = np.concatenate([*across, [link.width for link in links]])
    widths = np.unique(widths[(narrowest <= widths) & (widths < widest)])
    if not len(widths):
        return ()
    for step in STEPS:
        rounded = np.maximum(step * np.floor((widths + ROUNDING) / step), narrowest)
        fitting, first = np.unique(rounded, return_index=True)
        if len(fitting) < MOST_CLASSES:
            break
    last = np.append(first[1:], len(widths)) - 1
    return tuple(
        BodyClass(float(width) + ROUNDING, float(barred) + ROUNDING)
        for width, barred in zip(fitting, widths[last], strict=True)
    )
