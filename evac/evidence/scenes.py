"""People and directions of the scenes of the evidence, and the contact models that it compares, by their names."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from evac.base.arrays import FloatArray
from evac.conformance.scenes import Bounds, Scene, fields_of, one_direction, plugins, room
from evac.directions.fields import Fields
from evac.physics.contact.model import ContactModel
from evac.physics.state import make_crowd

#: Plugin and parameters of each model; other parameters have the plugin's defaults.
MODELS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "DEM": ("dem", {"stiffness": 1.2e5}),
    "NSM1 inertial": ("nsm1", {"variant": "inertial"}),
    "NSM1 overdamped": ("nsm1", {"variant": "overdamped"}),
    "NSM2": ("nsm2", {"normal_dissipation": 1e5, "tangential_dissipation": 0.0}),
}

#: Tolerance of NSM1 while a crowd walks to the state that is measured; its last steps use the defaults.
COARSE = {"gap_tolerance": 1e-3, "velocity_tolerance": 0.02}


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
