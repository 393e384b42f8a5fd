"""A grid of square cells on the floor of a level: cells covered by bodies, and densities with a Gaussian kernel."""

import math
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.building.model.building import Level
from evac.building.model.cells import Cells

#: Least side of a cell [m], greatest number of cells of a level, and greatest radius of the kernel [cells].
LEAST_SPACING, MOST_CELLS, MOST_KERNEL = 0.01, 10_000_000, 500

#: Where the kernel ends, in standard deviations.
TRUNCATED = 3.5

#: Number of cells whose densities are computed together.
MOST_TOGETHER = 200_000


class Grid(Cells):
    """Square cells over one level; cells whose centre is on the floor are used.

    Parameters
    ----------
    level : Level
    spacing : float [m]
        Side of the cells.
    kernel_radius : float [m]
        R of the kernel exp(-r^2 / R^2) / (pi R^2).

    Attributes
    ----------
    on_floor : (ny, nx) bool
    """

    def __init__(self, level: Level, spacing: float, kernel_radius: float) -> None:
        _check(level, spacing, kernel_radius)
        super().__init__(level, spacing)
        self._deviation = kernel_radius / math.sqrt(2.0) / spacing  # of the kernel, in cells
        self.on_floor: NDArray[np.bool_] = shapely.contains_xy(level.polygon, *self.centres())
        # Share of the kernel around each cell that lies on the floor.
        self._kept = np.maximum(self._smooth(self.on_floor.astype(np.float64)), 0.05)

    def gathered(self, position: FloatArray, *values: FloatArray) -> FloatArray:
        """Return sum_i values_i / k_i of the points in each cell, (v, ny, nx), for `smoothed`.

        Parameters
        ----------
        position : (s, 2) [m]
        *values : (s,)
            Of each point; 1 gives a density.
        """
        cell = self.cell(position)
        kept = self._kept.ravel()[cell]
        return np.array([np.bincount(cell, one / kept, minlength=self._kept.size) for one in values]).reshape(
            -1, *self.shape
        )

    def smoothed(self, gathered: FloatArray) -> FloatArray:
        """Return sum_i values_i K(x - x_i) / k_i [unit of the values / m2] in every cell, (..., ny, nx); 0 off it."""
        return np.where(self.on_floor, self._smooth(gathered) / self.spacing**2, 0.0)

    def densities(
        self, frame: NDArray[np.int64], position: FloatArray
    ) -> Iterator[tuple[NDArray[np.int64], FloatArray]]:
        """Yield the density of people in every cell at recorded times, at some of them together.

        Parameters
        ----------
        frame : (s,) int64
            Number of the recorded time of each point, ascending.
        position : (s, 2) [m]

        Yields
        ------
        (f,) int64, (f, ny, nx) float64 [1/m2]
            Numbers of the times at which somebody is there, and the densities.
        """
        frames, cell = np.unique(frame), self.cell(position)
        weight = 1.0 / self._kept.ravel()[cell]
        reach, together = math.ceil(TRUNCATED * self._deviation) + 1, max(1, MOST_TOGETHER // self._kept.size)
        for start in range(0, len(frames), together):
            some = frames[start : start + together]
            first, end = np.searchsorted(frame, [some[0], some[-1] + 1])
            row, column = np.divmod(cell[first:end], self.shape[1])
            # The densities of all other cells are zero.
            low_y, low_x = max(0, int(row.min()) - reach), max(0, int(column.min()) - reach)
            around = np.s_[low_y : int(row.max()) + reach + 1, low_x : int(column.max()) + reach + 1]
            shape = len(some), *self.on_floor[around].shape
            where = np.ravel_multi_index((np.searchsorted(some, frame[first:end]), row - low_y, column - low_x), shape)
            gathered = np.bincount(where, weight[first:end], minlength=math.prod(shape)).reshape(shape)
            densities = np.zeros((len(some), *self.shape))
            smooth = self._smooth(gathered.astype(np.float64, copy=False)) / self.spacing**2
            densities[:, *around] = np.where(self.on_floor[around], smooth, 0.0)
            yield some, densities

    def density_at(self, position: FloatArray) -> FloatArray:
        """Return the density of people at points (s, 2) in the cell of each of them, (s,) [1/m2]."""
        (gathered,) = self.gathered(position, np.ones(len(position)))
        density: FloatArray = self._smooth(gathered) / self.spacing**2
        return density.ravel()[self.cell(position)]  # a cell that is cut by a wall may be off the floor

    def covered(self, position: FloatArray, radius: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of bodies and covered cells of the floor: rows of `position`, and numbers of cells.

        A body covers the cells whose centres are within its `radius` (s,), and the cell that contains its centre.
        """
        ny, nx = self.shape
        # The centre of the k-th neighbour of a cell is no nearer than k - 1/2 cells.
        reach = math.floor(float(radius.max(initial=0.0)) / self.spacing + 0.5)
        steps = np.arange(-reach, reach + 1)
        own = np.floor((position - self.origin) / self.spacing).astype(np.int64)
        column = own[:, :1] + np.repeat(steps[None], steps.size, axis=0).ravel()
        row = own[:, 1:] + np.repeat(steps, steps.size)
        dx = self.origin[0] + self.spacing * (column + 0.5) - position[:, :1]
        dy = self.origin[1] + self.spacing * (row + 0.5) - position[:, 1:]
        within = (dx**2 + dy**2 <= radius[:, None] ** 2) | ((row == own[:, 1:]) & (column == own[:, :1]))
        within &= (row >= 0) & (row < ny) & (column >= 0) & (column < nx)
        body, which = np.nonzero(within)
        cell = row[body, which] * nx + column[body, which]
        there = self.on_floor.ravel()[cell]
        return body[there], cell[there]

    def _smooth(self, values: FloatArray) -> FloatArray:
        from scipy.ndimage import gaussian_filter

        deviation = [0.0] * (values.ndim - 2) + [self._deviation] * 2
        smooth: FloatArray = gaussian_filter(values, deviation, mode="constant", truncate=TRUNCATED)
        return smooth


def _check(level: Level, spacing: float, kernel_radius: float) -> None:
    low_x, low_y, high_x, high_y = level.polygon.bounds
    least = max(LEAST_SPACING, math.sqrt((high_x - low_x) * (high_y - low_y) / MOST_CELLS))
    if not spacing >= least:
        what = f"cells of {spacing:g} m are too small or too many for level {level.name!r}"
        raise ResultError(f"spacing: {what}; use {least:.2g} m or more")
    most = MOST_KERNEL * spacing
    if not 0.0 < kernel_radius <= most:
        what = f"must be greater than 0 and at most {most:g} m with cells of {spacing:g} m"
        raise ResultError(f"kernel_radius: {what}, got {kernel_radius:g} m (--kernel)")
