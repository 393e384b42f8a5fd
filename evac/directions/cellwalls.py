"""Walls in each grid cell, for interpolation that must not mix values from both sides of a wall."""

from collections.abc import Sequence

import numpy as np

from evac.base.arrays import FloatArray, IndexArray
from evac.directions.fields import CellWalls
from evac.directions.raster.grids import BuildingGrids
from evac.directions.raster.lattice import SLACK, Window, numbers_between


def find_cell_walls(classes: Sequence[BuildingGrids], routes: int, steepest: float) -> CellWalls:
    """List the walls, closed links and exits that pass through the interior of each cell, for each class of bodies.

    Exits are treated as walls, so that people in front of an exit use the nodes in front of it. `steepest` is the
    largest increase of a travel time [s] or length [m] per metre in plan.
    """
    cells: list[IndexArray] = [np.zeros(0, dtype=np.int64)]
    walls: list[FloatArray] = [np.zeros((0, 4))]
    offset = np.zeros((len(classes[0].levels), len(classes)), dtype=np.int32)
    for column, grids in enumerate(classes):
        for grid in grids.levels:
            building = grids.building
            exits = [way.segments for way in building.exits_of(grid.level) if building.is_open(way)]
            own = np.concatenate([grids.walls[grid.level], *exits])
            number, through = _cells_of(grid.window, own)
            offset[grid.level, column] = column * grids.size + grid.offset
            cells.append(offset[grid.level, column] + through)
            walls.append(own[number])
    cell = np.concatenate(cells)
    order = np.argsort(cell, kind="stable")
    walled, first = np.unique(cell[order], return_index=True)
    return CellWalls(
        offset=np.repeat(offset, routes, axis=1),
        cell=walled,
        start=np.append(first, len(cell)).astype(np.int64),
        wall=np.ascontiguousarray(np.concatenate(walls)[order]),
        steepest=steepest,
    )


def _cells_of(window: Window, walls: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return indices of walls (w, 4) and flat indices of the first nodes of the cells that each passes through.

    They are sorted by wall, then by cell.
    """
    ends = (walls.reshape(-1, 2, 2) - window.origin) / window.lattice.spacing
    step = ends[:, 1] - ends[:, 0]
    # Fractions of the length at which a wall starts, crosses a grid line and ends.
    owners = [np.arange(len(walls)), np.arange(len(walls))]
    shares = [np.zeros(len(walls)), np.ones(len(walls))]
    for axis in (0, 1):
        oblique = np.flatnonzero(np.abs(step[:, axis]) > SLACK)
        between = ends[oblique, :, axis]
        owner, line = numbers_between(np.ceil(between.min(axis=1)), np.floor(between.max(axis=1)))
        owners.append(oblique[owner])
        shares.append((line - between[owner, 0]) / step[oblique[owner], axis])
    owner, share = np.concatenate(owners), np.clip(np.concatenate(shares), 0.0, 1.0)
    order = np.lexsort((share, owner))
    owner, share = owner[order], share[order]
    is_piece = (owner[1:] == owner[:-1]) & (share[1:] > share[:-1])
    owner, halfway = owner[1:][is_piece], (0.5 * (share[1:] + share[:-1]))[is_piece]
    middle = ends[owner, 0] + halfway[:, None] * step[owner]
    # Pieces along a grid line, and tiny pieces at nodes due to rounding, are not in any cell.
    is_in_a_cell = np.all(np.abs(middle - np.round(middle)) > SLACK, axis=1)
    ix, iy = np.floor(middle[is_in_a_cell]).astype(np.int64).T
    number, cell = np.unique(np.stack([owner[is_in_a_cell], ix * window.shape[1] + iy], axis=1), axis=0).T
    return number, cell
