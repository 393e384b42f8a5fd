"""The building as every other part sees it: levels, portals, exits, areas, walls. Frozen data only."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from shapely.geometry.base import BaseGeometry

from evac.arrays import FloatArray, IntArray
from evac.building.findings import Finding, warnings_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: How a level is walked: on the flat, up or down its slope. Columns of speeds and lengths.
FLAT, UP, DOWN = 0, 1, 2


@dataclass(frozen=True)
class Level:
    """A maximal edge-connected set of cells of one slope class: a floor, a flight or a landing.

    Attributes
    ----------
    index : int
        Its row in every per-level array.
    name : str
        Tag of the mesh, or made from what it is and where (``"flight z=0.00..1.50"``); unique.
    kind : str
        ``"floor"``, ``"flight"`` (sloped) or ``"landing"`` (flat, between flights of one stair).
    stair : str or None
        Name of the stair it belongs to.
    triangles : (t, 3) int32
        Rows of ``Building.vertices``.
    polygon : shapely polygon or multipolygon
        The plan, holes included.
    uphill : (2,) float64
        Unit plan vector of steepest ascent, zero on a flat level.
    slope : float
        Angle with the horizontal [rad].
    z_min, z_max : float
        Heights of its lowest and highest vertex [m].
    """

    index: int
    name: str
    kind: str
    stair: str | None
    triangles: IntArray
    polygon: BaseGeometry
    uphill: FloatArray
    slope: float
    z_min: float
    z_max: float


@dataclass(frozen=True)
class Portal:
    """An edge chain shared by two levels; open for walking both ways.

    Attributes
    ----------
    index : int
        Its row in ``Building.portals``, which is its link as well.
    name : str
    levels : (int, int)
        The two levels that it joins.
    segments : (s, 4) float64
        x1, y1, x2, y2 [m], each with the first level's inside on its left.
    width : float
        Length of its segments together [m].
    """

    index: int
    name: str
    levels: tuple[int, int]
    segments: FloatArray
    width: float

    def other(self, level: int) -> int:
        """Return the level on the other side."""
        first, second = self.levels
        return second if level == first else first

    def segments_from(self, level: int) -> FloatArray:
        """Return the segments (s, 4) [m] with the inside of one of its levels on their left."""
        return self.segments if level == self.levels[0] else self.segments[:, [2, 3, 0, 1]]


@dataclass(frozen=True)
class Exit:
    """An edge chain on the boundary of one level; whoever's centre crosses it is out.

    Attributes
    ----------
    index : int
        Its row in ``Building.exits``; its link is `Building.link_of` it.
    name : str
    level : int
    segments : (s, 4) float64
        x1, y1, x2, y2 [m], each with the level's inside on its left.
    width : float
        Length of its segments together [m].
    """

    index: int
    name: str
    level: int
    segments: FloatArray
    width: float


@dataclass(frozen=True)
class Area:
    """A named part of a level in which people can start.

    Attributes
    ----------
    name : str
    level : int
    polygon : shapely polygon or multipolygon
        Its plan [m].
    """

    name: str
    level: int
    polygon: BaseGeometry


@dataclass(frozen=True)
class Building:
    """The building: levels, portals, exits, areas and walls, which do not change during a run.

    Portals and exits together are its links: portals first, then exits.

    Attributes
    ----------
    source : Path
        The mesh file.
    vertices : (v, 3) float64
        Welded vertices [m].
    levels : tuple of Level
    portals : tuple of Portal
    exits : tuple of Exit
    areas : tuple of Area
    walls : (w, 4) float64
        Segments x1, y1, x2, y2 [m], each with the level's inside on its left: free edges of the mesh that are
        no exit, and outlines of obstacles; collinear neighbours of one level are merged.
    wall_level : (w,) int32
        Level that each wall stands on.
    stairs : dict of str to tuple of int
        Levels of each stair, from top to bottom.
    findings : tuple of Finding
        Information and warnings for the user, each with its place.
    closed : frozenset of int
        Links that are walls during the whole run.
    """

    source: Path
    vertices: FloatArray
    levels: tuple[Level, ...]
    portals: tuple[Portal, ...]
    exits: tuple[Exit, ...]
    areas: tuple[Area, ...]
    walls: FloatArray
    wall_level: IntArray
    stairs: dict[str, tuple[int, ...]]
    findings: tuple[Finding, ...] = field(default=())
    closed: frozenset[int] = frozenset()

    def __repr__(self) -> str:
        exits = ", ".join(exit_.name for exit_ in self.exits) or "none"
        return f"<Building {self.source.name}: {len(self.levels)} levels, exits {exits}>"

    def plot(self) -> "Figure":
        """Return the plan of every storey, with names, widths and warnings, as a figure of matplotlib."""
        from evac.output.notebook import building_figure

        return building_figure(self)

    def _repr_html_(self) -> str:
        from evac.output.notebook import figure_html

        return figure_html(self.plot(), "plans of the storeys")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Texts of the warnings among the findings."""
        return warnings_of(self.findings)

    def level_named(self, name: str) -> Level | None:
        """Return the level of that name, or None."""
        return next((level for level in self.levels if level.name == name), None)

    @property
    def n_links(self) -> int:
        """Number of portals and exits."""
        return len(self.portals) + len(self.exits)

    def link_of(self, exit_: Exit) -> int:
        """Return the link of an exit; that of a portal is its index."""
        return len(self.portals) + exit_.index

    def is_open(self, link: Portal | Exit) -> bool:
        """Return whether a portal or an exit can be passed."""
        return (link.index if isinstance(link, Portal) else self.link_of(link)) not in self.closed

    def portals_of(self, level: int) -> list[Portal]:
        """Return the portals of a level, closed ones too."""
        return [portal for portal in self.portals if level in portal.levels]

    def exits_of(self, level: int) -> list[Exit]:
        """Return the exits of a level, closed ones too."""
        return [exit_ for exit_ in self.exits if level == exit_.level]
