"""Smoke as a field on the levels, which is recorded, shown, and read by behaviours."""

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.base.arrays import FloatArray, IndexArray
from evac.building.model.cells import MOST_CELLS
from evac.conditions.air import Air

if TYPE_CHECKING:
    from evac.simulation.scene import Scene

#: Name and unit of the field, which behaviours and trajectories know it by.
NAME, UNIT = "extinction", "1/m"

#: Least side of its cells [m], and time between two updates [s].
SPACING, PERIOD = 1.0, 2.0


class SmokeField:
    """The extinction coefficient at the mean height of heads, on square cells of all levels.

    Parameters
    ----------
    air : Air
    scene : Scene
    height : float
        Mean height of people [m].
    limits : (k,) float64 [1/m]
        Extinction coefficients whose first time on each level is kept.

    Attributes
    ----------
    first : (k, levels) float64 [s]
        Time at which each limit was first exceeded somewhere on each level; NaN if it was not.
    """

    def __init__(self, air: Air, scene: "Scene", height: float, limits: FloatArray) -> None:
        levels = scene.building.levels
        bounds = np.array([level.polygon.bounds for level in levels])
        area = float(np.prod(bounds[:, 2:] - bounds[:, :2] + 4.0 * SPACING, axis=1).sum())
        spacing = max(SPACING, math.ceil(math.sqrt(2.0 * area / MOST_CELLS)))
        self._air, self.values = air, (field := scene.add_field(NAME, UNIT, spacing)).values
        places, cells, level_of, first = [], [], [], 0
        for level, grid in zip(levels, field.cells, strict=True):
            centres = np.column_stack([values.ravel() for values in grid.centres()])
            ground = shapely.buffer(level.polygon, 0.5 * spacing, join_style="mitre")
            own = np.flatnonzero(shapely.intersects_xy(ground, *centres.T))
            places.append(centres[own])
            cells.append(first + own)
            level_of.append(np.full(len(own), level.index, np.int32))
            first += len(centres)
        self._limits, self.first = limits, np.full((len(limits), len(levels)), np.nan)
        self._cells: IndexArray = np.concatenate(cells)
        self._level, self._place = np.concatenate(level_of), np.concatenate(places)
        self._heads: FloatArray = air.heads_at(self._level, self._place, height)

    def update(self, time: float) -> None:
        """Write the values at a time of the run [s]."""
        found = self._air.at((NAME,), time, self._level, self._place, self._heads)[0]
        self.values[self._cells] = found
        greatest = np.maximum.reduceat(found, np.searchsorted(self._level, np.arange(self.first.shape[1])))
        self.first[np.isnan(self.first) & (greatest > self._limits[:, None])] = time
