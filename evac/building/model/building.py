"""Data model of a building: levels, portals, exits, areas, walls, all immutable, and heights of points on levels."""

import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Control
from evac.base.errors import ResultError
from evac.base.parameters import did_you_mean
from evac.building.model.findings import Finding, warnings_of

if TYPE_CHECKING:
    import networkx
    from matplotlib.figure import Figure

    from evac.building.model.lifts import Lift

FLAT, UP, DOWN = 0, 1, 2  #: Slope classes: walking on the flat, up or down a slope. Columns of speeds and lengths.


@dataclass(frozen=True)
class Level:
    """A maximal edge-connected set of cells with one slope class: a floor, a flight or a landing."""

    index: int  #: row in all per-level arrays
    name: str  #: tag of the mesh, or generated from kind and height (``"flight z=0.00..1.50"``); unique
    #: ``"floor"``, ``"flight"`` (sloped), ``"landing"`` (flat, between flights of one stair) or ``"car"`` (the room of
    #: a lift at one of its stops)
    kind: str
    stair: str | None  #: name of the stair it belongs to, or None
    triangles: IntArray  #: (t, 3) int32: rows of ``Building.vertices``
    polygon: BaseGeometry  #: the level in plan, with holes
    uphill: FloatArray  #: (2,) float64: unit vector of steepest ascent in plan, zero on a flat level
    slope: float  #: angle with the horizontal [rad]
    z_min: float  #: height of its lowest vertex [m]
    z_max: float  #: height of its highest vertex [m]
    is_ramp: bool = False  #: whether people walk on this slope at their speed on the level

    @property
    def title(self) -> str:
        """Name by which it is shown: that of the stair of which it is a piece, or its own."""
        return self.stair or self.name

    @property
    def climb(self) -> FloatArray:
        """Return `uphill`, or zero where people walk at their speed on the level, (2,)."""
        return np.zeros(2) if self.is_ramp else self.uphill


@dataclass(frozen=True)
class Portal:
    """A chain of edges shared by two levels, which people can cross in both directions."""

    kind: ClassVar[str] = "portal"
    index: int  #: row in ``Building.portals``
    name: str
    levels: tuple[int, int]  #: indices of the two levels that it joins
    segments: FloatArray  #: (s, 4) float64: x1, y1, x2, y2 [m], each with the first level's inside on its left
    width: float  #: total length of its segments [m]

    def other(self, level: int) -> int:
        """Return the level on the other side."""
        first, second = self.levels
        return second if level == first else first

    def segments_from(self, level: int) -> FloatArray:
        """Return the segments (s, 4) [m] oriented with the inside of the given level on their left."""
        return self.segments if level == self.levels[0] else self.segments[:, [2, 3, 0, 1]]


@dataclass(frozen=True)
class Exit:
    """A chain of edges on the boundary of one level; people leave the building when their centre crosses it."""

    kind: ClassVar[str] = "exit"
    index: int  #: row in ``Building.exits``
    name: str
    level: int
    segments: FloatArray  #: (s, 4) float64: x1, y1, x2, y2 [m], each with the level's inside on its left
    width: float  #: total length of its segments [m]

    @property
    def levels(self) -> tuple[int]:
        """Return its level."""
        return (self.level,)


@dataclass(frozen=True)
class Door:
    """A door between rooms: an opening in a wall within one level, and part of its floor."""

    kind: ClassVar[str] = "door"
    index: int  #: row in ``Building.doors``
    name: str
    level: int
    segment: FloatArray  #: (4,) float64: its ends x1, y1, x2, y2 [m]
    width: float  #: clear width [m]

    @property
    def levels(self) -> tuple[int]:
        """Return its level."""
        return (self.level,)

    @property
    def segments(self) -> FloatArray:
        """Return its segment, (1, 4) [m]."""
        return self.segment.reshape(1, 4)


@dataclass(frozen=True)
class Ride:
    """The way of a lift between two neighbouring stops: people change the level on it without crossing a line."""

    kind: ClassVar[str] = "ride"
    index: int  # row in `Building.rides`
    name: str
    levels: tuple[int, int]  # rooms of the lift, the lower one first
    width: ClassVar[float] = np.inf

    @property
    def segments(self) -> FloatArray:
        """Return no segment, (0, 4) [m]."""
        return np.zeros((0, 4))


