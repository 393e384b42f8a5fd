"""Conformance checks for plugins, which plugin authors call in their own tests.

A failed check raises `PluginError`, which names the plugin, the check and the scene, and says what is wrong, by how
much, and what to change. The same checks are applied to all built-in plugins.
"""

from collections.abc import Callable
from typing import Any

from evac.base.parameters import Configurable
from evac.building.importer import Importer
from evac.case.case import Case
from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from evac.conformance import cases, classes, contact_models, files, laws, solvers
from evac.conformance.failures import run_check
from evac.export.exporter import Exporter
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.solver import Solver
from evac.physics.force import Force
from evac.trajectory.recorder import Recorder

__all__ = ["check_plugin"]

#: Checks of a plugin by itself, and of one that a case uses for a number of ticks, by base class.
ALONE: tuple[tuple[type, Callable[..., None]], ...] = (
    (PairContact, contact_models.check_pair_law),
    (Solver, solvers.check_solver),
    (Force, laws.check_force),
    (SmokeLaw, laws.check_speeds),
    (Importer, files.check_damaged_files),
)
IN_A_CASE: tuple[tuple[type, Callable[..., None]], ...] = (
    (Importer, files.check_surface),
    (Exporter, files.check_exports),
    (ConditionSource, cases.check_source),
    (Behaviour, cases.check_declared_arrays),
    (Behaviour, cases.check_distance),
    (Recorder, cases.check_recorder),
    (Configurable, cases.check_same_bits),
)


def check_plugin(cls: type[Configurable], case: Case | None = None, ticks: int = 20, **values: Any) -> None:
    """Run all checks that apply to a plugin class."""
    check: Callable[..., None]
    for check in classes.CHECKS:
        run_check(cls, check, cls, values)
    for kind, check in ALONE:
        if issubclass(cls, kind):
            run_check(cls, check, cls(**values))
    pace = contact_models.PLAIN
    if issubclass(cls, ContactModel):
        pace = run_check(cls, contact_models.check_pace, cls(**values))
        for check in contact_models.CHECKS:
            run_check(cls, check, cls(**values), pace)
    if case is None and issubclass(cls, Importer):
        return
    case = case or run_check(cls, classes.check_registration, cls, values, pace)
    for kind, check in IN_A_CASE:
        if issubclass(cls, kind):
            run_check(cls, check, cls(**values), case, ticks)
