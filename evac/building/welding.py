"""Vertices that lie closer together than ``building.weld`` become one."""

import math

import numpy as np
import shapely

from evac.arrays import FloatArray, IndexArray
from evac.building.components import connected_components

#: A cluster of close vertices is merged into one where it reaches no farther than this, in units of the weld;
#: a longer one, such as a finely divided arc, is thinned: merged into one, it would lose its shape.
LARGEST_CLUSTER = 2.0

#: Close points are looked for in plan, sheared by so much per metre of height: many points may stand upon each other.
SHEAR = (0.367, 0.713)
#: Rounding errors of positions in plan, in units of the greatest coordinate.
ROUNDING = 1e-14


def weld_points(points: FloatArray, distance: float) -> tuple[FloatArray, IndexArray]:
    """Merge points that are close to each other.

    Parameters
    ----------
    points : (n, 3) float64 [m]
    distance : float [m]
        Points no farther apart become one; a point is moved by at most `LARGEST_CLUSTER` of it.

    Returns
    -------
    vertices : (v, 3) float64 [m]
        The least point of each cluster, in the order of (x, y, z).
    index : (n,) int64
        Vertex that each point became.
    """
    distinct, row = np.unique(points + 0.0, axis=0, return_inverse=True)  # + 0.0 turns -0.0 into 0.0
    pairs = close_pairs(distinct, distance)
    cluster = connected_components(len(distinct), pairs)
    _, least, cluster = np.unique(cluster, return_index=True, return_inverse=True)
    kept = least[cluster]  # row that each distinct point is merged into
    moved = np.linalg.norm(distinct - distinct[kept], axis=1)
    for number in np.unique(cluster[moved > LARGEST_CLUSTER * distance]):
        members = np.flatnonzero(cluster == number)
        kept[members] = members
        _thin(kept, pairs[cluster[pairs[:, 0]] == number])
    vertices, index = np.unique(kept, return_inverse=True)
    return distinct[vertices], index[row.ravel()]


def close_pairs(points: FloatArray, distance: float) -> IndexArray:
    """Return the pairs (p, 2) of points (n, 3) no farther apart than `distance` [m], the lower row first, in order."""
    sheared = shapely.points(points[:, :2] + points[:, 2:] * SHEAR)
    reach = distance * math.hypot(1.0, *SHEAR) + ROUNDING * float(np.abs(points).max())
    one, other = shapely.STRtree(sheared).query(sheared, predicate="dwithin", distance=reach)
    is_close = (one < other) & (((points[one] - points[other]) ** 2).sum(axis=1) <= distance**2)
    pairs = np.stack([one[is_close], other[is_close]], axis=1)
    return pairs[np.lexsort(pairs.T[::-1])]


def _thin(kept: IndexArray, pairs: IndexArray) -> None:
    """Let each point of `pairs`, which are in order, become the first one before it that is kept itself and close."""
    for one, other in pairs.tolist():
        if kept[one] == one and kept[other] == other:
            kept[other] = one
