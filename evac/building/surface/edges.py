"""Edges of a triangle mesh: the cells that share them, and chains of edges for portals, exits and walls."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from evac.base.arrays import FloatArray, IndexArray
from evac.base.errors import BuildingError

#: Corners at most this far from the straight line between their neighbours are removed [m].
COLLINEAR = 1e-4


@dataclass(frozen=True)
class EdgeTable:
    """All sides of all triangles, directed with the cell on their left."""

    ends: IndexArray  # (3 t, 2) int64
    cell: IndexArray  # (3 t,) int64
    partner: IndexArray  # (3 t,) int64: cell on the other side, -1 at a free edge


def edge_table(source: Path, vertices: FloatArray, triangles: IndexArray) -> EdgeTable:
    """Find the neighbouring cell across every edge."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    cell = np.tile(np.arange(len(triangles)), 3)
    least = np.sort(ends, axis=1)
    order = np.lexsort((cell, least[:, 1], least[:, 0]))
    same = (least[order[1:]] == least[order[:-1]]).all(axis=1)

    triple = np.flatnonzero(same[1:] & same[:-1])
    if len(triple):
        place = edge_place(vertices, least[order[triple[0]]])
        raise BuildingError(
            f"{source}: more than two cells share the edge {place}; an edge may join two cells only: cut the floor "
            "open where it passes under the foot of a stair"
        )
    one, other = order[:-1][same], order[1:][same]
    folded = (ends[one] == ends[other]).all(axis=1)
    if folded.any():
        place = edge_place(vertices, ends[one[folded][0]])
        raise BuildingError(
            f"{source}: the surface folds over itself at the edge {place}: both of its cells are on the same side in "
            "plan; put a landing there"
        )
    partner = np.full(len(ends), -1, dtype=np.int64)
    partner[one], partner[other] = cell[other], cell[one]
    return EdgeTable(ends, cell, partner)


def chains(vertices: FloatArray, ends: IndexArray) -> list[FloatArray]:
    """Join directed edges (e, 2) into chains, as plan segments (s, 4) [m] with collinear neighbours merged.

    A chain ends where the next edge is missing or ambiguous. A closed chain starts and ends at its smallest
    vertex, which is a corner. Chains are sorted by their vertices.
    """
    starts, lines = vertices[ends[:, 0], :2], []
    edges = shapely.multilinestrings(vertices[ends][:, :, :2])
    for line in shapely.get_parts(shapely.line_merge(edges, directed=True)):
        corners = shapely.get_coordinates(line)
        if (corners[0] == corners[-1]).all() and (starts == corners[0]).all(axis=1).sum() == 1:
            least = np.lexsort(corners[:-1].T[::-1])[0]
            corners = np.concatenate([corners[least:-1], corners[: least + 1]])
        lines.append(corners.tolist())
    whole = [shapely.LineString(line) for line in sorted(lines)]
    straight = shapely.simplify(whole, COLLINEAR, preserve_topology=False)
    return [np.concatenate([own[:-1], own[1:]], axis=1) for own in map(shapely.get_coordinates, straight)]


def edge_place(vertices: FloatArray, ends: IndexArray) -> str:
    """Describe the place of an edge, for a message."""
    return " - ".join(f"({x:z.2f}, {y:z.2f}, {z:z.2f})" for x, y, z in vertices[ends])
