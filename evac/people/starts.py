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

from evac.base.arrays import BoolArray, FloatArray, IntArray
from evac.base.defaults import DOOR_REACH
from evac.base.distributions import generator_for
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.building.model.building import Area, Building, Exit, Level, Portal
from evac.building.model.cells import Cells
from evac.building.model.findings import Finding, item_of
from evac.building.model.links import ways_onto
from evac.directions.routes import WEIGHED
from evac.people.placement import clearance
from evac.physics.state import Crowd

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
    """Return the areas in which a group starts at random, each with the number of people that it holds by itself."""
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


TRIES = 64  #: Places that are tried at random for each person at each tick.
GAP = 0.01  #: Gap between people, and from people to walls, at the place where somebody comes in [m].


def times_of_arrival(people: "GroupSettings", seed: int) -> FloatArray:
    """Return the times at which the people of a group come [s], in ascending order.

    At a rate, they are those of a Poisson process, from a generator of this group alone; infinite for those who come
    only if they are added.
    """
    arrive = people.arrive
    assert arrive is not None
    if arrive.reserve is not None:
        return np.full(arrive.reserve, np.inf)
    if arrive.times is not None:
        return np.sort(np.array(arrive.times, dtype=np.float64))
    begin, end = arrive.from_ or 0.0, arrive.to or 0.0
    generator = generator_for(seed, "people", people.name, "arrival")
    number = int(generator.poisson((arrive.rate or 0.0) * (end - begin)))
    return np.sort(generator.uniform(begin, end, number))


class Source(Saved):
    """The place at which the people of a group come in, and the times at which they come, ascending (k,) [s].

    `place` (k, 2) are the places of people who were added at one, NaN for others [m].
    """

    saved = ("due", "place")

    def __init__(self, people: "GroupSettings", rows: IntArray, due: FloatArray, seed: int) -> None:
        assert people.arrive is not None
        self.rows, self.due, self.place = rows, due, np.full((len(rows), 2), np.nan)
        self.name, self._seed = people.name, seed
        self._exit, self._portal = people.arrive.exit, people.arrive.portal
        self._is_at_edge = people.arrive.exit is not None or people.arrive.portal is not None
        self._place = people.area or people.level or ""

    def waiting(self, crowd: Crowd, time: float) -> IntArray:
        """Return the people whose time has come, but who are not inside."""
        due: IntArray = self.rows[np.isnan(crowd.arrival_time[self.rows]) & (self.due <= time + 1e-9)]
        return due

    def add(self, building: Building, crowd: Crowd, time: float, place: tuple[float, float] | None) -> int:
        """Let the next person of the reserve come at a time, at a place on the level [m] or where the group enters."""
        left = np.flatnonzero(np.isinf(self.due))
        if not len(left):
            raise ScenarioError(f"people.{self.name}: all {len(self.due)} people of arrive.reserve have come; raise it")
        if place is not None:
            level = building.levels[self._ways(building)[0]]
            if not level.polygon.covers(shapely.Point(place)):
                raise ScenarioError(f"people.{self.name}: ({place[0]:g}, {place[1]:g}) is not on level {level.name!r}")
            self.place[left[0]] = place
        self.due[left[0]] = time
        return int(self.rows[left[0]])

    def let_in(self, building: Building, crowd: Crowd, time: float) -> IntArray:
        """Put people who wait to free places, in the order of their times, and return those who have come in.

        Ways that are closed or lead out only let nobody in. The response times of people begin when they have come.
        """
        waiting, came = self.waiting(crowd, time), list[int]()
        if not len(waiting):
            return waiting
        level, ways = self._ways(building)
        area = None if self._is_at_edge else building.area_named(self._place)
        walls = [building.walls[building.wall_level == level]]
        walls += [link.segments for link in building.links_of(level) if all(link is not way for way in ways)]
        own = (way.segments_from(level) if isinstance(way, Portal) else way.segments for way in ways)
        edges = np.concatenate([np.zeros((0, 4)), *own])  # with the level on their left
        near = [level, *(way.other(level) for way in ways if isinstance(way, Portal))]
        for row in waiting.tolist():
            generator = generator_for(self._seed, "people", self.name, "place", str(row), f"{time:.6f}")
            radius = float(crowd.radius[row])
            if not np.isnan(own := self.place[self.rows == row]).any():
                tries = own
            elif area is not None:
                tries = _in_area(area.polygon, generator)
            elif len(edges):
                tries = _behind(edges, radius, generator)
            else:
                break  # all ways are closed
            there = np.flatnonzero(np.isin(crowd.level, near))
            away = np.hypot(*(tries[:, None] - crowd.position[there]).transpose(2, 0, 1))
            is_free = (away >= radius + crowd.radius[there] + GAP).all(axis=1)
            is_free &= clearance(tries, np.concatenate(walls)) >= radius + GAP
            if not is_free.any():
                if np.isnan(own).any():
                    break  # who comes later waits behind
                continue
            crowd.position[row], crowd.level[row] = tries[np.argmax(is_free)], level
            crowd.velocity[row], crowd.arrival_time[row] = 0.0, time
            crowd.start_time[row] += time
            came.append(row)
        return np.array(came, dtype=np.int32)

    def _ways(self, building: Building) -> tuple[int, list[Portal | Exit]]:
        """Return the level onto which people come, and the open exits or portals through which they do."""
        if self._exit is not None:
            exits = [way for way in building.exits if way.name == self._exit]
            return exits[0].level, [way for way in exits if building.lets_in(way)]
        area = building.area_named(self._place)
        assert area is not None
        portals = ways_onto(building, area.level).get(self._portal or "", [])
        return area.level, [way for way in portals if building.leads_from(way, way.other(area.level))]


def _in_area(polygon: shapely.Geometry, generator: np.random.Generator) -> FloatArray:
    """Return random places in a polygon [m]."""
    left, bottom, right, top = polygon.bounds
    places = generator.uniform((left, bottom), (right, top), (TRIES, 2))
    inside: FloatArray = places[shapely.contains_xy(polygon, *places.T)]
    return inside


def _behind(segments: FloatArray, radius: float, generator: np.random.Generator) -> FloatArray:
    """Return random places inside an exit or a portal whose bodies touch its line from the inside [m]."""
    x1, y1, x2, y2 = segments[generator.integers(len(segments), size=TRIES)].T
    share = generator.uniform(0.0, 1.0, TRIES)
    length = np.hypot(x2 - x1, y2 - y1)
    inward = np.stack([y1 - y2, x2 - x1], axis=1) / length[:, None]
    on_line = np.stack([x1 + share * (x2 - x1), y1 + share * (y2 - y1)], axis=1)
    found: FloatArray = on_line + (radius + GAP) * inward
    return found
