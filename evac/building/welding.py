"""Vertices that lie closer together than ``building.weld`` become one."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from evac.arrays import FloatArray, IndexArray

#: A cluster of close vertices is merged into one where it reaches no farther than this, in units of the weld;
#: a longer one, such as a finely divided arc, is thinned: merged into one, it would lose its shape.
LARGEST_CLUSTER = 2.0


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
    pairs = cKDTree(distinct).query_pairs(distance, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(distinct), len(distinct)))
    _, cluster = connected_components(links, directed=False)
    _, least, cluster = np.unique(cluster, return_index=True, return_inverse=True)
    kept = least[cluster]  # row that each distinct point is merged into
    moved = np.linalg.norm(distinct - distinct[kept], axis=1)
    for number in np.unique(cluster[moved > LARGEST_CLUSTER * distance]):
        members = np.flatnonzero(cluster == number)
        kept[members] = members[_thinned(distinct[members], distance)]
    vertices, index = np.unique(kept, return_inverse=True)
    return distinct[vertices], index[row.ravel()]


def _thinned(points: FloatArray, distance: float) -> IndexArray:
    """Return for each of some sorted points the first one before it that is kept within `distance`, or itself."""
    near = cKDTree(points).query_ball_point(points, distance, return_sorted=True)
    kept = np.full(len(points), -1, dtype=np.int64)
    for row, around in enumerate(near):
        if kept[row] < 0:
            around = np.array(around)
            kept[around[kept[around] < 0]] = row
    return kept
