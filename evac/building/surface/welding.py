"""Welding of vertices, and splitting of cells at vertices that hang on their edges."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.base.errors import BuildingError
from evac.building.geometry import connected_components, least_height, points_on

#: Maximum extent of a cluster of close vertices that is merged into one vertex, in units of the weld. A larger cluster,
#: such as a finely divided arc, is thinned instead, to preserve its shape.
LARGEST_CLUSTER = 2.0

#: Shear of plan coordinates per metre of height, so that points above each other do not coincide in the plan search.
SHEAR = (0.367, 0.713)
ROUNDING = 1e-14  #: Rounding errors of positions in plan, relative to the largest coordinate.


def weld_points(points: FloatArray, distance: float) -> tuple[FloatArray, IndexArray]:
    """Merge points (n, 3) that are at most `distance` apart [m], moved by at most `LARGEST_CLUSTER` times this.

    Returns the first point of each cluster in the order of (x, y, z), (v, 3), and the row in these of each point.
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


def welded(shapes: Sequence[BaseGeometry], distance: float) -> NDArray[np.object_]:
    """Merge the corners of shapes in plan that are at most a given distance apart [m]."""
    corners = shapely.get_coordinates([*shapes])
    vertices, index = weld_points(np.column_stack([corners, np.zeros(len(corners))]), distance)
    return np.asarray(shapely.set_coordinates(np.array([*shapes], dtype=object), vertices[index][:, :2]))


def close_pairs(points: FloatArray, distance: float) -> IndexArray:
    """Return the sorted pairs (p, 2) of points (n, 3) at most `distance` apart [m], with the lower row first."""
    sheared = shapely.points(points[:, :2] + points[:, 2:] * SHEAR)
    reach = distance * math.hypot(1.0, *SHEAR) + ROUNDING * float(np.abs(points).max())
    one, other = shapely.STRtree(sheared).query(sheared, predicate="dwithin", distance=reach)
    is_close = (one < other) & (((points[one] - points[other]) ** 2).sum(axis=1) <= distance**2)
    pairs = np.stack([one[is_close], other[is_close]], axis=1)
    return pairs[np.lexsort(pairs.T[::-1])]


Hanging = dict[tuple[int, int], list[int]]  #: The vertices on each edge (a, b), a < b, in their order from a to b.


#: Largest number of rounds of splitting. One is enough for most meshes; an edge split at a vertex that is slightly off
#: it moves, so that other vertices may then lie on its parts.
MOST_ROUNDS = 16
#: After so many rounds, narrow parts are kept: without them, vertices may lie on a side again in every second round.
PATIENCE = 12


def split_at_vertices(
    source: Path, vertices: FloatArray, triangles: IndexArray, edges: dict[str, IndexArray], distance: float
) -> tuple[IndexArray, IndexArray, dict[str, IndexArray]]:
    """Split free edges and tagged edges at the vertices that lie on them.

    Parts of a cell whose smallest height is at most `distance` are dropped, since the neighbour is then split at their
    vertices and takes their place; where that does not end, they are kept.

    `vertices` (v, 3) [m]: farther apart than `distance`; `triangles` (t, 3); `edges` (e, 2): tagged edges; `distance`
    [m]: largest distance of a vertex from an edge that it splits. Returns `triangles` (s, 3); `owner` (s,): row of the
    original triangle of each triangle; `edges` (e, 2).
    """
    owner, rounding = np.arange(len(triangles)), ROUNDING * float(np.abs(vertices).max())
    for turn in range(MOST_ROUNDS):
        hanging = _hanging_vertices(vertices, triangles, edges, distance)
        if not hanging:
            return triangles, owner, edges
        pieces: list[tuple[int, int, int]] = []
        cut_from: list[int] = []
        for row, (a, b, c) in enumerate(triangles.tolist()):
            parts = _split_triangle(a, b, c, _on_sides(vertices, (a, b, c), hanging))
            pieces += parts
            cut_from += [row] * len(parts)
        triangles, owner = np.array(pieces, dtype=np.int64), owner[cut_from]
        is_wide = least_height(vertices[triangles]) > (distance if turn < PATIENCE else rounding)
        if not is_wide.any():
            break
        triangles, owner = triangles[is_wide], owner[is_wide]
        edges = {
            name: np.array([part for a, b in pairs.tolist() for part in _parts(a, b, hanging)], dtype=np.int64)
            for name, pairs in edges.items()
        }
    x, y, z = vertices[min(min(on) for on in hanging.values())]
    raise BuildingError(
        f"{source}: splitting cells at vertices on their sides does not end around ({x:z.2f}, {y:z.2f}, {z:z.2f}): "
        f"several vertices are nearly within building.weld ({distance:g} m) of one side; repair the mesh there, set "
        "building.scale, or decrease building.weld"
    )


def _hanging_vertices(
    vertices: FloatArray, triangles: IndexArray, edges: dict[str, IndexArray], distance: float
) -> Hanging:
    """Find the vertices that lie on free edges and on tagged edges."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    sides, uses = np.unique(sides, axis=0, return_counts=True)
    tagged = [np.sort(pairs, axis=1) for pairs in edges.values()]
    used = np.unique(np.concatenate([triangles.ravel(), *(pairs.ravel() for pairs in tagged)]))
    lines = np.unique(np.concatenate([sides[uses == 1], *tagged]), axis=0)
    hanging: Hanging = {}
    tree = shapely.STRtree(shapely.points(vertices[used, :2]))
    for row, point in zip(*points_on(vertices[used], tree, vertices[lines], distance), strict=True):
        hanging.setdefault(tuple(lines[row].tolist()), []).append(int(used[point]))
    return hanging


def _on_sides(vertices: FloatArray, corners: tuple[int, int, int], hanging: Hanging) -> Hanging:
    """Return the vertices on the sides of one triangle, each assigned to the nearest side only."""
    sides = itertools.combinations(sorted(corners), 2)
    own = {side: [p for p in hanging[side] if p not in corners] for side in sides if side in hanging}
    if len(own) > 1:
        for p in set[int]().union(*own.values()):
            on = [side for side in own if p in own[side]]
            nearest = min(on, key=lambda side: _distance(vertices, p, side))
            for side in on:
                if side != nearest:
                    own[side].remove(p)
    return own


def _distance(vertices: FloatArray, p: int, edge: tuple[int, int]) -> float:
    """Return the distance of vertex `p` from the line through an edge [m]."""
    a, b = vertices[list(edge)]
    return float(np.linalg.norm(np.cross(b - a, vertices[p] - a)) / np.linalg.norm(b - a))


def _parts(a: int, b: int, hanging: Hanging) -> list[tuple[int, int]]:
    """Divide the edge from a to b at the vertices on it."""
    between = hanging.get((min(a, b), max(a, b)), [])
    return list(itertools.pairwise([a, *(between if a < b else between[::-1]), b]))


def _split_triangle(a: int, b: int, c: int, hanging: Hanging) -> list[tuple[int, int, int]]:
    """Split a triangle at the vertices on its sides: a fan from c over side ab, whose outer cells are split further."""
    for _ in range(3):
        if len(_parts(a, b, hanging)) > 1:
            break
        a, b, c = b, c, a
    else:
        return [(a, b, c)]
    (_, p), *inner, (q, _) = _parts(a, b, hanging)
    first = [(r, s, p) for r, s in _parts(c, a, hanging)]
    last = [(r, s, q) for r, s in _parts(b, c, hanging)]
    return [*first, *((r, s, c) for r, s in inner), *last]
