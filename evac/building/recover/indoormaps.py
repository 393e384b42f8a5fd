"""Indoor maps as GeoJSON: what the features of IMDF, of OpenStreetMap and of wrld3d are."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.geometry import lines_of
from evac.building.model.findings import numbered

#: Values that nobody walks on: categories of IMDF, of indoor and of room in OpenStreetMap.
CLOSED = frozenset(("opentobelow", "structure", "column", "elevator", "shaft", "vegetation", "wall", "void", "parking"))
#: Categories and values of ways that are open to each other without doors.
WAYS = frozenset(("walkway", "corridor", "area", "lobby", "foyer", "unenclosedarea", "ramp", "stairs", "steps"))
#: Categories of units of IMDF that are stairs.
STAIRS = ("stairs", "steps")
#: Width of doors without a width, of stairs without one [m], and the farthest that a door may be from its wall [m].
DOOR_WIDTH, STAIR_WIDTH, NEAR = 1.0, 1.5, 1.0
#: Widths of doors that are believed, and least length of a stair in plan [m].
DOORS, LEAST_STEPS = (0.3, 6.0), 0.5
#: Longest name of a level that is not an identifier.
LONGEST_NAME = 30
#: Most levels of one feature.
MOST_LEVELS = 300
#: Properties by which the profiles are known.
PROFILES = {
    "IMDF": ("level_id", "ordinal"),
    "OpenStreetMap indoor": ("indoor", "building:levels:underground", "buildingpart"),
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
    doors: list[tuple[str, BaseGeometry, float]] = field(default_factory=list)  # name, line or point, width


@dataclass(frozen=True)
class Steps:
    """A stair of a map: its name, the names of its levels, its line, its width, and whether the line ascends."""

    name: str
    levels: tuple[str, str]
    line: BaseGeometry
    width: float
    is_directed: bool


def profile_of(names: set[str]) -> str:
    """Return the profile of a file whose features have some properties; empty if it is none."""
    return next((profile for profile, keys in PROFILES.items() if names & set(keys)), "")


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
    names: dict[str, tuple[str, float]] = {}
    for own, _ in features:
        if "ordinal" in own:
            names[str(own.get("id"))] = (
                _text(own.get("name")) or f"level {own['ordinal']}",
                _number(own["ordinal"], 0.0),
            )
    taken: set[str] = set()
    for own, shape in features:
        what = _category(profile, own)
        on = _levels(own, names) if profile != "wrld3d" else ["floor"]
        if not what:
            continue
        if shape.is_empty or (what == "steps" and len(on) > 1 and shape.length < LEAST_STEPS):
            nowhere.append((f"{what} {_text(own.get('name'))!r} without a length", shape))
            continue
        if not on:
            nowhere.append((f"{what} {_text(own.get('name'))!r} without a level", shape))
        for name in on:
            label, order = names.get(name, (name, _number(name, float(len(levels)))))
            if name not in levels:
                label = numbered(f"level {len(levels)}" if len(label) > LONGEST_NAME else label, taken)
                taken.add(label)
                levels[name] = Storey(label, order)
        if what == "steps" and len(on) > 1:
            steps += _steps(own, shape, sorted((levels[name] for name in on), key=lambda one: one.order))
            if shape.geom_type == "LineString":
                continue
        if profile == "IMDF" and own.get("category") in STAIRS:
            shafts.append((own, shape, levels[on[0]]))
        for name in on:
            width = _number(own.get("width"), DOOR_WIDTH)
            width = width if DOORS[0] <= width <= DOORS[1] else DOOR_WIDTH
            _add(levels[name], what, _text(own.get("name")), shape, width)
    empty = [one for one in levels.values() if not (one.rooms or one.ways)]
    nowhere += [
        (f"door {name!r} on level {one.name!r}, which has no room", at) for one in empty for name, at, _ in one.doors
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
        return "" if kind != "unit" or category in CLOSED else "way" if category in WAYS else "room"
    if own.get("highway") == "steps" or own.get("stairs") == "yes" or own.get("room") == "stairs":
        return "steps"
    if own.get("entrance") or own.get("door") not in (None, "no"):
        return "door"
    indoor, room = str(own.get("indoor") or own.get("buildingpart") or ""), str(own.get("room") or "")
    if not indoor or indoor == "level" or room in CLOSED or own.get("highway") == "elevator":
        return ""
    return "solid" if indoor == "wall" else "" if indoor in CLOSED else "way" if indoor in WAYS else "room"


def _add(storey: Storey, what: str, name: str, shape: BaseGeometry, width: float) -> None:
    """Add a feature to a storey."""
    is_ground = shape.geom_type in ("Polygon", "MultiPolygon")
    if what == "door":
        storey.doors.append((name, _axis(shape) if is_ground else shape, width))
    elif what == "solid":
        storey.solids.append(shape if is_ground else shape.buffer(0.05, cap_style="flat"))
    elif is_ground and what == "room":
        storey.rooms.append((name, shape))
    elif is_ground:
        storey.ways.append(shape)


def _steps(own: Mapping[str, Any], shape: BaseGeometry, on: Sequence[Storey]) -> list[Steps]:
    """Return the stairs of a line, or of a polygon along its longer axis, one from each level to the next."""
    is_line = shape.geom_type == "LineString"
    line = shape if is_line else _axis(shape)
    given = _number(own.get("width"), 0.0)
    width = given or (STAIR_WIDTH if is_line else shape.area / max(line.length, 1e-9))
    if own.get("incline") == "down":
        line = line.reverse()
    name = _text(own.get("name")) or "stair"
    return [Steps(name, (low.name, up.name), line, width, "incline" in own) for low, up in itertools.pairwise(on)]


def _axis(shape: BaseGeometry) -> BaseGeometry:
    """Return the line through the middle of the smallest rectangle around a shape, along its longer sides."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:4]
    if np.hypot(*(corners[1] - corners[0])) > np.hypot(*(corners[2] - corners[1])):
        corners = np.roll(corners, -1, axis=0)
    return shapely.LineString([(corners[0] + corners[1]) / 2, (corners[2] + corners[3]) / 2])


