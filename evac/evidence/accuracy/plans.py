"""Plans on which travel times are compared with exact geodesics."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from evac.base.arrays import FloatArray
from evac.building.model.building import Building
from evac.building.plan.plan import Plan
from evac.evidence.accuracy.reference import geodesics, refracted
from evac.evidence.scenes import plugins
from evac.simulation.assembly import read_building
from evac.standard.plans import FLOOR, Shape, across, one_storey


class TimedPlan(NamedTuple):
    """A building with one exit whose travel times at 1 m/s along the slope are known."""

    name: str
    building: Building
    level: int  # where people stand
    points: FloatArray  # (p, 2) [m]
    time: FloatArray  # (p,) [s]
    direction: FloatArray  # (p, 2): unit directions of the shortest paths
    lead: FloatArray  # (p,) [m]: see `evac.evidence.accuracy.reference.geodesics`; inf if there is only one path
    wall_distance: FloatArray  # (p,) [m]


def l_corner(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return an L-shaped corridor along the axes, 2 m wide."""
    outline = shapely.Polygon([(0, 0), (8, 0), (8, 2), (2, 2), (2, 7), (0, 7)])
    return _one_level("L-corner", outline, ((8.0, 0.0), (8.0, 2.0)), points, generator)


def pillar(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return a room with a square pillar, turned by 20 degrees so that no wall lies along the grid."""
    outline = shapely.box(0, 0, 8, 6) - shapely.box(3.2, 2.2, 4.8, 3.7)
    turned = shapely.affinity.rotate(outline, 20.0, origin=(0, 0))
    ends = shapely.affinity.rotate(shapely.LineString([(8, 2.5), (8, 3.5)]), 20.0, origin=(0, 0))
    start, end = ends.coords
    return _one_level("room with a pillar", turned, (start, end), points, generator)


def school_floor(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return the upper floor of the shipped school, with an exit at the beginning of the stair."""
    case = plugins().get("case", "primary_school")
    building = read_building(Path(case) / "primary_school.msh")
    top = max((level for level in building.levels if level.kind == "floor"), key=lambda level: level.z_max)
    stair = next(portal for portal in building.portals if top.index in portal.levels)
    segment = stair.segments[0] if stair.levels[0] == top.index else stair.segments[0][[2, 3, 0, 1]]
    # Vertices of the mesh on straight walls are not corners of the outline.
    outline = shapely.normalize(top.polygon).simplify(1e-9)
    return _one_level("school floor", outline, (tuple(segment[:2]), tuple(segment[2:])), points, generator)


def stair(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return a floor, a flight of 32 degrees beside its middle, and a floor below with the exit."""
    slope, floor = math.radians(32.0), shapely.box(0, 0, 4, 5)
    seams, door = [(4.0, 1.5, 4.0, 3.5), (7.0, 1.5, 7.0, 3.5)], (11.0, 3.6, 11.0, 4.8)
    plan = Plan()
    plan.storey("upper", floor, 3.0 * math.tan(slope))
    plan.storey("lower", shapely.box(7, 0, 11, 5))
    plan.stair("flight", "lower", across(7, 1.5, 3.5), "upper", across(4, 1.5, 3.5))
    plan.exit("exit", "lower", across(11, 3.6, 4.8))
    places = _places(floor, points, generator)
    time, direction = refracted(places, [np.array(line) for line in (*seams, door)], [1.0, 1.0 / math.cos(slope), 1.0])
    return _timed("over a stair", plan, "upper", places, time, direction, np.full(len(places), np.inf))


PLANS = (l_corner, pillar, school_floor, stair)


def _one_level(
    name: str, outline: shapely.Polygon, ends: Shape, points: int, generator: np.random.Generator
) -> TimedPlan:
    places = _places(outline, points, generator)
    known = geodesics(outline, np.array([*ends[0], *ends[1]]), places)
    return _timed(name, one_storey(outline, exits={"exit": ends}), FLOOR, places, *known)


def _timed(
    name: str, plan: Plan, storey: str, places: FloatArray, time: FloatArray, direction: FloatArray, lead: FloatArray
) -> TimedPlan:
    building = plan.building()
    level = next(level.index for level in building.levels if level.name == storey)
    walls = shapely.linestrings(building.walls[building.wall_level == level].reshape(-1, 2, 2))
    wall_distance = np.asarray(shapely.distance(shapely.points(places), shapely.multilinestrings(walls)))
    return TimedPlan(name, building, level, places, time, direction, lead, wall_distance)


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
