"""Operations on masks of grid nodes: connected components, dilation and nearest neighbours.

The results agree with `scipy.ndimage`, whose import takes longer than computing the directions of small buildings.
"""

import numpy as np
import shapely

from evac.base.arrays import BoolArray, IndexArray
from evac.building.geometry.components import connected_components

#: Nodes that are looked at together, since each takes some 200 bytes.
CHUNK = 2**18


def parts_of(nodes: BoolArray) -> IndexArray:
    """Return the component (n,) of each marked node, with 4-connectivity."""
    number = np.full(nodes.shape, -1, dtype=np.int64)
    number[nodes] = np.arange(np.count_nonzero(nodes))
    along_x = np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2)
    along_y = np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2)
    pairs = np.concatenate([along_x, along_y])
    return connected_components(int(number.max(initial=-1)) + 1, pairs[(pairs >= 0).all(axis=1)])


def grown(nodes: BoolArray, steps: int) -> BoolArray:
    """Mark the nodes at most `steps` nodes from a marked one along each axis (dilation by a square)."""
    width = 2 * steps + 1
    for axis in (0, 1):
        padded = np.pad(nodes, [(steps + 1, steps) if axis == other else (0, 0) for other in (0, 1)])
        before = np.cumsum(padded, axis, dtype=np.int32)
        first, last = (slice(None, -width), slice(width, None))
        nodes = before[last] > before[first] if axis == 0 else before[:, last] > before[:, first]
    return nodes


def nearest_marked(nodes: BoolArray, wanted: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Return the marked node nearest to each wanted node.

    Ties are resolved by the smallest second index, then by the smallest first index.

    Parameters
    ----------
    nodes, wanted : (nx, ny) bool
        At least one of `nodes` is marked.

    Returns
    -------
    (w,) int64, (w,) int64
        First and second indices of the nearest nodes, in the order of the wanted nodes.
    """
    places = np.argwhere(wanted)
    # The nearest one is beside a node that is not marked, or is wanted itself.
    edge = np.argwhere(nodes & (grown(~nodes, 1) | wanted))
    tree = shapely.STRtree(shapely.points(edge))
    found = [np.zeros((0, 2), np.int64)]
    for first in range(0, len(places), CHUNK):
        owner, near = tree.query_nearest(shapely.points(places[first : first + CHUNK]))
        order = np.lexsort((edge[near, 0], edge[near, 1], owner))
        found.append(edge[near[order]][np.unique(owner[order], return_index=True)[1]])
    i, j = np.concatenate(found).T
    return i, j
