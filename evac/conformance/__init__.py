"""What every plugin has to hold to: checks that plugin authors call in their own tests.

::

    from evac.conformance import check_plugin

    def test_my_model():
        check_plugin(MyModel)                       # contact model, solver, force, recorder, exporter
        check_plugin(MyBehaviour, case)             # a behaviour in a case in which it has something to do
        check_plugin(MyImporter, case)              # an importer with a case whose building it reads

Each check raises `PluginError` that says what was broken, by how much, and what to change. The same checks
run over everything that evac itself registers.
"""

import sys
from typing import Any

from evac.behaviour import Behaviour, check_writes
from evac.building.importer import Importer
from evac.conformance.cases import check_declared_arrays, check_goes_on, check_looks_only, check_same_bits
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

#: Case that a plugin is tried in where its author gives none.
SHIPPED_CASE = "square_room"


def check_plugin(cls: type[Configurable], case: Case | None = None, ticks: int = 20, **values: Any) -> None:
    """Run every check that concerns a plugin class.

    Parameters
    ----------
    cls : type
        A `ContactModel`, `Solver`, `Force`, `Behaviour`, `Recorder`, `Importer` or `Exporter`.
    case : Case, optional
        Case that uses the plugin as it stands; by default the shipped square room, with the plugin in use. Without a
        case, an importer is tried on damaged files only.
    ticks : int
        Ticks of the case that are run.
    **values
        Parameters to set, instead of the defaults, where no case is given.

    Raises
    ------
    PluginError
        The first promise found broken.
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
            check_looks_only(cls(**values), case, ticks)
            check_goes_on(cls(**values), case, ticks)
        check_same_bits(case, ticks)


def check_metadata(cls: type[Configurable]) -> None:
    """Interface version, name, docstring, and every parameter with a type, a unit, a sentence and a legal default."""
    module = sys.modules.get(cls.__module__)
    if module is not None and any(hasattr(module, hook) for hook in KINDS.values()):
        check_interface(module, cls.__module__)
    check_class(cls, cls.__module__)
    name = cls.name
    if not (cls.__doc__ or "").strip():
        raise PluginError(f"{name}: {cls.__name__} has no docstring; its first line is what `evac plugins` shows")
    for key, parameter in cls.declared().items():
        if any(callable(vars(base).get(key)) for base in cls.__mro__):
            raise PluginError(f"{name}.{key}: a parameter with the name of a method would hide it; take another")
        if not parameter.doc.strip():
            raise PluginError(f"{name}.{key}: no doc; say in one sentence what it is")
        if _is_bounded(parameter) and not isinstance(parameter.default, (int, float)) and not parameter.distribution:
            raise PluginError(f"{name}.{key}: bounds on {parameter.default!r}, which is no number")
        parameter.check(f"{name}.{key}", parameter.default)
    made = cls()
    if any(isinstance(value, Parameter) for value in made.values().values()):
        raise PluginError(f"{name}: its parameters are lost in __init__; call super().__init__(**values) first")
    if isinstance(made, Behaviour):
        _check_declarations(made)


def _is_bounded(parameter: Parameter) -> bool:
    return (parameter.minimum, parameter.above, parameter.maximum) != (None, None, None)


def _check_declarations(behaviour: Behaviour) -> None:
    for array in (*behaviour.reads, *behaviour.writes):
        if array not in Crowd.kinds:
            raise PluginError(f"{behaviour.name}: declares {array!r}, which is no array of evac.physics.state.Crowd")
    check_writes(behaviour)
    if type(behaviour).act is Behaviour.act and type(behaviour).prepare is Behaviour.prepare:
        raise PluginError(f"{behaviour.name}: has neither act() nor prepare() of its own, so it does nothing")


def _case_with(cls: type[Configurable], values: dict[str, Any]) -> Case:
    """Return the shipped case with the plugin in use, registered if it is not."""
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
