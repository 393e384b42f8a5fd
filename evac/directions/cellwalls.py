"""Which walls pass through which cells of the grids, for samples that must not mix both sides of a wall."""

import numpy as np

from evac.arrays import FloatArray, IndexArray
from evac.directions.fields import CellWalls
from evac.directions.grids import BuildingGrids
from evac.directions.lattice import SLACK, Window


def find_cell_walls(grids: BuildingGrids, steepest: float) -> CellWalls:
    """List the walls, closed links and exits through each cell; one along the edge of a cell does not pass through it.

    An exit counts as a wall here, for whoever stands before it is led by the nodes before it.

    Parameters
    ----------
    grids : BuildingGrids
    steepest : float
        Greatest increase of a travel time [s] or length [m] over a metre in plan.
    """
    cells: list[IndexArray] = [np.zeros(0, dtype=np.int64)]
    walls: list[FloatArray] = [np.zeros((0, 4))]
    offset = np.array([grid.offset for grid in grids.levels], dtype=np.int64)
    for grid in grids.levels:
        for wall in (*grids.walls[grid.level], *grids.exit_segments(grid.level)):
            through = _cells_of(grid.window, wall)
            cells.append(grid.offset + through)
            walls.append(np.broadcast_to(wall, (len(through), 4)))
    cell = np.concatenate(cells)
    order = np.argsort(cell, kind="stable")
    walled, first = np.unique(cell[order], return_index=True)
    return CellWalls(
        offset=offset,
        cell=walled,
        start=np.append(first, len(cell)).astype(np.int64),
        wall=np.ascontiguousarray(np.concatenate(walls)[order]),
        steepest=steepest,
    )


def _cells_of(window: Window, wall: FloatArray) -> IndexArray:
    """Return the flat indices of the first nodes of the cells that a wall (4,) passes through."""
    ends = (wall.reshape(2, 2) - window.origin) / window.lattice.spacing
    step = ends[1] - ends[0]
    shares = [np.array([0.0, 1.0])]
    for axis in (0, 1):
        if abs(step[axis]) > SLACK:
            low, high = np.sort(ends[:, axis])
            shares.append((np.arange(np.ceil(low), np.floor(high) + 1) - ends[0, axis]) / step[axis])
    stops = np.unique(np.clip(np.concatenate(shares), 0.0, 1.0))
    middle = ends[0] + 0.5 * (stops[1:] + stops[:-1])[:, None] * step
    # Pieces along a line of the grid, and crumbs that rounding leaves at its nodes, are in no cell.
    is_in_a_cell = np.all(np.abs(middle - np.round(middle)) > SLACK, axis=1)
    ix, iy = np.floor(middle[is_in_a_cell]).astype(np.int64).T
    return np.unique(ix * window.shape[1] + iy)
