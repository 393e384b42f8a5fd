"""Conversion of polygons in plan, each with its height, to a conforming triangle mesh."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray

#: Height of a surface [m]: a number, or a function of the plan position (x, y) for a slope.
Height = float | Callable[[float, float], float]
#: A point (x, y, z).
Point = tuple[float, float, float]

#: Decimals to which coordinates are rounded, and the corresponding distance below which points coincide.
DECIMALS, TOLERANCE = 6, 1e-6


@dataclass(frozen=True)
class Conforming:
    """Vertices, triangles and edges."""

    points: list[Point]  # list of (x, y, z)
    triangles: list[list[int]]  # list of [int, int, int]
    surface: list[int]  # row of the surface of each triangle
    chains: list[list[list[int]]]  # list of list of [int, int]: edges that each given edge was divided into


def conform(
    surfaces: Sequence[tuple[str, BaseGeometry, Height]], edges: Sequence[tuple[str, Point, Point]]
) -> Conforming:
    """Triangulate polygons such that neighbours share their edges.

    Wherever a corner of one surface, or an end of an edge, lies on the side of another surface at the same height, both
    get a vertex there, so that there are no hanging nodes.

    Parameters
    ----------
    surfaces : sequence of (name, polygon or multipolygon, height)
        The names are for messages.
    edges : sequence of (name, start, end)
        Straight lines along the sides of surfaces.

    Raises
    ------
    ValueError
        A surface is not a valid polygon, or an edge is not on any surface; names the item and the place.
    """
    for name, plan, _ in surfaces:
        fault = "" if plan.is_valid else shapely.is_valid_reason(plan)
        if plan.is_empty or plan.geom_type not in ("Polygon", "MultiPolygon"):
            fault = f"it is {'empty' if plan.is_empty else f'a {plan.geom_type}'}"
        if fault:
            raise ValueError(f"the surface {name!r} must be a polygon whose sides do not cross: {fault}")
    corners = _Corners(
        [point for _, start, end in edges for point in (start, end)]
        + [_lifted(x, y, height) for _, plan, height in surfaces for x, y in shapely.get_coordinates(plan)]
    )
    points: dict[Point, int] = {}
    triangles: list[list[int]] = []
    surface: list[int] = []
    for row, (_, plan, height) in enumerate(surfaces):
        pieces = _triangles(plan, height, corners)
        triangles += [[points.setdefault(point, len(points)) for point in piece] for piece in pieces]
        surface += [row] * len(pieces)
    chains = []
    for name, start, end in edges:
        chain = [_rounded(point) for point in corners.split([(start, end)])[0]] + [_rounded(end)]
        for x, y, z in chain:
            if (x, y, z) not in points:
                raise ValueError(
                    f"the edge {name!r}: its point ({x:z.2f}, {y:z.2f}, {z:z.2f}) is not on any surface; move it to one"
                )
        chains.append([[points[one], points[other]] for one, other in pairwise(chain)])
    return Conforming(list(points), triangles, surface, chains)


class _Corners:
    """The distinct corners of a drawing, searchable by the sides that they lie on."""

    def __init__(self, points: Iterable[Point]) -> None:
        self._points: FloatArray = np.unique(np.round(list(points), DECIMALS).reshape(-1, 3), axis=0) + 0.0
        self._tree = shapely.STRtree(shapely.points(self._points[:, :2]))

    def split(self, sides: Sequence[tuple[Point, Point]]) -> list[list[Point]]:
        """Return, for each side, its start and the corners between its ends, in order."""
        ends = np.array(sides, dtype=np.float64)
        rows, corners = self._tree.query(shapely.linestrings(ends[:, :, :2]), "dwithin", distance=10.0 * TOLERANCE)
        origin, along = ends[rows, 0], ends[rows, 1] - ends[rows, 0]
        step = self._points[corners] - origin
        square = (along * along).sum(axis=1)
        share = np.divide((step * along).sum(axis=1), square, out=np.zeros(len(rows)), where=square > 0.0)
        off = np.linalg.norm(step - share[:, None] * along, axis=1)
        on = (off < TOLERANCE) & (share > TOLERANCE) & (share < 1.0 - TOLERANCE)
        split = [[side[0]] for side in sides]
        for k in np.flatnonzero(on)[np.lexsort((share[on], rows[on]))]:
            x, y, z = self._points[corners[k]].tolist()
            split[rows[k]].append((x, y, z))
        return split


def _triangles(plan: BaseGeometry, height: Height, corners: _Corners) -> list[list[Point]]:
    """Triangulate a surface; every corner of the drawing on its sides becomes a vertex."""
    triangles = []
    for polygon in shapely.get_parts(shapely.normalize(plan)):
        rings = []
        for ring in (polygon.exterior, *polygon.interiors):
            lifted = [_lifted(x, y, height) for x, y in shapely.get_coordinates(ring)]
            sides = corners.split(list(pairwise(lifted)))
            rings.append([(x, y) for side in sides for x, y, _ in side])
        try:
            pieces = shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:]))
        except shapely.GEOSException as error:
            x, y = rings[-1][0]
            raise ValueError(
                f"the ground at ({x:z.2f}, {y:z.2f}) cannot be triangulated ({error}): parts of its outline are too "
                "close to each other there; repair the outline"
            ) from error
        for triangle in shapely.get_parts(pieces):
            triangles.append([_lifted(x, y, height) for x, y in triangle.exterior.coords[:3]])
    return triangles


def _rounded(point: Point) -> Point:
    x, y, z = (round(float(value), DECIMALS) + 0.0 for value in point)
    return x, y, z


def _lifted(x: float, y: float, height: Height) -> Point:
    return _rounded((x, y, height(x, y) if callable(height) else height))
