import itertools
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.building.model.building import Area, Building, Exit, Level, Portal
from evac.case import case_from
from evac.directions.routes import Route


@pytest.fixture
def make_case(tmp_path, registry):
    """Return a function that makes a case of the groups given."""
    (tmp_path / "house.msh").write_text("", encoding="utf-8")

    def make(*people, **sections):
        table = {"building": {"mesh": "house.msh"}, "contact": {"model": "soft"}, "people": list(people), **sections}
        return case_from(table, tmp_path / "case.toml", registry=registry)

    return make


@pytest.fixture
def house():
    """Two rooms of 6 x 4 m, one 3 m above the other in the same plan, each cut in two by a portal at x = 4."""
    plan = [(0, 0), (4, 0), (4, 4), (0, 4), (6, 0), (6, 4)]
    vertices = np.array([(x, y, z) for z in (0.0, 3.0) for x, y in plan])
    levels = []
    walls, wall_level = [], []
    for floor, z in enumerate((0.0, 3.0)):
        for name, corners in (("west", (0, 1, 2, 3)), ("east", (1, 4, 5, 2))):
            a, b, c, d = (6 * floor + corner for corner in corners)
            index = len(levels)
            polygon = shapely.Polygon([plan[corner] for corner in corners])
            levels.append(
                Level(
                    index,
                    f"{name} {floor}",
                    "floor",
                    None,
                    np.array([[a, b, c], [a, c, d]], dtype=np.int32),
                    polygon,
                    np.zeros(2),
                    0.0,
                    z,
                    z,
                )
            )
            outline = shapely.get_coordinates(polygon.exterior)
            for start, end in itertools.pairwise(outline):
                if not start[0] == end[0] == 4:
                    walls.append((*start, *end))
                    wall_level.append(index)
    line = np.array([[4.0, 0.0, 4.0, 4.0]])
    return Building(
        source=Path("house.msh"),
        vertices=vertices,
        levels=tuple(levels),
        portals=tuple(Portal(p, f"portal {p}", (2 * p, 2 * p + 1), line, 4.0) for p in range(2)),
        exits=(Exit(0, "door", 1, np.array([[6.0, 1.0, 6.0, 2.0]]), 1.0),),
        areas=tuple(Area(f"room {index}", index, level.polygon) for index, level in enumerate(levels)),
        walls=np.array(walls),
        wall_level=np.array(wall_level, dtype=np.int32),
        stairs={},
    )


@dataclass
class FakeFields:
    """Travel times without fast marching: everywhere one second, but on closed levels."""

    routes: tuple[Route, ...] = (Route(),)
    closed: tuple[int, ...] = field(default=())

    def are_passable(self, level, position, route, radius=0.0):
        return np.isfinite(self.travel_time_at(np.full(len(position), level), position, route, radius))

    def travel_time_at(self, level, position, route, radius=0.0):
        return np.where(np.isin(level, self.closed), np.inf, 1.0)


@pytest.fixture
def fields():
    return FakeFields
