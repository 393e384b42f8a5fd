"""Conformance checks for plugins, which plugin authors call in their own tests.

::

    from evac.conformance import check_plugin

    def test_my_model():
        check_plugin(MyModel)                       # contact model, solver, force, recorder, exporter
        check_plugin(MyBehaviour, case)             # a behaviour, with a case in which it has an effect
        check_plugin(MyImporter, case)              # an importer, with a case whose building it reads

A failed check raises `PluginError`, which says what is wrong, by how much, and what to change. The same checks
are applied to all built-in plugins.
"""

import sys
from typing import Any

from evac.behaviour import Behaviour, check_writes
from evac.building.importer import Importer
from evac.conformance.cases import check_declared_arrays, check_read_only, check_resume, check_same_bits
from evac.conformance.contact_models import CONTACT_MODEL_CHECKS
from evac.conformance.exporters import EXPORTER_CHECKS, recorded
from evac.conformance.forces import check_pair_force
from evac.conformance.importers import check_damaged_files, check_surface
from evac.conformance.solvers import SOLVER_CHECKS
from evac.contract import check_class, check_interface
from evac.errors import PluginError, plugin_code
from evac.output.exporter import Exporter
from evac.output.recorder import Recorder
from evac.parameters import Configurable, Parameter
from evac.physics.contact_model import ContactModel
from evac.physics.force import Force
from evac.physics.solver import Solver
from evac.physics.state import Crowd
from evac.registry import KINDS, Registry
from evac.scenario.case import Case
from evac.scenario.loading import load_case

__all__ = ["check_plugin"]

#: Shipped case for checks of a plugin for which no case is given.
SHIPPED_CASE = "square_room"


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
        A check failed; the first failure is reported.
    """
    with plugin_code(cls.__name__):
        check_metadata(cls)
        if issubclass(cls, ContactModel):
            for check in CONTACT_MODEL_CHECKS:
                check(cls(**values))
        elif issubclass(cls, Solver):
            for check_solver in SOLVER_CHECKS:
                check_solver(cls)
        elif issubclass(cls, Force):
            check_pair_force(cls(**values))
        elif issubclass(cls, Exporter):
            with recorded(case or load_case(SHIPPED_CASE), ticks) as trajectory:
                for check_exporter in EXPORTER_CHECKS:
                    check_exporter(cls(**values), trajectory)
            return
        elif issubclass(cls, Importer):
            check_damaged_files(cls(**values))
            if case is None:
                return
            check_surface(case, cls.name)
        case = _case_with(cls, values) if case is None else case
        if issubclass(cls, Behaviour):
            check_declared_arrays(case, cls.name, ticks)
        elif issubclass(cls, Recorder):
            check_read_only(cls(**values), case, ticks)
            check_resume(cls(**values), case, ticks)
        check_same_bits(case, ticks)


def check_metadata(cls: type[Configurable]) -> None:
    """Check the interface version, the name, the docstring, and the declarations of all parameters."""
    module = sys.modules.get(cls.__module__)
    if module is not None and any(hasattr(module, hook) for hook in KINDS.values()):
        check_interface(module, cls.__module__)
    check_class(cls, cls.__module__)
    name = cls.name
    if not (cls.__doc__ or "").strip():
        raise PluginError(f"{name}: {cls.__name__} has no docstring; add one, `evac plugins` shows its first line")
    for key, parameter in cls.declared().items():
        if any(callable(vars(base).get(key)) for base in cls.__mro__):
            raise PluginError(f"{name}.{key}: a parameter must not have the name of a method; rename the parameter")
        if not parameter.doc.strip():
            raise PluginError(f"{name}.{key}: the parameter has no description; add doc to its declaration")
        if _is_bounded(parameter) and not isinstance(parameter.default, (int, float)) and not parameter.distribution:
            raise PluginError(f"{name}.{key}: remove the bounds; the default {parameter.default!r} is not a number")
        parameter.check(f"{name}.{key}", parameter.default)
    made = cls()
    if any(isinstance(value, Parameter) for value in made.values().values()):
        raise PluginError(f"{name}: __init__ does not set the parameters; call super().__init__(**values) first")
    if isinstance(made, Behaviour):
        _check_declarations(made)


def _is_bounded(parameter: Parameter) -> bool:
    return (parameter.minimum, parameter.above, parameter.maximum) != (None, None, None)


def _check_declarations(behaviour: Behaviour) -> None:
    for array in (*behaviour.reads, *behaviour.writes):
        if array not in Crowd.kinds:
            raise PluginError(f"{behaviour.name}: declares {array!r}, which Crowd does not have (evac.physics.state)")
    check_writes(behaviour)
    if type(behaviour).act is Behaviour.act and type(behaviour).prepare is Behaviour.prepare:
        raise PluginError(f"{behaviour.name}: has no effect; define act() or prepare()")


def _case_with(cls: type[Configurable], values: dict[str, Any]) -> Case:
    """Return the shipped case changed to use the plugin, which is registered if necessary."""
    registry = Registry()
    registry.add_class(cls)
    if issubclass(cls, ContactModel):
        changes = {"contact.model": cls.name, f"contact.{cls.name}": values}
    elif issubclass(cls, Solver):
        changes = {"contact.model": "nsm1", "contact.nsm1.solver": cls.name}
    elif issubclass(cls, Force):
        changes = {f"forces.{cls.name}": values}
    elif issubclass(cls, Behaviour):
        changes = {f"behaviours.{cls.name}": values}
    else:
        changes = {f"recorders.{cls.name}": values}
    return load_case(SHIPPED_CASE, changes, registry=registry)
