"""Checks of a plugin class before it is used: the contract, the declared parameters, construction, registration."""

import sys
from typing import Any

from evac.base.parameters import Configurable, Parameter
from evac.case.case import Case
from evac.case.loading import load_case
from evac.conformance.contact_models import PLAIN, Pace
from evac.conformance.failures import CheckError, examining, require
from evac.conformance.solvers import solved_model
from evac.contract.registry import Registry
from evac.contract.requirements import HOOKS, check_class, check_interface, kind_of

#: Shipped case for checks of a plugin for which no case is given.
SHIPPED_CASE = "square_room"


def check_contract(cls: Any, values: dict[str, Any]) -> None:
    """Check the interface version, the base class, the name and the docstring."""
    if not isinstance(cls, type):
        raise CheckError(f"{cls!r} is not a class; pass a class, such as {type(cls).__name__}")
    module = sys.modules.get(cls.__module__)
    if module is not None and any(hasattr(module, name) for name in ("evac_interface", *HOOKS)):
        with examining(f"the module {cls.__module__}"):
            check_interface(module, cls.__module__)
    check_class(cls, cls.__module__)
    told = f"{cls.__name__} has no docstring; add one, `evac plugins` shows its first line"
    require(bool((cls.__doc__ or "").strip()), told)


def check_parameters(cls: type[Configurable], values: dict[str, Any]) -> None:
    """Check that all parameters are described, and the defaults of distributions."""
    for key, parameter in cls.declared().items():
        with examining(f"the parameter {key}", "change its default or its range"):
            require(bool(parameter.doc.strip()), "it has no description; add doc to its declaration")
            parameter.check(f"{cls.name}.{key}", parameter.default)


def check_construction(cls: type[Configurable], values: dict[str, Any]) -> None:
    """Check that a plugin can be made with its defaults and with given parameters, which it keeps."""
    with examining("the class with its defaults"):
        is_set = not any(isinstance(value, Parameter) for value in cls().values().values())
        require(is_set, "__init__ does not set the parameters; call super().__init__(**values) first")
    given = ", ".join(f"{key} = {value!r}" for key, value in values.items())
    with examining(f"the class with {given}", "give other values, or correct the plugin"):
        cls(**values)


def check_registration(cls: type[Configurable], values: dict[str, Any], pace: Pace) -> Case:
    """Check that a plugin can be registered; return the shipped case at a pace, changed to use the plugin."""
    registry = Registry()
    registry.add_class(cls)
    kind, solved = kind_of(cls), solved_model().name
    smoke = {"source": "prescribed", "values": {"extinction": 1.0}}
    using: dict[str, dict[str, Any]] = {
        "contact_model": {"contact.model": cls.name, f"contact.{cls.name}": values},
        "solver": {"contact.model": solved, f"contact.{solved}.solver": cls.name},
        "smoke_law": {"smoke.law": cls.name, f"smoke.{cls.name}": values, "conditions": [smoke]},
        "condition_source": {"smoke.law": "none", "conditions": [{"source": cls.name, **values}]},
        "exporter": {},
    }
    changes = using.get(kind, {f"{kind}s.{cls.name}": values})
    if pace != PLAIN:
        changes |= {
            "simulation.step": pace.step,
            "simulation.tick": 0.1 * pace.slow,
            "simulation.duration": 60.0 * pace.slow,
            "output.every": 0.5 * pace.slow,
            "people.people.speed": {"uniform": [1.5 / pace.slow, 2.0 / pace.slow]},
            "people.people.tau": {"uniform": [0.1 * pace.slow, 0.5 * pace.slow]},
        }
    return load_case(SHIPPED_CASE, changes, registry=registry)


CHECKS = (check_contract, check_parameters, check_construction)
