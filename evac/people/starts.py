"""Where people start: rooms with their numbers, and the ground on which nobody starts unless the case names it."""

import math
import tomllib
from collections.abc import Callable, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray
from evac.base.defaults import DOOR_REACH
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.building.model.building import Area, Building, Level
from evac.building.model.cells import Cells
from evac.building.model.findings import Finding, item_of
from evac.directions.routes import WEIGHED

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import GroupSettings

#: Use of rooms that enclose stairs. Rooms without it do so where their ground is at most so many areas of the stair, or
#: where all of it is within this distance from the stair [m].
STAIR, MOST_STAIRS, AROUND_STAIR = "stair", 2.0, 3.0
#: Distance beside the end of a door at which its wall is measured, and within which outlines touch [m].
BESIDE, TOUCH = 0.02, 2e-3
#: Ground that is neglected [m2]; distance of the points at which ground without a way out is looked for [m], and the
#: greatest number of these points.
SMALLEST, SAMPLES, MOST_SAMPLES = 1e-3, 0.25, 20_000

NO_FACES = np.zeros((0, 4))


@cache
def load_table() -> dict[str, dict[str, Any]]:
    """Return the table of loads: of each known use ``ground`` of a person [m2], or ``people`` = 0, and ``source``."""
    return tomllib.loads(files("evac.people").joinpath("loads.toml").read_text(encoding="utf-8"))


def rooms_of(source: str, people: "GroupSettings", building: Building) -> list[tuple[Area, float]]:
    """Return the areas in which a group starts at random, each with the number of people that it holds by itself.

    That is their density if the group has one, or what the plan states for the room, or the load of its use.
    """
    if people.use is not None:
        rooms = [area for area in building.areas if area.use == people.use]
        if not rooms:
            known = did_you_mean(people.use, sorted({area.use for area in building.areas if area.use}))
            raise ScenarioError(f"{source}: people.{people.name}.use: no room has the use {people.use!r}; {known}")
    else:
        rooms = building.parts_named(people.area or people.level or "")
    return [(area, held_by(area, people.density)) for area in rooms]


def held_by(area: Area, density: float | None = None) -> float:
    """Return the number of people in an area by their density [1/m2], or else as stated, or by the load of its use."""
    if density is None and area.people is not None:
        return area.people
    if density is None:
        ground = load_table().get(area.use, {}).get("ground")
        density = 0.0 if ground is None else 1.0 / ground
    return density * float(area.polygon.area)


def with_numbers(case: "Case", building: Building) -> "Case":
    """Return the case with the number of people of each group that states a density or the use of rooms instead.

    Groups that do not use all stairs take lifts, unless they say otherwise.
    """
    groups = []
    for people in case.people:
        number = people.number
        if people.arrive is None and people.positions is None and number is None:
            rooms = rooms_of(str(case.source), people, building)
            number = sum(round(held) for _, held in rooms)
            if not number:
                names = ", ".join(repr(area.name) for area, _ in rooms)
                text = f"{case.source}: people.{people.name}.number: missing; {names} hold nobody by density or use"
                raise ScenarioError(f"{text} (of {', '.join(load_table())}); give number or density")
        own: dict[str, int | str | None] = {} if number == people.number else {"number": number}
        if building.lifts and people.lifts is None and people.steepest is not None:
            own |= {"lifts": WEIGHED}
        groups.append(people.model_copy(update=own) if own else people)
    return case.model_copy(update={"people": tuple(groups)})


def divided(people: int, shares: Sequence[float]) -> list[int]:
    """Return people divided in proportion to shares; the largest remainder method makes the numbers add up."""
    share = people * np.asarray(shares, np.float64) / max(sum(shares), 1e-9)
    number = np.floor(share)
    rest = int(people - number.sum()) if len(number) else 0
    number[np.argsort(-(share - number), kind="stable")[:rest]] += 1.0
    return [int(count) for count in number]


def starts_of(source: str, people: "GroupSettings", building: Building) -> list[tuple[Area, int]]:
    """Return the areas in which a group with a number starts at random, each with its number of people."""
    rooms = rooms_of(source, people, building)
    held = [round(number) for _, number in rooms]
    shares = held if any(held) else [area.polygon.area for area, _ in rooms]
    return [(rooms[k][0], number) for k, number in enumerate(divided(people.number or 0, shares))]


class LeftOut(NamedTuple):
    """Ground of a level on which nobody starts, unless a case names it."""

    doorways: BaseGeometry
    enclosures: BaseGeometry  # of stairs
    faces: FloatArray  # (s, 4): both sides of each doorway between rooms [m], on which no body stands


class Start(NamedTuple):
    """Where people of a group may start within an area, and what is left out of it."""

    may_start: Callable[[FloatArray], BoolArray]
    faces: FloatArray
    findings: tuple[Finding, ...]


