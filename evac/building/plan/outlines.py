"""Outlines in plan: shapes as they are given, and the lines and strips that are made from them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import FARTHEST, LEAST_LENGTH
from evac.base.errors import BuildingError
from evac.building.geometry import (
    ALONG,
    GRID,
    LEAST_AREA,
    flat_parts,
    gaps_along,
    pieces_along,
    place_of,
    remembered,
    rounded,
    segment_lengths,
    sides,
)
from evac.building.model.findings import Finding, written

SNAP = 0.15  #: Largest distance of an exit or a stair end from the outline of its floor [m].

#: Accepted representations of a shape: one of these, or a list of them.
Shape: TypeAlias = BaseGeometry | str | Mapping[str, Any] | Sequence[Any]

MOST_NESTED = 100  #: Greatest depth of nested parentheses in WKT: a multipolygon in a collection has five.


@contextmanager
def naming_part(source: Path, part: str) -> Iterator[None]:
    """Prefix a ValueError with a plan and its part, as a BuildingError."""
    try:
        yield
    except ValueError as error:
        raise BuildingError(f"{source}: {part}: {error}") from error


def geometries(given: Shape) -> Iterator[BaseGeometry]:
    """Yield the simple geometries of a shape; a sequence of points (x, y) is the outline of a polygon."""
    if isinstance(given, BaseGeometry):
        yield from _simple(given)
    elif isinstance(given, str):
        yield from _simple(from_wkt(given))
    elif isinstance(given, Mapping):
        yield from _of_geojson(given)
    elif isinstance(given, Iterable):
        items = list(given)
        if items and all(is_point(item) for item in items):
            if len(items) < 3:
                raise ValueError(f"an outline needs at least three corners [x, y], not {len(items)}")
            corners = np.array(items, dtype=np.float64)
            if not np.isfinite(corners).all():
                raise ValueError("a coordinate is not finite; correct it")
            yield shapely.Polygon(corners)
        else:
            for item in items:
                yield from geometries(item)
    else:
        raise ValueError(f"a shape must be a shapely geometry, WKT, GeoJSON or a list of corners, not {given!r}")


def from_wkt(text: str) -> BaseGeometry:
    """Parse WKT; raise ValueError if it is invalid, or nested so deep that GEOS would overflow its stack."""
    ends = np.frombuffer(text.encode("utf-8", "replace"), np.uint8)
    depth = (ends == ord("(")).astype(np.int64) - (ends == ord(")"))
    if depth.cumsum().max(initial=0) > MOST_NESTED:
        raise ValueError(f"WKT nested more than {MOST_NESTED} deep")
    try:
        with np.errstate(invalid="ignore"):
            return shapely.from_wkt(text)
    except shapely.GEOSException as error:
        raise ValueError(f"invalid WKT: {str(error).rpartition('Exception: ')[2]}") from error


def polygons_of(given: Shape, level: str | None, findings: list[Finding]) -> list[BaseGeometry]:
    """Return the valid polygons of a part on the grid of plans; add a finding for each repair or omission."""
    shapes: list[BaseGeometry] = []
    others: list[BaseGeometry] = []
    for part in geometries(given):
        corners = shapely.get_coordinates(part)
        if not (np.abs(corners) <= FARTHEST).all():  # nor NaN
            raise ValueError(f"a coordinate is not finite, or farther than {FARTHEST:g} m from the origin; correct it")
        if part.geom_type == "Polygon":
            shapes += _valid(shapely.force_2d(part), level, findings)
        elif not part.is_empty:
            others.append(part)
    if others:
        kinds = ", ".join(sorted({part.geom_type for part in others}))
        text = f"{len(others)} shapes that are not polygons ({kinds}); the first one is here"
        findings.append(Finding("left out", text, level, place_of(others[0])))
    if not shapes:
        raise ValueError("the part contains no polygon with an area")
    return shapes


def outline_of(given: Shape) -> BaseGeometry:
    """Return the one polygon of a shape on the grid of plans, with its corners in their order."""
    parts = list(geometries(given))
    if len(parts) != 1 or parts[0].geom_type != "Polygon":
        raise ValueError("must be one polygon; divide it, or add its parts to the polygons of its storey")
    return shapely.transform(shapely.force_2d(parts[0]), rounded)


def inclined_of(given: Shape) -> tuple[BaseGeometry, ...]:
    """Return polygons whose corners have heights [m]."""
    parts = list(geometries(given))
    for part in parts:
        corners = shapely.get_coordinates(part, include_z=True)
        if part.geom_type != "Polygon" or not part.has_z or not (np.abs(corners) <= FARTHEST).all():
            raise ValueError("an inclined polygon needs corners with heights, such as POLYGON Z ((0 0 0, 1 0 0, ...))")
        if not part.is_valid or part.area < LEAST_AREA:
            raise ValueError(f"an inclined polygon is not valid: {shapely.is_valid_reason(part)}; correct its corners")
    return tuple(shapely.transform(part, rounded, include_z=True) for part in parts)


def segment_of(given: Shape) -> FloatArray:
    """Return the two ends (2, 2) [m] of a segment, given as a line, as WKT or GeoJSON of one, or as two points."""
    if isinstance(given, (str, Mapping)):
        lines = list(geometries(given))
        given = lines[0] if len(lines) == 1 else []
    try:
        ends = shapely.get_coordinates(given) if isinstance(given, BaseGeometry) else np.array(given, np.float64)
    except (TypeError, ValueError, OverflowError):
        ends = np.empty(0)
    if ends.shape != (2, 2) or not (np.abs(ends) <= FARTHEST).all() or np.hypot(*(ends[1] - ends[0])) < LEAST_LENGTH:
        raise ValueError(
            f"a segment must be two different points [[x1, y1], [x2, y2]], at most {FARTHEST:g} m from the "
            f"origin, not {ends.tolist() if ends.size else given!r}"
        )
    return rounded(ends)


def _simple(geometry: BaseGeometry) -> Iterator[BaseGeometry]:
    """Yield the simple parts of a geometry, which may be nested."""
    if geometry.geom_type.startswith("Multi") or geometry.geom_type == "GeometryCollection":
        for part in geometry.geoms:
            yield from _simple(part)
    else:
        yield geometry


def _of_geojson(given: Mapping[str, Any]) -> Iterator[BaseGeometry]:
    """Yield the geometries of a GeoJSON object."""
    kind = given.get("type") if isinstance(given, Mapping) else None
    if kind == "FeatureCollection":
        for feature in given.get("features", ()):
            yield from _of_geojson(feature)
    elif kind == "Feature":
        if given.get("geometry") is not None:
            yield from _of_geojson(given["geometry"])
    else:
        try:
            with np.errstate(invalid="ignore"):
                made = shape(given)
            yield from _simple(made)
        except (shapely.errors.ShapelyError, AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            text = "its coordinates are not those of its type" if isinstance(kind, str) else "the type must be a text"
            raise ValueError(f"invalid GeoJSON geometry of type {kind!r}: {text}") from error


def is_point(item: Any) -> bool:
    """Return whether a value is a point [x, y]."""
    return (
        isinstance(item, Sequence | np.ndarray)
        and not isinstance(item, str)
        and len(item) == 2
        and all(isinstance(value, int | float | np.number) and not isinstance(value, bool) for value in item)
    )


def _valid(polygon: BaseGeometry, level: str | None, findings: list[Finding]) -> list[BaseGeometry]:
    """Return a polygon repaired, as valid polygons."""
    if polygon.is_empty:
        return []
    if not polygon.is_valid:
        reason, _, at = shapely.is_valid_reason(polygon).rstrip("]").partition("[")
        x, y = map(float, at.split()[:2]) if at else shapely.get_coordinates(polygon)[0].tolist()
        repaired = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
        text = f"an outline that crosses itself here ({reason}), of which {repaired.area:.2f} m2 are kept"
        findings.append(Finding("repaired", text, level, (x, y)))
        polygon = repaired
    snapped = flat_parts(shapely.set_precision(polygon, GRID))
    if snapped.is_empty:
        place = tuple(shapely.get_coordinates(polygon)[0].tolist()) if not polygon.is_empty else None
        findings.append(Finding("left out", "a polygon without an area", level, place))
    return [part for part in shapely.get_parts(shapely.normalize(snapped))]


#: Length of a segment that may lack a floor within reach [m], where an end of it is drawn slightly into a wall.
BESIDE_JAMB = 0.01
#: Cosine of the angle between a ray and a side above which the ray runs along the side (2.6 degrees).
ALIKE = 0.999
ON_FLOOR = 0.01  #: Length of a door that may lie on the floor beside its wall without a finding [m].


@dataclass(frozen=True)
class Strip:
    """Ground between a segment and a floor, and its depth [m]."""

    polygon: BaseGeometry
    depth: float


def along(polygon: BaseGeometry, ends: FloatArray, reach: float) -> FloatArray:
    """Return the pieces (p, 4) of a polygon's outline that lie along a segment, at most `reach` from it [m].

    Pieces shorter than 1 mm are left out. Where the outline is on the segment, pieces end exactly at its ends.
    """
    own, beyond = sides(polygon), reach + LEAST_LENGTH
    low, high = np.sort(own.reshape(-1, 2, 2), axis=1).transpose(1, 0, 2)
    own = own[((high >= ends.min(axis=0) - beyond) & (low <= ends.max(axis=0) + beyond)).all(axis=1)]
    pieces, _ = pieces_along(own[segment_lengths(own) > 0.0], ends, reach)
    return rounded(pieces)


def covered(pieces: FloatArray, ends: FloatArray) -> float:
    """Return the length of a segment that has a piece beside it [m]."""
    return float(np.hypot(*(ends[1] - ends[0])) - gaps_along(pieces, ends).sum())


@remembered
def strips(
    polygons: BaseGeometry | NDArray[np.object_], ends: FloatArray, ways: FloatArray, reach: float | FloatArray
) -> tuple[Strip | None, ...]:
    """Return the ground from a segment (2, 2) along unit vectors (n, 2) to a floor; None where there is none.

    There may be a floor, a segment and a reach [m] for each of the vectors.
    """
    ends = np.broadcast_to(ends, (len(ways), 2, 2))
    far = ends + (np.reshape(reach, (-1, 1)) + LEAST_LENGTH)[..., None] * ways[:, None]
    corridors = shapely.polygons(np.concatenate([ends, far[:, ::-1]], axis=1))
    parts, owner = shapely.get_parts(shapely.difference(corridors, polygons, grid_size=GRID), return_index=True)
    is_gap = (shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & (shapely.area(parts) > LEAST_AREA)
    is_gap &= shapely.dwithin(parts, shapely.linestrings(ends)[owner], 2 * GRID)
    gaps = np.split(parts[is_gap], np.searchsorted(owner[is_gap], np.arange(1, len(ways))))
    whole = np.array([own[0] if len(own) == 1 else shapely.union_all(own) for own in gaps])
    tops, found = shapely.linestrings(far), list[Strip | None]()
    does_reach = shapely.dwithin(whole, tops, 2 * GRID)
    for gap, start, way, top, reaches in zip(whole, ends[:, 0], ways, tops, does_reach, strict=True):
        if gap.is_empty:
            found.append(Strip(gap, 0.0))
        elif reaches and gap.intersection(top.buffer(2 * GRID)).area > 2 * GRID * BESIDE_JAMB:
            found.append(None)
        else:
            found.append(Strip(gap, float(((shapely.get_coordinates(gap) - start) @ way).max())))
    return tuple(found)


def normal(ends: FloatArray) -> FloatArray:
    """Return the unit vector to the left of a segment (2, 2), or of each of some (n, 2, 2)."""
    step = ends[..., 1, :] - ends[..., 0, :]
    along_it = step / np.hypot(step[..., :1], step[..., 1:])
    return np.stack([-along_it[..., 1], along_it[..., 0]], axis=-1)


def between_rooms(ends: FloatArray, storey: str) -> str:
    """Describe, for a message, an exit with floor on both its sides."""
    return (
        f"{written(ends)} does not lead outside: storey {storey!r} has floor on both sides of the wall there; "
        "make it a door, or move it to the outer outline"
    )


@remembered
def with_walls(rooms: Sequence[BaseGeometry], thickness: float) -> list[BaseGeometry]:
    """Shrink adjacent rooms so that walls of a given thickness fit between them; outer sides are not moved."""
    outlines = shapely.boundary(np.array(rooms, dtype=object))
    one, other = shapely.STRtree(outlines).query(outlines, "intersects")
    low, high = shapely.bounds(outlines)[:, :2], shapely.bounds(outlines)[:, 2:]
    meets = np.minimum(high[one], high[other]) - np.maximum(low[one], low[other])
    is_pair = (one < other) & (meets.max(axis=1) > 0.0)  # more than a corner
    one, other = one[is_pair], other[is_pair]
    shared, pair = shapely.get_parts(shapely.intersection(outlines[one], outlines[other]), return_index=True)
    is_line = shapely.get_type_id(shared) == shapely.GeometryType.LINESTRING
    lines, walls = np.tile(shared[is_line], 2), np.concatenate([one[pair[is_line]], other[pair[is_line]]])
    order = np.argsort(walls, kind="stable")
    beside, index = np.unique(walls, return_inverse=True)
    between = shapely.line_merge(shapely.multilinestrings(lines[order], indices=index[order]))
    between = shapely.buffer(between, thickness / 2, cap_style="square", join_style="mitre")
    divided = np.array(rooms, dtype=object)
    cuts = shapely.difference(divided[beside], between, grid_size=GRID)
    divided[beside] = [flat_parts(room) for room in cuts]
    return [room for room in divided if not room.is_empty]


def distinct(polygons: Sequence[BaseGeometry]) -> list[BaseGeometry]:
    """Return polygons without those that are equal to an earlier one."""
    by_shape: dict[bytes, BaseGeometry] = {}
    for polygon in polygons:
        by_shape.setdefault(shapely.to_wkb(shapely.normalize(polygon)), polygon)
    return list(by_shape.values())


@remembered
def doorway(floor: BaseGeometry, ends: FloatArray, reach: float) -> tuple[FloatArray, str, tuple[Strip | None, ...]]:
    """Return the segment of a door along its wall, what was changed, and the ground on its left and right."""
    both = np.outer([1.0, -1.0], normal(ends))
    if shapely.disjoint(floor, shapely.linestrings(ends)) and all(beside := strips(floor, ends, both, reach)):
        return ends, "", beside
    segment, change = placed(floor, ends, reach)
    return segment, change, strips(floor, segment, np.outer([1.0, -1.0], normal(segment)), reach)


def placed(floor: BaseGeometry, ends: FloatArray, reach: float) -> tuple[FloatArray, str]:
    """Return the segment of a door along its wall, and a description of what was changed, if anything.

    A segment in a room, at most `SNAP` beside a wall, is moved to the wall. One that crosses a wall at a small angle is
    turned along it; its clear width is then its length along the wall. A segment across an opening that the floor
    already has is not changed.

    `floor`: the rooms of the storey; `ends` (2, 2) [m]; `reach` [m]: largest distance between the door and its rooms.
    """
    parts = shapely.get_parts(shapely.difference(shapely.linestrings(ends), floor))
    parts = parts[shapely.length(parts) > LEAST_LENGTH]
    if not len(parts):
        return _on_floor(floor, ends)
    length = float(np.hypot(*(ends[1] - ends[0])))
    longest = parts[np.argmax(shapely.length(parts))]
    at = shapely.get_coordinates(longest).mean(axis=0)
    step, own = (ends[1] - ends[0]) / length, sides(floor)
    walls = [wall for way in (normal(ends), -normal(ends)) if (wall := _hit(own, at, reach * way)) is not None]
    if not walls:
        beyond = [_hit(own, at, (reach + length) * way) for way in (step, -step)]
        walls = [wall for wall in beyond if wall is not None] if all(wall is not None for wall in beyond) else []
    if not walls:
        return ends, ""
    turn = np.array([abs(float(wall @ step)) for wall in walls])
    wall = walls[int(turn.argmax())]
    if turn.max() <= ALONG:
        raise ValueError(
            f"{written(ends)} runs through the wall at an angle of {np.degrees(np.arccos(turn.max())):.0f} degrees at "
            f"({at[0]:z.2f}, {at[1]:z.2f}): draw it along the wall, as long as the opening is wide"
        )
    if length - float(shapely.length(parts).sum()) <= ON_FLOOR:
        return ends, ""
    segment = rounded(at + ((ends - at) @ wall)[:, None] * wall)
    if np.abs(segment - ends).max() <= ON_FLOOR:
        return ends, ""
    angle = np.degrees(np.arccos(min(float(turn.max()), 1.0)))
    width = float(np.hypot(*(segment[1] - segment[0])))
    return segment, f"turned by {angle:.0f} degrees to run along its wall, where it is {width:.2f} m wide"


def _on_floor(floor: BaseGeometry, ends: FloatArray) -> tuple[FloatArray, str]:
    """Move a segment on the floor to the wall beside it; keep one that ends at walls on both sides."""
    length = float(np.hypot(*(ends[1] - ends[0])))
    pieces = along(floor, ends, SNAP)
    if covered(pieces, ends) > 0.9 * length:
        middle = shapely.Point(ends.mean(axis=0))
        x1, y1, x2, y2 = pieces[np.argmin(shapely.distance(shapely.linestrings(pieces.reshape(-1, 2, 2)), middle))]
        origin, wall = np.array([x1, y1]), np.array([x2 - x1, y2 - y1]) / np.hypot(x2 - x1, y2 - y1)
        segment = rounded(origin + ((ends - origin) @ wall)[:, None] * wall)
        off = float(np.hypot(*(segment - ends).T).max())
        return segment, "" if off < LEAST_LENGTH else f"moved by {off:.2f} m to the wall beside it"
    if (shapely.distance(shapely.points(ends), shapely.boundary(floor)) <= SNAP).all():
        return ends, ""
    raise ValueError(
        f"{written(ends)} lies inside a room; move the door to a wall (rooms that touch have a wall between them only "
        "if their storey has wall > 0)"
    )


def _hit(own: FloatArray, start: FloatArray, way: FloatArray) -> FloatArray | None:
    """Return the direction (2,) of the side (s, 4) of a floor that a ray crosses first; None if it crosses none."""
    step, reach = own[:, 2:] - own[:, :2], own[:, :2] - start
    is_across = np.abs(step @ way) < ALIKE * np.hypot(*step.T) * np.hypot(*way)
    step, reach = step[is_across], reach[is_across]
    turn = way[0] * step[:, 1] - way[1] * step[:, 0]
    away = (reach[:, 0] * step[:, 1] - reach[:, 1] * step[:, 0]) / turn
    share = (reach[:, 0] * way[1] - reach[:, 1] * way[0]) / turn
    away = np.where((away >= 0.0) & (away <= 1.0) & (share >= 0.0) & (share <= 1.0), away, np.inf)
    if not np.isfinite(away).any():
        return None
    direction: FloatArray = step[away.argmin()] / np.hypot(*step[away.argmin()])
    return direction
