"""Conformance checks for plugins, which plugin authors call in their own tests.

A failed check raises `PluginError`, which names the plugin, the check and the scene, and says what is wrong, by how
much, and what to change. The same checks are applied to all built-in plugins.
"""

import sys
from collections.abc import Callable
from typing import Any

from evac.base.parameters import Configurable, Parameter
from evac.building.importer import Importer
from evac.case.case import Case
from evac.case.loading import load_case
from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from evac.conformance import cases, physics
from evac.conformance.failures import CheckError, examining, require, run_check
from evac.contract.registry import Registry
from evac.contract.requirements import HOOKS, check_class, check_interface, kind_of
from evac.export.exporter import Exporter
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.rows import Solver
from evac.physics.force import Force
from evac.trajectory.recorder import Recorder

__all__ = ["check_plugin"]

#: Checks of a plugin by itself, and of one that a case uses for a number of ticks, by base class.
ALONE: tuple[tuple[type, Callable[..., None]], ...] = (
    (PairContact, physics.check_pair_law),
    (Solver, physics.check_solver),
    (Force, physics.check_force),
    (SmokeLaw, cases.check_speeds),
    (Importer, cases.check_damaged_files),
)
IN_A_CASE: tuple[tuple[type, Callable[..., None]], ...] = (
    (Importer, cases.check_surface),
    (Exporter, cases.check_exports),
    (ConditionSource, cases.check_source),
    (Behaviour, cases.check_declared_arrays),
    (Behaviour, cases.check_distance),
    (Recorder, cases.check_recorder),
    (Configurable, cases.check_same_bits),
)


def check_plugin(cls: type[Configurable], case: Case | None = None, ticks: int = 20, **values: Any) -> None:
    """Run all checks that apply to a plugin class."""
    run_check(cls, check_contract, cls)
    run_check(cls, check_construction, cls, values)
    for kind, check in ALONE:
        if issubclass(cls, kind):
            run_check(cls, check, cls(**values))
    pace = physics.PLAIN
    if issubclass(cls, ContactModel):
        pace = run_check(cls, physics.check_pace, cls(**values))
        for check in physics.CHECKS:
            run_check(cls, check, cls(**values), pace)
    if case is None and (issubclass(cls, Importer) or pace != physics.PLAIN):
        return  # no shipped case has such files, or such soft or stiff contacts
    case = case or run_check(cls, check_registration, cls, values)
    for kind, check in IN_A_CASE:
        if issubclass(cls, kind):
            run_check(cls, check, cls(**values), case, ticks)


def check_contract(cls: Any) -> None:
    """Check the interface version, the base class, the name and the docstring."""
    if not isinstance(cls, type):
        raise CheckError(f"{cls!r} is not a class; pass a class, such as {type(cls).__name__}")
    module = sys.modules.get(cls.__module__)
    if module is not None and any(hasattr(module, name) for name in ("evac_interface", *HOOKS)):
        with examining(f"the module {cls.__module__}"):
            check_interface(module, cls.__module__)
    check_class(cls, cls.__module__)
    failure = f"{cls.__name__} has no docstring; add one, `evac plugins` shows its first line"
    require(bool((cls.__doc__ or "").strip()), failure)


def check_construction(cls: type[Configurable], values: dict[str, Any]) -> None:
    """Check that a plugin can be made with its defaults and with given parameters, which are described."""
    for key, parameter in cls.declared().items():
        with examining(f"the parameter {key}", "change its default or its range"):
            require(bool(parameter.doc.strip()), "it has no description; add doc to its declaration")
            parameter.check(f"{cls.name}.{key}", parameter.default)
    with examining("the class with its defaults"):
        is_set = not any(isinstance(value, Parameter) for value in cls().values().values())
        require(is_set, "__init__ does not set the parameters; call super().__init__(**values) first")
    given = ", ".join(f"{key} = {value!r}" for key, value in values.items())
    with examining(f"the class with {given}", "give other values, or correct the plugin"):
        cls(**values)


def check_registration(cls: type[Configurable], values: dict[str, Any]) -> Case:
    """Check that a plugin can be registered; return a shipped case, changed to use the plugin."""
    registry = Registry()
    registry.add_class(cls)
    kind, solved = kind_of(cls), physics.SOLVED.name
    smoke = {"source": "prescribed", "values": {"extinction": 1.0}}
    using: dict[str, dict[str, Any]] = {
        "contact_model": {"contact.model": cls.name, f"contact.{cls.name}": values},
        "solver": {"contact.model": solved, f"contact.{solved}.solver": cls.name},
        "smoke_law": {"smoke.law": cls.name, f"smoke.{cls.name}": values, "conditions": [smoke]},
        "condition_source": {"smoke.law": "none", "conditions": [{"source": cls.name, **values}]},
        "exporter": {},
    }
    return load_case("square_room", using.get(kind, {f"{kind}s.{cls.name}": values}), registry=registry)
