"""Indoor maps in GeoJSON: conversion of the features of IMDF, OpenStreetMap and wrld3d to parts of a plan."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.geometry import connected_components, divided, flat_parts, lines_of
from evac.building.model.findings import numbered
from evac.building.surface.welding import welded

#: Values that nobody walks on: categories of IMDF, of indoor and of room in OpenStreetMap; those of shafts, whose doors
#: are no exits, and all.
SHAFTS = frozenset(("opentobelow", "elevator", "escalator", "shaft", "void"))
CLOSED = SHAFTS | {"structure", "column", "vegetation", "wall", "parking"}
#: Categories and values of ways that are open to each other without doors.
WAYS = frozenset(("walkway", "corridor", "area", "lobby", "foyer", "unenclosedarea", "ramp", "stairs", "steps"))
#: Categories of openings of IMDF that lead out of a building.
ENTRANCES = ("pedestrian.principal", "emergencyexit")
#: Width of doors without a width, of stairs without one [m], and the farthest that a door may be from its wall [m].
DOOR_WIDTH, STAIR_WIDTH, NEAR = 1.0, 1.5, 1.0
#: Widths of doors that are believed, and least length of a stair in plan [m].
DOORS, LEAST_STEPS = (0.3, 6.0), 0.5
#: Metres of a unit in which a width may be given.
UNITS = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
#: Corners that are this near to a side are on it, and doors that are this near to a side are doors of it [m].
SAME, BESIDE = 0.03, 0.3
#: Stairwells at least this wide have two flights, which have a gap between them; floor before them [m].
TWO_FLIGHTS, GAP, BEFORE = 1.7, 0.1, 1.2
#: Stairwells at least this wide for each metre of their length may have flights across it, where their doors are.
SQUARE = 0.9
#: Length of a stair in plan for each metre that it rises, at most.
GENTLE = 1.8
#: Longest name of a level that is not an identifier.
LONGEST_NAME = 30
#: Most levels of one feature.
MOST_LEVELS = 300
#: Properties by which the profiles are known.
OSM = "OpenStreetMap indoor"
PROFILES = {
    "IMDF": ("level_id", "ordinal"),
    OSM: ("indoor", "building:levels:underground", "buildingpart"),
    "wrld3d": ("roomnumber",),
}


@dataclass
class Storey:
    """What an indoor map has on one level; all shapes are in metres."""

    name: str
    order: float
    rooms: list[tuple[str, BaseGeometry]] = field(default_factory=list)
    ways: list[BaseGeometry] = field(default_factory=list)
    solids: list[BaseGeometry] = field(default_factory=list)
    shafts: list[BaseGeometry] = field(default_factory=list)
    steps: list[BaseGeometry] = field(default_factory=list)  # of stairs to and from other storeys
    doors: "list[MapDoor]" = field(default_factory=list)

    @property
    def outlets(self) -> BaseGeometry:
        """The places of all doors."""
        return shapely.union_all([door.shape for door in self.doors])

    def spaces(self) -> list[BaseGeometry]:
        """Return rooms, and ways, joined where no door is between them."""
        given = np.array([part for way in self.ways for part in shapely.get_parts(way)], dtype=object)
        pairs = shapely.STRtree(given).query(given, "intersects").T
        one, other = pairs[pairs[:, 0] < pairs[:, 1]].T
        common = shapely.intersection(shapely.buffer(given[one], SAME), given[other])
        is_closed = shapely.intersects(common, self.outlets.buffer(BESIDE / 2))
        is_open = ~is_closed | (shapely.area(common) > shapely.length(common) * SAME)
        group = connected_components(len(given), np.column_stack([one, other])[is_open])
        ways = [shapely.union_all(given[group == number]) for number in np.unique(group)]
        rooms = [part for _, room in self.rooms for part in shapely.get_parts(room)]
        return [*ways, *rooms]


@dataclass(frozen=True)
class MapDoor:
    """A door of a map: its name, its line or point, its width, and whether it is stated to lead out of the building."""

    name: str
    shape: BaseGeometry
    width: float
    is_entrance: bool


@dataclass(frozen=True)
class Steps:
    """A stair of a map: its name, those of its levels, its line and width, whether the line ascends, and its area."""

    name: str
    levels: tuple[str, str]
    line: BaseGeometry
    width: float
    is_directed: bool
    area: BaseGeometry | None = None


def read_map(
    profile: str, features: Sequence[tuple[Mapping[str, Any], BaseGeometry]]
) -> tuple[list[Storey], list[Steps], list[tuple[str, BaseGeometry]]]:
    """Return the storeys of an indoor map, the lowest first, its stairs, and what is on no storey: text and shape.

    `profile`: one of `PROFILES`; `features` [m].
    """
    levels: dict[str, Storey] = {}
    steps: list[Steps] = []
    nowhere: list[tuple[str, BaseGeometry]] = []
    shafts: list[tuple[Mapping[str, Any], BaseGeometry, Storey]] = []
    names = {
        str(own.get("id")): (_text(own.get("name")) or f"level {own['ordinal']}", _number(own["ordinal"], 0.0))
        for own, _ in features
        if "ordinal" in own
    }
    taken: set[str] = set()
    for own, drawn in features:
        shape = flat_parts(drawn) if drawn.geom_type == "GeometryCollection" else drawn
        what = _category(profile, own)
        on = _levels(own, names) if profile != "wrld3d" else ["floor"]
        if not what:
            nowhere.append((f"no floor, door or stair: {_kind(own)}", shape))
            continue
        is_stair = what == "steps" and len(on) > 1
        is_line = is_stair or what in ("door", "solid")
        if shape.is_empty or (is_stair and shape.length < LEAST_STEPS) or not (is_line or shape.area):
            nowhere.append((f"{what} {_text(own.get('name'))!r} without an area or a length", shape))
            continue
        if not on:
            nowhere.append((f"{what} {_text(own.get('name'))!r} without a level", shape))
        for name in on:
            label, order = names.get(name, (name, _number(name, float(len(levels)))))
            if name not in levels:
                label = numbered(f"level {len(levels)}" if len(label) > LONGEST_NAME else label, taken)
                taken.add(label)
                levels[name] = Storey(label, order)
        if is_stair:
            steps += _steps(own, shape, sorted((levels[name] for name in on), key=lambda one: one.order))
            if shape.geom_type == "LineString":
                continue
        if profile == "IMDF" and own.get("category") in ("stairs", "steps"):
            shafts.append((own, shape, levels[on[0]]))
        for name in on:
            _add(levels[name], what, own, shape)
    empty = [one for one in levels.values() if not (one.rooms or one.ways)]
    nowhere += [
        (f"door {door.name!r} on level {one.name!r}, which has no room", door.shape)
        for one in empty
        for door in one.doors
    ]
    storeys = sorted((one for one in levels.values() if one not in empty), key=lambda one: one.order)
    orders = sorted({storey.order for storey in storeys})
    above = dict(itertools.pairwise(orders))  # storeys of several buildings may have the same order
    for given, shape, low in shafts:  # a unit on each level: the one above belongs to the same stair
        for _, other, up in shafts:
            if above.get(low.order) == up.order and shape.intersection(other).area > 0.5 * shape.area:
                steps += _steps(given, shape, [low, up])
    known = {storey.name for storey in storeys}
    return storeys, [step for step in steps if known.issuperset(step.levels)], nowhere


def _category(profile: str, own: Mapping[str, Any]) -> str:
    """Return what a feature is: way, room, solid, door, steps; empty for what is not of interest."""
    if profile == "wrld3d":
        kinds = {"building_outline": "way", "wall": "solid", "window": "solid", "elevator": "solid", "door": "door"}
        return kinds.get(str(own.get("type")), "")
    if profile == "IMDF":
        if "ordinal" in own or "level_id" not in own:
            return ""
        kind = str(own.get("feature_type") or "unit")
        category = str(own.get("category") or "").partition(".")[0]
        if kind == "opening":
            return "door"
        if kind == "corridor":  # a type of its own in indoor maps like IMDF
            return "way"
        if kind != "unit" or category in CLOSED:
            return "shaft" if kind == "unit" and category in SHAFTS else ""
        return "way" if category in WAYS else "room"
    if own.get("highway") == "steps" or own.get("stairs") == "yes" or own.get("room") == "stairs":
        return "steps"
    if own.get("entrance") or own.get("door") not in (None, "no"):
        return "door"
    indoor, room = str(own.get("indoor") or own.get("buildingpart") or ""), str(own.get("room") or "")
    if own.get("highway") == "elevator" or {indoor, room} & SHAFTS:
        return "shaft"
    if not indoor or indoor == "level" or room in CLOSED:
        return ""
    return "solid" if indoor == "wall" else "" if indoor in CLOSED else "way" if indoor in WAYS else "room"


def _kind(own: Mapping[str, Any]) -> str:
    """Return what a feature that is not read says that it is, for the account."""
    kind = own.get("feature_type")
    keys = [
        key
        for key in ("category", "indoor", "room", "highway", "building", "amenity", "natural", "type")
        if own.get(key)
    ]
    keys = keys or [key for key in own if not key.startswith(("@", "addr"))] or ["no property"]
    return " ".join([*([str(kind)] if kind else []), f"{keys[0]}={_text(own.get(keys[0]))[:LONGEST_NAME]}"])


def _add(storey: Storey, what: str, own: Mapping[str, Any], shape: BaseGeometry) -> None:
    """Add a feature to a storey."""
    is_ground, name = shape.geom_type in ("Polygon", "MultiPolygon"), _text(own.get("name"))
    if what == "door":
        width = _length(own.get("width"), DOOR_WIDTH)
        width = width if DOORS[0] <= width <= DOORS[1] else DOOR_WIDTH
        is_entrance = bool(own.get("entrance")) or own.get("category") in ENTRANCES
        storey.doors.append(MapDoor(name, _axis(shape) if is_ground else shape, width, is_entrance))
    elif what == "solid":
        storey.solids.append(shape if is_ground else shape.buffer(0.05, cap_style="flat"))
    elif what == "shaft":
        storey.shafts.append(shape)
    elif what == "room":
        storey.rooms.append((name, shape))
    else:
        storey.ways.append(shape)


def _steps(own: Mapping[str, Any], shape: BaseGeometry, on: Sequence[Storey]) -> list[Steps]:
    """Return the stairs of a line, or of a polygon along its longer axis, one from each level to the next."""
    is_line = shape.geom_type == "LineString"
    line = shape.simplify(SAME) if is_line else _axis(shape)
    given = _length(own.get("width"), 0.0)
    width = given or (STAIR_WIDTH if is_line else shape.area / max(line.length, 1e-9))
    if own.get("incline") == "down":
        line = line.reverse()
    name, is_directed, area = _text(own.get("name")) or "stair", "incline" in own, None if is_line else shape
    pairs = itertools.pairwise(on)
    return [Steps(name, (low.name, up.name), line, width, is_directed, area) for low, up in pairs]


def laid(one: Steps, low: Storey, up: Storey, rise: float) -> Steps:
    """Return a stair that is given by its area with the line on which people walk in it.

    It is straight if there is floor at both ends, or if it is narrow, and else turns back to where the floor or the
    doors are.

    `rise` [m].
    """
    area = one.area
    if area is None:
        return one
    doors = (low.outlets | up.outlets) & area.buffer(BESIDE)
    places = shapely.get_coordinates([part.centroid for part in shapely.get_parts(doors)])
    walled = bool(len(places))
    if walled and _depth(one, places) > BEFORE and one.width >= SQUARE * one.line.length:
        one = min(one, _across(one), key=lambda way: _depth(way, places))
    ends = shapely.get_coordinates(one.line)
    length, width = float(np.hypot(*(ends[1] - ends[0]))), one.width
    floors = [shapely.union_all([*storey.ways, *(room for _, room in storey.rooms)]) for storey in (low, up)]
    floors = [floor.difference(area.buffer(SAME, join_style="mitre")) for floor in floors]
    beyond = [_beyond(end, end - ends.mean(axis=0), width) for end in ends]
    is_open = np.array([[(floor & box).area > box.area / 2 for box in beyond] for floor in floors])
    for way, (foot, head) in ((ends, (0, 1)), (ends[::-1], (1, 0))):
        if (not walled and is_open[0, foot] and is_open[1, head]) or (foot == 0 and width < TWO_FLIGHTS):
            return replace(one, line=shapely.LineString(way))
    if walled:
        first = int(np.hypot(*(places[:, None] - ends).transpose(2, 0, 1)).sum(axis=0).argmin())
    else:
        first = int(is_open.sum(axis=0).argmax())
    start, along = ends[first], (ends[1 - first] - ends[first]) / length
    across, lane = np.array([-along[1], along[0]]), (width - GAP) / 2
    flight = min(length - lane - (BEFORE if walled else 0.0), GENTLE * rise / 2 if walled else np.inf)
    begin, turn = length - lane - flight, length - lane / 2
    corners = [(begin, 1), (turn, 1), (turn, -1), (begin, -1)]
    line = [start + s * along + side * (lane + GAP) / 2 * across for s, side in corners]
    return replace(one, line=shapely.LineString(line), width=lane)


def _depth(one: Steps, places: FloatArray) -> float:
    """Return how far doors are from one end of a stair along it [m], the end at which this is less."""
    ends = shapely.get_coordinates(one.line)
    along = (places - ends[0]) @ (ends[1] - ends[0]) / one.line.length
    return float(min(along.max(), one.line.length - along.min()))


def _across(one: Steps) -> Steps:
    """Return a stair whose line is across its area."""
    ends = shapely.get_coordinates(one.line)
    half = (ends[1] - ends[0]) @ [[0, 1], [-1, 0]] / one.line.length * one.width / 2
    return replace(one, line=shapely.LineString(ends.mean(axis=0) + np.stack([-half, half])), width=one.line.length)


def _beyond(end: FloatArray, way: FloatArray, width: float) -> BaseGeometry:
    """Return the ground before the middle of an end of a stair, as deep as people need to stand on it."""
    way = way / np.hypot(*way)
    across = np.array([-way[1], way[0]]) * width / 4
    return shapely.polygons([end - across, end + across, end + across + BESIDE * way, end - across + BESIDE * way])


def pieces_of(one: Steps) -> tuple[list[FloatArray], list[BaseGeometry]]:
    """Return the edges (2, 2, 2) of the flights of a stair, at foot and head, and the landings between them.

    Turns have landings as deep as the stair is wide; parts of the line that are hardly longer belong to them.
    """
    corners = shapely.get_coordinates(one.line)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(*steps.T)
    last = len(steps) - 1
    rows = [row for row in range(last + 1) if row in (0, last) or lengths[row] > 1.5 * one.width]
    ways = steps / lengths[:, None]
    half = one.width / 2 * np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    flights = []
    for row in rows:
        foot = corners[row] + (row > 0) * one.width / 2 * ways[row]
        head = corners[row + 1] - (row < last) * one.width / 2 * ways[row]
        flights.append(np.array([[foot + half[row], foot - half[row]], [head + half[row], head - half[row]]]))
    landings = []
    for (row, before), (other, after) in itertools.pairwise(zip(rows, flights, strict=True)):
        depth = [one.width * ways[row], -one.width * ways[other]]
        edges = [before[1], before[1] + depth[0], after[0], after[0] + depth[1]]
        landings.append(shapely.MultiPoint(np.concatenate(edges)).convex_hull)
    parts = [shapely.MultiPoint(flight.reshape(-1, 2)).convex_hull for flight in flights] + landings
    is_tight = sum(part.area for part in parts) > shapely.union_all(parts).area + SAME
    if is_tight and np.hypot(*(corners[-1] - corners[0])) > LEAST_STEPS:  # It turns within its width.
        return pieces_of(replace(one, line=shapely.LineString(corners[[0, -1]])))
    return flights, landings


def agreeing(polygons: Sequence[BaseGeometry], fixed: FloatArray) -> list[BaseGeometry]:
    """Return polygons whose corners and sides are the same where they are at most `SAME` apart, without slivers.

    `fixed` (n, 2) [m]: points to which corners are moved that are as near to them.
    """
    corners, tree = shapely.get_coordinates(polygons), shapely.STRtree(shapely.points(fixed))
    row, near = tree.query_nearest(shapely.points(corners), max_distance=SAME, all_matches=False)
    corners[row] = fixed[near]
    joined = welded(shapely.set_coordinates(np.array(polygons, dtype=object), corners), SAME)
    corners = np.unique(shapely.get_coordinates(joined), axis=0)
    tree, found = shapely.STRtree(shapely.points(corners)), list[BaseGeometry]()
    for polygon in joined:
        outline, ring = shapely.get_coordinates(shapely.get_rings(polygon), return_index=True)
        is_side = ring[:-1] == ring[1:]
        side, points = divided(corners, tree, np.stack([outline[:-1], outline[1:]], axis=1)[is_side], SAME)
        rings = shapely.linearrings(points, indices=ring[:-1][is_side][side])
        whole = shapely.make_valid(shapely.polygons(rings[0], rings[1:]), method="structure", keep_collapsed=False)
        found += shapely.get_parts(flat_parts(whole)).tolist()
    return found


def _axis(shape: BaseGeometry) -> BaseGeometry:
    """Return the line through the middle of the smallest rectangle around a shape, along its longer sides."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:4]
    if np.hypot(*(corners[1] - corners[0])) > np.hypot(*(corners[2] - corners[1])):
        corners = np.roll(corners, -1, axis=0)
    return shapely.LineString([(corners[0] + corners[1]) / 2, (corners[2] + corners[3]) / 2])


