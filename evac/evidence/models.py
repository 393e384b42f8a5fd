"""The contact models compared by the evidence, by their names in tables and plots."""

from collections.abc import Mapping
from functools import cache
from typing import Any, cast

from evac.contract.registry import Registry
from evac.physics.contact.model import ContactModel
from evac.physics.engine import CompiledEngine
from evac.physics.state import World

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


def make_model(name: str, **parameters: Any) -> ContactModel:
    """Return a contact model by its name in `MODELS`, with additional or changed parameters."""
    plugin, given = MODELS[name]
    model = plugins().get("contact_model", plugin)(**{**given, **parameters})
    return cast(ContactModel, model)


def model_overrides(name: str) -> dict[str, Any]:
    """Return the keys of a case that choose a model by its name in `MODELS`."""
    plugin, given = MODELS[name]
    return {"contact.model": plugin} | {f"contact.{plugin}.{key}": value for key, value in given.items()}
