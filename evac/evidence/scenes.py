"""Small scenes without mesh files: walled rooms with people and directions; and the contact models compared."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from evac.base.arrays import FloatArray
from evac.building.model.building import Building
from evac.contract.registry import Registry
from evac.directions.fields import Fields
from evac.physics.contact.model import BorderScene, ContactModel, border_scene
from evac.physics.engine import CompiledEngine
from evac.physics.scenes import Bounds, one_direction, room
from evac.physics.state import Crowd, World, copy_of, make_crowd
from evac.physics.world import make_world, set_open

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