def ride_name(lift: str, lower: str, upper: str) -> str:
    """Return the name of the ride of a lift between two neighbouring stops."""
    return f"{lift}: {lower} - {upper}"


#: What people pass and what can be closed: they have `kind`, `index`, `name`, `levels`, `segments` and `width`.
Link = Portal | Exit | Door | Ride


@dataclass(frozen=True)
class Area:
    """A named part of a level in which people can start."""

    name: str
    level: int
    polygon: BaseGeometry  #: the area in plan [m]
    use: str = ""  #: what the room of a plan is used for, such as ``"office"``; empty if the source does not say
    people: float | None = None  #: number of people that the source states for it, or None


class Jump(NamedTuple):
    """A way from one area to another one that takes a stated time, as by a lift."""

    start: str  # name of an area
    end: str
    time: float  # from the middle of the one to that of the other [s]


@dataclass(frozen=True)
class Place:
    """A place with a task in the evacuation, which a case names."""

    name: str
    #: ``"refuge"``, ``"assembly"``, ``"sign"`` or ``"fire"``; or ``"line"``, through which people are counted
    kind: str
    level: int
    shape: BaseGeometry  #: polygon, point of a sign or a fire, or line, in plan [m]
    area: str = ""  #: name of the area; empty for signs and fires
    capacity: int | None = None  #: greatest number of people in an area, or None
    exit: str = ""  #: name of the exit that a sign shows
    range: float = 0.0  #: distance from which a sign is seen [m]

    def __str__(self) -> str:
        """Return what pictures write: the exit that a sign shows, or the name."""
        return f"\u2192 {self.exit}" if self.kind == "sign" else self.name

    @property
    def use(self) -> str:
        """How many people there is room for, or from where a sign is seen."""
        if self.kind == "sign":
            return f"seen from {self.range:g} m"
        if self.kind in ("line", "fire"):
            return "people who pass are counted" if self.kind == "line" else "it burns"
        return "any number" if self.capacity is None else f"{self.capacity} people"


