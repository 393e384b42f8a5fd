"""Plans: a building given storey by storey as polygons, with stairs, doors, exits, areas and obstacles."""

import copy
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.change import Control, LiftOptions
from evac.base.defaults import DOOR_REACH, FARTHEST, HEADROOM
from evac.base.errors import BuildingError, counted
from evac.building.model.findings import Finding, findings_of
from evac.building.plan.outlines import Shape, inclined_of, is_point, naming_part, outline_of, polygons_of, segment_of

if TYPE_CHECKING:
    from evac.building.model.building import Building
    from evac.building.surface.surfacemesh import SurfaceMesh
#: Ending of the names of plan files.
PLAN = ".plan.toml"
#: Least height and depth of a step, and least width of a door at a wall [m].
LEAST_STEP = 0.05
OUTSIDE = ("refuse", "exit", "opening")  #: Options for a door with a room on one side only.


@dataclass(frozen=True)
class Storey:
    """A storey: its polygons, or the file that contains them; see `evac.building.plan.plan.Plan.storey`."""

    name: str
    z: float
    polygons: tuple[BaseGeometry, ...] = ()
    file: Path | None = None
    wall: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    like: str | None = None


@dataclass(frozen=True)
class Stair:
    """A stair between two storeys; see `evac.building.plan.plan.Plan.stair`."""

    name: str
    lower: str
    lower_edge: FloatArray
    upper: str
    upper_edge: FloatArray | None
    length: float | None
    direction: FloatArray | None
    landing: float | None
    landings: int
    turn: str | None
    gap: float
    handrails: float = 0.0
    key: str | None = None  # of the shaft of which it is a part

    @property
    def clear(self) -> "Stair":
        """The stair between its handrails; its landings are as deep as before."""
        if not self.handrails:
            return self
        lower, upper = (
            None
            if edge is None
            else np.round(edge - self.handrails * (edge - edge[::-1]) / np.hypot(*(edge[1] - edge[0])), 6)
            for edge in (self.lower_edge, self.upper_edge)
        )
        assert lower is not None
        depth = float(np.hypot(*(self.lower_edge[1] - self.lower_edge[0]))) if self.landing is None else self.landing
        return replace(self, lower_edge=lower, upper_edge=upper, landing=depth, gap=self.gap + 2.0 * self.handrails)


@dataclass(frozen=True)
class Shaft(Stair):
    """Stairs above each other; see `evac.building.plan.plan.Plan.shaft`."""

    kind: str | None = None
    rise: float | None = None
    going: float | None = None


@dataclass(frozen=True)
class Room:
    """A room of a storey; see `evac.building.plan.plan.Plan.room`."""

    name: str
    storey: str
    outline: BaseGeometry  # with its corners in the order in which they are given
    polygons: tuple[BaseGeometry, ...]
    use: str | None
    people: int | None
    density: float | None
    key: str | None = None  # of the room that it repeats on another storey

    @property
    def is_area(self) -> bool:
        """Whether people can start in it."""
        return (self.use, self.people, self.density) != (None, None, None)

    @property
    def number(self) -> float | None:
        """Number of people that it states, by itself or by their density."""
        return self.people if self.density is None else self.density * float(self.outline.area)


@dataclass(frozen=True)
class Tie:
    """A segment on the wall of one room or between two, or the ground of one room; see `Plan.door`."""

    rooms: tuple[str, ...]
    side: int | None = None
    at: float | None = None
    width: float | None = None
    inset: float | None = None


@dataclass(frozen=True)
class Item:
    """A door, exit, opening, area or obstacle on a storey: a segment (2, 2), polygons, or a tie to walls of rooms."""

    name: str
    storey: str
    segment: FloatArray | None = None
    polygons: tuple[BaseGeometry, ...] = ()
    reach: float = DOOR_REACH
    outside: str = "refuse"
    tie: Tie | None = None
    control: Control | None = None
    key: str | None = None  # of the room that it is, or of what it repeats on another storey


