"""Conformance checks for plugins, which plugin authors call in their own tests.

::

    from evac.conformance import check_plugin

    def test_my_model():
        check_plugin(MyModel)                       # contact model, solver, force, recorder, exporter
        check_plugin(MyBehaviour, case)             # a behaviour, with a case in which it has an effect
        check_plugin(MyImporter, case)              # an importer, with a case whose building it reads

A failed check raises `PluginError`, which names the check and the scene, and says what is wrong, by how much, and what
to change. The same checks are applied to all built-in plugins.
"""

import sys
from collections.abc import Callable
from typing import Any

from evac.behaviour import Behaviour, check_writes
from evac.building.importer import Importer
from evac.conformance.behaviours import check_declared_arrays
from evac.conformance.cases import check_read_only, check_resume, check_same_bits
from evac.conformance.contact_models import CONTACT_MODEL_CHECKS
from evac.conformance.exporters import EXPORTER_CHECKS, recorded
from evac.conformance.forces import FORCE_CHECKS
from evac.conformance.importers import check_damaged_files, check_surface
from evac.conformance.scenes import PLAIN, Pace, pace_of
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
        pace = PLAIN
        if issubclass(cls, ContactModel):
            pace = pace_of(cls(**values))
            for check in CONTACT_MODEL_CHECKS:
                _run(check, cls, cls(**values), pace)
        elif issubclass(cls, Solver):
            for check_solver in SOLVER_CHECKS:
                _run(check_solver, cls, cls)
        elif issubclass(cls, Force):
            for check_force in FORCE_CHECKS:
                _run(check_force, cls, cls(**values))
        elif issubclass(cls, Exporter):
            with recorded(case or load_case(SHIPPED_CASE), ticks) as trajectory:
                for check_exporter in EXPORTER_CHECKS:
                    _run(check_exporter, cls, cls(**values), trajectory)
            return
        elif issubclass(cls, Importer):
            _run(check_damaged_files, cls, cls(**values))
            if case is None:
                return
            _run(check_surface, cls, case, cls.name)
        case = _case_with(cls, values, pace) if case is None else case
        if issubclass(cls, Behaviour):
            _run(check_declared_arrays, cls, case, cls.name, ticks)
        elif issubclass(cls, Recorder):
            _run(check_read_only, cls, cls(**values), case, ticks)
            _run(check_resume, cls, cls(**values), case, ticks)
        _run(check_same_bits, cls, case, ticks)


def _run(check: Callable[..., None], cls: type[Configurable], *arguments: Any) -> None:
    """Run a check; prefix its error with the names of the plugin and of the check."""
    try:
        check(*arguments)
    except PluginError as error:
        raise PluginError(f"{cls.name}: {check.__name__}: {error}") from error


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


def _case_with(cls: type[Configurable], values: dict[str, Any], pace: Pace) -> Case:
    """Return the shipped case at a pace, changed to use the plugin, which is registered if necessary."""
    registry = Registry()
    registry.add_class(cls)
    changes: dict[str, Any]
    if issubclass(cls, ContactModel):
        changes = {"contact.model": cls.name, f"contact.{cls.name}": values}
        if pace != PLAIN:
            changes |= _slower(pace)
    elif issubclass(cls, Solver):
        changes = {"contact.model": "nsm1", "contact.nsm1.solver": cls.name}
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
