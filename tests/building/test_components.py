import numpy as np
import pytest
from scipy import sparse

from evac.building.geometry import connected_components


@pytest.mark.parametrize(("count", "links"), [(1, 0), (7, 0), (50, 20), (50, 60), (2000, 1500), (2000, 20000)])
def test_components_are_those_of_scipy(count, links):
    pairs = np.random.default_rng(links).integers(0, count, (links, 2))
    graph = sparse.coo_array((np.ones(links), tuple(pairs.T)), shape=(count, count))
    _, label = sparse.csgraph.connected_components(graph, directed=False)
    _, first, expected = np.unique(label, return_index=True, return_inverse=True)
    expected = np.argsort(np.argsort(first))[expected]
    np.testing.assert_array_equal(connected_components(count, pairs), expected)


def test_a_long_chain_in_any_order_is_one_component():
    order = np.random.default_rng(1).permutation(100_000)
    pairs = np.stack([order[:-1], order[1:]], axis=1)
    assert not connected_components(len(order), pairs).any()
