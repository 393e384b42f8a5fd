"""Cells of the plan: who stands in which, in rising order."""

import numpy as np
import pytest

from evac.jit import Ints, Pairs, kernel
from evac.physics.contact.cells import CELLS_PER_LEVEL, CELLS_PER_PERSON, Cells, fill_cells, make_cells, sort_by_level


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


@kernel
def sort(cells: Cells, position: Pairs, level: Ints) -> None:
    sort_by_level(cells, level.shape[0], position, level, 1.0)


def sorted_by_level(position, level, levels):
    """Return the cells, and the people in each that has any, by level, column and row."""
    cells = make_cells(len(level), levels)
    sort(cells, np.array(position, dtype=float), np.array(level, np.int32))
    found = {}
    for at in range(levels):
        for k in range(cells.columns[at] * cells.rows[at]):
            people = cells.slots[cells.start[cells.first[at] + k] : cells.start[cells.first[at] + k + 1]].tolist()
            if people:
                found[at, k // int(cells.rows[at]), k % int(cells.rows[at])] = people
    return cells, found


def test_each_level_has_cells_of_its_own():
    position = [[5.5, -1.5], [3.5, -1.5], [5.5, 0.5], [9.5, 9.5], [5.2, -1.1], [-7.5, 2.5]]
    cells, found = sorted_by_level(position, [0, 2, 0, -1, 0, 2], 3)
    assert found == {(0, 0, 0): [0, 4], (0, 0, 2): [2], (2, 0, 4): [5], (2, 11, 0): [1]}
    assert cells.cell_of[3] == -1
    assert (cells.columns * cells.rows).tolist() == [3, 0, 60]
    assert not cells.wraps.any()


@pytest.mark.parametrize("far", [(5000.5, 4000.5), (5000.5, 0.5), (0.5, -4000.5)])
def test_one_person_far_away_leaves_the_others_their_cells(far):
    place = np.array([(x, y) for x in range(20) for y in range(20)]) + 0.5
    cells, found = sorted_by_level([*place, far], [0] * 401, 1)
    assert cells.wraps[0]
    assert cells.columns[0] * cells.rows[0] <= 401 * CELLS_PER_PERSON + CELLS_PER_LEVEL
    assert min(cells.columns[0], cells.rows[0]) >= 3
    assert max(map(len, found.values())) <= 2
