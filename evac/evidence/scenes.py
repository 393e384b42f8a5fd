"""Small scenes without mesh files: walled rooms with people and directions; and the contact models compared."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from shapely.geometry import box

from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Exit, Level
from evac.contract.registry import Registry
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route
from evac.physics.contact.model import BorderScene, ContactModel, border_scene
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, World, copy_of, make_crowd
from evac.physics.world import make_world, set_open

Bounds = tuple[float, float, float, float]


#: Plugin and parameters of each model; other parameters have the plugin's defaults.
MODELS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "DEM": ("dem", {"stiffness": 1.2e5}),
    "NSM1 inertial": ("nsm1", {"variant": "inertial"}),
    "NSM1 overdamped": ("nsm1", {"variant": "overdamped"}),
    "NSM2": ("nsm2", {"normal_dissipation": 1e5, "tangential_dissipation": 0.0}),
}

#: Tolerance of NSM1 while a crowd walks to the state that is measured; its last steps use the defaults.
COARSE = {"gap_tolerance": 1e-3, "velocity_tolerance": 0.02}


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


def make_model(name: str, **parameters: Any) -> ContactModel:
    """Return a contact model by its name in `MODELS`, with additional or changed parameters."""
    plugin, given = MODELS[name]
    model = plugins().get("contact_model", plugin)(**{**given, **parameters})
    return cast(ContactModel, model)


def model_overrides(name: str) -> dict[str, Any]:
    """Return the keys of a case that choose a model by its name in `MODELS`."""
    plugin, given = MODELS[name]
    return {"contact.model": plugin} | {f"contact.{plugin}.{key}": value for key, value in given.items()}


def people_in(bounds: Bounds, position: ArrayLike, velocity: ArrayLike = 0.0, **settings: Any) -> Scene:
    """Return people in a room without exits who head along x; further arguments as for `make_crowd`."""
    return Scene(bounds, room(bounds), one_direction(bounds), make_crowd(position, velocity, **settings))


def towards(bounds: Bounds, point: tuple[float, float], spacing: float = 0.25) -> Fields:
    """Return directions that converge on a point; the travel time is the distance to it [m]."""
    x1, y1, x2, y2 = bounds
    across = int(np.ceil((x2 - x1) / spacing)) + 2
    along = int(np.ceil((y2 - y1) / spacing)) + 2
    x, y = np.meshgrid(x1 + spacing * np.arange(across), y1 + spacing * np.arange(along), indexing="ij")
    away = np.stack([x - point[0], y - point[1]], axis=2).reshape(-1, 2)
    distance = np.hypot(away[:, 0], away[:, 1])
    direction = -away / np.maximum(distance, 1e-9)[:, None]
    return fields_of((x1, y1), (across, along), spacing, direction, distance)


def packed(number: int, rows: int, radius: float, right: float, bottom: float, gap: float = 0.0) -> FloatArray:
    """Return places (n, 2) in a triangular packing of `rows` rows against the walls x = right and y = bottom.

    Neighbours are `gap` [m] apart; odd columns are shifted up by half a body.
    """
    spacing = 2.0 * radius + gap
    column, row = np.divmod(np.arange(number), rows)
    x = right - radius - column * spacing * np.sqrt(0.75)
    y = bottom + radius + (row + 0.5 * (column % 2)) * spacing
    return np.column_stack([x, y])


def scattered(number: int, bounds: Bounds, radius: ArrayLike, generator: np.random.Generator) -> FloatArray:
    """Return places (n, 2) in `bounds`, drawn one after another so that nobody overlaps; give large radii first."""
    radii = np.broadcast_to(np.asarray(radius, dtype=float), (number,))
    places = np.empty((number, 2))
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    for k in range(number):
        for _ in range(10_000):
            places[k] = generator.uniform(low + radii[k], high - radii[k])
            away = places[:k] - places[k]
            if np.all(np.hypot(away[:, 0], away[:, 1]) > radii[:k] + radii[k]):
                break
        else:
            raise ValueError(f"no room for body {k} of {number} in {bounds}")
    return places
