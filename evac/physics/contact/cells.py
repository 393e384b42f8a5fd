"""Cell lists: people sorted into square cells of each level by a counting sort."""

import math

import numpy as np

from evac.base.arrays import FloatArray, IntArray
from evac.jit import Bytes, Ints, Struct, inner

#: Room for cells: a number for each person, and one for each level.
CELLS_PER_PERSON = 4
CELLS_PER_LEVEL = 1024

#: Least number of columns and rows of cells that are used again, so that those around a cell are different ones.
FEWEST = 3


class Cells(Struct):
    """People in the square cells of their levels.

    A level has cells for the rectangle that its people are in. If there is no room for all, as where a person is far
    away, `wraps` is 1 and its columns and rows are used again and again: cells then also contain people from elsewhere.
    """

    size: float  # [m]
    low_column: Ints  # (levels,) first column and row of the rectangle, counted from the origin of the plan
    low_row: Ints
    columns: Ints  # (levels,) numbers of columns and rows of cells
    rows: Ints
    wraps: Bytes  # (levels,)
    first: Ints  # (levels,) first cell; cell (column, row) is column * rows + row cells behind it
    start: Ints  # first of each cell in slots
    cell_of: Ints  # (n,) -1 for people on no level
    slots: Ints  # (n,) people of each cell, in ascending order


def make_cells(people: int, levels: int) -> Cells:
    """Return empty cells for numbers of people and levels."""
    return Cells(
        size=1.0,
        **{name: np.zeros(levels, np.int32) for name in ("low_column", "low_row", "columns", "rows", "first")},
        wraps=np.zeros(levels, np.uint8),
        start=np.zeros(CELLS_PER_PERSON * people + CELLS_PER_LEVEL * levels + 1, np.int32),
        cell_of=np.zeros(people, np.int32),
        slots=np.zeros(people, np.int32),
    )


@inner
def line_at(x: float, size: float) -> int:
    """Return the column of an x coordinate, or the row of a y coordinate [m], counted from the origin of the plan."""
    return math.floor(x / size)


@inner
def sort_by_level(cells: Cells, n: int, position: FloatArray, level: IntArray, size: float) -> None:
    """Sort the first `n` people who are on a level into cells of `size` [m]."""
    cells.size = size
    number = _divide(cells, n, position, level)
    start = cells.start
    for c in range(number + 1):
        start[c] = 0
    for i in range(n):
        cells.cell_of[i] = -1
        at = level[i]
        if at >= 0:
            column = line_at(position[i, 0], size) - cells.low_column[at]
            row = line_at(position[i, 1], size) - cells.low_row[at]
            if cells.wraps[at]:
                column, row = column % cells.columns[at], row % cells.rows[at]
            cells.cell_of[i] = cells.first[at] + column * cells.rows[at] + row
            start[cells.cell_of[i]] += 1
    for c in range(number):
        start[c + 1] += start[c]
    # Filling backwards, the end of each cell decreases to its start and people are in ascending order.
    for i in range(n - 1, -1, -1):
        c = cells.cell_of[i]
        if c >= 0:
            start[c] -= 1
            cells.slots[start[c]] = i


@inner
def _divide(cells: Cells, n: int, position: FloatArray, level: IntArray) -> int:
    """Set the rectangle, the numbers of columns and rows and the first cell of each level; return how many cells."""
    levels = cells.first.shape[0]
    for at in range(levels):
        cells.first[at] = 0  # the number of its people, until that of the cells is known
    for i in range(n):
        at = level[i]
        if at >= 0:
            column, row = line_at(position[i, 0], cells.size), line_at(position[i, 1], cells.size)
            if cells.first[at] == 0:
                cells.low_column[at], cells.low_row[at] = column, row
                cells.columns[at], cells.rows[at] = column, row  # the last ones, likewise
            cells.first[at] += 1
            cells.low_column[at] = min(cells.low_column[at], column)
            cells.low_row[at] = min(cells.low_row[at], row)
            cells.columns[at] = max(cells.columns[at], column)
            cells.rows[at] = max(cells.rows[at], row)
    number = 0
    for at in range(levels):
        people = cells.first[at]
        cells.first[at] = number
        if people == 0:
            cells.columns[at] = cells.rows[at] = cells.wraps[at] = 0
            continue
        columns = cells.columns[at] - cells.low_column[at] + 1
        rows = cells.rows[at] - cells.low_row[at] + 1
        room = CELLS_PER_PERSON * people + CELLS_PER_LEVEL
        cells.wraps[at] = columns * rows > room
        if cells.wraps[at]:
            fewer = max(min(columns, rows, int(math.sqrt(room))), FEWEST)
            if columns < rows:
                columns, rows = fewer, room // fewer
            else:
                columns, rows = room // fewer, fewer
        cells.columns[at], cells.rows[at] = columns, rows
        number += columns * rows
    return number
