"""Connected components in NumPy: importing a graph library takes longer than reading most buildings."""

import numpy as np

from evac.base.arrays import IndexArray


def connected_components(count: int, pairs: IndexArray) -> IndexArray:
    """Return the component of each node of a graph.

    Parameters
    ----------
    count : int
        Number of nodes.
    pairs : (p, 2) int64
        Nodes that are connected.

    Returns
    -------
    (count,) int64
        Component of each node; components are numbered in the order of their first nodes.
    """
    # Every node points to a node of its component that is not greater, and finally to the smallest one.
    least = np.arange(count)
    while True:
        low = least[pairs].min(axis=1)
        if (least[pairs] == low[:, None]).all():
            return np.unique(least, return_inverse=True)[1]
        for end in (0, 1):
            np.minimum.at(least, least[pairs[:, end]], low)
        while ((further := least[least]) != least).any():
            least = further
