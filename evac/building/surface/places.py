"""Exits, areas and obstacles that a case adds to a building, given as segments and polygons on a level."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH, LEAST_LENGTH
from evac.base.parameters import did_you_mean
from evac.building.geometry import (
    between_floors,
    flat_parts,
    gaps_along,
    pieces_along,
    place_of,
    segment_lengths,
    sides,
    union,
)
from evac.building.model.building import Area, Building, Exit, Level
from evac.building.model.elevation import level_elevation
from evac.building.model.findings import Finding, item_of, noting, written
from evac.building.options import ExitLine, Outline, Placed
from evac.building.surface.levels import COLLINEAR, sorted_walls

#: Largest distance of an exit from the free edge that it is snapped to [m].
EXIT_REACH = 0.05
#: Largest difference between a height given for a level and the height of the level [m].
HEIGHT_REACH = 0.5
CUT_OFF = 0.01  #: Share of an area outside its level above which a warning is issued.


def add_exit(building: Building, item: ExitLine) -> Building:
    """Add an exit along a segment, which is snapped to the free edges of a level."""
    if any(other.name == item.name for other in building.exits):
        raise ValueError("another exit has the same name; rename one")
    ends = np.array(item.segment)
    level = find_level(building, item, shapely.LineString(ends))
    own = building.walls[building.wall_level == level.index]
    segments, rows = pieces_along(own, ends, EXIT_REACH)
    rest = np.concatenate(
        [np.column_stack([own[rows, :2], segments[:, :2]]), np.column_stack([segments[:, 2:], own[rows, 2:]])]
    )
    gaps = gaps_along(segments, ends)
    if gaps.max() > EXIT_REACH:
        advice = f"{gaps.sum():.2f} m of it are off: shorten it, or check for an exit or a portal there"
        if not len(rows) and len(own):
            away = shapely.distance(shapely.linestrings(own.reshape(-1, 2, 2)), shapely.multipoints(ends))
            nearest = own[away.argmin()].reshape(2, 2)
            advice = f"the nearest free edge is {written(nearest)}, {away.min():.2f} m away"
        raise ValueError(
            f"{written(ends)} on level {level.name!r} does not lie on a free edge (within {EXIT_REACH} m all along); "
            f"{advice}"
        )
    if between_floors(level.polygon, segments, DOOR_REACH).any():
        x, y = ends.mean(axis=0)
        raise ValueError(
            f"it does not lead outside: level {level.name!r} has floor on both sides of the wall at "
            f"({x:z.2f}, {y:z.2f}); move it to the outer outline"
        )
    width = float(segment_lengths(segments).sum())
    new = Exit(len(building.exits), item.name, level.index, segments, width)
    kept = np.concatenate([np.delete(own, rows, axis=0), rest[segment_lengths(rest) > LEAST_LENGTH]])
    return replace(_with_walls(building, level, kept), exits=(*building.exits, new))


def add_area(building: Building, item: Outline) -> Building:
    """Add an area, clipped to the polygon of its level."""
    if any(other.name == item.name for other in building.areas):
        raise ValueError("another area has the same name; rename one")
    drawn = _polygon(item)
    level = find_level(building, item, drawn)
    polygon = flat_parts(drawn.intersection(level.polygon))
    if polygon.is_empty:
        raise ValueError(f"it has no part on level {level.name!r}{_extent(level)}")
    findings = building.findings
    if polygon.area < (1.0 - CUT_OFF) * drawn.area:
        whole = f"{polygon.area:.2f} of its {drawn.area:.2f} m2"
        text = f"area {item.name!r}: {whole} are on the level; the rest is cut off"
        findings += (Finding("warning", text, level.title, place_of(polygon), f"building.areas.{item.name}"),)
    return replace(building, areas=(*building.areas, Area(item.name, level.index, polygon)), findings=findings)


def obstacle_place(building: Building, item: Outline) -> tuple[Level, BaseGeometry]:
    """Return level and polygon of an obstacle."""
    polygon = _polygon(item)
    return find_level(building, item, polygon), polygon


def add_obstacles(
    building: Building, places: Sequence[tuple[str, Level, BaseGeometry]], errors: list[Finding]
) -> Building:
    """Cut obstacles (key, level, polygon) out of levels and areas; their outlines become walls."""
    on_level: dict[int, list[BaseGeometry]] = {}
    for key, level, polygon in places:
        with noting(errors, f"obstacle {key.partition('obstacles.')[2]!r}", key, level.title, polygon):
            if polygon.intersection(level.polygon).area <= LEAST_LENGTH**2:
                raise ValueError(f"it is not on level {level.title!r}{_extent(level)}")
            _check_open(building, level, polygon)
            on_level.setdefault(level.index, []).append(polygon)
    for index, polygons in on_level.items():
        level = building.levels[index]
        with noting(errors, f"level {level.title!r}", item_of(level), level.title, union(polygons)):
            building = _take_out(building, level, union(polygons))
    return building


def find_level(building: Building, item: Placed, geometry: BaseGeometry) -> Level:
    """Find the level that an item names, or the level at about its height on which most of `geometry` lies.

    Levels are compared by the area of a polygon on them, or by the length of a segment along their walls. For equal
    levels, the nearest one in plan is chosen, then the one nearest to its height, then a floor rather than a flight.
    """
    if item.level is not None:
        index = building.level_named(item.level)
        if index is None:
            names = [level.name for level in building.levels]
            raise ValueError(f"level: no level is named {item.level!r}; {did_you_mean(item.level, names)}")
        return index
    assert item.z is not None
    centre = shapely.points(shapely.get_coordinates(geometry.centroid))
    near = []
    for level in building.levels:
        point = shapely.get_coordinates(shapely.shortest_line(level.polygon, centre)[0])[:1]
        height_error = abs(float(level_elevation(building.vertices, level, point)[0]) - item.z)
        if height_error <= HEIGHT_REACH:
            distance = max(float(level.polygon.distance(geometry)) - EXIT_REACH, 0.0)
            overlap, is_flight = _overlap(building, level, geometry), level.kind == "flight"
            near.append((-round(overlap, 3), round(distance, 3), round(height_error, 3), is_flight, level.index))
    if not near:
        heights = ", ".join(f"{level.name!r} z = {level.z_min:z.2f} to {level.z_max:z.2f}" for level in building.levels)
        raise ValueError(f"z: no level is at the height z = {item.z:g} m there; correct z, or name a level: {heights}")
    return building.levels[min(near)[-1]]


def _overlap(building: Building, level: Level, geometry: BaseGeometry) -> float:
    """Return the area of a polygon on a level [m2], or the length of a segment along its walls [m]."""
    if geometry.geom_type != "LineString":
        return float(geometry.intersection(level.polygon).area)
    ends = shapely.get_coordinates(geometry)
    pieces, _ = pieces_along(building.walls[building.wall_level == level.index], ends, EXIT_REACH)
    return float(segment_lengths(pieces).sum())


def _polygon(item: Outline) -> BaseGeometry:
    """Check and return the polygon of an item."""
    polygon = shapely.Polygon(item.polygon)
    if not polygon.is_valid or polygon.area <= LEAST_LENGTH**2:
        cause = shapely.is_valid_reason(polygon) if not polygon.is_valid else "it has no area"
        raise ValueError(f"polygon is not a valid outline: {cause}; draw it without crossings")
    return polygon


def _check_open(building: Building, level: Level, polygon: BaseGeometry) -> None:
    """Refuse an obstacle that covers part of a portal or an exit."""
    for way in building.links_of(level.index):
        covered = shapely.multilinestrings(way.segments.reshape(-1, 2, 2)).intersection(polygon)
        if covered.length > LEAST_LENGTH:
            x, y = covered.centroid.coords[0]
            raise ValueError(
                f"it covers {covered.length:.2f} m of the {way.kind} {way.name!r} at ({x:z.2f}, {y:z.2f}) on level "
                f"{level.title!r}; move it off"
            )


def _take_out(building: Building, level: Level, obstacle: BaseGeometry) -> Building:
    """Subtract an obstacle from a level and its areas, and add walls along its outline."""
    polygon = flat_parts(level.polygon.difference(obstacle))
    if polygon.is_empty:
        raise ValueError("obstacles cover all of it; make them smaller")
    new, old = sides(polygon), level.polygon.boundary
    middle = shapely.points((new[:, :2] + new[:, 2:]) / 2)
    is_new = shapely.distance(middle, old) > COLLINEAR
    own = building.walls[building.wall_level == level.index]
    kept = own[~shapely.covers(obstacle, shapely.linestrings(own.reshape(-1, 2, 2)))]
    levels = list(building.levels)
    levels[level.index] = replace(level, polygon=polygon.normalize())
    areas = [
        replace(area, polygon=flat_parts(area.polygon.difference(obstacle))) if area.level == level.index else area
        for area in building.areas
    ]
    gone = [area.name for area in areas if area.polygon.is_empty]
    if gone:
        raise ValueError(f"obstacles cover all of the area {gone[0]!r}; make them smaller, or move the area")
    building = _with_walls(building, level, np.concatenate([kept, new[is_new]]))
    return replace(building, levels=tuple(levels), areas=tuple(areas))


def _with_walls(building: Building, level: Level, own: FloatArray) -> Building:
    """Replace the walls of one level."""
    other = building.wall_level != level.index
    walls, wall_level = sorted_walls(
        np.concatenate([building.walls[other], own]),
        np.concatenate([building.wall_level[other], np.full(len(own), level.index)]),
    )
    return replace(building, walls=walls, wall_level=wall_level)


def _extent(level: Level) -> str:
    """Describe, for a message, the plan extent of a level and how to correct a place that is not on it."""
    x1, y1, x2, y2 = level.polygon.bounds
    return f", which extends from ({x1:z.2f}, {y1:z.2f}) to ({x2:z.2f}, {y2:z.2f}); move it there"
