"""Heights of the ground, and points, triangles and velocities in space."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building, Level

PLANE = 1e-9  #: Largest distance of the vertices of a level from a plane for which it is treated as one plane [m].
Ground = Callable[[FloatArray], FloatArray]  #: Gives the heights (n,) of points (n, 2) on a level [m].


def elevation(building: Building, level: ArrayLike, position: ArrayLike) -> FloatArray:
    """Return the heights (n,) [m] of points (n, 2) [m] on levels (n,); NaN where the level is -1.

    Heights are exact on cells; beyond the edge of a level, the plane of the nearest cell is extrapolated.
    """
    grounds = [partial(level_elevation, building.vertices, one) for one in building.levels]
    return heights_on(grounds, np.asarray(level), np.asarray(position, np.float64))


def heights_on(grounds: Sequence[Ground], level: IntArray, position: FloatArray) -> FloatArray:
    """Return the heights (n,) of points, as `elevation`, on the grounds of all levels, see `ground_of`."""
    height = np.full(len(position), np.nan)
    for index in np.unique(level[level >= 0]).tolist():
        here = level == index
        height[here] = grounds[index](position[here])
    return height


def on_level(building: Building, level: ArrayLike, plan: ArrayLike) -> FloatArray:
    """Return points in plan (n, 2) on a level, or on one level each (n,), as points in space (n, 3) [m]."""
    points = np.asarray(plan, np.float64)
    return np.column_stack([points, elevation(building, np.broadcast_to(level, len(points)), points)])


def triangles_on(building: Building, level: int, shape: BaseGeometry) -> FloatArray:
    """Return the corners (3 t, 3) [m] of triangles that cover a shape in plan on a level."""
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(shape))
    return on_level(building, level, np.concatenate([shapely.get_coordinates(piece)[:3] for piece in pieces]))


def gradients(building: Building) -> FloatArray:
    """Return the rise of each level per metre along x and y, (levels, 2)."""
    return np.array([np.tan(level.slope) * level.uphill for level in building.levels]).reshape(-1, 2)


def in_space(gradient: FloatArray, level: IntArray, velocity: FloatArray) -> FloatArray:
    """Return velocities in space (n, 3) of people on levels (n,) with velocities in plan (n, 2), see `gradients`."""
    return np.column_stack([velocity, np.einsum("ij,ij->i", velocity, gradient[level])])


def level_elevation(vertices: FloatArray, level: Level, position: FloatArray) -> FloatArray:
    """Return the heights (n,) of points (n, 2) on one level [m]; see `elevation`."""
    return ground_of(vertices, level)(position)


def ground_of(vertices: FloatArray, level: Level) -> Ground:
    """Return a function that gives the heights (n,) of points (n, 2) on one level [m]; see `elevation`."""
    own = vertices[np.unique(level.triangles)]
    gradient = np.tan(level.slope) * level.uphill
    off = own[:, 2] - own[0, 2] - (own[:, :2] - own[0, :2]) @ gradient
    if np.abs(off).max() <= PLANE:
        return partial(_on_plane, own[0], gradient)
    corners = vertices[level.triangles]
    return partial(_on_cells, corners, shapely.STRtree(shapely.polygons(corners[:, :, :2])))


def _on_plane(corner: FloatArray, gradient: FloatArray, position: FloatArray) -> FloatArray:
    """Return the heights of points on the plane through a corner (3,) with a gradient (2,)."""
    height: FloatArray = corner[2] + (position - corner[:2]) @ gradient
    return height


def _on_cells(corners: FloatArray, cells: shapely.STRtree, position: FloatArray) -> FloatArray:
    """Return the heights of points on the nearest of the cells with these corners (t, 3, 3)."""
    a, b, c = corners[cells.nearest(shapely.points(position))].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    height: FloatArray = a[:, 2] - ((position - a[:, :2]) * normal[:, :2]).sum(axis=1) / normal[:, 2]
    return height