def door_at(place: BaseGeometry, width: float, spaces: Sequence[BaseGeometry]) -> FloatArray | None:
    """Return the segment (2, 2) of a door along the side of a space at which it is; None if there is none near it.

    `place` [m]; `width` [m]: of a door that is a point; `spaces` [m].
    """
    if place.geom_type == "LineString":
        ends = shapely.get_coordinates(place)[[0, -1]]
        return ends if np.hypot(*(ends[1] - ends[0])) > 0.3 else None
    middle = place.centroid
    rings = [ring for part in spaces if part.dwithin(middle, NEAR) for ring in shapely.get_parts(part.boundary)]
    lines = np.array([side for ring in rings for side in _long_sides(ring)], dtype=object)
    apart = shapely.distance(lines, middle)
    if apart.min(initial=np.inf) > NEAR:
        return None
    near = sorted(lines[apart <= apart.min() + SAME], key=shapely.length)
    a, b = shapely.get_coordinates(next((side for side in near if 0.9 * side.length > width), near[-1]))
    length = float(np.hypot(*(b - a)))
    half = min(width, 0.9 * length) / 2.0
    at = float(np.clip(shapely.line_locate_point(shapely.LineString([a, b]), middle), half, length - half))
    return np.stack([a + (at - half) * (b - a) / length, a + (at + half) * (b - a) / length])


