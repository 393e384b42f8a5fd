"""Which cells a wall passes through, against points laid densely along it."""

import numpy as np
import pytest

from evac.directions.build import _cells_of
from evac.directions.raster.lattice import Lattice


@pytest.mark.parametrize("seed", range(5))
def test_cells_are_those_of_points_along_the_wall(seed):
    window = Lattice((0.0, 0.0), 0.5).window((0.0, 0.0, 3.0, 3.0), 1)
    walls = np.random.default_rng(seed).uniform(0.0, 3.0, (8, 4))
    number, cell = _cells_of(window, walls)
    share = np.linspace(0.0, 1.0, 20_001)[:, None]
    for k, wall in enumerate(walls):
        points = (wall[:2] + share * (wall[2:] - wall[:2]) - window.origin) / 0.5
        ix, iy = np.floor(points).astype(int).T
        assert set(cell[number == k].tolist()) == set((ix * window.shape[1] + iy).tolist())


def test_a_wall_along_a_line_of_the_grid_is_in_no_cell_and_one_across_a_node_in_two():
    window = Lattice((0.0, 0.0), 0.5).window((0.0, 0.0, 3.0, 3.0), 0)
    walls = np.array([[0.5, 0.5, 0.5, 2.5], [0.5, 1.0, 2.0, 1.0], [1.0, 1.0, 2.0, 2.0], [1.1, 1.1, 1.2, 1.3]])
    number, cell = _cells_of(window, walls)
    columns = window.shape[1]
    assert number.tolist() == [2, 2, 3]
    assert cell.tolist() == [2 * columns + 2, 3 * columns + 3, 2 * columns + 2]