@dataclass(frozen=True)
class LiftItem:
    """A lift through several storeys; see `evac.building.plan.plan.Plan.lift`."""

    name: str
    storeys: tuple[str, ...]
    polygon: BaseGeometry
    doors: tuple[FloatArray, ...]
    operation: LiftOptions

    def tag_at(self, storey: str) -> str:
        """Return the tag of the room of the car at a storey."""
        return f"floor:{self.name} {storey}"


class Plan:
    """A building drawn in plan, from which a surface mesh, a `Building` or a case can be made.

    Shapes are shapely geometries, WKT, GeoJSON, lists of corners [x, y], or lists of these; lengths are in metres.
    Items may be added in any order. A name that is used already, and arguments that do not define an item, are a
    `BuildingError`; errors in their combination are found by `surface`.

    Parameters
    ----------
    source : str or Path
        Name of the plan in messages.
    north : float [degrees]
        Direction of north in plan, counterclockwise from y; None if it is not known.
    headroom : float [m]
        Minimum free height above and below stairs; floors that leave less are cut away. 0 cuts nothing.

    Examples
    --------
    >>> plan = Plan()
    >>> plan.storey("ground", "POLYGON ((0 0, 10 0, 10 6, 0 6, 0 0))")
    >>> plan.storey("first", "POLYGON ((14 0, 24 0, 24 6, 14 6, 14 0))", z=3.0)
    >>> plan.stair("main", "ground", [(10, 2), (10, 4)], "first", [(14, 2), (14, 4)])
    >>> plan.exit("door", "ground", [(0, 2), (0, 3)])
    >>> [level.name for level in plan.building().levels]
    ['ground', 'main flight z=0.00..3.00', 'first']
    """

    def __init__(
        self, source: str | Path = "<plan>", *, headroom: float = HEADROOM, north: float | None = None
    ) -> None:
        self.source = Path(source)
        self.headroom = self._number("plan", "headroom", headroom, least=0.0)
        self.north = None if north is None else self._number("plan", "north", north)
        self.storeys: dict[str, Storey] = {}  #: by name, in the order in which they were added
        self.rooms: list[Room] = []
        self.stairs: list[Stair] = []
        self.shafts: list[Shaft] = []
        self.doors: list[Item] = []
        self.exits: list[Item] = []
        self.openings: list[Item] = []
        self.areas: list[Item] = []
        self.obstacles: list[Item] = []
        self.lifts: list[LiftItem] = []
        #: flights and landings added one by one, each with the stair, the kind and the shape
        self.pieces: list[tuple[str, str, tuple[Any, ...]]] = []
        #: stairs that an importer has seen and not added, each a finding, which is one of `findings`, and arguments of
        #: `stair`
        self.proposals: list[tuple[Finding, dict[str, Any]]] = []
        #: lines (2, 2) [m] through which people are counted, with name and storey; `evac import` writes them into the
        #: case
        self.lines: list[tuple[str, str, FloatArray]] = []
        #: repairs and omissions made when shapes were added, and findings of importers
        self.findings: list[Finding] = []
        self.refused: set[str] = set()  # storeys and rooms that a plan file does not define as it should

    def __repr__(self) -> str:
        parts = {
            "storey": len(self.storeys),
            "stair": len({*(one.name for one in (*self.stairs, *self.shafts)), *(piece[0] for piece in self.pieces)}),
            "exit": len(self.exits),
        }
        return f"<Plan {str(self.source)!r}: {', '.join(counted(number, what) for what, number in parts.items())}>"

    def storey(
        self,
        name: str,
        polygons: Shape | None = None,
        z: float = 0.0,
        *,
        wall: float | None = None,
        file: str | Path | None = None,
        options: Mapping[str, Any] | None = None,
        like: str | None = None,
    ) -> None:
        """Add a storey.

        Parameters
        ----------
        name : str
        polygons : shape
            Ground that people can walk on; holes are obstacles. Polygons that overlap or touch are joined. Not needed
            in a storey with rooms.
        z : float [m]
            Height of its floor.
        wall : float [m]
            If greater than 0, polygons that touch are rooms with walls of this thickness between them. 0 by default, or
            as in the storey that this one is like.
        file : str or Path
            Instead of polygons: a file with one storey in any format that an importer reads as a plan. Other items in
            the file, such as exits, are added too.
        options : mapping
            Parameters of the importer of the file.
        like : str
            Instead of polygons: another storey, whose polygons, rooms, doors, areas and obstacles this one repeats. The
            copies are named by this storey: a room ``office`` of a storey like it becomes ``NAME office``, where the
            name of the other storey at its beginning is left out.
        """
        what = f"storey {name!r}"
        self._check_new("storeys", name, self.storeys)
        if sum(given is not None for given in (polygons, file, like)) > 1:
            raise BuildingError(f"{self.source}: {what}: give only one of polygons, file and like")
        self._number(what, "z", z)
        wall = None if wall is None else self._number(what, "wall", wall, least=0.0)
        if not isinstance(options or {}, Mapping):
            raise BuildingError(f"{self.source}: {what}: options must be a table, not {options!r}")
        shapes = () if polygons is None else self._polygons(f"storeys.{name}", name, polygons)
        self.storeys[name] = Storey(
            name, float(z), shapes, Path(file) if file is not None else None, wall, dict(options or {}), like
        )

    def room(
        self,
        name: str,
        storey: str,
        polygon: Shape,
        *,
        use: str | None = None,
        people: int | None = None,
        density: float | None = None,
    ) -> None:
        """Add a room to a storey. If its use or its people are given, it is also an area in which people can start.

        Parameters
        ----------
        name, storey : str
        polygon : shape
            Its ground, one polygon; a part of the ground of the storey, as if it were among its polygons.
        use : str
            What it is used for, such as ``"office"``.
        people : int
            Number of people, which groups take that do not state another, and `evac import` writes to the case.
        density : float [1/m2]
            People per square metre, instead of their number.
        """
        what = f"room {name!r}"
        self._check_new("rooms", name, [room.name for room in self.rooms])
        if people is not None and density is not None:
            raise BuildingError(f"{self.source}: {what}: give people or density, and not both")
        self._check_numbers(what, 0.0, people=people, density=density)
        with naming_part(self.source, what):
            outline = outline_of(polygon)
        self.rooms.append(
            Room(name, storey, outline, self._polygons(f"rooms.{name}", storey, outline), use, people, density)
        )

    def stair(
        self,
        name: str,
        lower: str,
        lower_edge: Shape,
        upper: str,
        upper_edge: Shape | None = None,
        *,
        length: float | None = None,
        direction: Sequence[float] | None = None,
        landing: float | None = None,
        landings: int | None = None,
        turn: str | None = None,
        gap: float = 0.1,
        handrails: float = 0.0,
    ) -> None:
        """Add a stair between two storeys: straight, straight with landings, or U-shaped with a half landing.

        - Straight: both edges; or one edge, `length`, and `direction` if it is ambiguous.
        - Straight with landings: additionally `landing`, and `landings` if there are several.
        - U-shaped: two edges side by side and the `length` of the first flight; or one edge, `length` and `turn`.

        Parameters
        ----------
        name : str
        lower, upper : str
            Names of the storeys.
        lower_edge, upper_edge : segments
            Edges at which the stair begins and ends; their length is the width of the stair.
        length : float [m]
            Length in plan: of the whole stair, or of the first flight of a U-shaped one.
        direction : (x, y)
            Direction of the first flight from the lower edge. By default away from the lower floor.
        landing : float [m]
            Depth of each landing in plan. By default, the half landing of a U-shaped stair is as deep as the stair is
            wide.
        landings : int
            Number of landings of a straight stair, 1 by default.
        turn : "left" or "right"
            Side of the second flight of a U-shaped stair, seen in upward direction, if `upper_edge` is not given.
        gap : float [m]
            Gap between the two flights, if `turn` is given.
        handrails : float [m]
            Width at each side of its flights on which nobody walks, as that of handrails or of a boundary layer.
        """
        values = (name, lower, lower_edge, upper, upper_edge, length, direction, landing, landings, turn)
        self.stairs.append(self._checked("stair", (*values, gap, handrails)))

    def shaft(
        self,
        name: str,
        lower: str,
        upper: str,
        lower_edge: Shape | None = None,
        upper_edge: Shape | None = None,
        *,
        foot: Sequence[float] | None = None,
        width: float | None = None,
        kind: str | None = None,
        length: float | None = None,
        rise: float | None = None,
        going: float | None = None,
        direction: Sequence[float] | None = None,
        landing: float | None = None,
        landings: int | None = None,
        turn: str | None = None,
        gap: float = 0.1,
        handrails: float = 0.0,
    ) -> None:
        """Add a stair through several storeys: a stair from each storey to the next, above each other.

        The storeys are those from `lower` to `upper` in the order in which they were added. The stairs are named by
        the shaft and a number from 0 on; one alone has the name of the shaft.

        Parameters
        ----------
        name : str
        lower, upper : str
            Names of the lowest and of the highest storey.
        lower_edge, upper_edge, length, direction, landing, landings, turn, gap, handrails
            Of each stair, as for `stair`.
        foot : (x, y) [m]
            Instead of `lower_edge`: its middle, with `width` and `direction`.
        width : float [m]
            Width of the stair.
        kind : "straight" or "dog-leg"
            Dog-leg stairs are U-shaped, and need `turn` or both edges. By default what the other arguments say.
        rise, going : float [m]
            Instead of `length`: height of a step and its depth in plan, from which the length follows for each storey.
        """
        what = f"shaft {name!r}"
        if (foot is None) == (lower_edge is None) or (foot is None) != (width is None):
            raise BuildingError(f"{self.source}: {what}: give either lower_edge, or foot and width")
        if foot is not None:
            if direction is None:
                raise BuildingError(f"{self.source}: {what}: foot requires direction = [x, y]")
            way, middle = self._vector(what, "direction", direction), self._vector(what, "foot", foot, may_be_zero=True)
            half = self._number(what, "width", width, least=0.0) / 2 * np.array([-way[1], way[0]]) / np.hypot(*way)
            lower_edge = [(middle + half).tolist(), (middle - half).tolist()]
        if (rise is None) != (going is None) or (rise is not None and length is not None):
            raise BuildingError(f"{self.source}: {what}: give either length, or rise and going")
        self._check_numbers(what, LEAST_STEP, rise=rise, going=going)
        is_bent = turn is not None or (upper_edge is not None and (length or rise) is not None)
        if kind not in (None, "straight", "dog-leg") or (kind is not None and (kind == "dog-leg") != is_bent):
            raise BuildingError(
                f"{self.source}: {what}: kind must be 'straight', or 'dog-leg' with turn or with upper_edge and length"
            )
        run = length if rise is None else 1.0
        values = (name, lower, lower_edge, upper, upper_edge, run, direction, landing, landings, turn, gap, handrails)
        stair = replace(self._checked("shaft", values), length=length)
        self.shafts.append(Shaft(**vars(stair), kind=kind, rise=rise, going=going))

    def _checked(self, section: str, values: tuple[Any, ...]) -> Stair:
        """Return a stair, or what a shaft has of one, with checked values."""
        given = Stair(*values)
        what = f"{section} {given.name!r}"
        self._check_new(f"{section}s", given.name, [one.name for one in getattr(self, f"{section}s")])
        if given.upper_edge is None and given.length is None:
            raise BuildingError(f"{self.source}: {what}: give upper_edge or length")
        if given.turn not in (None, "left", "right") or (given.turn is not None and given.upper_edge is not None):
            raise BuildingError(f"{self.source}: {what}: turn must be 'left' or 'right', given instead of upper_edge")
        self._check_numbers(
            what, 0.0, length=given.length, landing=given.landing, gap=given.gap, handrails=given.handrails
        )
        way = None if given.direction is None else self._vector(what, "direction", given.direction)
        edge = None if given.upper_edge is None else self._segment(what, "upper_edge", given.upper_edge)
        count = 1 if given.landing is not None and given.landings is None else given.landings or 0
        if count and given.landing is None:
            raise BuildingError(f"{self.source}: {what}: landings requires a landing depth, such as landing = 1.5")
        foot = self._segment(what, "lower_edge", given.lower_edge)
        width = min(float(np.hypot(*(one[1] - one[0]))) for one in (foot, edge) if one is not None)
        if given.handrails >= 0.5 * width:
            raise BuildingError(f"{self.source}: {what}: handrails must be less than half its width of {width:.2f} m")
        return replace(given, lower_edge=foot, upper_edge=edge, direction=way, landings=count)

    def flight(
        self,
        stair: str,
        lower_edge: Shape | None = None,
        lower_z: float | None = None,
        upper_edge: Shape | None = None,
        upper_z: float | None = None,
        *,
        polygon: Shape | None = None,
    ) -> None:
        """Add one flight of a stair of any shape; see `landing`.

        Parameters
        ----------
        stair : str
        lower_edge, upper_edge : segments
            Edges at which the flight begins and ends.
        lower_z, upper_z : float [m]
            Their heights.
        polygon : shape
            Instead of edges: polygons whose corners have heights, such as ``POLYGON Z ((...))``, each in one plane.
        """
        what = f"a flight of stair {stair!r}"
        if polygon is not None:
            if (lower_edge, lower_z, upper_edge, upper_z) != (None, None, None, None):
                raise BuildingError(f"{self.source}: {what}: give either polygon or edges, and not both")
            with naming_part(self.source, what):
                self.pieces.append((stair, "slope", (inclined_of(polygon),)))
            return
        ends = [self._segment(what, "lower_edge", lower_edge), self._segment(what, "upper_edge", upper_edge)]
        heights = [self._number(what, key, z) for key, z in (("lower_z", lower_z), ("upper_z", upper_z))]
        self.pieces.append((stair, "flight", (ends[0], heights[0], ends[1], heights[1])))

    def landing(self, stair: str, polygon: Shape, z: float) -> None:
        """Add one landing of a stair of any shape, at its height [m]; flights must end at its outline."""
        what = f"a landing of stair {stair!r}"
        shapes = self._polygons(f"landings.{stair}", None, polygon)
        self.pieces.append((stair, "landing", (shapes, self._number(what, "z", z))))

    def door(
        self,
        name: str,
        storey: str,
        segment: Shape,
        *,
        reach: float = DOOR_REACH,
        outside: str = "refuse",
        control: Mapping[str, Any] | None = None,
    ) -> None:
        """Add a door: an opening in the wall between two rooms.

        Parameters
        ----------
        name, storey : str
        segment : segment
            Along the wall, as long as the opening is wide, anywhere within the thickness of the wall. It is moved to a
            wall at most 0.15 m beside it, and turned along a wall that it crosses at a small angle; both are findings.
            Or a table that ties it to walls of rooms, which it then follows: ``{"rooms": ["office", "corridor"],
            "at": 3.0, "width": 0.9}`` on the wall between two rooms, at 3 m along it from its end with the least x (of
            equal ones, y); or ``{"rooms": ["hall"], "side": 2}`` on the wall from corner 2 to corner 3 of a room,
            counted from 0. By default, it is in the middle of the wall, and as wide as the wall is long.
        reach : float [m]
            Largest distance between the segment and the rooms.
        outside : "refuse", "exit" or "opening"
            Meaning of a door with a room on one side only: an error, an exit, or an opening that `evac import`
            suggests as an exit.
        control : mapping
            How it lets people through, such as ``{"every": 2.0}``: the keys of `evac.base.change.Control`.
        """
        what = f"door {name!r}"
        if outside not in OUTSIDE:
            raise BuildingError(f"{self.source}: {what}: outside must be one of {', '.join(OUTSIDE)}, not {outside!r}")
        self._number(what, "reach", reach, least=0.0)
        line = replace(self._line(what, name, storey, segment), control=self._control(what, control))
        self.doors.append(replace(line, reach=float(reach), outside=outside))

    def exit(
        self,
        name: str,
        storey: str,
        segment: Shape | None = None,
        *,
        polygon: Shape | None = None,
        control: Mapping[str, Any] | None = None,
    ) -> None:
        """Add an exit; people leave the building when their centre crosses it.

        Parameters
        ----------
        name, storey : str
        segment : segment
            Along the outer outline of the floor, at most 0.15 m from it; or on the outer face of a wall at most 0.6 m
            thick, through which the floor is then extended. Several segments, as a list, are one exit. It may be tied
            to walls as that of a door.
        polygon : shape
            Instead of a segment: ground outside. It is cut out of the floor, and every edge that it then shares with
            the floor is part of the exit.
        control : mapping
            As for `door`.
        """
        what = f"exit {name!r}"
        self._check_new("exits", name, [way.name for way in self.exits])
        if (segment is None) == (polygon is None):
            raise BuildingError(f"{self.source}: {what}: give either segment or polygon, and not both")
        own = self._control(what, control)
        if segment is None:
            self.exits.append(Item(name, storey, None, self._polygons(f"exits.{name}", storey, polygon), control=own))
            return
        several = segment if isinstance(segment, list) and segment and not any(map(is_point, segment)) else [segment]
        self.exits += [replace(self._line(what, name, storey, one), control=own) for one in several]

    def opening(self, storey: str, segment: Shape, name: str = "") -> None:
        """Add an opening to the outside that is not declared as an exit; `evac import` suggests it as an exit."""
        self.openings.append(self._line("an opening", name, storey, segment))

    def area(self, name: str, storey: str, polygon: Shape) -> None:
        """Add an area in which people can start: the part of a polygon that is on the floor of its storey.

        The polygon may be a table that ties it to a room: ``{"rooms": ["office"], "inset": 0.5}`` is the ground of the
        room without a rim of 0.5 m, by default all of it.
        """
        self._check_new("areas", name, [area.name for area in self.areas])
        if _is_tie(polygon):
            self.areas.append(Item(name, storey, tie=self._tie(f"area {name!r}", polygon, ("inset",))))
            return
        self.areas.append(Item(name, storey, polygons=self._polygons(f"areas.{name}", storey, polygon)))

    def obstacle(self, name: str, storey: str, polygon: Shape) -> None:
        """Add an obstacle: it is cut out of the floor of its storey, and its outline becomes a wall."""
        self.obstacles.append(Item(name, storey, polygons=self._polygons(f"obstacles.{name}", storey, polygon)))

    def lift(
        self,
        name: str,
        storeys: Sequence[str],
        polygon: Shape,
        door: Shape,
        *,
        operation: Mapping[str, Any] | None = None,
    ) -> None:
        """Add a lift: a car that stops at some storeys, from whose floors it is parted by walls of 0.15 m at least.

        Parameters
        ----------
        name : str
        storeys : sequence of str
            The storeys at which it stops.
        polygon : shape
            Ground of its car, one polygon.
        door : segment
            On the outline of the car, at most 0.6 m from the floor before it. Of several segments, as a list, each is a
            door on the storeys that have floor before it.
        operation : mapping
            How it works, such as ``{"speed": 2.5, "capacity": 13}``: the keys of `evac.base.change.LiftOptions`.
        """
        what = f"lift {name!r}"
        self._check_new("lifts", name, [lift.name for lift in self.lifts])
        names = [] if isinstance(storeys, str) or not isinstance(storeys, Sequence) else [*storeys]
        if not all(isinstance(one, str) for one in names) or len({*names}) < max(2, len(names)):
            raise BuildingError(f"{self.source}: {what}: storeys must be a list of at least two names, not {storeys!r}")
        with naming_part(self.source, what):
            outline = outline_of(polygon)
        several = door if isinstance(door, list) and door and not any(map(is_point, door)) else [door]
        doors = tuple(self._segment(what, "door", one) for one in several)
        own = LiftOptions.read(operation or {}, BuildingError, f"{self.source}: {what}: operation.")
        self.lifts.append(LiftItem(name, tuple(storeys), outline, doors, own))

    def take(self, name: str, other: "Plan") -> None:
        """Copy the polygons and all items of another plan with one storey to a storey that was given as a file.

        Raises
        ------
        BuildingError
            The other plan does not have exactly one storey, or a name in it is already used.
        """
        if len(other.storeys) != 1 or other.stairs or other.shafts or other.pieces:
            raise BuildingError(
                f"{other.source}: has {len(other.storeys)} storeys ({', '.join(other.storeys)}); the file of a storey "
                "must have exactly one storey and no stairs"
            )
        (taken,) = other.storeys.values()
        self.north = other.north if self.north is None else self.north
        own = self.storeys[name]
        self.storeys[name] = replace(own, polygons=taken.polygons, file=None, wall=own.wall or taken.wall, options={})
        for kind in ("rooms", "doors", "exits", "openings", "areas", "obstacles"):
            items, names = getattr(self, kind), {one.name for one in getattr(self, kind)}
            for item in getattr(other, kind):
                if kind in ("rooms", "exits", "areas") and item.name in names:
                    raise BuildingError(
                        f"{self.source}: two {kind} are named {item.name!r}, one of them in {other.source}; rename one"
                    )
                items.append(replace(item, storey=name))
        self.findings += [
            replace(finding, level=name if finding.level == taken.name else finding.level) for finding in other.findings
        ]

    def note(
        self,
        kind: str,
        text: str,
        storey: str | None = None,
        place: tuple[float, float] | None = None,
        element: str = "",
        number: int = 1,
    ) -> None:
        """Add a finding, such as what an importer has found, assumed, repaired or left out; see `Finding`.

        An importer accounts for every element of a file: it tells how many of each kind of `element` it has found, and
        which of them are left out, or are missing in the building, and why.
        """
        self.findings.append(Finding(kind, text, storey, place, element=element, number=number))

    @property
    def files(self) -> list[Path]:
        """The files of storeys that are given as such."""
        return [storey.file for storey in self.storeys.values() if storey.file is not None]

    def surface(self) -> "SurfaceMesh":
        """Return the tagged surface mesh: a floor for each storey with areas, obstacles and exits, and the stairs.

        Raises
        ------
        BuildingError
            Items do not fit together; names them and the place.
        """
        from evac.building.options import SurfaceOptions
        from evac.building.plan.faults import DrawnPlan

        return DrawnPlan(self, self.source, SurfaceOptions()).mesh

    def check(self) -> tuple[Finding, ...]:
        """Return all findings about the plan: its errors, and what `Building.findings` has of what is right in it.

        Errors have the key of their item and a remedy that has been tried out; see `Finding`.
        """
        try:
            return self.building(need_exit=False).findings
        except BuildingError as error:
            return findings_of(error, self.source)

    def building(self, *, need_exit: bool = True, **options: Any) -> "Building":
        """Return the building; the options are the keys of ``[building]`` and `need_exit`, as for `read_building`.

        Raises
        ------
        BuildingError
            As `surface`, or the building cannot be used.
        """
        from evac.building.options import BuildingOptions
        from evac.building.plan.faults import build

        own = BuildingOptions.read(options, BuildingError, f"{self.source}: building.")
        return build(self, self.source, own, need_exit=need_exit)

    def write(self, path: str | Path) -> None:
        """Write the plan to a plan file, or its surface to a Gmsh 2.2 file; equal plans give identical files.

        A plan file (.plan.toml) has the rooms, shafts, ties and repeated storeys as they were given, and is read as an
        equal plan; findings and proposals are not written. A mesh (.msh) has tags as physical groups.

        Raises
        ------
        BuildingError
            The name ends neither in .plan.toml nor in .msh; or as `surface`.
        """
        from evac.building.plan.plantable import plan_text, table_of
        from evac.building.surface.surface import write_surface

        if Path(path).name.lower().endswith(PLAN):
            Path(path).write_text(plan_text(table_of(self)), encoding="utf-8")
        elif Path(path).suffix.lower() == ".msh":
            write_surface(self.surface(), Path(path))
        else:
            raise BuildingError(f"{path}: give a name that ends in {PLAN}, or in .msh for a mesh of Gmsh")

    def _check_new(self, kind: str, name: str, known: Collection[str]) -> None:
        if name in known:
            raise BuildingError(f"{self.source}: there are two {kind} named {name!r}; rename one")

    def _polygons(self, key: str, storey: str | None, given: Shape) -> tuple[BaseGeometry, ...]:
        section, _, name = key.partition(".")
        known = len(self.findings)
        with naming_part(self.source, f"{section.removesuffix('s')} {name!r}"):
            polygons = tuple(polygons_of(given, storey, self.findings))
        self.findings[known:] = [replace(finding, item=key) for finding in self.findings[known:]]
        return polygons

    def _segment(self, what: str, key: str, given: Shape | None) -> FloatArray:
        with naming_part(self.source, f"{what}: {key}"):
            return segment_of(given if given is not None else [])

    def _line(self, what: str, name: str, storey: str, given: Shape) -> Item:
        """Return a door, exit or opening from its segment, or from its tie to walls."""
        if _is_tie(given):
            return Item(name, storey, tie=self._tie(f"{what}: segment", given, ("side", "at", "width")))
        return Item(name, storey, self._segment(what, "segment", given))

    def _control(self, what: str, given: Any) -> Control | None:
        if given is None or isinstance(given, Control):
            return given
        return Control.read(given, BuildingError, f"{self.source}: {what}: control.")

    def _tie(self, what: str, given: Any, known: tuple[str, ...]) -> Tie:
        rooms, values = given["rooms"], {key: value for key, value in given.items() if key != "rooms"}
        most = 1 if "inset" in known else 2
        is_list = (
            isinstance(rooms, list | tuple) and 0 < len(rooms) <= most and all(isinstance(one, str) for one in rooms)
        )
        if not is_list or set(values) - set(known) or (most == 2 and (len(rooms) == 1) != ("side" in values)):
            raise BuildingError(
                f"{self.source}: {what}: a tie must have rooms = [NAME, NAME], or rooms = [NAME] and side = NUMBER, "
                f"and may have {', '.join(key for key in known if key != 'side')}; not {given!r}"
            )
        self._check_numbers(what, 0.0, **values)
        self._check_numbers(what, LEAST_STEP, width=values.get("width"))
        return Tie(tuple(rooms), **values)

    def _vector(self, what: str, key: str, value: Any, *, may_be_zero: bool = False) -> FloatArray:
        try:
            vector = np.asarray(value, np.float64)
        except (TypeError, ValueError, OverflowError):
            vector = np.empty(0)
        if vector.shape != (2,) or not (np.abs(vector) <= FARTHEST).all() or not (may_be_zero or vector.any()):
            raise BuildingError(f"{self.source}: {what}: {key} must be a vector [x, y], not {value!r}")
        return vector

    def _check_numbers(self, what: str, least: float, **given: Any) -> None:
        for key, value in given.items():
            if value is not None:
                self._number(what, key, value, least)

    def _number(self, what: str, key: str, value: Any, least: float = -FARTHEST) -> float:
        is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not is_number or not abs(value) <= FARTHEST:
            raise BuildingError(f"{self.source}: {what}: {key} must be a number up to {FARTHEST:g}, not {value!r}")
        if value < least:
            raise BuildingError(f"{self.source}: {what}: {key} must be at least {least:g}, not {value:g}")
        return float(value)


def copied(plan: Plan) -> Plan:
    """Return a plan with the same content, to which more can be added."""
    own = copy.copy(plan)
    vars(own).update({name: copy.copy(value) for name, value in vars(plan).items()})
    return own


def _is_tie(given: Any) -> bool:
    return isinstance(given, Mapping) and "rooms" in given
