"""The plan of a building that exists: its floors as storeys, its flights as inclined polygons."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.building.geometry.overlays import united
from evac.building.model.building import Building, Level
from evac.building.plan.plan import Plan
from evac.building.plan.stairs import LEVEL

#: Digits to which the planes of cells agree, in slope and in height at the origin of the flight.
DIGITS = 5


def plan_of_building(building: Building) -> Plan:
    """Return the plan from which a building is made again.

    Raises
    ------
    ValueError
        The building has no such plan: a floor is not level, or an exit is on a stair.
    """
    plan = Plan(building.source, headroom=0.0)
    for level in building.levels:
        if level.kind == "flight":
            plan.flight(str(level.stair), polygon=slopes_of(building, level))
        elif level.z_max - level.z_min > LEVEL:
            raise ValueError(f"level {level.name!r} is not level")
        elif level.kind == "landing":
            plan.landing(str(level.stair), level.polygon, level.z_min)
        else:
            plan.storey(level.name, level.polygon, level.z_min)
    for way in building.exits:
        level = building.levels[way.level]
        if level.kind != "floor":
            raise ValueError(f"exit {way.name!r} is on a stair")
        plan.exit(way.name, level.name, way.segments.reshape(-1, 2, 2).tolist())
    for door in building.doors:
        plan.door(door.name, building.levels[door.level].name, door.segment.reshape(2, 2))
    for area in building.areas:
        plan.area(area.name, building.levels[area.level].name, area.polygon)
    return plan


def slopes_of(building: Building, level: Level) -> list[BaseGeometry]:
    """Return the planes of a flight: polygons whose corners have heights [m]."""
    corners = building.vertices[level.triangles]
    origin = corners[0, 0, :2]
    sides = corners[:, 1:] - corners[:, :1]
    gradient = np.linalg.solve(sides[:, :, :2], sides[:, :, 2:])[:, :, 0]
    offset = corners[:, 0, 2] - ((corners[:, 0, :2] - origin) * gradient).sum(axis=1)
    planes = np.column_stack([gradient, offset])
    _, plane_of = np.unique(planes.round(DIGITS), axis=0, return_inverse=True)
    polygons = []
    for index in range(plane_of.max() + 1):
        own = plane_of.ravel() == index
        plane = planes[own].mean(axis=0)
        for part in shapely.get_parts(united(shapely.polygons(corners[own][:, :, :2]))):
            flat = shapely.get_coordinates(part)
            heights = (flat - origin) @ plane[:2] + plane[2]
            rings = np.split(
                np.column_stack([flat, heights]), np.cumsum(shapely.get_num_coordinates(shapely.get_rings(part)))[:-1]
            )
            polygons.append(shapely.Polygon(rings[0], rings[1:]))
    return polygons
