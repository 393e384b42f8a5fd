"""Plans on which travel times are compared with exact geodesics."""

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Exit, Level, Portal
from evac.evidence.accuracy.reference import geodesics, refracted
from evac.evidence.models import plugins
from evac.simulation.assembly import read_building

Point = tuple[float, float]


@dataclass(frozen=True)
class Plan:
    """A building with one exit whose travel times at 1 m/s along the slope are known."""

    name: str
    building: Building
    level: int  # where people stand
    points: FloatArray  # (p, 2) [m]
    time: FloatArray  # (p,) [s]
    direction: FloatArray  # (p, 2): unit directions of the shortest paths
    lead: FloatArray  # (p,) [m]: see `evac.evidence.accuracy.reference.geodesics`; inf if there is only one path
    wall_distance: FloatArray  # (p,) [m]


def l_corner(points: int, generator: np.random.Generator) -> Plan:
    """Return an L-shaped corridor along the axes, 2 m wide."""
    outline = shapely.Polygon([(0, 0), (8, 0), (8, 2), (2, 2), (2, 7), (0, 7)])
    return _one_level("L-corner", outline, ((8.0, 0.0), (8.0, 2.0)), points, generator)


def pillar(points: int, generator: np.random.Generator) -> Plan:
    """Return a room with a square pillar, turned by 20 degrees so that no wall lies along the grid."""
    outline = shapely.box(0, 0, 8, 6) - shapely.box(3.2, 2.2, 4.8, 3.7)
    turned = shapely.affinity.rotate(outline, 20.0, origin=(0, 0))
    ends = shapely.affinity.rotate(shapely.LineString([(8, 2.5), (8, 3.5)]), 20.0, origin=(0, 0))
    start, end = ends.coords
    return _one_level("room with a pillar", turned, (start, end), points, generator)


def school_floor(points: int, generator: np.random.Generator) -> Plan:
    """Return the upper floor of the shipped school, with an exit at the beginning of the stair."""
    case = plugins().get("case", "primary_school")
    building = read_building(Path(case) / "primary_school.msh")
    top = max((level for level in building.levels if level.kind == "floor"), key=lambda level: level.z_max)
    stair = next(portal for portal in building.portals if top.index in portal.levels)
    segment = stair.segments[0] if stair.levels[0] == top.index else stair.segments[0][[2, 3, 0, 1]]
    # Vertices of the mesh on straight walls are not corners of the outline.
    outline = shapely.normalize(top.polygon).simplify(1e-9)
    return _one_level("school floor", outline, (tuple(segment[:2]), tuple(segment[2:])), points, generator)


def stair(points: int, generator: np.random.Generator) -> Plan:
    """Return a floor, a flight of 32 degrees beside its middle, and a floor below with the exit."""
    slope = math.radians(32.0)
    levels = (
        _level(0, shapely.box(0, 0, 4, 5)),
        _level(1, shapely.box(4, 1.5, 7, 3.5), uphill=(-1.0, 0.0), slope=slope),
        _level(2, shapely.box(7, 0, 11, 5)),
    )
    seams = [(4.0, 1.5, 4.0, 3.5), (7.0, 1.5, 7.0, 3.5)]
    portals = tuple(Portal(k, f"portal {k}", (k, k + 1), np.array([segment]), 2.0) for k, segment in enumerate(seams))
    door = (11.0, 3.6, 11.0, 4.8)
    exits = (Exit(0, "exit", 2, np.array([door]), 1.2),)
    building = _put_together(levels, portals, exits)
    places = _places(levels[0].polygon, points, generator)
    time, direction = refracted(places, [np.array(line) for line in (*seams, door)], [1.0, 1.0 / math.cos(slope), 1.0])
    one_way = np.full(len(places), np.inf)
    return Plan("over a stair", building, 0, places, time, direction, one_way, _wall_distance(building, 0, places))


PLANS = (l_corner, pillar, school_floor, stair)


def _one_level(
    name: str, outline: shapely.Polygon, ends: tuple[Point, Point], points: int, generator: np.random.Generator
) -> Plan:
    """Return a plan of one level with one exit; the outline is on the left of the exit line."""
    segment = np.array([*ends[0], *ends[1]])
    building = _put_together(
        (_level(0, outline),), (), (Exit(0, "exit", 0, segment[None], float(np.hypot(*(segment[2:] - segment[:2])))),)
    )
    places = _places(outline, points, generator)
    length, direction, lead = geodesics(outline, segment, places)
    return Plan(name, building, 0, places, length, direction, lead, _wall_distance(building, 0, places))


def _level(index: int, polygon: shapely.Polygon, uphill: Point = (0.0, 0.0), slope: float = 0.0) -> Level:
    kind = "flight" if slope else "floor"
    return Level(
        index, f"{kind} {index}", kind, None, np.zeros((0, 3), np.int32), polygon, np.array(uphill), slope, 0.0, 0.0
    )


def _put_together(levels: tuple[Level, ...], portals: tuple[Portal, ...], exits: tuple[Exit, ...]) -> Building:
    """Return the building; walls are the outlines without portals and exits."""
    walls, wall_level = [], []
    for level in levels:
        outline = level.polygon.boundary
        lines = [p.segments for p in portals if level.index in p.levels]
        lines += [e.segments for e in exits if e.level == level.index]
        for line in lines:
            outline = outline.difference(shapely.LineString(line.reshape(-1, 2)).buffer(1e-7, cap_style="flat"))
        for part in shapely.get_parts(outline):
            for start, end in itertools.pairwise(shapely.get_coordinates(part)):
                if math.dist(start, end) > 1e-6:
                    walls.append((*start, *end))
                    wall_level.append(level.index)
    corners = np.concatenate([shapely.get_coordinates(level.polygon) for level in levels])
    return Building(
        Path("by hand"),
        np.column_stack([corners, np.zeros(len(corners))]),
        levels,
        portals,
        exits,
        (),
        np.array(walls),
        np.array(wall_level, np.int32),
        {},
    )


def _places(polygon: shapely.Polygon, number: int, generator: np.random.Generator) -> FloatArray:
    """Return random places (number, 2), half of them within 0.4 m of the outline, none closer than 0.05 m."""
    low_x, low_y, high_x, high_y = polygon.bounds
    inner = polygon.buffer(-0.05)
    rim = inner - polygon.buffer(-0.4)
    found = []
    for where, wanted in ((inner, number - number // 2), (rim, number // 2)):
        shapely.prepare(where)
        places = np.zeros((0, 2))
        while len(places) < wanted:
            drawn = generator.uniform((low_x, low_y), (high_x, high_y), (4 * number, 2))
            places = np.concatenate([places, drawn[shapely.contains_xy(where, drawn)]])
        found.append(places[:wanted])
    return np.concatenate(found)


def _wall_distance(building: Building, level: int, places: FloatArray) -> FloatArray:
    """Return the distances (p,) to the walls of a level [m]."""
    walls = shapely.multilinestrings(
        shapely.linestrings(building.walls[building.wall_level == level].reshape(-1, 2, 2))
    )
    return np.asarray(shapely.distance(shapely.points(places), walls))