def door_at(place: BaseGeometry, width: float, walls: BaseGeometry) -> FloatArray | None:
    """Return the segment (2, 2) of a door along the wall at which it is; None if there is no wall near it.

    `place` [m]; `width` [m]: of a door that is a point; `walls` [m].
    """
    if place.geom_type == "LineString":
        ends = shapely.get_coordinates(place)[[0, -1]]
        return ends if np.hypot(*(ends[1] - ends[0])) > 0.3 else None
    middle = place.centroid
    lines = [side for part in shapely.get_parts(walls) for side in lines_of(part)]
    tree = shapely.STRtree(lines)
    near = tree.query_nearest(middle, max_distance=NEAR)
    if not len(near):
        return None
    a, b = shapely.get_coordinates(lines[int(near[0])])
    length = float(np.hypot(*(b - a)))
    half = min(width, 0.9 * length) / 2.0
    at = float(np.clip(shapely.line_locate_point(lines[int(near[0])], middle), half, length - half))
    return np.stack([a + (at - half) * (b - a) / length, a + (at + half) * (b - a) / length])


def at_outline(ends: FloatArray, floor: BaseGeometry) -> FloatArray:
    """Return a door (2, 2) to the outside moved through its wall to the outline of the floor."""
    step = ends[1] - ends[0]
    across = np.array([-step[1], step[0]]) / np.hypot(*step)
    middle = ends.mean(axis=0)
    rays = [shapely.LineString([middle, middle + NEAR * way]) for way in (across, -across)]
    inside = [shapely.intersection(ray, floor).length for ray in rays]
    out = across if inside[0] < inside[1] else -across
    moved: FloatArray = ends + min(inside) * out
    return moved


def _levels(own: Mapping[str, Any], names: Mapping[str, Any]) -> list[str]:
    """Return the levels of a feature; level 0 for entrances without one."""
    if "level_id" in own:
        return [str(own["level_id"])]
    text = str(own.get("level") if own.get("level") is not None else "0" if own.get("entrance") else "")
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


def _number(value: Any, default: float) -> float:
    try:
        number = float(str(value))
    except ValueError:
        return default
    return number if math.isfinite(number) else default
