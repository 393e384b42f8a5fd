"""Polygons in plan: triangulation independent of orientation, areas, and robust unions."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray

#: Polygons whose unit normal has a smaller vertical component are upright (walls); their plan outline is not checked.
UPRIGHT = 0.2
#: Grid on which polygons are united that do not share their sides [m].
SNAP = 1e-8


def triangulate(points: FloatArray, polygons: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Triangulate polygons with k corners each.

    Polygons that are convex in plan become fans around their first corner in the order of (x, y, z);
    others are divided by a constrained Delaunay triangulation.

    Parameters
    ----------
    points : (v, 3) float64
    polygons : (n, k) int64

    Returns
    -------
    triangles : (t, 3) int64
    owner : (t,) int64
        Row of `polygons` of each triangle.
    """
    n, k = polygons.shape
    if k == 3:
        return polygons, np.arange(n)
    polygons = _start_at_least(points, polygons)
    plan = points[polygons][:, :, :2]
    step = np.roll(plan, -1, axis=1) - plan
    following = np.roll(step, -1, axis=1)
    turn = step[..., 0] * following[..., 1] - step[..., 1] * following[..., 0]
    rounding = 1e-9 * np.square(step).sum(axis=2).max(axis=1, keepdims=True)
    is_convex = (turn >= -rounding).all(axis=1) | (turn <= rounding).all(axis=1)

    fans = np.stack([polygons[:, [0, i, i + 1]] for i in range(1, k - 1)], axis=1)[is_convex]
    triangles = [fans.reshape(-1, 3)]
    owner = [np.repeat(np.flatnonzero(is_convex), k - 2)]
    for row in np.flatnonzero(~is_convex):
        pieces = _delaunay(points, polygons[row])
        triangles.append(pieces)
        owner.append(np.full(len(pieces), row))
    return np.concatenate(triangles), np.concatenate(owner)


def least_height(corners: FloatArray) -> FloatArray:
    """Return the smallest heights (t,) of triangles (t, 3, 3), zero where corners coincide [m]."""
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    twice_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    height: FloatArray = np.divide(twice_area, longest, out=np.zeros(len(corners)), where=longest > 0)
    return height


def plan_area(corners: FloatArray) -> FloatArray:
    """Return the unsigned areas in plan (t,) of triangles (t, 3, 3) [m2]."""
    one, other = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    area: FloatArray = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    return area


def union(polygons: Sequence[BaseGeometry] | NDArray[np.object_]) -> BaseGeometry:
    """Return the union of polygons: exact if they share their sides, as cells do, else on a grid.

    Without a grid, GEOS may omit a polygon if vertices of its neighbour are a rounding error away from its side.
    """
    if shapely.coverage_is_valid(polygons):
        return shapely.coverage_union_all(polygons)
    return shapely.union_all(polygons, grid_size=SNAP)


def _start_at_least(points: FloatArray, polygons: IndexArray) -> IndexArray:
    """Rotate and flip the corners so that the smallest one comes first and its smaller neighbour second."""
    k = polygons.shape[1]
    rank = np.empty(len(points), dtype=np.int64)
    rank[np.lexsort(points.T[::-1])] = np.arange(len(points))
    first = rank[polygons].argmin(axis=1)
    turned = np.take_along_axis(polygons, (first[:, None] + np.arange(k)) % k, axis=1)
    flip = rank[turned[:, 1]] > rank[turned[:, -1]]
    turned[flip, 1:] = turned[flip, :0:-1]
    return turned


def _delaunay(points: FloatArray, polygon: IndexArray) -> IndexArray:
    """Triangulate a non-convex polygon."""
    plan = points[polygon, :2]
    outline = shapely.Polygon(plan)
    if not outline.is_valid:
        corners = points[polygon] - points[polygon[0]]
        normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)  # Newell's method
        if abs(normal[2]) < UPRIGHT * float(np.linalg.norm(normal)):
            return np.array([polygon[[0, i, i + 1]] for i in range(1, len(polygon) - 1)])
        x, y, z = points[polygon[0]]
        raise ValueError(f"the outline of the polygon at ({x:z.2f}, {y:z.2f}, {z:z.2f}) crosses itself in plan")
    corner_at = {(x, y): corner for (x, y), corner in zip(plan.tolist(), polygon.tolist(), strict=True)}
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(outline))
    return np.array([[corner_at[xy] for xy in piece.exterior.coords[:3]] for piece in pieces], dtype=np.int64)
