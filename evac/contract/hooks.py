"""Every hook that a plugin may implement, the kinds of plugin classes, and the built-in ones that are the default."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pluggy

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.contract.registry import Registry
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation

#: Version of the plugin interface. A plugin's module states the one that it was written for as ``evac_interface``;
#: docs/changelog.md lists what changed in each.
INTERFACE = 3

#: The behaviour with which people keep distances in the cases that evac writes, and which the output of a run names.
DEFAULT_MOVEMENT = "walking"

#: What its key ``preset`` means: the basis of how people walk.
BASES = {
    "measured": "people walk as in experiments, with the flows measured there",
    "regulation": "people walk without anticipation, with the flows through doors that standard tests prescribe",
}

DEFAULT_FIRE = "fds"  #: The source of conditions for which `evac conditions deck` prints lines.
DEFAULT_DISPATCHER = "top_down"  #: The dispatcher of lifts of a case that names none.

#: Solvers of the contact problem: that of models, and that of solves in which another solver fails.
DEFAULT_SOLVER, DEFAULT_STRONGER_SOLVER = "accelerated_sweeps", "conjugate_faces"

hookspec = pluggy.HookspecMarker("evac")
hookimpl = pluggy.HookimplMarker("evac")


class PluginKind(NamedTuple):
    """A kind of plugin classes."""

    module: str  # of its base class
    base: str  # name of its base class, which `evac` exports
    files: str  # with what the names of built-in modules begin
    classes: str  # what its hook returns


#: Kinds of plugin classes. Those of KIND are returned by the hook evac_KINDs.
PLUGIN_KINDS = {
    "contact_model": PluginKind("evac.physics.contact.model", "ContactModel", "contact_", "contact model classes"),
    "solver": PluginKind("evac.physics.contact.rows", "Solver", "solver_", "classes of solvers of the contact problem"),
    "force": PluginKind("evac.physics.force", "Force", "force_", "force classes"),
    "behaviour": PluginKind("evac.people.behaviour", "Behaviour", "behaviour_", "behaviour classes"),
    "recorder": PluginKind("evac.trajectory.recorder", "Recorder", "recorder_", "recorder classes"),
    "importer": PluginKind(
        "evac.building.importer", "Importer", "import_", "importer classes, which read files of buildings"
    ),
    "exporter": PluginKind(
        "evac.export.exporter",
        "Exporter",
        "export_",
        "exporter classes, which write recorded runs in formats of other programs",
    ),
    "condition_source": PluginKind(
        "evac.conditions.source", "ConditionSource", "conditions_", "classes of sources of smoke, gases and heat"
    ),
    "smoke_law": PluginKind("evac.conditions.law", "SmokeLaw", "smoke_", "classes of laws of the speed in smoke"),
    "dispatcher": PluginKind("evac.people.dispatcher", "Dispatcher", "dispatch_", "classes of dispatchers of lifts"),
}


def _hook(name: str, kind: PluginKind) -> Callable[[], Any]:
    """Return the hook that collects the classes of a kind."""

    def collect() -> None: ...

    collect.__name__ = collect.__qualname__ = name
    collect.__doc__ = f"Return {kind.classes}."
    collect.__annotations__["return"] = f"Sequence[type[{kind.base}]]"
    return hookspec(collect)


for _name, _kind in PLUGIN_KINDS.items():
    globals()[f"evac_{_name}s"] = _hook(f"evac_{_name}s", _kind)


@hookspec
def evac_building_cases() -> Sequence[Path]:  # type: ignore[empty-body]
    """Return folders that hold a case.toml; the folder's name is the case's name."""


@hookspec
def evac_configure(case: "Case", registry: "Registry") -> None:
    """Inspect a checked case before anything is built from it; raise an error to reject it."""


@hookspec
def evac_prepare(simulation: "Simulation") -> None:
    """Act once on a simulation before its first step."""


@hookspec
def evac_finish(simulation: "Simulation", results: "Results | None", error: BaseException | None) -> None:
    """Act once after a run, however it ended."""


@hookspec
def evac_metrics(results: "Results") -> Mapping[str, Any]:  # type: ignore[empty-body]
    """Return values to add to summary.json under the plugin's name."""
