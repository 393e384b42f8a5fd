"""Cells of levels on which densities and places of bodies are added up over the recorded times."""

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.building.model.building import Level
from evac.building.model.cells import Cells
from evac.jit import ByteGrid, Bytes, FloatGrid, Floats, Ints, Longs, Pairs, Struct, inner, kernel

#: Least side of a cell [m], greatest number of cells of a level, and greatest radius of the kernel [cells].
LEAST_SPACING, MOST_CELLS, MOST_KERNEL = 0.01, 10_000_000, 500

#: Where the kernel ends, in standard deviations.
TRUNCATED = 3.5

#: Greatest number of covered cells that are written at once.
MOST_COVERED = 1_000_000


class Grid(Cells):
    """Square cells over one level, with sides of `spacing` [m], and the kernel exp(-r^2 / R^2) / (pi R^2).

    Cells whose centre is on the floor are used: `on_floor` (ny, nx).
    """

    def __init__(self, level: Level, spacing: float, kernel_radius: float) -> None:
        _check(level, spacing, kernel_radius)
        super().__init__(level, spacing)
        self._deviation = kernel_radius / math.sqrt(2.0) / spacing  # of the kernel, in cells
        reach = int(TRUNCATED * self._deviation + 0.5)
        profile = np.exp(-0.5 * (np.arange(-reach, reach + 1) / self._deviation) ** 2)
        #: Weights of the kernel along an axis, in the cells that it reaches, of which the middle one has the person.
        self.profile: FloatArray = profile / profile.sum()
        self.on_floor: NDArray[np.bool_] = shapely.contains_xy(level.polygon, *self.centres())
        #: Share of the kernel around each cell that lies on the floor.
        self.kept: FloatArray = np.maximum(self._smooth(self.on_floor.astype(np.float64)), 0.05)

    def gathered(self, position: FloatArray, *values: FloatArray) -> FloatArray:
        """Return sum_i values_i / k_i of the points in each cell, (v, ny, nx), for `smoothed`; 1 gives a density."""
        cell = self.cell(position)
        kept = self.kept.ravel()[cell]
        return np.array([np.bincount(cell, value / kept, minlength=self.kept.size) for value in values]).reshape(
            -1, *self.shape
        )

    def smoothed(self, gathered: FloatArray) -> FloatArray:
        """Return sum_i values_i K(x - x_i) / k_i [unit of the values / m2] in every cell, (..., ny, nx); 0 off it."""
        return np.where(self.on_floor, self._smooth(gathered) / self.spacing**2, 0.0)

    def density_at(self, position: FloatArray) -> FloatArray:
        """Return the density of people at points (s, 2) in the cell of each of them, (s,) [1/m2]."""
        (gathered,) = self.gathered(position, np.ones(len(position)))
        density: FloatArray = self._smooth(gathered) / self.spacing**2
        return density.ravel()[self.cell(position)]  # a cell that is cut by a wall may be off the floor

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
        raise ResultError(f"kernel_radius: {what}, got {kernel_radius:g} m")


class Densities(Struct):
    """Densities on a grid at recorded times, each of which counts until the next one.

    With a threshold [1/m2], the times above it are added up.
    """

    threshold: float  # [1/m2]
    time: Floats  # (f,) recorded times [s]
    end: Floats  # (f,): those until which each of them counts [s]
    greatest: Floats  # (cells,) greatest density [1/m2]
    total: Floats  # (cells,) time above the threshold [s]
    longest: Floats  # (cells,): without an interruption [s]
    spell: Floats  # (cells,): since the last interruption [s]
    first: Ints  # (cells,): number of the first recorded time above the threshold, -1 for none
    last: Ints  # (cells,): of the last one, -2 for none
    density: FloatGrid  # (ny, nx): of one recorded time, zero between them

    def __init__(self, grid: Grid, time: FloatArray, threshold: float = math.inf) -> None:
        cells = grid.on_floor.size
        super().__init__(
            threshold=threshold,
            time=np.array(time),
            end=np.append(time[1:], time[-1]),
            greatest=np.zeros(cells),
            total=np.zeros(cells),
            longest=np.zeros(cells),
            spell=np.zeros(cells),
            first=np.full(cells, -1, np.int32),
            last=np.full(cells, -2, np.int32),
            density=np.zeros(grid.shape),
        )
        self.grid = grid

    def add(self, frame: NDArray[np.int64], position: FloatArray) -> None:
        """Add the people at positions (s, 2) [m] at recorded times, given by their numbers, ascending (s,)."""
        grid, cell = self.grid, self.grid.cell(position)
        weight = 1.0 / grid.kept.ravel()[cell]
        on_floor = grid.on_floor.view(np.uint8)
        add_densities(frame, cell, weight, grid.profile, on_floor, 1.0 / grid.spacing**2, self)


