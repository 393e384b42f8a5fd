"""The plan of a building that exists: its floors as storeys, its flights as inclined polygons."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.building.model.building import Building, Level
from evac.building.plan.plan import Plan
from evac.building.plan.stairs import LEVEL
from evac.building.surface.patches import patches_of


def plan_of_building(building: Building) -> Plan:
    """Return the plan from which a building is made again."""
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
    cells = level.triangles.astype(np.int64)
    patches = patches_of(building.vertices, cells, np.zeros(len(cells), dtype=np.int64), {})
    return [
        shapely.transform(
            shapely.force_3d(patch.plan),
            lambda at, patch=patch: np.column_stack([at[:, :2], patch.height(at[:, :2])]),
            include_z=True,
        )
        for patch in patches
    ]