def _long_sides(ring: BaseGeometry) -> list[BaseGeometry]:
    """Return the sides of a ring between its corners, without corners on straight sides."""
    corners = shapely.get_coordinates(ring)[:-1]
    first = int(np.argmax(np.hypot(*(corners - corners.mean(axis=0)).T)))  # is no corner on a side
    return lines_of(shapely.linearrings(np.roll(corners, -first, axis=0)).simplify(SAME))


def at_wall(ends: FloatArray, floor: BaseGeometry, *, leads_out: bool) -> FloatArray:
    """Return a door (2, 2) moved to the middle of its wall, or, if it leads out, through its wall to the outline."""
    step = ends[1] - ends[0]
    across = np.array([-step[1], step[0]]) / np.hypot(*step)
    middle = ends.mean(axis=0)
    rays = [shapely.LineString([middle, middle + NEAR * way]) for way in (across, -across)]
    moved: FloatArray = ends
    if leads_out:
        inside = [shapely.intersection(ray, floor).length for ray in rays]
        moved = ends + min(inside) * (across if inside[0] < inside[1] else -across)
        return moved
    gaps = shapely.get_parts(shapely.difference(shapely.union_all(rays), floor))
    gaps = shapely.get_parts(shapely.line_merge(shapely.union_all(gaps)))
    gaps = [gap for gap in gaps if gap.dwithin(shapely.Point(middle), BESIDE) and gap.length < NEAR]
    if gaps:
        wall = min(gaps, key=shapely.Point(middle).distance)
        moved = ends + shapely.get_coordinates(wall).mean(axis=0) - middle
    return moved


