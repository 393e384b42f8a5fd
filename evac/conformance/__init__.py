"""Conformance checks for plugins, which plugin authors call in their own tests.

A failed check raises `PluginError`, which names the plugin, the check and the scene, and says what is wrong, by how
much, and what to change. The same checks are applied to all built-in plugins.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from evac.base.parameters import Configurable
from evac.building.importer import Importer
from evac.case.case import Case
from evac.case.loading import load_case
from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from evac.conformance import air, behaviours, cases, classes, contact_models, files, forces, solvers
from evac.conformance.failures import run_check
from evac.conformance.scenes import PLAIN
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
        A `ContactModel`, `Solver`, `Force`, `Behaviour`, `Recorder`, `Importer`, `Exporter`,
        `SmokeLaw` or `ConditionSource`.
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

    run(classes.check_contract, cls)
    run(classes.check_parameters, cls)
    run(classes.check_construction, cls, values)
    pace = PLAIN
    check: Any
    if issubclass(cls, ContactModel):
        if issubclass(cls, PairContact):
            run(contact_models.check_pair_law, cls(**values))
        pace = run(contact_models.check_pace, cls(**values))
        for check in contact_models.CHECKS:
            run(check, cls(**values), pace)
    elif issubclass(cls, Solver):
        for check in solvers.CHECKS:
            run(check, cls)
    elif issubclass(cls, Force):
        for check in forces.CHECKS:
            run(check, cls(**values))
    elif issubclass(cls, Exporter):
        with TemporaryDirectory() as folder:
            trajectory = run(files.check_case, case or load_case(classes.SHIPPED_CASE), ticks, Path(folder))
            run(files.check_files, cls(**values), trajectory)
            run(files.check_without_frames, cls(**values), trajectory)
        return
    elif issubclass(cls, Importer):
        run(files.check_damaged_files, cls(**values))
        if case is None:
            return
        run(files.check_surface, case, cls.name)
    elif issubclass(cls, SmokeLaw):
        for check in air.LAW_CHECKS:
            run(check, cls(**values))
    if case is None:
        case = run(classes.check_registration, cls, values, pace)
    if issubclass(cls, ConditionSource):
        run(air.check_source, case)
    if issubclass(cls, Behaviour):
        run(behaviours.check_declared_arrays, case, cls.name, ticks)
        if cls.keeps_distance:
            run(behaviours.check_distance, case, cls.name)
    if issubclass(cls, Recorder):
        run(cases.check_recorder, cls(**values), case)
    run(cases.check_same_bits, case, ticks)
