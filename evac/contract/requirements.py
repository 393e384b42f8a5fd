"""The plugin contract: requirements that a module and a class must meet to be registered."""

import inspect
import reprlib
import sys
from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import Any

import pluggy

from evac.base.errors import PluginError, fault
from evac.base.parameters import Parameter, did_you_mean
from evac.contract import hooks
from evac.contract.hooks import KINDS

#: Kinds of what plugins provide, and the hook that returns each.
RETURNED_BY = {kind: f"evac_{kind}s" for kind in KINDS} | {"case": "evac_building_cases"}

#: Names of all hooks, and of those that are called in every run.
HOOKS = [name for name in vars(hooks) if name.startswith("evac_")]
RUN_HOOKS = [name for name in HOOKS if name not in RETURNED_BY.values()]

#: Names that would hide a key of their section.
RESERVED = {("contact_model", "model")}


def check_module(manager: pluggy.PluginManager, module: ModuleType, plugin: str) -> None:
    """Check that a module has plugin classes or valid hooks, and was written for this version of the interface."""
    what = f"plugin {plugin}"
    marked = {name: mark for name in vars(module) if (mark := manager.parse_hookimpl_opts(module, name)) is not None}
    unmarked = [name for name in HOOKS if name not in marked and hasattr(module, name)]
    if not (marked or unmarked or classes_in(module)):
        bases, known = ", ".join(kind.base for kind in KINDS.values()), ", ".join(HOOKS)
        raise fault(what, "defines no plugin", f"derive a class from one of {bases}, or define a hook: {known}", module)
    check_interface(module, plugin)
    for name in unmarked:
        value = getattr(module, name)
        if not inspect.isroutine(value):
            wrong = f"{name} is an object of class {type(value).__name__}, not a hook"
            raise fault(what, wrong, "define a function that returns it, and decorate it with @hookimpl", module, name)
        raise fault(what, f"{name} is not marked as a hook", "decorate it with @hookimpl", value)
    for name, options in marked.items():
        function = getattr(module, name)
        if name not in HOOKS:
            raise fault(what, f"there is no hook {name!r}", did_you_mean(name, HOOKS), function)
        if options.get("wrapper") or options.get("hookwrapper"):
            raise fault(what, f"{name} is a hook wrapper", "make it an ordinary hook", function)


def check_interface(module: ModuleType, plugin: str) -> None:
    """Check that a module, or its package, states the version of the plugin interface, and that it is this one."""
    package, own = sys.modules.get(module.__package__ or ""), hooks.INTERFACE
    stated = getattr(module, "evac_interface", getattr(package, "evac_interface", None))
    if stated == own and isinstance(stated, int):
        return
    wrong = f"was written for version {stated!r} of the plugin interface, this evac has version {own}"
    if stated is None:
        wrong = "does not state for which version of the plugin interface it was written"
    remedy = "see docs/changelog.md for what changed, adapt the plugin, and then write"
    remedy += f" `evac_interface = {own}` in the module"
    raise fault(f"plugin {plugin}", wrong, remedy, module, "evac_interface")


def classes_in(module: ModuleType) -> list[type[Any]]:
    """Return the plugin classes that a module or package defines, in order."""
    classes = {
        item: None
        for item in vars(module).values()
        if isinstance(item, type) and f"{item.__module__}.".startswith(f"{module.__name__}.") and kind_of(item)
    }
    return [
        item
        for item in classes
        if "name" in vars(item) or not any(other is not item and issubclass(other, item) for other in classes)
    ]


def check_answer(kind: str, answer: Any, hook: Any, plugin: str) -> None:
    """Check that a hook returns a list, of classes of a kind or, for the kind ``"case"``, of folders."""
    what, returns = f"plugin {plugin}", f"{hook.__name__}() returns"
    if isinstance(answer, str | bytes) or not isinstance(answer, Sequence):
        got = reprlib.repr(getattr(answer, "__name__", answer))
        raise fault(what, f"{returns} {got}", "return a list, such as [MyClass]", hook)
    for item in answer if kind != "case" else ():
        base = f"evac.{KINDS[kind].base}"
        if not isinstance(item, type):
            got = f"an object of class {type(item).__name__}"
            raise fault(what, f"{returns} {got}", f"return the class itself, which must derive from {base}", hook)
        if kind_of(item) != kind:
            raise fault(what, f"{returns} {item.__name__}", f"derive it from {base}", hook)


def check_class(cls: Any, plugin: str) -> str:
    """Check that a class is a complete plugin class with a valid name, and return its kind, a key of `KINDS`."""
    kind = kind_of(cls)
    if not kind:
        bases = ", ".join(known.base for known in KINDS.values())
        raise fault(f"plugin {plugin}", f"{cls!r} is not a plugin", f"derive it from one of {bases}", cls)
    _check_name(kind, cls, plugin)
    for key, parameter in cls.declared().items():
        _check_parameter(cls, key, parameter, plugin)
    _check_methods(kind, cls, plugin)
    _check_suffixes(kind, cls, plugin)
    _check_memory(kind, cls, plugin)
    return kind


