"""Findings of an import on a building: openings that may be exits, rooms with people, and missing parts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from evac.base.arrays import FloatArray
from evac.base.defaults import LEAST_LENGTH, NEGLIGIBLE
from evac.base.errors import counted
from evac.building.geometry import segment_lengths
from evac.building.model.building import Building, Level
from evac.building.model.elevation import elevation
from evac.building.model.findings import Finding, keyed, numbered
from evac.building.model.links import isolated_parts, levels_reaching
from evac.people.starts import divided, left_out

#: Least width of an opening [m].
LEAST_WIDTH = 0.5
#: Greatest distance of an opening from the outline of its level [m].
REACH = 0.05
#: Greatest width of a way through a wall [m].
WIDEST_WAY = 3.0
#: Distance from a way at which the wall beside it is looked for [m].
ASIDE = 0.2
#: Greatest thickness of a wall between two rooms [m].
THICKEST = 1.0
#: Relative positions along a wall at which ground behind it is searched.
LOOKS = (0.1, 0.3, 0.5, 0.7, 0.9)
#: Share of the ground of a room in enclosures of stairs from which on nobody starts in it.
STAIRWELL = 0.7
#: Number of levels that are named.
MOST_NAMED = 10


@dataclass(frozen=True)
class Opening:
    """A part of an outline that can become an exit."""

    number: int  # number in lists, from 1
    level: str  # name of its level in the building that the files describe, which edits may have taken away
    z: float  # height [m]
    segment: FloatArray  # (4,) float64: x1, y1, x2, y2 [m]
    width: float  # [m]

    def exit(self) -> dict[str, Any]:
        """Return the opening as an exit of a case."""
        x1, y1, x2, y2 = np.round(self.segment, 3).tolist()
        return {"name": f"exit {self.number}", "segment": [[x1, y1], [x2, y2]], "level": self.level}


def find_openings(building: Building, given: Sequence[tuple[str, ArrayLike]]) -> list[Opening]:
    """Return the openings of a building: ways through outer walls first, the widest first.

    `given` (4,) [m]: openings in the file; if there are none, the outer edges of all floors are used.
    """
    found: list[tuple[int, FloatArray]] = []
    for name, ends in given:
        segment = np.asarray(ends, dtype=np.float64)
        on = _level_of(building, name, segment)
        if on is not None:
            found.append((on, segment))
    rows = []
    for on, segment in found or _outer(building):
        width = float(np.hypot(*(segment[2:] - segment[:2])))
        if width >= LEAST_WIDTH:
            is_other = not _is_way(building.levels[on].polygon, segment)
            rows.append((is_other, -round(width, 3), on, *segment.tolist()))
    rows.sort()
    index, segments = np.array([row[2] for row in rows], np.int32), np.reshape([row[3:] for row in rows], (-1, 4))
    heights = elevation(building, index, (segments[:, :2] + segments[:, 2:]) / 2)
    found_there = zip(index.tolist(), heights.tolist(), segments, segment_lengths(segments).tolist(), strict=True)
    return [Opening(k, building.levels[on].name, z, *own) for k, (on, z, *own) in enumerate(found_there, start=1)]


def _is_way(ground: shapely.Geometry, segment: FloatArray) -> bool:
    """Return whether an outer edge, with the ground on its left, is as wide as a way through a wall, and in one."""
    ends, width = segment.reshape(2, 2), float(np.hypot(*(segment[2:] - segment[:2])))
    if width > WIDEST_WAY:
        return False
    step = (ends[1] - ends[0]) / width
    beside = ends + ASIDE * np.stack([-step, step])
    rays = shapely.linestrings(np.stack([beside, beside + THICKEST * np.array([-step[1], step[0]])], axis=1))
    depth = shapely.distance(shapely.intersection(rays, ground), shapely.points(beside))  # NaN without ground
    return bool(depth.min() > REACH and np.ptp(depth) < REACH)


def _outer(building: Building) -> list[tuple[int, FloatArray]]:
    """Return the walls (4,) of floors that are not inner walls: no ground at about their height is close behind."""
    floors = [level for level in building.levels if level.kind == "floor"]
    index, grounds = np.array([level.index for level in floors]), [level.polygon for level in floors]
    height = np.array([level.z_min for level in building.levels])
    rings = np.array([shapely.multilinestrings(shapely.get_exterior_ring(shapely.get_parts(own))) for own in grounds])
    shapely.prepare(rings)
    rows = np.flatnonzero(np.isin(building.wall_level, index))
    walls, on = building.walls[rows], building.wall_level[rows]
    step = (walls[:, 2:] - walls[:, :2]) / segment_lengths(walls)[:, None]
    outward = np.column_stack([step[:, 1], -step[:, 0]])
    middle = shapely.points((walls[:, :2] + walls[:, 2:]) / 2)
    is_outer = shapely.dwithin(rings[np.searchsorted(index, on)], middle, LEAST_LENGTH)
    for share in LOOKS:
        start = walls[:, :2] + share * (walls[:, 2:] - walls[:, :2])
        behind = shapely.linestrings(np.stack([start + REACH * outward, start + THICKEST * outward], axis=1))
        floor, wall = shapely.STRtree(behind).query(grounds, predicate="intersects")
        is_near = np.abs(height[index[floor]] - height[on[wall]]) < THICKEST
        is_outer[wall[is_near]] = False
    return [(int(on[row]), walls[row]) for row in np.flatnonzero(is_outer)]


def _level_of(building: Building, name: str, segment: FloatArray) -> int | None:
    """Return the level with a given name, or a part of it, on whose outline a segment lies."""
    middle = shapely.points((segment[:2] + segment[2:]) / 2)
    for level in building.levels:
        is_named = level.name == name or level.name.startswith(f"{name} (")
        if is_named and level.polygon.boundary.distance(middle) <= REACH:
            return level.index
    return None


@dataclass(frozen=True)
class Room:
    """An area, or a floor without areas: its key in a case, its name, level, ground [m2] and number of people."""

    key: str
    name: str
    level: int
    ground: float
    number: int = 0


def find_rooms(building: Building) -> list[Room]:
    """Return the areas of a building, and the floors without areas."""
    rooms = [Room("area", area.name, area.level, float(area.polygon.area)) for area in building.areas]
    taken = {room.level for room in rooms}
    floors = [level for level in building.levels if level.kind == "floor" and level.index not in taken]
    rooms += [Room("level", level.name, level.index, float(level.polygon.area)) for level in floors]
    return sorted(rooms, key=lambda room: (room.level, room.name))


def fill(
    building: Building, rooms: list[Room], people: int | None, density: float, stated: Mapping[str, float]
) -> list[Room]:
    """Return rooms with their numbers of people, 0 without a way to an exit or in stairwells.

    `people`: total number, divided among the rooms by area; `density` [1/m2]: used if `people` is not given, where the
    plan does not state the number of an area, as in `stated`; nobody starts on floors without areas if it states any.
    """
    open_levels = levels_reaching(building, building.exits) if building.exits else set(range(len(building.levels)))
    enclosures = {index: left_out(building, building.levels[index]).enclosures for index in open_levels}
    stairwells = {
        area.name
        for area in building.areas
        if area.level in enclosures and (area.polygon & enclosures[area.level]).area > STAIRWELL * area.polygon.area
    }
    used = [room for room in rooms if room.level in open_levels and room.name not in stairwells]
    names = {(room.key, room.name) for room in used}
    closed = [replace(room, number=0) for room in rooms if (room.key, room.name) not in names]
    if people is None:
        held = {(room.key, room.name): max(density * room.ground, 1.0) for room in used}
        held |= {("level", room.name): 0.0 for room in used if stated}
        held |= {("area", name): number for name, number in stated.items()}
        return [replace(room, number=int(held[room.key, room.name] + 0.5)) for room in used] + closed
    numbers = divided(people, [room.ground for room in used])
    return [replace(room, number=number) for room, number in zip(used, numbers, strict=True)] + closed


def groups_of(building: Building, rooms: Sequence[Room]) -> list[tuple[str, Room]]:
    """Return groups and their names: the rooms, those of a use as one if people start in all of them or in none."""
    uses = {area.name: area.use for area in building.areas}
    by_use: dict[object, list[Room]] = {}
    for row, room in enumerate(rooms):
        by_use.setdefault((room.key == "area" and uses.get(room.name)) or row, []).append(room)
    groups, names = [], set[str]()
    for use, own in by_use.items():
        if len(own) > 1 and len({room.number > 0 for room in own}) == 1:
            own = [Room("use", str(use), own[0].level, sum(one.ground for one in own), sum(one.number for one in own))]
        for group in own:
            groups.append((numbered(group.name, names), group))
            names.add(groups[-1][0])
    return groups


def with_missing(building: Building, findings: Sequence[Finding]) -> list[Finding]:
    """Return findings with what the building lacks first, the worst first, in place of warnings that tell the same."""
    if not building.exits:
        return list(findings)
    reached = levels_reaching(building, building.exits)
    floors = [own for _, levels in building.storeys if (own := [level for level in levels if level.kind == "floor"])]
    ground = sum(level.polygon.area for own in floors for level in own)
    lost = [level for own in floors for level in own if level.index not in reached]
    if sum(level.polygon.area for level in lost) <= NEGLIGIBLE * ground:
        return list(findings)
    closed = [own for own in floors if reached.isdisjoint(level.index for level in own)]
    lacks, told = [], [level for own in closed for level in own]
    if closed:
        verb = "has" if len(closed) == 1 else "have"
        names = _names([own[0] for own in closed])
        lacks.append(f"{len(closed)} of {counted(len(floors), 'storey')} {verb} no way out: {names}")
    rest = [level for level in lost if level not in told]
    area = sum(level.polygon.area for level in rest)
    if area > NEGLIGIBLE * ground:
        share = 100.0 * area / ground
        other = " on other storeys" if closed else ""
        lacks.append(f"{area:.1f} m2 of ground ({share:.0f} %){other} have no way out: {_names(rest)}")
        told += rest
    names_told = {level.name for level in told}
    again = {one for one in keyed(isolated_parts(building), building.keys) if one.level in names_told}
    return [*(Finding("missing", text) for text in lacks), *(finding for finding in findings if finding not in again)]


def _names(levels: Sequence[Level]) -> str:
    """Return the names of some levels, of which only the first are written."""
    others = f" and {len(levels) - MOST_NAMED} others" if len(levels) > MOST_NAMED else ""
    return ", ".join(repr(level.name) for level in levels[:MOST_NAMED]) + others