def _levels(own: Mapping[str, Any], names: Mapping[str, Any]) -> list[str]:
    """Return the levels of a feature; level 0 for entrances without one."""
    if "level_id" in own:
        return [str(own["level_id"])]
    given = own.get("level") if own.get("level") is not None else "0" if own.get("entrance") else ""
    text = ";".join(map(str, given)) if isinstance(given, list) else str(given)
    found: list[str] = []
    for part in re.split(r"\s*[;,]\s*", f"{text};{own.get('repeat_on') or ''}".strip()):
        span = re.fullmatch(r"(-?\d+)\s*-\s*(-?\d+)", part)
        if span and abs(int(span[2]) - int(span[1])) > MOST_LEVELS:
            raise ValueError(f"a feature is on the levels {part}, more than {MOST_LEVELS}")
        if span:
            low, high = sorted((int(span[1]), int(span[2])))
            found += [str(number) for number in range(low, high + 1)]
        elif part:
            number = _number(part, math.inf)
            found.append(part if number == math.inf else f"{number:g}")
    return list(dict.fromkeys(found))


def _text(value: Any) -> str:
    """Return a name; of a table of languages the first one."""
    if isinstance(value, Mapping):
        return str(value.get("en") or next(iter(value.values()), ""))
    return "" if value is None else str(value)


def _length(value: Any, default: float) -> float:
    """Return a length in metres, which may have its unit: ``0.9``, ``90 cm``."""
    found = re.fullmatch(r"\s*([\d.,]+)\s*([a-z]*)\s*", str(value))
    if found is None or found[2] not in UNITS:
        return default
    return _number(found[1].replace(",", "."), default / UNITS[found[2]]) * UNITS[found[2]]


def _number(value: Any, default: float) -> float:
    try:
        number = float(str(value))
    except ValueError:
        return default
    return number if math.isfinite(number) else default
