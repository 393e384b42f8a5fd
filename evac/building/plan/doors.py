"""Doors of plans: what they may reach, and the segment along the wall that a door stands for."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import LEAST_LENGTH
from evac.building.geometry.segments import ALONG, sides
from evac.building.plan.outlines import along, covered, nearest, normal, written
from evac.building.plan.plan import SNAP

#: Cosine of the angle to its wall above which a door runs across the wall (60 degrees).
ACROSS = 0.5
#: Cosine of the angle between a ray and a side above which the ray runs along the side (2.6 degrees).
ALIKE = 0.999
#: Length of a door that may lie on the floor beside its wall without a finding [m].
ON_FLOOR = 0.01


def placed(floor: BaseGeometry, ends: FloatArray, reach: float) -> tuple[FloatArray, str]:
    """Return the segment of a door along its wall, and a description of what was changed, if anything.

    A segment in a room, at most `SNAP` beside a wall, is moved to the wall. One that crosses a wall at a small angle is
    turned along it; its clear width is then its length along the wall. A segment across an opening that the floor
    already has is not changed.

    Parameters
    ----------
    floor : shapely polygon or multipolygon
        The rooms of the storey.
    ends : (2, 2) float64 [m]
    reach : float [m]
        Largest distance between the door and its rooms.

    Raises
    ------
    ValueError
        The segment lies inside a room, or runs across or obliquely through its wall; names the place.
    """
    parts = shapely.get_parts(shapely.difference(shapely.LineString(ends), floor))
    parts = parts[shapely.length(parts) > LEAST_LENGTH]
    if not len(parts):
        return _on_floor(floor, ends, reach)
    length = float(np.hypot(*(ends[1] - ends[0])))
    longest = parts[np.argmax(shapely.length(parts))]
    at = shapely.get_coordinates(longest).mean(axis=0)
    step = (ends[1] - ends[0]) / length
    walls = [wall for way in (normal(ends), -normal(ends)) if (wall := _hit(floor, at, reach * way)) is not None]
    if not walls:
        beyond = [_hit(floor, at, (reach + length) * way) for way in (step, -step)]
        walls = [wall for wall in beyond if wall is not None] if all(wall is not None for wall in beyond) else []
    if not walls:
        return ends, ""
    turn = np.array([abs(float(wall @ step)) for wall in walls])
    wall = walls[int(turn.argmax())]
    if turn.max() <= ALONG:
        raise ValueError(_across(at, ends, float(turn.max())))
    if length - float(shapely.length(parts).sum()) <= ON_FLOOR:
        return ends, ""
    segment = np.round(at + ((ends - at) @ wall)[:, None] * wall, 6) + 0.0
    if np.abs(segment - ends).max() <= ON_FLOOR:
        return ends, ""
    angle = np.degrees(np.arccos(min(float(turn.max()), 1.0)))
    width = float(np.hypot(*(segment[1] - segment[0])))
    return segment, f"turned by {angle:.0f} degrees to run along its wall, where it is {width:.2f} m wide"


def _on_floor(floor: BaseGeometry, ends: FloatArray, reach: float) -> tuple[FloatArray, str]:
    """Move a segment on the floor to the wall beside it; keep one that ends at walls on both sides."""
    length = float(np.hypot(*(ends[1] - ends[0])))
    pieces = along(floor, ends, SNAP)
    if covered(pieces, ends) > 0.9 * length:
        middle = shapely.Point(ends.mean(axis=0))
        x1, y1, x2, y2 = pieces[np.argmin(shapely.distance(shapely.linestrings(pieces.reshape(-1, 2, 2)), middle))]
        origin, wall = np.array([x1, y1]), np.array([x2 - x1, y2 - y1]) / np.hypot(x2 - x1, y2 - y1)
        segment = np.round(origin + ((ends - origin) @ wall)[:, None] * wall, 6) + 0.0
        off = float(np.hypot(*(segment - ends).T).max())
        return (ends, "") if off < LEAST_LENGTH else (segment, f"moved by {off:.2f} m to the wall beside it")
    if (shapely.distance(shapely.points(ends), shapely.boundary(floor)) <= SNAP).all():
        return ends, ""
    raise ValueError(
        f"{written(ends)} lies inside a room; {nearest(floor, ends, reach=reach, between=True)}: move the door there "
        "(rooms that touch have a wall between them only if their storey has wall > 0)"
    )


def _hit(floor: BaseGeometry, start: FloatArray, way: FloatArray) -> FloatArray | None:
    """Return the direction (2,) of the side of the floor that a ray crosses first; None if it crosses none."""
    own = sides(floor)
    step = own[:, 2:] - own[:, :2]
    own = own[np.abs(step @ way) < ALIKE * np.hypot(*step.T) * np.hypot(*way)]
    lines = shapely.linestrings(own.reshape(-1, 2, 2))
    met = shapely.intersection(shapely.LineString([start, start + way]), lines)
    away = np.where(shapely.is_empty(met), np.inf, shapely.distance(met, shapely.Point(start)))
    if not np.isfinite(away).any():
        return None
    row = int(np.nanargmin(away))
    side = own[row, 2:] - own[row, :2]
    direction: FloatArray = side / np.hypot(*side)
    return direction


def _across(at: FloatArray, ends: FloatArray, cosine: float) -> str:
    """Describe a segment that does not run along its wall."""
    if cosine < ACROSS:
        how = "runs across the wall"
    else:
        how = f"runs through the wall at an angle of {np.degrees(np.arccos(cosine)):.0f} degrees"
    return (
        f"{written(ends)} {how} at ({at[0]:z.2f}, {at[1]:z.2f}): draw it along the wall, as long as the opening is wide"
    )
