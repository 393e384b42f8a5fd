"""What scipy.ndimage finds too, which takes too long to load for a run."""

import numpy as np
import pytest
from scipy import ndimage

from evac.directions.raster.lattice import grown, nearest_marked, parts_of

SHAPES = [(1, 1), (1, 9), (9, 1), (23, 31), (60, 40)]
SHARES = [0.02, 0.3, 0.6, 0.95]


def marked(shape, share):
    nodes = np.random.default_rng([*shape, int(100 * share)]).uniform(size=shape) < share
    nodes[shape[0] // 2, shape[1] // 3] = True
    return nodes


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", SHARES)
def test_parts_are_linked_along_the_axes(shape, share):
    nodes = marked(shape, share)
    labels, number = ndimage.label(nodes)
    np.testing.assert_array_equal(parts_of(nodes) + 1, labels[nodes])
    assert parts_of(np.zeros(shape, dtype=bool)).size == 0
    assert number == parts_of(nodes).max() + 1


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("steps", [1, 2, 5, 100])
def test_nodes_grow_into_squares(shape, steps):
    nodes = marked(shape, 0.02)
    np.testing.assert_array_equal(grown(nodes, steps), ndimage.binary_dilation(nodes, np.ones((3, 3)), steps))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("wanted", ["all", "others", "none"])
def test_the_nearest_node_is_chosen_as_by_scipy_also_where_several_are_as_near(shape, share, wanted):
    nodes = marked(shape, share)
    which = {"all": np.ones(shape, dtype=bool), "others": ~nodes, "none": np.zeros(shape, dtype=bool)}[wanted]
    expected = ndimage.distance_transform_edt(~nodes, return_distances=False, return_indices=True)
    np.testing.assert_array_equal(np.stack(nearest_marked(nodes, which)), expected[:, which])


def test_of_nodes_that_are_as_near_the_one_with_the_least_second_index_is_chosen():
    nodes = np.zeros((5, 5), dtype=bool)
    nodes[[0, 4, 2, 2], [2, 2, 0, 4]] = True
    only = np.zeros((5, 5), dtype=bool)
    only[2, 2] = True
    assert [int(index[0]) for index in nearest_marked(nodes, only)] == [2, 0]
