"""Operations on masks of grid nodes: connected components, dilation and nearest neighbours.

The results agree with `scipy.ndimage`, whose import takes longer than computing the directions of small buildings.
"""

import numpy as np

from evac.base.arrays import BoolArray, IndexArray
from evac.building.geometry.components import connected_components

#: Nodes that are looked at together, since each takes some 80 bytes.
CHUNK = 2**21

NONE: IndexArray = np.zeros(0, dtype=np.int64)


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
    far = np.int32(sum(nodes.shape))  # larger than any distance
    along = np.arange(nodes.shape[0], dtype=np.int32)[:, None]
    before = np.maximum.accumulate(np.where(nodes, along, -far), axis=0)
    behind = np.minimum.accumulate(np.where(nodes, along, 2 * far)[::-1], axis=0)[::-1]
    in_line = np.where(along - before <= behind - along, before, behind)
    del before, behind
    lines = np.flatnonzero(nodes.any(axis=0))
    some = max(1, CHUNK // nodes.shape[1])
    firsts, seconds = [NONE], [NONE]
    for first in range(0, nodes.shape[0], some):
        i, j = np.nonzero(wanted[first : first + some])
        if len(i):
            away = in_line[first : first + some].astype(np.int64) - along[first : first + some]
            line = _nearest_lines(away**2, lines)[i, j]
            firsts.append(in_line[first + i, line].astype(np.int64))
            seconds.append(line)
    return np.concatenate(firsts), np.concatenate(seconds)


def _nearest_lines(squared: IndexArray, lines: IndexArray) -> IndexArray:
    """Return, for each node (i, j), the first k of `lines` with the smallest ``(j - k)^2 + squared[i, k]``.

    These are parabolas in j, whose lower envelope is kept in a stack for each i: Felzenszwalb and Huttenlocher,
    Distance transforms of sampled functions, Theory of Computing 8 (2012) 415-428.
    """
    count, length = squared.shape
    stack = np.zeros((length + 1, count), dtype=np.int64)  # lines
    since = np.zeros((length + 1, count), dtype=np.int64)  # first j at which each line is the lowest
    top = np.full(count, -1)
    for k in lines.tolist():
        columns = np.arange(count)
        while columns.size:
            last, is_first = top[columns], top[columns] < 0
            other = np.where(is_first, k - 1, stack[last, columns])
            rise = k**2 - other**2 + squared[columns, k] - squared[columns, other]
            first = np.where(is_first, 0, rise // (2 * (k - other)) + 1)
            is_higher = ~is_first & (first <= since[last, columns])
            kept, place = columns[~is_higher], last[~is_higher] + 1
            stack[place, kept], since[place, kept], top[kept] = k, first[~is_higher], place
            columns = columns[is_higher]
            top[columns] -= 1
    found = np.empty_like(squared)
    place, columns = np.zeros(count, dtype=np.int64), np.arange(count)
    for j in range(length):
        place += (place < top) & (since[np.minimum(place + 1, top), columns] <= j)
        found[:, j] = stack[place, columns]
    return found
