"""Merging of vertices that are closer together than ``building.weld``."""

import math

import numpy as np
import shapely

from evac.base.arrays import FloatArray, IndexArray
from evac.building.geometry.components import connected_components

#: Maximum extent of a cluster of close vertices that is merged into one vertex, in units of the weld. A larger cluster,
#: such as a finely divided arc, is thinned instead, to preserve its shape.
LARGEST_CLUSTER = 2.0

#: Shear of plan coordinates per metre of height, so that points above each other do not coincide in the plan search.
SHEAR = (0.367, 0.713)
#: Rounding errors of positions in plan, relative to the largest coordinate.
ROUNDING = 1e-14


def weld_points(points: FloatArray, distance: float) -> tuple[FloatArray, IndexArray]:
    """Merge points that are close to each other.

    Parameters
    ----------
    points : (n, 3) float64 [m]
    distance : float [m]
        Points at most this far apart are merged; a point is moved by at most `LARGEST_CLUSTER` times this.

    Returns
    -------
    vertices : (v, 3) float64 [m]
        The first point of each cluster in the order of (x, y, z).
    index : (n,) int64
        Row in `vertices` of each point.
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
        for one, other in pairs[cluster[pairs[:, 0]] == number].tolist():
            if kept[one] == one and kept[other] == other:  # the first close point before it that is kept
                kept[other] = one
    vertices, index = np.unique(kept, return_inverse=True)
    return distinct[vertices], index[row.ravel()]


def close_pairs(points: FloatArray, distance: float) -> IndexArray:
    """Return the sorted pairs (p, 2) of points (n, 3) at most `distance` apart [m], with the lower row first."""
    sheared = shapely.points(points[:, :2] + points[:, 2:] * SHEAR)
    reach = distance * math.hypot(1.0, *SHEAR) + ROUNDING * float(np.abs(points).max())
    one, other = shapely.STRtree(sheared).query(sheared, predicate="dwithin", distance=reach)
    is_close = (one < other) & (((points[one] - points[other]) ** 2).sum(axis=1) <= distance**2)
    pairs = np.stack([one[is_close], other[is_close]], axis=1)
    return pairs[np.lexsort(pairs.T[::-1])]
