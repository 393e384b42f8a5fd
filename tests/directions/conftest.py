"""Buildings drawn by hand, so that exact answers are known."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.building.model.building import Building, Exit, Level, Portal


class Drawing:
    """Levels, portals and exits put together to a Building; walls are what is left of the outlines."""

    def __init__(self):
        self.levels, self.portals, self.exits, self.walls = [], [], [], []

    def level(self, polygon, *, uphill=(0.0, 0.0), slope=0.0, z=0.0):
        if isinstance(polygon, tuple):
            polygon = shapely.box(*polygon)
        index = len(self.levels)
        kind = "flight" if slope else "floor"
        self.levels.append(
            Level(
                index,
                f"{kind} {index}",
                kind,
                None,
                np.zeros((0, 3), np.int32),
                polygon,
                np.array(uphill, dtype=float),
                slope,
                z,
                z,
            )
        )
        return index

    def _inside_left(self, level, segment):
        (x1, y1), (x2, y2) = segment
        ahead = np.array([0.5 * (x1 + x2), 0.5 * (y1 + y2)])
        ahead += 1e-3 * np.array([y1 - y2, x2 - x1]) / math.hypot(x2 - x1, y2 - y1)
        inside = shapely.contains_xy(self.levels[level].polygon, *ahead)
        return np.array([[x1, y1, x2, y2] if inside else [x2, y2, x1, y1]], dtype=float)

    def portal(self, first, second, start, end):
        segments = self._inside_left(first, (start, end))
        width = math.dist(start, end)
        self.portals.append(Portal(len(self.portals), f"portal {len(self.portals)}", (first, second), segments, width))

    def exit(self, name, level, start, end):
        segments = self._inside_left(level, (start, end))
        self.exits.append(Exit(len(self.exits), name, level, segments, math.dist(start, end)))

    def wall(self, level, start, end):
        self.walls.append((level, (*start, *end)))

    def build(self):
        walls, wall_level = [], []
        for level in self.levels:
            openings = [p.segments for p in self.portals if level.index in p.levels]
            openings += [e.segments for e in self.exits if e.level == level.index]
            outline = level.polygon.boundary
            for segments in openings:
                outline = outline.difference(shapely.LineString(segments.reshape(-1, 2)).buffer(1e-9, cap_style="flat"))
            for part in shapely.get_parts(outline):
                points = shapely.get_coordinates(part)
                for start, end in itertools.pairwise(points):
                    if math.dist(start, end) > 1e-6:
                        walls.append((*start, *end))
                        wall_level.append(level.index)
        for level, segment in self.walls:
            walls.append(segment)
            wall_level.append(level)
        corners = np.concatenate([shapely.get_coordinates(level.polygon) for level in self.levels])
        return Building(
            Path("drawn.msh"),
            np.column_stack((corners, np.zeros(len(corners)))),
            tuple(self.levels),
            tuple(self.portals),
            tuple(self.exits),
            (),
            np.array(walls, dtype=float).reshape(-1, 4),
            np.array(wall_level, dtype=np.int32),
            {},
        )


@pytest.fixture
def drawing():
    return Drawing()


@pytest.fixture
def corridor(drawing):
    drawing.exit("end", drawing.level((0.0, 0.0, 12.0, 2.0)), (12.0, 0.0), (12.0, 2.0))
    return drawing.build()


@pytest.fixture
def hall(drawing):
    level = drawing.level((0.0, 0.0, 16.0, 6.0))
    drawing.exit("left", level, (2.0, 0.0), (3.0, 0.0))
    drawing.exit("right", level, (13.0, 0.0), (14.0, 0.0))
    return drawing.build()


@pytest.fixture
def row(drawing):
    """Return three rooms one after another; the exit is in the last one."""
    rooms = [drawing.level((8.0 * k, 0.0, 8.0 * (k + 1), 4.0)) for k in range(3)]
    for first, second in ((0, 1), (1, 2)):
        drawing.portal(rooms[first], rooms[second], (8.0 * second, 1.0), (8.0 * second, 3.0))
    drawing.exit("out", rooms[2], (24.0, 1.0), (24.0, 3.0))
    return drawing.build()
