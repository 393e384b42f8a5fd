"""Evacuation of multi-floor buildings, person by person, with swappable contact models.

>>> import evac
>>> case = evac.load("classroom").change({"simulation.duration": 60.0, "simulation.seed": 7})  # doctest: +SKIP
>>> results = evac.run(case, "classroom-result")  # doctest: +SKIP
>>> time, number_out = results.egress()  # doctest: +SKIP
>>> positions = evac.read_trajectory("classroom-result").position  # doctest: +SKIP
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evac.analysis.maps import LevelMaps as LevelMaps
    from evac.base.change import Change as Change
    from evac.base.errors import BuildingError as BuildingError
    from evac.base.errors import EvacError as EvacError
    from evac.base.errors import EvacWarning as EvacWarning
    from evac.base.errors import PluginError as PluginError
    from evac.base.errors import ResultError as ResultError
    from evac.base.errors import RunWarning as RunWarning
    from evac.base.errors import ScenarioError as ScenarioError
    from evac.base.errors import SimulationError as SimulationError
    from evac.base.parameters import Parameter as Parameter
    from evac.base.progress import Progress as Progress
    from evac.building.importer import Importer as Importer
    from evac.building.model.building import Building as Building
    from evac.building.model.findings import Finding as Finding
    from evac.building.plan.plan import Plan as Plan
    from evac.building.surface.surfacemesh import SurfaceMesh as SurfaceMesh
    from evac.case.case import Case as Case
    from evac.case.loading import load_case
    from evac.conditions.law import SmokeLaw as SmokeLaw
    from evac.conditions.source import ConditionSource as ConditionSource
    from evac.contract.hooks import hookimpl as hookimpl
    from evac.contract.registry import Registry as Registry
    from evac.directions.routes import Route as Route
    from evac.editor import edit as edit
    from evac.export.exporter import Exporter as Exporter
    from evac.importing import import_building as import_building
    from evac.people.behaviour import Behaviour as Behaviour
    from evac.people.behaviour import BehaviourScene as BehaviourScene
    from evac.people.dispatcher import Dispatcher as Dispatcher
    from evac.physics.contact.model import ContactModel as ContactModel
    from evac.physics.contact.pair_contact import PairContact as PairContact
    from evac.physics.contact.rows import Solver as Solver
    from evac.physics.force import Force as Force
    from evac.report.comparison import Comparison as Comparison
    from evac.report.comparison import compare as compare
    from evac.results.ending import Stopped as Stopped
    from evac.results.reading import read_results as read_results
    from evac.results.results import Results as Results
    from evac.simulation.assembly import read_building as read_building
    from evac.simulation.running import resume as resume
    from evac.simulation.running import run as run
    from evac.simulation.simulation import Simulation as Simulation
    from evac.study.api import repeat as repeat
    from evac.study.api import sweep as sweep
    from evac.study.study import Study as Study
    from evac.study.study import read_study as read_study
    from evac.trajectory.recorder import Recorder as Recorder
    from evac.trajectory.trajectory import Trajectory as Trajectory
    from evac.trajectory.trajectory import read_trajectory as read_trajectory

    load, __version__ = load_case, ""

#: Public names, and where each is imported from when it is first asked for: `import evac` alone costs nothing.
_HOMES = {
    name: home
    for home, names in {
        "evac.analysis.maps": "LevelMaps",
        "evac.base.change": "Change",
        "evac.base.errors": "BuildingError EvacError EvacWarning PluginError ResultError RunWarning ScenarioError "
        "SimulationError",
        "evac.base.parameters": "Parameter",
        "evac.base.progress": "Progress",
        "evac.building.importer": "Importer",
        "evac.building.model.building": "Building",
        "evac.building.model.findings": "Finding",
        "evac.building.plan.plan": "Plan",
        "evac.building.surface.surfacemesh": "SurfaceMesh",
        "evac.case.case": "Case",
        "evac.case.loading": "load",
        "evac.conditions.law": "SmokeLaw",
        "evac.conditions.source": "ConditionSource",
        "evac.contract.hooks": "hookimpl",
        "evac.contract.registry": "Registry",
        "evac.directions.routes": "Route",
        "evac.editor": "edit",
        "evac.export.exporter": "Exporter",
        "evac.importing": "import_building",
        "evac.people.behaviour": "Behaviour BehaviourScene",
        "evac.people.dispatcher": "Dispatcher",
        "evac.physics.contact.model": "ContactModel",
        "evac.physics.contact.pair_contact": "PairContact",
        "evac.physics.contact.rows": "Solver",
        "evac.physics.force": "Force",
        "evac.report.comparison": "Comparison compare",
        "evac.results.ending": "Stopped",
        "evac.results.reading": "read_results",
        "evac.results.results": "Results",
        "evac.simulation.assembly": "read_building",
        "evac.simulation.running": "resume run",
        "evac.simulation.simulation": "Simulation",
        "evac.study.api": "repeat sweep",
        "evac.study.study": "Study read_study",
        "evac.trajectory.recorder": "Recorder",
        "evac.trajectory.trajectory": "Trajectory read_trajectory",
    }.items()
    for name in names.split()
}

__all__ = list(_HOMES)


if not TYPE_CHECKING:  # to type checkers, unknown names would be of any type

    def __getattr__(name: str) -> Any:
        """Import a public name when it is first asked for."""
        if name == "__version__":
            return importlib.import_module("importlib.metadata").version("evac")
        if name not in _HOMES:
            raise AttributeError(f"module 'evac' has no attribute {name!r}")
        value = getattr(importlib.import_module(_HOMES[name]), "load_case" if name == "load" else name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