def start_in(building: Building, area: Area, out: LeftOut, has_way: Callable[[FloatArray], BoolArray]) -> Start:
    """Return where people may start in an area; a kind of ground that is all of the area is not left out of it."""
    kinds = {"doorways": out.doorways, "enclosures of stairs": out.enclosures}
    lost = {kind: ground.intersection(area.polygon) for kind, ground in kinds.items()}
    lost = {kind: ground for kind, ground in lost.items() if SMALLEST < ground.area < area.polygon.area - SMALLEST}
    ground = {kind: float(part.area) for kind, part in lost.items()}
    barred = shapely.union_all([*lost.values()])
    shapely.prepare(barred)
    spacing = max(SAMPLES, math.sqrt(area.polygon.envelope.area / MOST_SAMPLES))
    cells = np.column_stack([one.ravel() for one in Cells(area, spacing).centres()])
    cells = cells[shapely.intersects_xy(area.polygon.buffer(-SAMPLES / 2), *cells.T)]
    is_way = has_way(cells)
    if is_needed := bool(is_way.any() and not is_way.all()):
        ground["floor without a way out"] = spacing**2 * int((~is_way).sum())

    def may_start(points: FloatArray) -> BoolArray:
        allowed: BoolArray = ~shapely.intersects_xy(barred, points[:, 0], points[:, 1])
        return allowed & has_way(points) if is_needed else allowed

    name, on = area.name, building.levels[area.level]
    item = item_of(on) if name == on.name else f"areas.{name}"
    texts = [f"nobody starts in {value:.1f} m2 of {kind} in {name!r}" for kind, value in ground.items()]
    places = {kind: part.representative_point().coords[0] for kind, part in lost.items()}
    if is_needed:
        places["floor without a way out"] = tuple(cells[~is_way][(~is_way).sum() // 2].tolist())
    findings = [
        Finding("left out", text, on.name, places[kind], item) for text, kind in zip(texts, ground, strict=True)
    ]
    return Start(may_start, out.faces if "doorways" in lost or out.doorways.is_empty else NO_FACES, tuple(findings))


def left_out(building: Building, level: Level) -> LeftOut:
    """Return the doorways of a level, from one face of their wall to the other, and its enclosures of stairs."""
    doors = np.array([door.segment for door in building.doors if door.level == level.index]).reshape(-1, 4)
    ways = np.concatenate([doors, *(way.segments for way in building.exits_of(level.index))])
    left, right = (_depth(level.polygon, ways, side)[:, None] * _across(ways, side) for side in (1.0, -1.0))
    starts, ends = ways[:, :2], ways[:, 2:]
    passages = shapely.polygons(np.stack([starts + left, ends + left, ends + right, starts + right], axis=1))
    doorways = shapely.union_all(passages[shapely.area(passages) > SMALLEST]).intersection(level.polygon)
    faces = np.stack([starts + left, ends + left, starts + right, ends + right], axis=1)[: len(doors)].reshape(-1, 4)
    return LeftOut(doorways, _enclosures(building, level, faces), faces)


def _across(ways: FloatArray, side: float) -> FloatArray:
    """Return the unit vectors (n, 2) to the left of segments, or with -1 to their right."""
    along = (ways[:, 2:] - ways[:, :2]) / np.hypot(*(ways[:, 2:] - ways[:, :2]).T)[:, None]
    across: FloatArray = side * np.column_stack([-along[:, 1], along[:, 0]])
    return across


def _depth(floor: BaseGeometry, ways: FloatArray, side: float) -> FloatArray:
    """Return the depth (n,) of the wall on one side of doors and exits [m]; 0 where it has no face within reach."""
    across, depth = _across(ways, side), np.zeros(len(ways))
    shapely.prepare(floor)
    for end, other in ((slice(0, 2), slice(2, 4)), (slice(2, 4), slice(0, 2))):
        outward = ways[:, end] - ways[:, other]
        beside = ways[:, end] + BESIDE * outward / np.hypot(*outward.T)[:, None]
        rays = shapely.linestrings(np.stack([beside, beside + DOOR_REACH * across], axis=1))
        face = shapely.distance(shapely.points(beside), shapely.intersection(rays, floor))
        depth = np.fmax(depth, face)
    return depth


def _enclosures(building: Building, level: Level, faces: FloatArray) -> BaseGeometry:
    """Return the rooms with the use of a stair, and small ones with a door from which a stair leads away."""
    found = [area.polygon for area in building.areas if area.level == level.index and area.use == STAIR]
    ways = [(portal, building.levels[portal.other(level.index)].stair) for portal in building.portals_of(level.index)]
    if level.stair is None and len(faces) and any(stair for _, stair in ways):
        walls = building.walls[building.wall_level == level.index]
        doors = shapely.linestrings(faces.reshape(-1, 2, 2))
        lines = shapely.union_all([*shapely.linestrings(walls.reshape(-1, 2, 2)), *doors])
        parts = shapely.get_parts(level.polygon.difference(lines.buffer(TOUCH / 4, quad_segs=1)))
        parts = parts[shapely.distance(parts, shapely.union_all(doors)) <= TOUCH]
        for portal, stair in ways:
            line = shapely.multilinestrings(portal.segments.reshape(-1, 2, 2))
            pieces = [building.levels[index].polygon for index in building.stairs.get(stair or "", ())]
            stair_ground = shapely.convex_hull(shapely.union_all([line, *pieces]))
            most = MOST_STAIRS * sum(piece.area for piece in pieces)
            for part in parts[shapely.distance(parts, line) <= TOUCH] if stair else ():
                corners = shapely.points(shapely.get_coordinates(part))
                if part.area <= most or shapely.distance(corners, stair_ground).max() <= AROUND_STAIR:
                    found.append(part)
    return shapely.union_all(found)
