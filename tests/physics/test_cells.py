"""Cells of levels: who stands in which, in rising order."""

import numpy as np
import pytest

from evac.jit import Ints, Pairs, kernel
from evac.physics.contact.neighbours import sort_by_level
from evac.physics.state import CELLS_PER_LEVEL, CELLS_PER_PERSON, Cells, make_cells


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
