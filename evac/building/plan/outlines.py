"""Outlines of floors: pieces along a segment, strips between a segment and a floor, walls and doors between rooms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import LEAST_LENGTH
from evac.building.geometry.overlays import GRID, cut
from evac.building.geometry.segments import ALONG, between_floors, gaps_along, pieces_along, segment_lengths, sides
from evac.building.model.findings import away
from evac.building.plan.plan import SNAP
from evac.building.surface.resolution import FACTORS

#: Units of the segment for which it has to be multiplied by a factor.
UNITS = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches", 0.3048: "feet"}
#: Distance from a floor, as a share of its extent, at which a segment in another unit would lie at the floor.
NEAR = 0.05
#: Length of a segment that may lack a floor within reach [m], where an end of it is drawn slightly into a wall.
BESIDE_JAMB = 0.01
#: Cosine of the angle to its wall above which a door runs across the wall (60 degrees).
ACROSS = 0.5
#: Cosine of the angle between a ray and a side above which the ray runs along the side (2.6 degrees).
ALIKE = 0.999
#: Length of a door that may lie on the floor beside its wall without a finding [m].
ON_FLOOR = 0.01


@dataclass(frozen=True)
class Strip:
    """Ground between a segment and a floor, and its depth [m]."""

    polygon: BaseGeometry
    depth: float


def along(polygon: BaseGeometry, ends: FloatArray, reach: float) -> FloatArray:
    """Return the pieces (p, 4) of a polygon's outline that lie along a segment, at most `reach` from it [m].

    Pieces shorter than 1 mm are left out. Where the outline is on the segment, pieces end exactly at its ends.
    """
    own = sides(polygon)
    pieces, _ = pieces_along(own[segment_lengths(own) > 0.0], ends, reach)
    rounded: FloatArray = np.round(pieces, 6) + 0.0
    return rounded


def covered(pieces: FloatArray, ends: FloatArray) -> float:
    """Return the length of a segment that has a piece beside it [m]."""
    return float(np.hypot(*(ends[1] - ends[0])) - gaps_along(pieces, ends).sum())


def strip(polygon: BaseGeometry, ends: FloatArray, way: FloatArray, reach: float) -> Strip | None:
    """Return the strip of ground between a segment and a floor in a given direction.

    Parameters
    ----------
    polygon : shapely polygon or multipolygon
        The floor.
    ends : (2, 2) float64 [m]
    way : (2,) float64
        Unit vector across the segment.
    reach : float [m]
    """
    far = ends + (reach + LEAST_LENGTH) * way
    corridor = shapely.set_precision(shapely.Polygon([*ends, *far[::-1]]), GRID)
    line, end = shapely.LineString(ends).buffer(2 * GRID), shapely.LineString(far).buffer(2 * GRID)
    gaps = [part for part in shapely.get_parts(cut(corridor, polygon)) if part.intersects(line)]
    gap = shapely.union_all(gaps)
    if gap.is_empty:
        return Strip(gap, 0.0)
    if sum(part.intersection(end).area for part in gaps) > 2 * GRID * BESIDE_JAMB:
        return None
    depth = float(((shapely.get_coordinates(gap) - ends[0]) @ way).max())
    return Strip(gap, depth)


def normal(ends: FloatArray) -> FloatArray:
    """Return the unit vector to the left of a segment."""
    along_it = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    return np.array([-along_it[1], along_it[0]])


def nearest(polygon: BaseGeometry, ends: FloatArray, *, reach: float = 0.0, between: bool = False) -> str:
    """Describe, for a message, the edge of an outline nearest to a segment, and its distance.

    If `reach` is greater than 0, only edges with floor beyond a wall of this thickness are considered (`between`), or
    only the others, provided that there is one.
    """
    own = sides(polygon)
    if reach > 0.0 and len(own):
        is_wanted = between_floors(polygon, own, reach) == between
        own = own[is_wanted] if is_wanted.any() else own
    if not len(own):
        return "obstacles, stairs and exits cover its whole floor"
    line = shapely.LineString(ends)
    middle = shapely.points(ends.mean(axis=0))
    lines = shapely.linestrings(own.reshape(-1, 2, 2))
    row = np.lexsort((shapely.distance(lines, middle), shapely.distance(lines, line)))[0]
    x1, y1, x2, y2 = own[row]
    return (
        f"the nearest edge of its outline is ({x1:z.2f}, {y1:z.2f}) - ({x2:z.2f}, {y2:z.2f}), "
        f"{away(shapely.distance(lines[row], line))}{_in_other_unit(polygon, ends)}"
    )


def _in_other_unit(polygon: BaseGeometry, ends: FloatArray) -> str:
    """Describe, for a message, the unit in which a segment far away from a floor would lie at the floor."""
    low, high = np.reshape(polygon.bounds, (2, 2))
    extent = float(np.hypot(*(high - low)))
    if polygon.distance(shapely.LineString(ends)) < extent:
        return ""
    off = [float(polygon.boundary.distance(shapely.LineString(factor * ends))) for factor in FACTORS]
    best = int(np.argmin(off))
    if off[best] > NEAR * extent:
        return ""
    unit = UNITS.get(FACTORS[best])
    question = f"are these {unit}?" if unit else "is the unit of the storey the metre?"
    return f" ({question} Multiplied by {FACTORS[best]:.4g}, the segment lies at the floor)"


def between_rooms(ends: FloatArray, storey: str) -> str:
    """Describe, for a message, an exit with floor on both its sides."""
    return (
        f"{written(ends)} does not lead outside: storey {storey!r} has floor on both sides of the wall there; "
        "make it a door, or move it to the outer outline"
    )


def written(ends: FloatArray) -> str:
    """Describe a segment for a message."""
    (x1, y1), (x2, y2) = ends
    return f"({x1:z.2f}, {y1:z.2f}) - ({x2:z.2f}, {y2:z.2f})"


def with_walls(rooms: Sequence[BaseGeometry], thickness: float) -> list[BaseGeometry]:
    """Shrink adjacent rooms so that walls of a given thickness fit between them; outer sides are not moved."""
    tree = shapely.STRtree(rooms)
    divided = []
    for index, room in enumerate(rooms):
        others = [rooms[other] for other in tree.query(room, "intersects").tolist() if other != index]
        shared = shapely.intersection(room.boundary, shapely.union_all([other.boundary for other in others]))
        lines = [part for part in shapely.get_parts(shared) if part.geom_type == "LineString"]
        if not lines:
            divided.append(room)
            continue
        walls = shapely.line_merge(shapely.union_all(lines))
        divided.append(cut(room, walls.buffer(thickness / 2, cap_style="square", join_style="mitre")))
    return [room for room in divided if not room.is_empty]


def distinct(polygons: Sequence[BaseGeometry]) -> list[BaseGeometry]:
    """Return polygons without those that are equal to an earlier one."""
    by_shape: dict[bytes, BaseGeometry] = {}
    for polygon in polygons:
        by_shape.setdefault(shapely.to_wkb(shapely.normalize(polygon)), polygon)
    return list(by_shape.values())


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
