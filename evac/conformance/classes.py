"""Checks of a plugin class before it is used: the contract, the declared parameters, construction, registration."""

import sys
from typing import Any

from evac.base.parameters import Configurable, Parameter
from evac.case.case import Case
from evac.case.loading import load_case
from evac.conformance.failures import CheckError, examining
from evac.conformance.scenes import PLAIN, Pace
from evac.contract.registry import Registry
from evac.contract.requirements import HOOKS, check_class, check_interface
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel, SolvedContactModel
from evac.physics.contact.solver import Solver
from evac.physics.force import Force

#: Shipped case for checks of a plugin for which no case is given.
SHIPPED_CASE = "square_room"


def check_contract(cls: Any) -> None:
    """Check the interface version, the base class, the name and the docstring."""
    if not isinstance(cls, type):
        raise CheckError(f"{cls!r} is not a class", f"pass a class, such as {type(cls).__name__}")
    module = sys.modules.get(cls.__module__)
    if module is not None and any(hasattr(module, one) for one in ("evac_interface", *HOOKS)):
        with examining(f"the module {cls.__module__}"):
            check_interface(module, cls.__module__)
    check_class(cls, cls.__module__)
    if not (cls.__doc__ or "").strip():
        raise CheckError(f"{cls.__name__} has no docstring", "add one, `evac plugins` shows its first line")


def check_parameters(cls: type[Configurable]) -> None:
    """Check that all parameters are described, and the defaults of distributions."""
    for key, parameter in cls.declared().items():
        with examining(f"the parameter {key}", "change its default or its range"):
            if not parameter.doc.strip():
                raise CheckError("it has no description", "add doc to its declaration")
            parameter.check(f"{cls.name}.{key}", parameter.default)


def check_construction(cls: type[Configurable], values: dict[str, Any]) -> None:
    """Check that a plugin can be made with its defaults and with given parameters, which it keeps."""
    with examining("the class with its defaults"):
        made = cls()
        if any(isinstance(value, Parameter) for value in made.values().values()):
            raise CheckError("__init__ does not set the parameters", "call super().__init__(**values) first")
    if values:
        given = ", ".join(f"{key} = {value!r}" for key, value in values.items())
        with examining(f"the class with {given}", "give other values, or correct the plugin"):
            cls(**values)


def check_registration(cls: type[Configurable], values: dict[str, Any], pace: Pace = PLAIN) -> Case:
    """Check that a plugin can be registered; return the shipped case at a pace, changed to use the plugin."""
    registry = Registry()
    registry.add_class(cls)
    changes: dict[str, Any]
    if issubclass(cls, ContactModel):
        changes = {"contact.model": cls.name, f"contact.{cls.name}": values}
        if pace != PLAIN:
            changes |= _slower(pace)
    elif issubclass(cls, Solver):
        models = registry.contact_models.items()
        solved = next(name for name, model in models if issubclass(model, SolvedContactModel))
        changes = {"contact.model": solved, f"contact.{solved}.solver": cls.name}
    elif issubclass(cls, Force):
        changes = {f"forces.{cls.name}": values}
    elif issubclass(cls, Behaviour):
        changes = {f"behaviours.{cls.name}": values}
    else:
        changes = {f"recorders.{cls.name}": values}
    return load_case(SHIPPED_CASE, changes, registry=registry)


def _slower(pace: Pace) -> dict[str, Any]:
    """Return the changes of the shipped case for a pace, at which all times are longer by a factor."""
    return {
        "simulation.step": pace.step,
        "simulation.tick": 0.1 * pace.slow,
        "simulation.duration": 60.0 * pace.slow,
        "output.every": 0.5 * pace.slow,
        "people.people.speed": {"uniform": [1.5 / pace.slow, 2.0 / pace.slow]},
        "people.people.tau": {"uniform": [0.1 * pace.slow, 0.5 * pace.slow]},
    }
