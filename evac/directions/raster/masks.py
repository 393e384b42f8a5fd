"""Operations on masks of grid nodes: connected components, dilation and nearest neighbours.

The results agree with `scipy.ndimage`, whose import takes longer than computing the directions of small buildings.
"""

import numpy as np

from evac.base.arrays import BoolArray, IndexArray
from evac.building.geometry import connected_components


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
    """Return both indices (w,) of the node of a mask (nx, ny) that is nearest to each wanted node (nx, ny), in their
    order.

    Ties are resolved by the smallest second index, then by the smallest first index. At least one node is marked.
    """
    row, far = np.arange(len(nodes))[:, None], sum(nodes.shape)
    before = np.maximum.accumulate(np.where(nodes, row, -far), axis=0)
    after = np.minimum.accumulate(np.where(nodes, row, 2 * far)[::-1], axis=0)[::-1]
    nearest = np.where(row - before <= after - row, before, after)  # along the column of each node
    i, j = np.nonzero(wanted)
    squared, of_column, left, step = np.full(len(i), 4 * far**2), j.copy(), np.arange(len(i)), 0
    while len(left):  # columns beside that of a node, as long as they may have a nearer one
        for column in (j[left] - step, j[left] + step):
            inside = (column >= 0) & (column < nodes.shape[1])
            one, column = left[inside], column[inside]
            offer = step**2 + (nearest[i[one], column] - i[one]) ** 2
            is_nearer = (offer < squared[one]) | ((offer == squared[one]) & (column < of_column[one]))
            squared[one[is_nearer]], of_column[one[is_nearer]] = offer[is_nearer], column[is_nearer]
        step += 1
        left = left[step**2 <= squared[left]]
    return nearest[i, of_column], of_column
