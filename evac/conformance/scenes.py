"""Small scenes without mesh files: walled rooms with given directions and positions of people, and their engine."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from shapely.geometry import box

from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Exit, Level
from evac.contract.registry import Registry
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route
from evac.physics.contact.model import BorderScene, border_scene
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, World, copy_of
from evac.physics.world import make_world, set_open

Bounds = tuple[float, float, float, float]


@cache
def plugins() -> Registry:
    """Return the registered plugins."""
    return Registry()


def make_engine(world: World, people: int) -> CompiledEngine:
    """Return an engine without forces at a distance that knows the registered solvers."""
    return CompiledEngine(world, people, [], solvers=plugins().solvers)


@dataclass(frozen=True)
class Scene:
    """People in a rectangular room with walls on all sides except for its exits."""

    room: Bounds  # (x1, y1, x2, y2) [m]
    building: Building
    fields: Fields
    crowd: Crowd  # the initial state; `start` returns copies
    is_closed: bool = False  # whether the exits are closed

    def start(self) -> tuple[CompiledEngine, Crowd]:
        """Return a new engine and a copy of the crowd."""
        crowd = copy_of(self.crowd)
        world = make_world(self.building, self.fields)
        for link in range(len(self.building.exits) if self.is_closed else 0):
            set_open(world, link, False)
        return make_engine(world, len(crowd.level)), crowd

    def changed(self, **arrays: FloatArray) -> "Scene":
        """Return the scene with other arrays of the crowd."""
        return replace(self, crowd=self.crowd.replace(**arrays))

    def border(self, step: float, explicit: bool) -> BorderScene:
        """Return the data with which contact models check a step [s]."""
        return border_scene(self.crowd, step, explicit)


def room(bounds: Bounds, inner_walls: ArrayLike = (), exits: tuple[Bounds, ...] = ()) -> Building:
    """Return one flat level with walls around `bounds` [m], further walls (w, 4), and exits.

    Exits are segments on the right side, x = x2, rising in y; the wall there is left out between their ends.
    """
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


def one_direction(bounds: Bounds, *directions: ArrayLike) -> Fields:
    """Return the same unit direction everywhere, +x by default; a route for each; travel times decrease along it."""
    x1, y1, x2, y2 = bounds
    side = max(x2 - x1, y2 - y1)
    node = np.array([(x1, y1), (x1, y1 + side), (x1 + side, y1), (x1 + side, y1 + side)], dtype=float)
    ahead = np.array(directions or [(1.0, 0.0)], dtype=float)
    time = np.concatenate([2.0 * side - (node - node[0]) @ way for way in ahead])
    return fields_of((x1, y1), (2, 2), side, np.repeat(ahead, 4, axis=0), time)


def fields_of(
    origin: tuple[float, float], shape: tuple[int, int], spacing: float, direction: FloatArray, time: FloatArray
) -> Fields:
    """Return the fields of one level from directions (k, 2) and travel times (k,) at the nodes of each route."""
    routes = len(time) // (shape[0] * shape[1])
    return Fields(
        routes=tuple(Route((f"exit {k}",)) for k in range(routes)) if routes > 1 else (Route(),),
        packed=PackedFields(
            origin=np.array([origin], dtype=float),
            shape=np.array([shape], np.int32),
            spacing=spacing,
            width=np.zeros(0),
            field_of=np.arange(routes, dtype=np.int32).reshape(1, -1),
            offset=shape[0] * shape[1] * np.arange(routes, dtype=np.int64),
            direction=np.ascontiguousarray(direction),
            travel_time=time,
            walls=NO_CELL_WALLS,
        ),
    )
