"""Size of a building in its file, its unit and axis, and the resolution of its coordinates."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.defaults import FARTHEST, WELD
from evac.base.errors import BuildingError
from evac.building.geometry import plan_area
from evac.building.model.findings import Finding
from evac.building.surface.foreign import turned
from evac.building.surface.patches import bodies
from evac.building.surface.surfacemesh import TriangleMesh

#: Axis that points upwards.
Axis = Literal["z", "y"]
#: Maximum extent of a building [m].
MOST_EXTENT = 1e5
#: Minimum width of a building [m], in its larger direction: nobody fits into a smaller one.
LEAST_WIDTH = 0.5
#: Range of plausible extents of a building [m]; others cause a warning.
SMALLEST, LARGEST = 2.0, 5e3
#: Units that are tried for meshes, and heights and thicknesses of walls that are believed [m].
WALL_UNITS, TALL, THICK = (0.3048, 0.001, 0.01, 0.0254), (2.1, 5.0), (0.1, 0.6)
#: Cosine of the slope of level faces, and how much larger upright ones towards y may be before the axes are doubted,
#: and must be before they are turned because of the walls.
LEVEL, MOST_UPRIGHT, LEAST_UPRIGHT = 0.998, 3.0, 2.0
#: Factors between length units that drawings and exporters confuse, the most likely first.
FACTORS = (0.001, 0.01, 0.0254, 0.3048, 1000.0, 100.0, 1.0 / 0.0254, 1.0 / 0.3048)


def is_plausible(extent: float) -> bool:
    """Return whether a building may extend so far [m]."""
    return SMALLEST <= extent <= LARGEST


def helpful_factor(extent: float) -> float | None:
    """Return the factor that makes an implausible extent [m] plausible; None if it is plausible or no factor helps."""
    if is_plausible(extent):
        return None
    return next((factor for factor in FACTORS if is_plausible(factor * extent)), None)


def check_extent(mesh: TriangleMesh, points: FloatArray, scale: float) -> list[Finding]:
    """Refuse buildings too large, too small or too far from the origin; warn of those of an unusual size."""
    used = points[mesh.triangles.ravel()]
    low, high = used.min(axis=0), used.max(axis=0)
    width, depth, height = (high - low).tolist()
    extent = f"the building measures {width:.4g} x {depth:.4g} m in plan, {height:.4g} m in height"
    factor = helpful_factor(max(width, depth))
    if factor is not None and is_plausible(max(width, depth) / scale):
        factor = 1.0 / scale  # the usual mistake in a file that is drawn in metres
    helps = "" if factor is None else f" = {factor * scale:.4g}"
    is_far = (high - low).max() > MOST_EXTENT or max(np.abs(low).max(), np.abs(high).max()) > FARTHEST
    if is_far or max(width, depth) < LEAST_WIDTH:
        raise BuildingError(
            f"{mesh.source}: {extent}, and begins at ({low[0]:.4g}, {low[1]:.4g}, {low[2]:.4g}); it must measure "
            f"between {LEAST_WIDTH:g} and {MOST_EXTENT:g} m, and be within {FARTHEST:g} m of the origin: set "
            f"building.scale{helps}, or move the building"
        )
    if factor is None:
        return []
    text = (
        f"{extent}; if its unit is not the metre, building.scale{helps} would make it {factor * width:.4g} x "
        f"{factor * depth:.4g} m"
    )
    return [Finding("warning", text)]


def likely_frame(mesh: TriangleMesh, axes: Sequence[Axis]) -> tuple[Axis, float, str]:
    """Return the axis that points upwards and metres per unit of a mesh, by its walls, and why if they are not z and 1.

    `axes`: those that are possible, the likely one first.
    """
    up, wall, turns = axes[0], _largest_wall(turned(mesh, axes[0])), ""
    if wall is None or wall[0] <= TALL[1]:
        return up, 1.0, ""
    units = _units(*wall)
    if not units and len(axes) > 1 and _levelled(mesh, mesh.points) > LEAST_UPRIGHT:
        other = _largest_wall(turned(mesh, axes[1])) or wall
        # Halls as deep as walls are high in feet have walls of one height already.
        units = [unit for unit in _units(*other) if unit != WALL_UNITS[0] or wall[2] < 0.9 < other[2]]
        up, turns = (axes[1], f"{axes[1]} points upwards and ") if units else (up, "")
    unit = (units or [1.0])[0]
    why = f"1 unit is {unit:g} m: else walls would be {wall[0]:.2f} m high and {wall[1]:.2f} m thick (up, scale)"
    return up, unit, turns + why if units else ""


def _units(tall: float, thin: float, _: float) -> list[float]:
    """Return the units with which the largest wall is as high and as thick as walls are."""
    return [
        unit for unit in (1.0, *WALL_UNITS) if TALL[0] <= tall * unit <= TALL[1] and THICK[0] <= thin * unit <= THICK[1]
    ]


def _largest_wall(mesh: TriangleMesh) -> tuple[float, float, float] | None:
    """Return height and thickness of the largest wall [units] and the share of walls as high; None if there is none."""
    points, index = np.unique(mesh.points, axis=0, return_inverse=True)
    cells = index.ravel()[mesh.triangles]
    cells = cells[(cells != np.roll(cells, 1, axis=1)).all(axis=1)]  # rounding joins corners of slivers
    body = bodies(len(points), cells)
    count, corners = int(body.max()) + 1, points[cells]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, body, corners.min(axis=1))
    np.maximum.at(high, body, corners.max(axis=1))
    ground = np.bincount(body, plan_area(corners), count) / 2.0  # of a foot and a top
    length, height = np.hypot(*(high - low)[:, :2].T), high[:, 2] - low[:, 2]
    sides = np.diff(corners, axis=1)
    whole = np.bincount(body, np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1), count) / 2.0
    upright = np.maximum(whole - 2.0 * ground, 1e-9)
    thick = 2.0 * ground * height / upright
    is_wall = (thick > 1e-3) & (length > 3.0 * thick) & (height > 3.0 * thick)
    if not is_wall.any():
        return None
    largest = int(np.where(is_wall, upright, 0.0).argmax())
    tall, thin = float(height[largest]), float(thick[largest])
    slabs = np.unique(np.round(high[:, 2][~is_wall & (ground > 0.1 * ground.max())], 1))
    gaps = np.diff(slabs)[np.diff(slabs) > thin * 3.0]
    alike = np.abs(height - tall) < 0.01 * tall
    return min([tall, *gaps.tolist()]), thin, float(upright[is_wall & alike].sum() / upright[is_wall].sum())


def _levelled(mesh: TriangleMesh, points: FloatArray) -> float:
    """Return the area of faces that are level with y upwards, over that with z upwards."""
    sides = np.diff(points[mesh.triangles], axis=1)
    normal = np.abs(np.cross(sides[:, 0], sides[:, 1]))
    _, y, z = normal[normal.max(axis=1) >= LEVEL * np.linalg.norm(normal, axis=1)].sum(axis=0).tolist()
    return y / z if z else float(np.inf if y else 0.0)


def doubted_axis(mesh: TriangleMesh, points: FloatArray) -> list[Finding]:
    """Doubt that z points upwards, if faces that are level with y upwards are by far larger."""
    if _levelled(mesh, points) <= MOST_UPRIGHT:
        return []
    text = 'most faces are level if y points upwards, and upright now: building.up = "y" turns them'
    return [Finding("warning", text)]


def check_resolution(source: Path, points: FloatArray, scale: float, weld: float) -> None:
    """Refuse float32 coordinates so coarse that adjacent cells of the building may not meet in the file.

    `points` (v, 3) [units of the file]; `scale`: metres per unit of the file; `weld` [m].
    """
    plan = np.abs(points[:, :2])
    spacing = np.spacing(plan.astype(np.float32)).astype(np.float64)
    # A building may be drawn on a coarser grid, in whole metres for example; one that was rounded uses the last bit.
    step = scale * float(spacing[plan / spacing % 2 == 1].max(initial=0.0))
    if (plan != plan.astype(np.float32)).any() or step <= max(weld, WELD):
        return
    x, y, z = points[plan.max(axis=1).argmax()]
    raise BuildingError(
        f"{source}: coordinates as large as those of the vertex ({x:z.2f}, {y:z.2f}, {z:z.2f}) are rounded to steps "
        f"of {step:.2g} m in the file, too coarse for neighbours to meet (building.weld = {weld:g} m); "
        "export the mesh relative to an origin in the building, or in double precision, or increase building.weld"
    )
