"""Plans: a building given storey by storey as polygons, with stairs, doors, exits, areas and obstacles."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH, FARTHEST, HEADROOM
from evac.base.errors import BuildingError, counted
from evac.building.model.findings import Finding
from evac.building.plan.outlines import Shape, inclined_of, is_point, naming_part, polygons_of, segment_of

if TYPE_CHECKING:
    from evac.building.model.building import Building
    from evac.building.surface.surfacemesh import SurfaceMesh
#: Options for a door with a room on one side only.
OUTSIDE = ("refuse", "exit", "opening")


@dataclass(frozen=True)
class Storey:
    """A storey: its polygons, or the file that contains them; see `evac.building.plan.plan.Plan.storey`."""

    name: str
    z: float
    polygons: tuple[BaseGeometry, ...] = ()
    file: Path | None = None
    wall: float = 0.0
    options: Mapping[str, Any] = field(default_factory=dict)


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


@dataclass(frozen=True)
class Item:
    """A door, exit, opening, area or obstacle on a storey: a segment (2, 2) or polygons."""

    name: str
    storey: str
    segment: FloatArray | None = None
    polygons: tuple[BaseGeometry, ...] = ()
    reach: float = DOOR_REACH
    outside: str = "refuse"


class Plan:
    """A building drawn in plan, from which a surface mesh, a `Building` or a case can be made.

    Shapes are shapely geometries, WKT, GeoJSON, lists of corners [x, y], or lists of these; lengths are in metres.
    Items may be added in any order. Errors in their combination are found by `surface`.

    Parameters
    ----------
    source : str or Path
        Name of the plan in messages.
    headroom : float [m]
        Minimum free height above and below stairs; floors that leave less are cut away. 0 cuts nothing.

    Attributes
    ----------
    storeys : dict of str to Storey
        By name, in the order in which they were added.
    stairs : list of Stair
    doors, exits, openings, areas, obstacles : list of Item
    pieces : list of (str, str, tuple)
        Flights and landings added one by one: the stair, the kind and the shape.
    proposals : list of (Finding, dict)
        Stairs that an importer has seen and not added: a finding, which is one of `findings`, and arguments of `stair`.
    findings : list of Finding
        Repairs and omissions made when shapes were added, and findings of importers.

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

    def __init__(self, source: str | Path = "<plan>", *, headroom: float = HEADROOM) -> None:
        self.source = Path(source)
        self.headroom = self._number("plan", "headroom", headroom, least=0.0)
        self.storeys: dict[str, Storey] = {}
        self.stairs: list[Stair] = []
        self.doors: list[Item] = []
        self.exits: list[Item] = []
        self.openings: list[Item] = []
        self.areas: list[Item] = []
        self.obstacles: list[Item] = []
        self.pieces: list[tuple[str, str, tuple[Any, ...]]] = []
        self.proposals: list[tuple[Finding, dict[str, Any]]] = []
        self.findings: list[Finding] = []

    def __repr__(self) -> str:
        parts = {
            "storey": len(self.storeys),
            "stair": len({*(stair.name for stair in self.stairs), *(piece[0] for piece in self.pieces)}),
            "exit": len(self.exits),
        }
        return f"<Plan {str(self.source)!r}: {', '.join(counted(number, what) for what, number in parts.items())}>"

    def storey(
        self,
        name: str,
        polygons: Shape | None = None,
        z: float = 0.0,
        *,
        wall: float = 0.0,
        file: str | Path | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Add a storey.

        Parameters
        ----------
        name : str
        polygons : shape
            Ground that people can walk on; holes are obstacles. Polygons that overlap or touch are joined.
        z : float [m]
            Height of its floor.
        wall : float [m]
            If greater than 0, polygons that touch are rooms with walls of this thickness between them.
        file : str or Path
            Instead of polygons: a file with one storey in any format that an importer reads as a plan. Other items in
            the file, such as exits, are added too.
        options : mapping
            Parameters of the importer of the file.

        Raises
        ------
        BuildingError
            The name is already used, or the shape is invalid.
        """
        what = f"storey {name!r}"
        self._check_new("storeys", name, self.storeys)
        if (polygons is None) == (file is None):
            raise BuildingError(f"{self.source}: {what}: give either polygons or file, and not both")
        self._number(what, "z", z)
        self._number(what, "wall", wall, least=0.0)
        if not isinstance(options or {}, Mapping):
            raise BuildingError(f"{self.source}: {what}: options must be a table, not {options!r}")
        shapes = () if polygons is None else self._polygons(what, name, polygons)
        self.storeys[name] = Storey(
            name, float(z), shapes, Path(file) if file is not None else None, float(wall), dict(options or {})
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

        Raises
        ------
        BuildingError
            The name is already used, or the arguments do not define a stair.
        """
        what = f"stair {name!r}"
        self._check_new("stairs", name, [stair.name for stair in self.stairs])
        if upper_edge is None and length is None:
            raise BuildingError(f"{self.source}: {what}: give upper_edge or length")
        if turn not in (None, "left", "right") or (turn is not None and upper_edge is not None):
            raise BuildingError(f"{self.source}: {what}: turn must be 'left' or 'right', given instead of upper_edge")
        for key, value in (("length", length), ("landing", landing), ("gap", gap)):
            if value is not None:
                self._number(what, key, value, least=0.0)
        way = None if direction is None else self._vector(what, "direction", direction)
        edge = None if upper_edge is None else self._segment(what, "upper_edge", upper_edge)
        count = 1 if landing is not None and landings is None else landings or 0
        if count and landing is None:
            raise BuildingError(f"{self.source}: {what}: landings requires a landing depth, such as landing = 1.5")
        foot = self._segment(what, "lower_edge", lower_edge)
        self.stairs.append(Stair(name, lower, foot, upper, edge, length, way, landing, count, turn, gap))

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

        Raises
        ------
        BuildingError
            The arguments do not define a flight.
        """
        what = f"a flight of stair {stair!r}"
        if polygon is not None:
            if (lower_edge, lower_z, upper_edge, upper_z) != (None, None, None, None):
                raise BuildingError(f"{self.source}: {what}: give either polygon or edges, and not both")
            with naming_part(self.source, what):
                self.pieces.append((stair, "slope", (inclined_of(polygon),)))
            return
        for key, value in (("lower_edge", lower_edge), ("upper_edge", upper_edge)):
            if value is None:
                raise BuildingError(f"{self.source}: {what}: {key} is missing; give both edges, or polygon")
        ends = [self._segment(what, "lower_edge", lower_edge), self._segment(what, "upper_edge", upper_edge)]
        heights = [self._number(what, key, z) for key, z in (("lower_z", lower_z), ("upper_z", upper_z))]
        self.pieces.append((stair, "flight", (ends[0], heights[0], ends[1], heights[1])))

    def landing(self, stair: str, polygon: Shape, z: float) -> None:
        """Add one landing of a stair of any shape, at its height [m]; flights must end at its outline."""
        what = f"a landing of stair {stair!r}"
        shapes = self._polygons(what, None, polygon)
        self.pieces.append((stair, "landing", (shapes, self._number(what, "z", z))))

    def door(
        self, name: str, storey: str, segment: Shape, *, reach: float = DOOR_REACH, outside: str = "refuse"
    ) -> None:
        """Add a door: an opening in the wall between two rooms.

        Parameters
        ----------
        name, storey : str
        segment : segment
            Along the wall, as long as the opening is wide, anywhere within the thickness of the wall. It is moved to a
            wall at most 0.15 m beside it, and turned along a wall that it crosses at a small angle; both are findings.
        reach : float [m]
            Largest distance between the segment and the rooms.
        outside : "refuse", "exit" or "opening"
            Meaning of a door with a room on one side only: an error, an exit, or an opening that `evac import`
            suggests as an exit.

        Raises
        ------
        BuildingError
            An argument is invalid.
        """
        what = f"door {name!r}"
        if outside not in OUTSIDE:
            raise BuildingError(f"{self.source}: {what}: outside must be one of {', '.join(OUTSIDE)}, not {outside!r}")
        self._number(what, "reach", reach, least=0.0)
        self.doors.append(Item(name, storey, self._segment(what, "segment", segment), (), float(reach), outside))

    def exit(self, name: str, storey: str, segment: Shape | None = None, *, polygon: Shape | None = None) -> None:
        """Add an exit; people leave the building when their centre crosses it.

        Parameters
        ----------
        name, storey : str
        segment : segment
            Along the outer outline of the floor, at most 0.15 m from it; or on the outer face of a wall at most 0.6 m
            thick, through which the floor is then extended. Several segments, as a list, are one exit.
        polygon : shape
            Instead of a segment: ground outside. It is cut out of the floor, and every edge that it then shares with
            the floor is part of the exit.

        Raises
        ------
        BuildingError
            The name is already used, or the shape is invalid.
        """
        what = f"exit {name!r}"
        self._check_new("exits", name, [way.name for way in self.exits])
        if (segment is None) == (polygon is None):
            raise BuildingError(f"{self.source}: {what}: give either segment or polygon, and not both")
        if segment is None:
            self.exits.append(Item(name, storey, None, self._polygons(what, storey, polygon)))
            return
        several = segment if isinstance(segment, list) and segment and not any(map(is_point, segment)) else [segment]
        self.exits += [Item(name, storey, self._segment(what, "segment", one)) for one in several]

    def opening(self, storey: str, segment: Shape, name: str = "") -> None:
        """Add an opening to the outside that is not declared as an exit; `evac import` suggests it as an exit.

        Raises
        ------
        BuildingError
            The segment is invalid.
        """
        self.openings.append(Item(name, storey, self._segment("an opening", "segment", segment)))

    def area(self, name: str, storey: str, polygon: Shape) -> None:
        """Add an area in which people can start: the part of a polygon that is on the floor of its storey.

        Raises
        ------
        BuildingError
            The name is already used, or the shape is invalid.
        """
        self._check_new("areas", name, [area.name for area in self.areas])
        self.areas.append(Item(name, storey, polygons=self._polygons(f"area {name!r}", storey, polygon)))

    def obstacle(self, name: str, storey: str, polygon: Shape) -> None:
        """Add an obstacle: it is cut out of the floor of its storey, and its outline becomes a wall.

        Raises
        ------
        BuildingError
            The shape is invalid.
        """
        self.obstacles.append(Item(name, storey, polygons=self._polygons(f"obstacle {name!r}", storey, polygon)))

    def take(self, name: str, other: "Plan") -> None:
        """Copy the polygons and all items of another plan with one storey to a storey that was given as a file.

        Raises
        ------
        BuildingError
            The other plan does not have exactly one storey, or a name in it is already used.
        """
        if len(other.storeys) != 1 or other.stairs or other.pieces:
            raise BuildingError(
                f"{other.source}: has {len(other.storeys)} storeys ({', '.join(other.storeys)}); the file of a storey "
                "must have exactly one storey and no stairs"
            )
        (taken,) = other.storeys.values()
        own = self.storeys[name]
        self.storeys[name] = replace(own, polygons=taken.polygons, file=None, wall=own.wall or taken.wall, options={})
        for kind in ("doors", "exits", "openings", "areas", "obstacles"):
            items, names = getattr(self, kind), {one.name for one in getattr(self, kind)}
            for item in getattr(other, kind):
                if kind in ("exits", "areas") and item.name in names:
                    raise BuildingError(
                        f"{self.source}: two {kind} are named {item.name!r}, one of them in {other.source}; rename one"
                    )
                items.append(replace(item, storey=name))
        self.findings += [
            replace(finding, level=name if finding.level == taken.name else finding.level) for finding in other.findings
        ]

    def note(self, kind: str, text: str, storey: str | None = None, place: tuple[float, float] | None = None) -> None:
        """Add a finding, such as what an importer has found, assumed, repaired or left out."""
        self.findings.append(Finding(kind, text, storey, place))

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
        from evac.building.plan.drawing import draw

        return draw(self)

    def building(self, *, need_exit: bool = True, **options: Any) -> "Building":
        """Return the building; the options are the keys of ``[building]`` and `need_exit`, as for `read_building`.

        Raises
        ------
        BuildingError
            As `surface`, or the building cannot be used.
        """
        from evac.building.options import BuildingOptions
        from evac.building.surface.build import build_building

        own = BuildingOptions.read(options, BuildingError, f"{self.source}: building.")
        return build_building(self.surface(), self.source, own, need_exit=need_exit)

    def write(self, path: str | Path) -> None:
        """Write the surface to a Gmsh 2.2 file, with tags as physical groups; equal plans give identical files.

        Raises
        ------
        BuildingError
            As `surface`; or the name does not end in .msh.
        """
        from evac.building.surface.meshfile import write_surface

        if Path(path).suffix.lower() != ".msh":
            raise BuildingError(f"{path}: a plan is written as a mesh of Gmsh; give a name that ends in .msh")
        write_surface(self.surface(), Path(path))

    def _check_new(self, kind: str, name: str, known: Collection[str]) -> None:
        if name in known:
            raise BuildingError(f"{self.source}: there are two {kind} named {name!r}; rename one")

    def _polygons(self, what: str, storey: str | None, given: Shape) -> tuple[BaseGeometry, ...]:
        with naming_part(self.source, what):
            return tuple(polygons_of(given, storey, self.findings))

    def _segment(self, what: str, key: str, given: Shape | None) -> FloatArray:
        with naming_part(self.source, f"{what}: {key}"):
            return segment_of(given if given is not None else [])

    def _vector(self, what: str, key: str, value: Any) -> FloatArray:
        try:
            vector = np.asarray(value, np.float64)
        except (TypeError, ValueError, OverflowError):
            vector = np.empty(0)
        if vector.shape != (2,) or not (np.abs(vector) <= FARTHEST).all() or not vector.any():
            raise BuildingError(f"{self.source}: {what}: {key} must be a vector [x, y], not {value!r}")
        return vector

    def _number(self, what: str, key: str, value: Any, least: float = -FARTHEST) -> float:
        is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not is_number or not abs(value) <= FARTHEST:
            raise BuildingError(f"{self.source}: {what}: {key} must be a number up to {FARTHEST:g}, not {value!r}")
        if value < least:
            raise BuildingError(f"{self.source}: {what}: {key} must be at least {least:g}, not {value:g}")
        return float(value)
