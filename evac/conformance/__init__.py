"""Conformance checks for plugins, which plugin authors call in their own tests.

::

    from evac.conformance import check_plugin

    def test_my_model():
        check_plugin(MyModel)                       # contact model, solver, force, recorder, exporter
        check_plugin(MyBehaviour, case)             # a behaviour, with a case in which it has an effect
        check_plugin(MyImporter, case)              # an importer, with a case whose building it reads

A failed check raises `PluginError`, which names the plugin, the check and the scene, and says what is wrong, by how
much, and what to change. The same checks are applied to all built-in plugins.
"""

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from evac.base.errors import ConformanceWarning
from evac.base.parameters import Configurable
from evac.building.importer import Importer
from evac.case.case import Case
from evac.case.loading import load_case
from evac.conformance.behaviours import check_declared_arrays, check_distance
from evac.conformance.cases import check_read_only, check_resume, check_same_bits
from evac.conformance.classes import (
    SHIPPED_CASE,
    check_construction,
    check_contract,
    check_parameters,
    check_registration,
)
from evac.conformance.contact_models import CONTACT_MODEL_CHECKS, check_pair_law
from evac.conformance.exporters import EXPORTER_CHECKS, check_case
from evac.conformance.failures import run_check
from evac.conformance.forces import FORCE_CHECKS
from evac.conformance.importers import check_damaged_files, check_surface
from evac.conformance.scenes import PLAIN, check_pace
from evac.conformance.solvers import SOLVER_CHECKS
from evac.export.exporter import Exporter
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.solver import Solver
from evac.physics.force import Force
from evac.trajectory.recorder import Recorder

__all__ = ["check_plugin"]


def check_plugin(cls: type[Configurable], case: Case | None = None, ticks: int = 20, **values: Any) -> None:
    """Run all checks that apply to a plugin class.

    Parameters
    ----------
    cls : type
        A `ContactModel`, `Solver`, `Force`, `Behaviour`, `Recorder`, `Importer` or `Exporter`.
    case : Case, optional
        Case that already uses the plugin; by default the shipped square room, changed to use the plugin. Without a
        case, an importer is checked with damaged files only.
    ticks : int
        Number of ticks of the case that are run.
    **values
        Parameters of the plugin, if no case is given.

    Raises
    ------
    PluginError
        A check failed; the first failure is reported. An exception that the plugin raised is its cause.
    """

    def run(check: Any, *arguments: Any) -> Any:
        return run_check(cls, check, *arguments)

    run(check_contract, cls)
    run(check_parameters, cls)
    run(check_construction, cls, values)
    pace = PLAIN
    if issubclass(cls, ContactModel):
        if issubclass(cls, PairContact):
            run(check_pair_law, cls(**values))
        pace = run(check_pace, cls(**values))
        for check in CONTACT_MODEL_CHECKS:
            run(check, cls(**values), pace)
    elif issubclass(cls, Solver):
        for check_solver in SOLVER_CHECKS:
            run(check_solver, cls)
    elif issubclass(cls, Force):
        for check_force in FORCE_CHECKS:
            run(check_force, cls(**values))
    elif issubclass(cls, Exporter):
        with TemporaryDirectory() as folder:
            trajectory = run(check_case, case or load_case(SHIPPED_CASE), ticks, Path(folder))
            for check_exporter in EXPORTER_CHECKS:
                run(check_exporter, cls(**values), trajectory)
        return
    elif issubclass(cls, Importer):
        run(check_damaged_files, cls(**values))
        if case is None:
            return
        run(check_surface, case, cls.name)
    if case is None:
        case = run(check_registration, cls, values, pace)
    if issubclass(cls, Behaviour) and (missing := run(check_declared_arrays, case, cls.name, ticks)):
        advice = f"give a case that executes them: check_plugin({cls.__name__}, case)"
        warnings.warn(f"{cls.name}: check_declared_arrays, {missing}; {advice}", ConformanceWarning, stacklevel=2)
    if issubclass(cls, Behaviour) and cls.keeps_distance:
        run(check_distance, case, cls.name)
    if issubclass(cls, Recorder):
        run(check_read_only, cls(**values), case, ticks)
        run(check_resume, cls(**values), case, ticks)
    run(check_same_bits, case, ticks)