@dataclass(frozen=True)
class Building:
    """The fixed geometry of a case: levels, portals, exits, areas and walls.

    Portals, exits, doors and rides of lifts are links, which have their numbers in this order.
    """

    source: Path  #: the file that it was read from, for messages
    vertices: FloatArray  #: (v, 3) float64: welded vertices [m]
    levels: tuple[Level, ...]
    portals: tuple[Portal, ...]
    exits: tuple[Exit, ...]
    areas: tuple[Area, ...]
    #: (w, 4) float64: segments x1, y1, x2, y2 [m], each with the level's inside on its left, of free edges of the mesh
    #: that are not exits, and outlines of obstacles; collinear neighbours of one level are merged
    walls: FloatArray
    wall_level: IntArray  #: (w,) int32: level of each wall
    #: levels of each stair, its pieces, from top to bottom; a stair leads from storey to storey
    stairs: dict[str, tuple[int, ...]]
    #: warnings and other facts that do not prevent a run, with their places
    findings: tuple[Finding, ...] = field(default=())
    closed: frozenset[int] = frozenset()  #: numbers of links that are closed and act as walls
    doors: tuple[Door, ...] = ()  #: doors between rooms, if the source names them as plans do; empty for meshes
    #: links that are passed in one direction only, each with where they are passed from, portals with the level, exits
    #: with their level or -1, from outside, and doors with the side of their segment, 0 for the left
    one_way: frozenset[tuple[int, int]] = frozenset()
    #: areas, or levels, in which people walk at a share of their speeds, each with this share
    slowed: frozenset[tuple[str, float]] = frozenset()
    barred: frozenset[str] = frozenset()  #: areas, or levels, around which ways lead where there is another way
    places: tuple[Place, ...] = ()  #: refuges, assembly areas and signs of the case
    #: links through which ways lead also while they are closed or of the other direction, so that people wait there
    awaited: frozenset[int] = frozenset()
    #: exits and areas at which ways end with a cost, each with this time [s]
    costs: frozenset[tuple[str, float]] = frozenset()
    #: ways between levels that take a stated time; travel times count them, and whoever adds one takes people along
    jumps: frozenset[Jump] = frozenset()
    #: direction of north in plan, counterclockwise from y [degrees]; None if it is not known
    north: float | None = None
    lifts: "tuple[Lift, ...]" = ()  #: lifts, with a level for each stop; see `evac.building.model.lifts`
    #: open links that let people through in another way than all at once
    controls: frozenset[tuple[int, Control]] = frozenset()
    emptying: frozenset[str] = frozenset()  #: stairs that close when those on them have left
    #: levels whose ground moves, as that of escalators, each with the velocity of the ground in plan [m/s]
    moving: frozenset[tuple[int, float, float]] = frozenset()
    #: keys in its plan of stairs and areas that the plan has as something else, as ``stairs.west 0`` is ``shafts.west``
    keys: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        exits = ", ".join(exit_.name for exit_ in self.exits) or "none"
        return f"<Building {self.source.name}: {len(self.levels)} levels, exits {exits}>"

    def plot(self) -> "Figure":
        """Return a matplotlib figure with the plan of every storey, including names, widths and warnings."""
        from evac.pictures.notebook import building_figure

        return building_figure(self)

    def _repr_html_(self) -> str:
        from evac.pictures.notebook import figure_html

        return figure_html(self.plot(), "plans of the storeys")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Texts of the warnings among the findings."""
        return warnings_of(self.findings)

    def level_named(self, name: str) -> Level | None:
        """Return the level with a given name, or None."""
        return next((level for level in self.levels if level.name == name), None)

    def level_at(self, level: str | int) -> Level:
        """Return a level by its name or index."""
        names = [each.name for each in self.levels]
        if isinstance(level, int) and not 0 <= level < len(names):
            raise ResultError(f"there is no level {level}; the building has levels 0 to {len(names) - 1}")
        if isinstance(level, str) and level not in names:
            raise ResultError(f"there is no level {level!r}; {did_you_mean(level, names)}")
        return self.levels[level if isinstance(level, int) else names.index(level)]

    def with_cars(self, level: str | int) -> list[Level]:
        """Return a level by its name or index, and the levels of the cars of lifts that stop at it."""
        own = self.level_at(level)
        beside = {portal.other(own.index) for portal in self.portals_of(own.index)}
        return [own, *(self.levels[other] for other in sorted(beside) if self.levels[other].kind == "car")]

    @cached_property
    def storeys(self) -> list[tuple[str, list[Level]]]:
        """The storeys from the bottom to the top, each with a name and its levels.

        A storey consists of the floors of one height, and the flights and landings between it and the storey above,
        which do not overlap in plan. Flights and landings below the lowest floor belong to the lowest storey.
        """
        floors = [level for level in self.levels if level.kind == "floor"] or list(self.levels)
        heights = sorted({round(level.z_min, 2) for level in floors})
        members: list[list[Level]] = [[] for _ in heights]
        for level in self.levels:
            below = [k for k, height in enumerate(heights) if height <= level.z_min + 0.05]
            members[below[-1] if below else 0].append(level)
        return [
            (", ".join(level.name for level in levels if level.kind == "floor") or levels[0].name, levels)
            for levels in members
            if levels
        ]

    def area_named(self, name: str) -> Area | None:
        """Return the area with a given name, or the whole level with this name; None if there is neither."""
        area = next((area for area in self.areas if area.name == name), None)
        level = self.level_named(name)
        return area if area is not None or level is None else Area(level.name, level.index, level.polygon)

    def parts_named(self, name: str) -> list[Area]:
        """Return the area with a given name, or the levels of this name, or of a stair or shaft of it; or nothing."""
        area = self.area_named(name)
        levels = [self.levels[index] for index in self.pieces_of(name)]
        return [area] if area is not None else [Area(level.name, level.index, level.polygon) for level in levels]

    @cached_property
    def shafts(self) -> dict[str, tuple[str, ...]]:
        """Stairs above each other, from bottom to top, by their name without its number; one alone has its own name.

        If their names differ, or if several shafts or something else has this name, a shaft has those of its first and
        last stair, as ``lower - upper``.
        """
        found: list[tuple[BaseGeometry, list[str]]] = []
        for name in sorted(self.stairs, key=lambda one: min(self.levels[k].z_min for k in self.stairs[one])):
            ground = shapely.union_all([self.levels[k].polygon for k in self.stairs[name]]).envelope
            below = (own for box, own in found if shapely.contains(box, ground.centroid))
            if (own := next(below, None)) is None:
                found.append((ground, own := []))
            own.append(name)
        begins = [{own[0]} if len(own) == 1 else {re.sub(r"[\s\d]+$", "", one) for one in own} for _, own in found]
        others = {name for level in self.levels for name in (level.name, level.title)}
        others |= {link.name for link in self.links} | {area.name for area in self.areas}
        return {
            "".join(begin)
            if len(own) == 1 or (len(begin) == 1 == begins.count(begin) and begin.isdisjoint(others))
            else f"{own[0]} - {own[-1]}": tuple(own)
            for begin, (_, own) in zip(begins, found, strict=True)
        }

    def pieces_of(self, name: str) -> tuple[int, ...]:
        """Return the levels of a stair, or of all stairs of a shaft; none if neither has this name."""
        stairs = (name,) if name in self.stairs else self.shafts.get(name, ())
        return tuple(level for stair in stairs for level in self.stairs[stair])

    @property
    def northward(self) -> FloatArray | None:
        """Unit vector to the north in plan, (2,), if that is known."""
        angle = None if self.north is None else np.radians(self.north)
        return None if angle is None else np.array([-np.sin(angle), np.cos(angle)])

    @property
    def condition(self) -> Hashable:
        """All that changes of a scene can change: equal for buildings that are the same at two times of a run."""
        own = self.closed, self.one_way, self.slowed, self.barred, self.awaited, self.costs, self.jumps
        return *own, self.controls, self.emptying, self.moving

    @property
    def ground_velocity(self) -> FloatArray:
        """Velocity of the ground of each level in plan, (levels, 2) [m/s]; zero where nothing moves."""
        velocity = np.zeros((len(self.levels), 2))
        for level, x, y in self.moving:
            velocity[level] = x, y
        return velocity

    @cached_property
    def for_ways(self) -> "Building":
        """The building in which ways are planned: the links at which people wait are open."""
        if not (self.awaited or self.controls or self.emptying):
            return self
        others, none = frozenset(one for one in self.one_way if one[0] not in self.awaited), frozenset[Any]()
        closed = self.closed - self.awaited
        return replace(self, closed=closed, one_way=others, awaited=none, controls=none, emptying=none)

    def cost_of(self, end: "Exit | Area") -> float:
        """Return the cost of an exit or an area at which a way ends [s]."""
        return dict(self.costs).get(end.name, 0.0)

    @property
    def has_areas_to_heed(self) -> bool:
        """Whether there are slow or barred areas."""
        return bool(self.slowed or self.barred)

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The portals, exits, doors and rides, each at the place of its number."""
        return *self.portals, *self.exits, *self.doors, *self.rides

    @cached_property
    def rides(self) -> tuple[Ride, ...]:
        """The rides of all lifts between neighbouring stops, from bottom to top."""
        pairs = [(lift, k) for lift in self.lifts for k in range(len(lift.rooms) - 1)]
        return tuple(
            Ride(row, ride_name(lift.name, *lift.storeys[k : k + 2]), (lift.rooms[k], lift.rooms[k + 1]))
            for row, (lift, k) in enumerate(pairs)
        )

    @cached_property
    def lift_doors(self) -> dict[int, int]:
        """The portals that are doors of lifts, each with the room of the car behind it."""
        pairs = (pair for lift in self.lifts for pair in zip(lift.rooms, lift.doors, strict=True))
        return {door: room for room, doors in pairs for door in doors}

    @cached_property
    def backs(self) -> tuple[Area, ...]:
        """The backs of the rooms of lifts, at which jumps by lifts begin and end."""
        return tuple(
            Area(self.levels[room].name, room, shapely.Point(lift.back).buffer(0.1))
            for lift in self.lifts
            for room in lift.rooms
        )

    @property
    def n_links(self) -> int:
        """Number of portals and exits."""
        return len(self.portals) + len(self.exits)

    def link_of(self, link: Link) -> int:
        """Return the number of a portal, exit, door or ride."""
        before = {"portal": 0, "exit": len(self.portals), "door": self.n_links}
        before["ride"] = self.n_links + len(self.doors)
        return before[link.kind] + link.index

    @cached_property
    def shut(self) -> frozenset[int]:
        """The closed links, and the exits through which people only come in."""
        return self.closed | {link for link, origin in self.one_way if origin < 0}

    @cached_property
    def directed(self) -> dict[int, int]:
        """The open portals and doors of one direction, with the level or side from which they are passed."""
        exits = range(len(self.portals), self.n_links)
        return {link: origin for link, origin in self.one_way if link not in self.closed and link not in exits}

    @cached_property
    def controlled(self) -> dict[int, Control]:
        """The open links that are controlled, in the order of their numbers."""
        return {link: control for link, control in sorted(self.controls, key=itemgetter(0)) if link not in self.closed}

    def is_open(self, link: Link) -> bool:
        """Return whether people inside can pass a portal, exit or door."""
        return self.link_of(link) not in self.shut

    def lets_in(self, way: Exit) -> bool:
        """Return whether people outside can pass an exit."""
        link = self.link_of(way)
        return link not in self.closed and (link, way.level) not in self.one_way

    def label_of(self, exit_: Exit) -> str:
        """Return the name of an exit, and in parentheses what `note_on` says."""
        note = self.note_on(exit_)
        return f"{exit_.name} ({note})" if note else exit_.name

    def note_on(self, exit_: Exit) -> str:
        """Return whether an exit is closed, lets people only in, or is controlled; empty for others."""
        if not self.is_open(exit_):
            return "entrance only" if self.lets_in(exit_) else "closed"
        return "controlled" if self.link_of(exit_) in self.controlled else ""

    def leads_from(self, portal: Portal, level: int) -> bool:
        """Return whether a portal can be passed from one of its levels."""
        return self.is_open(portal) and (portal.index, portal.other(level)) not in self.one_way

    def links_of(self, level: int) -> "list[Portal | Exit]":
        """Return the portals and exits of a level, including closed ones."""
        return [*self.portals_of(level), *self.exits_of(level)]

    def portals_of(self, level: int) -> list[Portal]:
        """Return the portals of a level, including closed ones."""
        return self._portals_of.get(level, [])

    @cached_property
    def _portals_of(self) -> dict[int, list[Portal]]:
        found: dict[int, list[Portal]] = {}
        for portal in self.portals:
            for level in portal.levels:
                found.setdefault(level, []).append(portal)
        return found

    def exits_of(self, level: int) -> list[Exit]:
        """Return the exits of a level, including closed ones."""
        return [exit_ for exit_ in self.exits if level == exit_.level]

    def graph(self) -> "networkx.MultiGraph":
        """Return the graph of open portals and exits, for analyses of the ways through the building.

        Returns
        -------
        networkx.MultiGraph
            Nodes are ``("level", i)`` and ``("exit", e)`` with their ``name``. Each open portal and exit is an edge
            with its ``name`` and ``width`` [m]; its key is the index of the link, portals first.
        """
        import networkx  # takes 0.1 s, and no run needs it

        graph = networkx.MultiGraph()
        graph.add_nodes_from((("level", level.index), {"name": level.name}) for level in self.levels)
        graph.add_nodes_from((("exit", exit_.index), {"name": exit_.name}) for exit_ in self.exits)
        for portal in filter(self.is_open, self.portals):
            first, second = (("level", level) for level in portal.levels)
            graph.add_edge(first, second, key=portal.index, name=portal.name, width=portal.width)
        for exit_ in filter(self.is_open, self.exits):
            ends = ("level", exit_.level), ("exit", exit_.index)
            graph.add_edge(*ends, key=self.link_of(exit_), name=exit_.name, width=exit_.width)
        return graph
