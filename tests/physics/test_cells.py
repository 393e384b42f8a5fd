"""Cells of the plan: who stands in which, in rising order."""

import numpy as np
import pytest

from evac.jit import Ints, Pairs, kernel
from evac.physics.cells import fill_cells


@kernel
def fill(
    n: int, position: Pairs, level: Ints, size: float, start: Ints, cell_of: Ints, slots: Ints, shape: Ints
) -> None:
    shape[0], shape[1] = fill_cells(n, position, level, size, start, cell_of, slots)


def filled(position, level, size, room):
    """Return the numbers of cells, the cell of each person, and the people of each cell."""
    n = len(position)
    start, cell_of, slots = np.full(room + 1, -7, np.int32), np.full(n, -7, np.int32), np.full(n, -7, np.int32)
    shape = np.zeros(2, np.int32)
    fill(n, np.array(position, dtype=float), np.array(level, np.int32), size, start, cell_of, slots, shape)
    cells = shape[0] * shape[1]
    assert start[0] == 0
    return tuple(shape), cell_of.tolist(), [slots[start[c] : start[c + 1]].tolist() for c in range(cells)]


def test_people_stand_in_their_cells_in_rising_order():
    position = [[5.5, -1.0], [3.0, -1.5], [3.2, 0.6], [100.0, 100.0], [3.9, -0.6], [3.0, -2.0]]
    shape, cell_of, cells = filled(position, [0, 1, 0, -1, 0, 2], 1.0, 100)
    assert shape == (3, 3)
    assert cell_of == [7, 0, 2, -1, 1, 0]
    assert cells == [[1, 5], [4], [2], [], [], [], [], [0], []]


@pytest.mark.parametrize(("room", "shape"), [(12, (4, 3)), (11, (3, 2)), (5, (2, 1))])
def test_cells_are_larger_where_there_is_no_room(room, shape):
    """Of 3.2 x 2.1 m, in cells of 1, 1.5 and 2.25 m."""
    assert filled([[0.0, 0.0], [3.2, 2.1]], [0, 0], 1.0, room)[0] == shape
