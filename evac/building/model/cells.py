"""Square cells over levels, and scalar fields on the cells of all levels."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.defaults import LONGEST_NAME
from evac.base.errors import is_one_line
from evac.base.saved import Saved
from evac.building.model.building import Area, Building, Level
from evac.jit import IntPairs, Ints, Longs, Pairs, Struct, inner, kernel

#: Least and greatest side of the cells of a field [m], and greatest number of cells of all levels.
LEAST_SPACING, MOST_SPACING, MOST_CELLS = 0.05, 1e6, 1_000_000

MOST_FIELDS = 100  #: Greatest number of fields of a run.


class Cells:
    """Square cells over a level or area, with sides of `spacing` [m], numbered row by row: ``row * nx + column``."""

    def __init__(self, level: Level | Area, spacing: float) -> None:
        low_x, low_y, high_x, high_y = level.polygon.bounds
        self.spacing = spacing
        self.origin: FloatArray = spacing * np.floor(np.array([low_x, low_y]) / spacing)  # lower left corner (2,) [m]
        nx, ny = (
            max(1, math.ceil((high - low) / spacing)) for high, low in zip((high_x, high_y), self.origin, strict=True)
        )
        self.shape = ny, nx

    def centres(self) -> tuple[FloatArray, FloatArray]:
        """Return x and y of the centre of each cell, (ny, nx) [m]."""
        ny, nx = self.shape
        x = self.origin[0] + self.spacing * (np.arange(nx) + 0.5)
        y = self.origin[1] + self.spacing * (np.arange(ny) + 0.5)
        return tuple(np.meshgrid(x, y))  # type: ignore[return-value]

    def cell(self, position: FloatArray) -> NDArray[np.int64]:
        """Return the number of the cell of each point (s, 2); points outside the grid are moved to its edge."""
        ny, nx = self.shape
        column, row = np.floor((position - self.origin) / self.spacing).astype(np.int64).T
        cell: NDArray[np.int64] = np.clip(row, 0, ny - 1) * nx + np.clip(column, 0, nx - 1)
        return cell


class CellIndex(Struct):
    """The cells of all levels, one level after the other, as kernels find them."""

    first: Longs  # (levels,) cell
    origin: Pairs  # (levels, 2) [m]
    shape: IntPairs  # (levels, 2) number of cells along y and along x
    spacing: float  # [m]


class LevelField(Saved):
    """A scalar on square cells of all levels, such as the density of smoke.

    A behaviour gets its own from `BehaviourScene.level_field` and writes its values; `Trajectory.field` returns what
    was recorded.

    Parameters
    ----------
    building : Building
    name, unit : str
    spacing : float [m]
        Side of the cells.
    values : (..., m) float64, optional
        Values of the cells of all levels, one level after the other; zero by default.

    Attributes
    ----------
    name, unit, spacing, values
        As given.
    size : int
        Number m of cells.
    index : CellIndex
    cells : list of Cells
        Those of each level.

    Raises
    ------
    ValueError
        The cells are too small, too large or too many, or name or unit are not short texts.
    """

    saved = ("values",)

    def __init__(
        self, building: Building, name: str, unit: str, spacing: float, values: FloatArray | None = None
    ) -> None:
        for text in (name, unit):
            if not (isinstance(text, str) and is_one_line(text) and len(text) <= LONGEST_NAME):
                wrong = f"field {name!r:.80}: name and unit are one line of at most {LONGEST_NAME} characters"
                raise ValueError(f"{wrong}, not {text!r:.80}")
        if not LEAST_SPACING <= spacing <= MOST_SPACING:
            remedy = f"use {LEAST_SPACING:g} m or more, and {MOST_SPACING:g} m or less"
            raise ValueError(f"field {name!r}: its cells cannot have {spacing!r:.20} m; {remedy}")
        low = np.array([level.polygon.bounds for level in building.levels])
        area = float(np.prod(low[:, 2:] - low[:, :2] + 2.0 * spacing, axis=1).sum())
        if area > MOST_CELLS * spacing**2:
            least = 1.1 * math.sqrt(area / MOST_CELLS)
            raise ValueError(f"field {name!r}: cells of {spacing:g} m are too small; use {least:.2g} m or more")
        self.name, self.unit, self.spacing = name, unit, float(spacing)
        self.cells = [Cells(level, spacing) for level in building.levels]
        self._start = np.cumsum([0, *(math.prod(cells.shape) for cells in self.cells)])
        self.index = CellIndex(
            first=self._start[:-1].copy(),
            origin=np.array([cells.origin for cells in self.cells]),
            shape=np.array([cells.shape for cells in self.cells], np.int32),
            spacing=self.spacing,
        )
        self.size = int(self._start[-1])
        self.values: FloatArray = np.zeros(self.size) if values is None else values

    def on(self, level: int) -> FloatArray:
        """Return the values on a level, (..., ny, nx), as a view."""
        values = self.values[..., self._start[level] : self._start[level + 1]]
        return values.reshape(*values.shape[:-1], *self.cells[level].shape)

    def at(self, level: Sequence[int] | NDArray[np.integer], position: FloatArray) -> FloatArray:
        """Return the values in the cells at points in plan, (..., n); 0 for people who are out.

        Parameters
        ----------
        level : (n,) int
            Index of the level of each point; -1 for people who are out.
        position : (n, 2) [m]
        """
        cell = np.empty(len(level), np.int64)
        find_cells(self.index, np.asarray(level, np.int32), np.ascontiguousarray(position), cell)
        values = self.values.take(np.maximum(cell, 0), -1)
        values[..., cell < 0] = 0.0
        return values


@kernel
def find_cells(index: CellIndex, level: Ints, position: Pairs, cell: Longs) -> None:
    """Find the cells (n,) of all levels at points (n, 2) on levels (n,); -1 where the level is."""
    for k in range(len(level)):
        cell[k] = cell_at(index, level[k], position[k, 0], position[k, 1])


@inner
def cell_at(index: CellIndex, level: int, x: float, y: float) -> int:
    """Return the cell of all levels at a point on a level; -1 if the level is."""
    if level < 0:
        return -1
    column = math.floor((x - index.origin[level, 0]) / index.spacing)
    row = math.floor((y - index.origin[level, 1]) / index.spacing)
    rows, columns = index.shape[level, 0], index.shape[level, 1]
    cell: int = index.first[level] + min(max(row, 0), rows - 1) * columns + min(max(column, 0), columns - 1)
    return cell
