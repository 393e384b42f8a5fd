"""Scenes made by hand, without files: a room with walls and exits, and directions given at the nodes of a grid."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from shapely.geometry import box

from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Exit, Level
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route

Bounds = tuple[float, float, float, float]


def room(bounds: Bounds, inner_walls: ArrayLike = (), exits: tuple[Bounds, ...] = ()) -> Building:
    """Return one flat level with walls around `bounds` [m], further walls (w, 4), and exits on its right side."""
    x1, y1, x2, y2 = bounds
    ends = [y1, *(y for way_out in exits for y in (way_out[1], way_out[3])), y2]
    right = [(x2, low, x2, high) for low, high in zip(ends[::2], ends[1::2], strict=True)]
    walls = np.array([(x1, y1, x2, y1), (x2, y2, x1, y2), (x1, y2, x1, y1), *right], dtype=float)
    walls = np.concatenate([walls, np.array(inner_walls, dtype=float).reshape(-1, 4)])
    level = Level(0, "floor", "floor", None, np.zeros((0, 3), np.int32), box(*bounds), np.zeros(2), 0.0, 0.0, 0.0)
    doors = tuple(
        Exit(k, f"exit {k}", 0, np.array([way_out], dtype=float), way_out[3] - way_out[1])
        for k, way_out in enumerate(exits)
    )
    corners = np.array([(x1, y1, 0.0), (x2, y1, 0.0), (x2, y2, 0.0), (x1, y2, 0.0)])
    return Building(Path("by hand"), corners, (level,), (), doors, (), walls, np.zeros(len(walls), np.int32), {})


def one_direction(bounds: Bounds, *directions: ArrayLike, levels: int = 1) -> Fields:
    """Return the same unit direction everywhere, +x by default; a route for each; travel times decrease along it."""
    x1, y1, x2, y2 = bounds
    side = max(x2 - x1, y2 - y1)
    node = np.array([(x1, y1), (x1, y1 + side), (x1 + side, y1), (x1 + side, y1 + side)], dtype=float)
    ahead = np.array(directions or [(1.0, 0.0)], dtype=float)
    time = np.concatenate([2.0 * side - (node - node[0]) @ way for way in ahead])
    return fields_of((x1, y1), (2, 2), side, np.repeat(ahead, 4, axis=0), time, levels)


def fields_of(
    origin: tuple[float, float],
    shape: tuple[int, int],
    spacing: float,
    direction: FloatArray,
    time: FloatArray,
    levels: int = 1,
) -> Fields:
    """Return the fields of levels from directions (k, 2) and travel times (k,) at the nodes of each route."""
    routes = len(time) // (shape[0] * shape[1])
    return Fields(
        routes=tuple(Route((f"exit {k}",)) for k in range(routes)) if routes > 1 else (Route(),),
        packed=PackedFields(
            origin=np.tile(np.array(origin, dtype=float), (levels, 1)),
            shape=np.tile(np.array(shape, np.int32), (levels, 1)),
            spacing=spacing,
            width=np.zeros(0),
            field_of=np.tile(np.arange(routes, dtype=np.int32), (levels, 1)),
            offset=shape[0] * shape[1] * np.arange(routes, dtype=np.int64),
            direction=np.ascontiguousarray(direction),
            travel_time=time,
            walls=NO_CELL_WALLS,
        ),
    )


def towards(bounds: Bounds, point: tuple[float, float], spacing: float = 0.25, levels: int = 1) -> Fields:
    """Return directions that converge on a point; the travel time is the distance to it [m]."""
    x1, y1, x2, y2 = bounds
    across = int(np.ceil((x2 - x1) / spacing)) + 2
    along = int(np.ceil((y2 - y1) / spacing)) + 2
    x, y = np.meshgrid(x1 + spacing * np.arange(across), y1 + spacing * np.arange(along), indexing="ij")
    away = np.stack([x - point[0], y - point[1]], axis=2).reshape(-1, 2)
    distance = np.hypot(away[:, 0], away[:, 1])
    direction = -away / np.maximum(distance, 1e-9)[:, None]
    return fields_of((x1, y1), (across, along), spacing, direction, distance, levels)
