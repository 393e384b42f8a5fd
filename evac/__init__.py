"""Evacuation of multi-floor buildings, person by person, with swappable contact models.

>>> import evac
>>> case = evac.load("classroom").change({"contact.model": "nsm1", "simulation.seed": 7})  # doctest: +SKIP
>>> results = evac.run(case, "classroom-result")  # doctest: +SKIP
>>> time, number_out = results.egress()  # doctest: +SKIP
>>> positions = evac.read_trajectory("classroom-result").position  # doctest: +SKIP
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evac.assembly import read_building as read_building
    from evac.behaviour import Behaviour as Behaviour
    from evac.behaviour import BehaviourScene as BehaviourScene
    from evac.building.findings import Finding as Finding
    from evac.building.importer import Importer as Importer
    from evac.building.model import Building as Building
    from evac.building.plan import Plan as Plan
    from evac.building.surfacemesh import SurfaceMesh as SurfaceMesh
    from evac.errors import BuildingError as BuildingError
    from evac.errors import EvacError as EvacError
    from evac.errors import EvacWarning as EvacWarning
    from evac.errors import PluginError as PluginError
    from evac.errors import ResultError as ResultError
    from evac.errors import RunWarning as RunWarning
    from evac.errors import ScenarioError as ScenarioError
    from evac.errors import SimulationError as SimulationError
    from evac.hookspecs import hookimpl as hookimpl
    from evac.importing import import_building as import_building
    from evac.output.exporter import Exporter as Exporter
    from evac.output.maps import LevelMaps as LevelMaps
    from evac.output.recorder import Recorder as Recorder
    from evac.output.results import Results as Results
    from evac.output.trajectory import Trajectory as Trajectory
    from evac.output.trajectory import read_trajectory as read_trajectory
    from evac.parameters import Parameter as Parameter
    from evac.phases import Progress as Progress
    from evac.physics.contact_model import ContactModel as ContactModel
    from evac.physics.force import Force as Force
    from evac.physics.pair_contact import PairContact as PairContact
    from evac.physics.solver import Solver as Solver
    from evac.registry import Registry as Registry
    from evac.running import resume as resume
    from evac.running import run as run
    from evac.scenario.case import Case as Case
    from evac.scenario.loading import load_case as load  # noqa: F401
    from evac.simulation import Simulation as Simulation
    from evac.study.asking import repeat as repeat
    from evac.study.asking import sweep as sweep
    from evac.study.reading import read_study as read_study
    from evac.study.study import Study as Study

#: Public names, and where each is imported from when it is first asked for: `import evac` alone costs nothing.
_HOMES = {
    "Behaviour": "evac.behaviour",
    "BehaviourScene": "evac.behaviour",
    "Building": "evac.building.model",
    "BuildingError": "evac.errors",
    "Case": "evac.scenario.case",
    "ContactModel": "evac.physics.contact_model",
    "EvacError": "evac.errors",
    "EvacWarning": "evac.errors",
    "Exporter": "evac.output.exporter",
    "Finding": "evac.building.findings",
    "Force": "evac.physics.force",
    "Importer": "evac.building.importer",
    "LevelMaps": "evac.output.maps",
    "PairContact": "evac.physics.pair_contact",
    "Parameter": "evac.parameters",
    "Plan": "evac.building.plan",
    "PluginError": "evac.errors",
    "Progress": "evac.phases",
    "Recorder": "evac.output.recorder",
    "Registry": "evac.registry",
    "ResultError": "evac.errors",
    "Results": "evac.output.results",
    "RunWarning": "evac.errors",
    "ScenarioError": "evac.errors",
    "Simulation": "evac.simulation",
    "SimulationError": "evac.errors",
    "Solver": "evac.physics.solver",
    "Study": "evac.study.study",
    "SurfaceMesh": "evac.building.surfacemesh",
    "Trajectory": "evac.output.trajectory",
    "hookimpl": "evac.hookspecs",
    "import_building": "evac.importing",
    "load": "evac.scenario.loading",
    "read_building": "evac.assembly",
    "read_study": "evac.study.reading",
    "read_trajectory": "evac.output.trajectory",
    "repeat": "evac.study.asking",
    "resume": "evac.running",
    "run": "evac.running",
    "sweep": "evac.study.asking",
}

__all__ = list(_HOMES)


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
