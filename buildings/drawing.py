"""Draw a building's walkable surfaces as polygons and write them as one conforming, tagged triangle mesh."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

#: Height of a surface [m]: one number, or a function of the plan position (x, y) for a slope.
Height = float | Callable[[float, float], float]

_Point = tuple[float, float, float]
_TOLERANCE = 1e-6


class Drawing:
    """Tagged surfaces and edges that become one mesh.

    Wherever a corner of one surface lies on the side of another at the same height, both get a vertex
    there, so that neighbours share their edges and no node hangs.
    """

    def __init__(self) -> None:
        self._surfaces: list[tuple[str, BaseGeometry, Height]] = []
        self._edges: list[tuple[str, _Point, _Point]] = []

    def surface(self, tag: str, plan: BaseGeometry, height: Height = 0.0) -> None:
        """Add a surface: its physical name, its plan (polygon or multipolygon, holes allowed) and its height [m]."""
        self._surfaces.append((tag, plan, height))

    def edge(self, tag: str, start: tuple[float, float], end: tuple[float, float], height: float = 0.0) -> None:
        """Add a named edge on the side of a surface, such as an exit."""
        self._edges.append((tag, (*start, height), (*end, height)))

    def write(self, path: Path) -> None:
        """Triangulate and write a Gmsh 2.2 ASCII file with the tags as physical groups.

        Every call on the same drawing writes the same bytes.

        Raises
        ------
        ValueError
            An edge is not on a surface; names the edge and the point.
        """
        import meshio

        corners = self._corners()
        points: dict[_Point, int] = {}
        groups: dict[tuple[str, int], list[list[int]]] = {}
        for tag, plan, height in self._surfaces:
            cells = groups.setdefault((tag, 2), [])
            for triangle in _triangles(plan, height, corners):
                cells.append([points.setdefault(point, len(points)) for point in triangle])
        for tag, start, end in self._edges:
            chain = []
            for point in map(_rounded, _split(start, end, corners)):
                if point not in points:
                    raise ValueError(f"edge {tag!r}: its point {point} is on no surface at that height; draw one there")
                chain.append(points[point])
            groups.setdefault((tag, 1), []).extend([a, b] for a, b in pairwise(chain))
        numbers = [np.full(len(cells), i + 1, dtype=np.int32) for i, cells in enumerate(groups.values())]
        mesh = meshio.Mesh(
            np.array(list(points)),
            [("triangle" if dim == 2 else "line", np.array(cells)) for (_, dim), cells in groups.items()],
            cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
            field_data={tag: np.array([i + 1, dim]) for i, (tag, dim) in enumerate(groups)},
        )
        meshio.write(path, mesh, file_format="gmsh22", binary=False)

    def _corners(self) -> NDArray[np.float64]:
        """Return every corner of the drawing, (n, 3) float64 [m], none twice."""
        corners = [point for _, start, end in self._edges for point in (start, end)]
        for _, plan, height in self._surfaces:
            corners += [_lifted(x, y, height) for x, y in shapely.get_coordinates(plan)]
        return np.unique(np.round(corners, 6), axis=0)


def _rounded(point: _Point) -> _Point:
    x, y, z = (round(float(value), 6) + 0.0 for value in point)
    return x, y, z


def _lifted(x: float, y: float, height: Height) -> _Point:
    return _rounded((x, y, height(x, y) if callable(height) else height))


def _split(start: _Point, end: _Point, corners: NDArray[np.float64]) -> list[_Point]:
    """Return the segment's ends and the corners that lie on it, in order."""
    origin, along = np.asarray(start), np.asarray(end) - np.asarray(start)
    share = (corners - origin) @ along / (along @ along)
    off = np.linalg.norm(corners - origin - share[:, None] * along, axis=1)
    on = (off < _TOLERANCE) & (share > _TOLERANCE) & (share < 1.0 - _TOLERANCE)
    between = corners[on][np.argsort(share[on])]
    return [start, *((float(x), float(y), float(z)) for x, y, z in between), end]


def _triangles(plan: BaseGeometry, height: Height, corners: NDArray[np.float64]) -> list[list[_Point]]:
    """Return the triangles of a surface, every corner of the drawing on its sides being a vertex."""
    triangles = []
    for polygon in shapely.get_parts(shapely.normalize(plan)):
        rings = [_dense_ring(ring, height, corners) for ring in (polygon.exterior, *polygon.interiors)]
        pieces = shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:]))
        for triangle in shapely.get_parts(pieces):
            triangles.append([_lifted(x, y, height) for x, y in triangle.exterior.coords[:3]])
    return triangles


def _dense_ring(ring: BaseGeometry, height: Height, corners: NDArray[np.float64]) -> list[tuple[float, float]]:
    lifted = [_lifted(x, y, height) for x, y in ring.coords]
    return [(x, y) for start, end in pairwise(lifted) for x, y, _ in _split(start, end, corners)[:-1]]
