"""A solid body of a building model, with its level faces and horizontal sections."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.building.geometry import GRID, flat_parts, rounded

#: A face is level if the vertical component of its unit normal exceeds this: slopes below 3 degrees.
LEVEL = float(np.cos(np.radians(3.0)))
#: Level faces whose heights differ by at most this are at the same height [m].
SAME_HEIGHT = 0.02
#: Grid to which plans of bodies are rounded [m]; corners closer together would be welded.
MILLIMETRE = 1e-3
#: Vertical component of the unit normal of sides that are vertical, at most: 0.3 mm in 3 m; the other two corners of a
#: triangle.
VERTICAL, OTHERS = 1e-4, np.array([[1, 2], [0, 2], [0, 1]])
#: Notches in outlines up to this depth are smoothed [m].
NOTCH = 2.5e-3


@dataclass(frozen=True, eq=False)
class Body:
    """A solid as a triangle mesh."""

    # space, slab, roof, wall, column, opening, door, window, stair, landing, furniture or lift; openings are holes in
    # walls
    kind: str
    name: str  # name in the file
    points: FloatArray  # (v, 3) float64 [m]
    triangles: IndexArray  # (t, 3) int64
    number: int = -1  # number in the file
    storey: str = ""  # name of the storey that a space belongs to, by the file
    fills: int = -1  # number of the opening that a door or window fills, by the file
    use: str = ""  # what a space is used for, by the file
    capacity: int = 0  # people whom a lift carries, by the file; 0 if it does not say
    load: float = 0.0  # mass that a lift carries, by the file [kg]; 0 if it does not say

    @cached_property
    def corners(self) -> FloatArray:
        """Corners (t, 3, 3) of the triangles, oriented so that normals point outwards [m]."""
        corners: FloatArray = self.points[self.triangles]
        away = corners - self.points.mean(axis=0)
        return corners if np.linalg.det(away).sum() >= 0.0 else corners[:, ::-1]

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals (t, 3); zero where a triangle has no area."""
        sides = self.corners[:, 1:] - self.corners[:, :1]
        normal = np.cross(sides[:, 0], sides[:, 1])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit: FloatArray = np.divide(normal, length, out=np.zeros_like(normal), where=length > 1e-12)
        return unit

    @cached_property
    def box(self) -> FloatArray:
        """Bounding box (2, 3): minimum and maximum coordinates [m]."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @property
    def z_min(self) -> float:
        """Height of the lowest point [m]."""
        return float(self.box[0, 2])

    @property
    def z_max(self) -> float:
        """Height of the highest point [m]."""
        return float(self.box[1, 2])

    @property
    def place(self) -> tuple[float, float]:
        """Centre (x, y) of the bounding box, for messages [m]."""
        x, y = self.box[:, :2].mean(axis=0).tolist()
        return x, y

    @cached_property
    def tops(self) -> list[tuple[BaseGeometry, float]]:
        """Level faces that point upwards: for each height, their union in plan and the height [m]."""
        return self._level_faces(self.normals[:, 2])

    def bottoms(self) -> list[tuple[BaseGeometry, float]]:
        """Return the level faces that point downwards, or all if the triangles are not oriented alike; see `tops`."""
        return self._level_faces(-self.normals[:, 2]) or self._level_faces(np.abs(self.normals[:, 2]))

    def _level_faces(self, upwards: FloatArray) -> list[tuple[BaseGeometry, float]]:
        rows = np.flatnonzero(upwards > LEVEL)
        height = self.corners[rows, :, 2].mean(axis=1)
        order = np.argsort(height, kind="stable")
        rows, height = rows[order], height[order]
        ends = np.flatnonzero(np.diff(height) > SAME_HEIGHT) + 1
        levels = []
        for group in np.split(np.arange(len(rows)), ends):
            plan = in_plan(self.corners[rows[group], :, :2])
            if not plan.is_empty:
                levels.append((plan, float(height[group].max())))
        return levels

    @cached_property
    def shadow(self) -> BaseGeometry:
        """Projection of the body onto the plan."""
        return in_plan(self.corners[:, :, :2])

    def sections(self, heights: Sequence[float]) -> list[BaseGeometry]:
        """Return the sections at heights [m], equal ones of vertical sides once; empty where the body is not closed."""
        found, known = list[BaseGeometry](), set[bytes]()
        for z in heights:
            above = self.corners[:, :, 2] > z
            cut = above.any(axis=1) & ~above.all(axis=1)
            is_prism = np.abs(self.normals[cut, 2]).max(initial=0.0) < VERTICAL
            if is_prism and above.tobytes() in known:
                continue
            known.add(above.tobytes())
            corners, is_above = self.corners[cut], above[cut]
            rows = np.arange(len(corners))
            lone = (is_above == (is_above.sum(axis=1) == 1)[:, None]).argmax(axis=1)
            start, others = corners[rows, None, lone], corners[rows[:, None], OTHERS[lone]]
            share = (z - start[..., 2:]) / (others[..., 2:] - start[..., 2:])
            lines = shapely.linestrings(np.round((start + share * (others - start))[..., :2], 4))
            found.append(flat_parts(shapely.build_area(shapely.union_all(lines))))
        return found

    def rectangle(self) -> FloatArray | None:
        """Return the corners (4, 2) of the minimum rotated rectangle, a long side first [m]; None if degenerate."""
        hull = shapely.minimum_rotated_rectangle(shapely.multipoints(self.points[:, :2]))
        if hull.geom_type != "Polygon":
            return None
        corners: FloatArray = shapely.get_coordinates(hull)[:4]
        sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
        return corners if sides[0] >= sides[1] else np.roll(corners, -1, axis=0)


def in_plan(triangles: FloatArray) -> BaseGeometry:
    """Return the union of triangles (t, 3, 2) in plan, without those that have an area by rounding alone."""
    if not len(triangles):
        return shapely.Polygon()
    polygons = shapely.polygons(rounded(triangles))
    whole = shapely.union_all(polygons[shapely.area(polygons) > GRID * shapely.length(polygons)])
    return flat_parts(shapely.set_precision(whole, GRID))


def closed(geometry: BaseGeometry, gap: float) -> BaseGeometry:
    """Close gaps and notches of polygons up to the width `gap` [m] (morphological closing)."""
    half = 0.5 * gap
    grown = shapely.buffer(geometry, half, join_style="mitre", mitre_limit=2.0)
    return shapely.buffer(grown, -half, join_style="mitre", mitre_limit=2.0)


def without_slivers(geometry: BaseGeometry, width: float) -> BaseGeometry:
    """Drop the parts of polygons that are nowhere wider than `width` [m]."""
    parts = shapely.get_parts(geometry)
    return flat_parts(shapely.multipolygons(parts[~shapely.is_empty(shapely.buffer(parts, -0.5 * width))]))


def snapped(geometry: BaseGeometry) -> BaseGeometry:
    """Round the corners of polygons to the grid of bodies, and smooth notches and holes of a few grid steps."""
    plan = shapely.set_precision(shapely.simplify(geometry, NOTCH), MILLIMETRE)
    rings = shapely.polygons(shapely.get_rings(shapely.get_parts(plan)))
    thin = rings[shapely.is_empty(shapely.buffer(rings, -NOTCH / 2))]
    return flat_parts(shapely.union_all([plan, *thin], grid_size=MILLIMETRE) if len(thin) else plan)
