"""The whole plugin contract: every hook that a plugin may implement, and nothing else."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from evac.building.importer import Importer
    from evac.case.case import Case
    from evac.conditions.law import SmokeLaw
    from evac.conditions.source import ConditionSource
    from evac.contract.registry import Registry
    from evac.export.exporter import Exporter
    from evac.people.behaviour import Behaviour
    from evac.physics.contact.model import ContactModel
    from evac.physics.contact.solver import Solver
    from evac.physics.force import Force
    from evac.results.results import Results
    from evac.simulation.simulation import Simulation
    from evac.trajectory.recorder import Recorder

#: Version of the plugin interface. A plugin's module states the one that it was written for as ``evac_interface``;
#: docs/plugins_versions.md lists what changed in each.
INTERFACE = 3

hookspec = pluggy.HookspecMarker("evac")
hookimpl = pluggy.HookimplMarker("evac")


@hookspec
def evac_contact_models() -> "Sequence[type[ContactModel]]":  # type: ignore[empty-body]
    """Return contact model classes."""


@hookspec
def evac_solvers() -> "Sequence[type[Solver]]":  # type: ignore[empty-body]
    """Return classes of solvers of the contact problem."""


@hookspec
def evac_forces() -> "Sequence[type[Force]]":  # type: ignore[empty-body]
    """Return force classes."""


@hookspec
def evac_behaviours() -> "Sequence[type[Behaviour]]":  # type: ignore[empty-body]
    """Return behaviour classes."""


@hookspec
def evac_recorders() -> "Sequence[type[Recorder]]":  # type: ignore[empty-body]
    """Return recorder classes."""


@hookspec
def evac_importers() -> "Sequence[type[Importer]]":  # type: ignore[empty-body]
    """Return importer classes, which read files of buildings."""


@hookspec
def evac_exporters() -> "Sequence[type[Exporter]]":  # type: ignore[empty-body]
    """Return exporter classes, which write recorded runs in formats of other programs."""


@hookspec
def evac_condition_sources() -> "Sequence[type[ConditionSource]]":  # type: ignore[empty-body]
    """Return classes of sources of smoke, gases and heat."""


@hookspec
def evac_smoke_laws() -> "Sequence[type[SmokeLaw]]":  # type: ignore[empty-body]
    """Return classes of laws of the speed in smoke."""


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