def _check_name(kind: str, cls: Any, plugin: str) -> None:
    name = getattr(cls, "name", "")
    what = f"{cls.__name__}.name is {name!r}"
    if not isinstance(name, str) or not name.isidentifier() or name != name.lower():
        raise fault(f"plugin {plugin}", what, "write one word in lower case, such as 'my_plugin'", cls, "name")
    if (kind, name) in RESERVED:
        raise fault(f"plugin {plugin}", f"{what}, a key of its section", "choose another name", cls, "name")


@cache
def _check_methods(kind: str, cls: Any, plugin: str) -> None:
    """Check that a class defines what its kind needs, and that its methods take the arguments that evac gives them."""
    what, name = f"plugin {plugin}", KINDS[kind].base
    base = next(parent for parent in cls.__mro__ if (parent.__module__, parent.__qualname__) == KINDS[kind][:2])
    if missing := sorted(getattr(cls, "__abstractmethods__", ())):
        raise fault(what, f"{cls.__name__} has no {missing[0]}(), which every {name} needs", "add it", cls)
    effects = ("act", "prepare", "routes", "contact_radius")
    if kind == "behaviour" and all(getattr(cls, effect) is getattr(base, effect) for effect in effects):
        raise fault(what, f"{cls.__name__} has no effect", "define act(self, crowd, time) or prepare(self, scene)", cls)
    for key, method in vars(base).items():
        redefined = getattr(cls, key)
        if key.startswith("_") or not inspect.isfunction(method) or redefined is method:
            continue
        given = list(inspect.signature(method).parameters)
        try:
            own = inspect.signature(redefined)
            own.bind(*given)
        except (TypeError, ValueError):
            shown = f"{key}{own}" if callable(redefined) else f"{key}, which is not a method"
            wrong, remedy = f"{cls.__name__} defines {shown}", f"define {key}({', '.join(given)})"
            raise fault(what, wrong, remedy, redefined if callable(redefined) else cls, key) from None


def _check_parameter(cls: Any, key: str, parameter: Parameter, plugin: str) -> None:
    """Check the name and the default of a declared parameter; distributions are checked where they are used."""
    what = f"plugin {plugin}"
    if any(callable(vars(base).get(key)) for base in cls.__mro__):
        wrong = f"the parameter {key} of {cls.__name__} has the name of a method"
        raise fault(what, wrong, "rename the parameter", cls, key)
    if parameter.distribution:
        return
    bounds = (parameter.minimum, parameter.above, parameter.maximum)
    if any(bound is not None for bound in bounds) and not isinstance(parameter.default, (int, float)):
        wrong = f"the parameter {key} of {cls.__name__} has bounds, but its default {parameter.default!r} is no number"
        raise fault(what, wrong, "remove the bounds", cls, key)
    try:
        parameter.check(f"the default of {cls.name}.{key}", parameter.default)
    except PluginError as error:
        raise fault(what, str(error), "change its default or its range", cls, key) from None


def _check_suffixes(kind: str, cls: Any, plugin: str) -> None:
    if kind == "importer" and not _are_suffixes(suffixes := getattr(cls, "suffixes", None)):
        wrong, remedy = f"{cls.__name__}.suffixes is {suffixes!r}", "write a tuple of endings, such as ('.obj',)"
        raise fault(f"plugin {plugin}", wrong, f"{remedy}, in lower case", cls, "suffixes")
    if kind == "exporter" and getattr(cls, "suffix", None) != "" and not _are_suffixes((cls.suffix,)):
        wrong = f"{cls.__name__}.suffix is {cls.suffix!r}"
        remedy = "write an ending in lower case, such as '.csv', or none for a folder"
        raise fault(f"plugin {plugin}", wrong, remedy, cls, "suffix")


def _check_memory(kind: str, cls: Any, plugin: str) -> None:
    names = cls.memory if kind == "contact_model" else ()
    is_list = isinstance(names, tuple) and all(isinstance(name, str) and name.isidentifier() for name in names)
    if not is_list or len(set(names)) < len(names):
        wrong, remedy = f"{cls.__name__}.memory is {names!r}", "write a tuple of different names, such as ('stretch',)"
        raise fault(f"plugin {plugin}", wrong, remedy, cls, "memory")


def _are_suffixes(value: Any) -> bool:
    return (
        isinstance(value, tuple)
        and len(value) > 0
        and all(isinstance(suffix, str) and suffix.startswith(".") and suffix == suffix.lower() for suffix in value)
    )


def kind_of(item: Any) -> str:
    """Return the kind of a plugin class, without importing its base class, or an empty string if it has none."""
    bases = {(base.__module__, base.__qualname__) for base in item.__mro__} if isinstance(item, type) else set()
    return next((kind for kind, known in KINDS.items() if known[:2] in bases), "")