@kernel
def add_densities(
    frame: Longs, cell: Longs, weight: Floats, profile: Floats, on_floor: ByteGrid, scale: float, dense: Densities
) -> None:
    """Add people in cells (s,) at recorded times, ascending (s,), with weights (s,), by the densities at each time."""
    ny, nx = on_floor.shape
    width = len(profile)
    reach = width // 2
    density = dense.density
    start = 0
    while start < len(frame):
        k = frame[start]
        low_y, high_y, low_x, high_x = ny, 0, nx, 0  # outside of these, the density is zero
        while start < len(frame) and frame[start] == k:
            y, x = cell[start] // nx - reach, cell[start] % nx - reach
            first_y, end_y, first_x, end_x = max(0, y), min(ny, y + width), max(0, x), min(nx, x + width)
            low_y, high_y, low_x, high_x = (
                min(low_y, first_y),
                max(high_y, end_y),
                min(low_x, first_x),
                max(high_x, end_x),
            )
            for row in range(first_y, end_y):
                share = weight[start] * profile[row - y]
                for column in range(first_x, end_x):
                    density[row, column] += share * profile[column - x]
            start += 1
        for row in range(low_y, high_y):
            for column in range(low_x, high_x):
                here = scale * density[row, column]
                density[row, column] = 0.0
                if on_floor[row, column] and here > dense.greatest[row * nx + column]:
                    dense.greatest[row * nx + column] = here
                if on_floor[row, column] and here > dense.threshold:
                    add_time(dense, k, row * nx + column)


@inner
def add_time(dense, k, cell):
    """Add the k-th recorded time, at which the threshold was exceeded in a cell."""
    span = dense.end[k] - dense.time[k]
    dense.total[cell] += span
    dense.spell[cell] = span + (dense.spell[cell] if dense.last[cell] == k - 1 else 0.0)
    dense.longest[cell] = max(dense.longest[cell], dense.spell[cell])
    dense.first[cell] = k if dense.first[cell] < 0 else dense.first[cell]
    dense.last[cell] = k


class Covered(Struct):
    """Which bodies covered each cell of a level."""

    cells: int  # along x
    spacing: float  # [m]
    origin: Floats  # (2,): lower left corner [m]
    on_floor: Bytes  # (cells,)
    last: Floats  # (cells,): time at which a body was last there, -inf for none [s]
    pressure: Floats  # (cells,): greatest one of these bodies at recorded times [N/m]
    visitor: Ints  # (cells,): person who was last there, -1 for none
    visits: Longs  # (v,): person * cells + cell of visits, where the visitor is another one than before
    number: int  # of visits that are written


@inner
def cover(covered, x, y, radius, person, time, pressure):
    """Mark the cells whose centres are within the radius of a body, and the cell that contains its centre."""
    spacing, nx = covered.spacing, covered.cells
    ny = len(covered.last) // nx
    own_x, own_y = math.floor((x - covered.origin[0]) / spacing), math.floor((y - covered.origin[1]) / spacing)
    # The centre of the k-th neighbour of a cell is no nearer than k - 1/2 cells.
    reach = math.floor(radius / spacing + 0.5)
    for row in range(max(0, own_y - reach), min(ny, own_y + reach + 1)):
        dy = covered.origin[1] + spacing * (row + 0.5) - y
        for column in range(max(0, own_x - reach), min(nx, own_x + reach + 1)):
            dx = covered.origin[0] + spacing * (column + 0.5) - x
            cell = row * nx + column
            is_own = row == own_y and column == own_x
            if not covered.on_floor[cell] or not (is_own or dx * dx + dy * dy <= radius * radius):
                continue
            covered.last[cell] = max(covered.last[cell], time)
            covered.pressure[cell] = max(covered.pressure[cell], pressure)
            if covered.visitor[cell] != person:
                covered.visitor[cell] = person
                covered.visits[covered.number] = person * len(covered.last) + cell
                covered.number += 1


@kernel
def add_bodies(
    covered: Covered,
    person: Ints,
    radius: Floats,
    pressure: Floats,
    position: Pairs,
    way: Pairs,
    time: Floats,
    span: Floats,
    parts: Longs,
) -> None:
    """Add bodies (s,) at recorded times, and on their ways (s, 2) until the next ones, in equal parts."""
    for i in range(len(person)):
        x, y = position[i, 0], position[i, 1]
        cover(covered, x, y, radius[i], person[i], time[i], pressure[i])
        for part in range(1, parts[i]):
            share = part / parts[i]
            then = time[i] + share * span[i]
            cover(covered, x + share * way[i, 0], y + share * way[i, 1], radius[i], person[i], then, 0.0)
