"""Plane patches of a mesh: coplanar cells joined to a polygon in plan, and triangulated again."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.building.geometry import GRID, LEAST_AREA, below, connected_components, flat_parts

#: Tolerances for coplanar cells: of their slopes, and of their heights at the origin of the patch [m].
SAME_RISE, SAME_HEIGHT = 1e-3, 2e-3


@dataclass(frozen=True)
class Patch:
    """Adjacent coplanar cells of one body with the same tags."""

    body: int  # vertex-connected component of the mesh that the patch belongs to
    tags: frozenset[str]
    plan: BaseGeometry  # shapely polygon or multipolygon [m]
    rise: FloatArray  # (2,) float64: gradient (dz/dx, dz/dy)
    z: float  # [m]: height of the plane at x = y = 0

    @property
    def is_flat(self) -> bool:
        """Whether the patch is horizontal."""
        return bool(np.hypot(*self.rise) < SAME_RISE)

    def height(self, points: FloatArray) -> FloatArray:
        """Return the heights (n,) of points (n, 2) [m]."""
        heights: FloatArray = self.z + points @ self.rise
        return heights

    def height_at(self, x: float, y: float) -> float:
        """Return the height of a point [m]."""
        return float(self.z + self.rise @ (x, y))

    def without(self, away: BaseGeometry) -> "Patch":
        """Return the patch without a part of its plan."""
        return replace(self, plan=flat_parts(shapely.difference(self.plan, away, grid_size=GRID)))

    def over(self, other: "Patch", least: float, most: float) -> BaseGeometry:
        """Return the polygon where this patch is between `least` and `most` [m] above another one."""
        rise, z = self.rise - other.rise, self.z - other.z
        boxes = np.reshape([self.plan.bounds, other.plan.bounds], (2, 2, 2))
        ends = z + np.sort(rise * [boxes[:, 0].max(axis=0), boxes[:, 1].min(axis=0)], axis=0).sum(axis=1)
        if ends[1] < least or ends[0] > most:
            return shapely.Polygon()
        common = flat_parts(shapely.intersection(self.plan, other.plan, grid_size=GRID))
        if common.is_empty:
            return common
        room = z + shapely.get_coordinates(common) @ rise
        if room.min() >= least and room.max() <= most:
            return common
        if room.max() <= least or room.min() >= most:
            return shapely.Polygon()

        def apart(x: float, y: float) -> float:
            return float(z + rise[0] * x + rise[1] * y)

        part = below(common, apart, most) if room.max() > most else common
        if room.min() < least:
            part = shapely.difference(part, below(common, apart, least))
        return flat_parts(part)


def patches_of(points: FloatArray, triangles: IndexArray, body: IndexArray, tags: dict[str, np.ndarray]) -> list[Patch]:
    """Join cells (t, 3), none upright, of bodies (t,) and with tags (t,) to patches, sorted by place."""
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rise = -normal[:, :2] / normal[:, 2:]
    origin = points[:, :2].mean(axis=0)
    z = corners[:, 0, 2] - ((corners[:, 0, :2] - origin) * rise).sum(axis=1)
    own = np.stack([*tags.values()], axis=1) if tags else np.zeros((len(triangles), 0), dtype=bool)
    keys = np.column_stack([body, own, np.round(rise / SAME_RISE), np.round(z / SAME_HEIGHT)]).astype(np.int64)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    patches = []
    for number in range(int(group.max(initial=-1)) + 1):
        rows = np.flatnonzero(group.ravel() == number)
        plans = shapely.polygons(corners[rows][:, :, :2])
        joined = flat_parts(shapely.union_all(plans, grid_size=GRID))
        first = rows[0]
        height = float(corners[first, 0, 2] - corners[first, 0, :2] @ rise[first])
        names = frozenset(name for k, name in enumerate(tags) if own[first, k])
        patches += [
            Patch(int(body[first]), names, part, rise[first] + 0.0, height)
            for part in shapely.get_parts(joined)
            if part.area > LEAST_AREA
        ]
    return sorted(patches, key=lambda patch: (patch.z, *patch.plan.bounds, patch.body))


def bodies(count: int, triangles: IndexArray) -> IndexArray:
    """Return the body index of each cell: cells that share vertices, but closed bodies that touch are told apart."""
    part: IndexArray = connected_components(count, np.concatenate([triangles[:, :2], triangles[:, 1:]]))[
        triangles[:, 0]
    ]
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    _, edge, uses = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    pairs = order[np.isin(edge.ravel()[order], np.flatnonzero(uses == 2))].reshape(-1, 2) // 3
    shell = connected_components(len(triangles), pairs)
    is_open = np.isin(part, part[~np.isin(shell, list(closed_bodies(triangles, shell)))])
    return np.unique(np.where(is_open, part, count + shell), return_inverse=True)[1]


def closed_bodies(triangles: IndexArray, body: IndexArray) -> set[int]:
    """Return the bodies that enclose a volume: all of their edges have an even number of cells."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    own = np.repeat(body, 3)
    _, row, uses = np.unique(np.column_stack([own, sides]), axis=0, return_inverse=True, return_counts=True)
    return set(body.tolist()) - set(own[uses[row.ravel()] % 2 == 1].tolist())
