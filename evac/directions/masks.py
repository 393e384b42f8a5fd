"""Marked nodes of a grid: their connected parts, what lies around them, and which is nearest.

As `scipy.ndimage` finds them, to the last tie; loading it takes longer than making the directions of many a building.
"""

import numpy as np

from evac.arrays import BoolArray, IndexArray
from evac.building.components import connected_components


def parts_of(nodes: BoolArray) -> IndexArray:
    """Return the number (n,) of the connected part of each marked node, where the four beside a node are linked."""
    number = np.full(nodes.shape, -1, dtype=np.int64)
    number[nodes] = np.arange(np.count_nonzero(nodes))
    along_x = np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2)
    along_y = np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2)
    pairs = np.concatenate([along_x, along_y])
    return connected_components(int(number.max(initial=-1)) + 1, pairs[(pairs >= 0).all(axis=1)])


def grown(nodes: BoolArray, steps: int) -> BoolArray:
    """Mark the nodes that are at most `steps` from a marked one, along each axis."""
    width = 2 * steps + 1
    for axis in (0, 1):
        before = np.cumsum(np.pad(nodes, [(steps + 1, steps) if axis == other else (0, 0) for other in (0, 1)]), axis)
        first, last = (slice(None, -width), slice(width, None))
        nodes = before[last] > before[first] if axis == 0 else before[:, last] > before[:, first]
    return nodes


def nearest_marked(nodes: BoolArray, wanted: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Return the marked node that is nearest to each wanted one.

    Of several, it is the one with the least second index, then with the least first one.

    Parameters
    ----------
    nodes, wanted : (nx, ny) bool
        At least one of `nodes` is marked.

    Returns
    -------
    (w,) int64, (w,) int64
        First and second indices, in the order of the wanted nodes.
    """
    count = sum(nodes.shape)  # farther than any node
    along = np.arange(nodes.shape[0])[:, None]
    before = np.maximum.accumulate(np.where(nodes, along, -count), axis=0)
    behind = np.minimum.accumulate(np.where(nodes, along, 2 * count)[::-1], axis=0)[::-1]
    in_line = np.where(along - before <= behind - along, before, behind)
    squared = (in_line - along) ** 2
    i, j = np.nonzero(wanted)
    best, found = squared[i, j], j.copy()
    rows = np.arange(len(i))
    for step in range(1, nodes.shape[1]):
        rows = rows[best[rows] >= step**2]
        for line in (j[rows] - step, j[rows] + step):
            inside = (line >= 0) & (line < nodes.shape[1])
            row, line = rows[inside], line[inside]
            candidate = squared[i[row], line] + step**2
            better = (candidate < best[row]) | ((candidate == best[row]) & (line < found[row]))
            best[row[better]], found[row[better]] = candidate[better], line[better]
        if not rows.size:
            break
    return in_line[i, found], found
