"""The plugin contract: requirements that a module and a class must meet to be registered."""

import inspect
from types import ModuleType
from typing import Any

import pluggy

from evac import hookspecs
from evac.errors import PluginError
from evac.parameters import did_you_mean

#: Module and name of the base class of each kind.
BASES = {
    "contact_model": ("evac.physics.contact_model", "ContactModel"),
    "solver": ("evac.physics.solver", "Solver"),
    "force": ("evac.physics.force", "Force"),
    "behaviour": ("evac.behaviour", "Behaviour"),
    "recorder": ("evac.output.recorder", "Recorder"),
    "importer": ("evac.building.importer", "Importer"),
    "exporter": ("evac.output.exporter", "Exporter"),
}

#: Names that would hide a key of their section.
RESERVED = {("contact_model", "model")}


def check_module(manager: pluggy.PluginManager, module: ModuleType, plugin: str) -> None:
    """Check that a module has hooks, all of them valid, and was written for this version of the interface.

    Parameters
    ----------
    manager : pluggy.PluginManager
    module : module
    plugin : str
        Name of the plugin, for the message.

    Raises
    ------
    PluginError
        It does not; names the plugin and what to change.
    """
    known = [name for name in vars(hookspecs) if name.startswith("evac_")]
    marked = {name: found for name in vars(module) if (found := manager.parse_hookimpl_opts(module, name)) is not None}
    unmarked = [name for name in known if name not in marked and inspect.isfunction(getattr(module, name, None))]
    if not marked and not unmarked:
        raise PluginError(f"plugin {plugin}: defines no hook; define at least one of {', '.join(known)}")
    check_interface(module, plugin)
    if unmarked:
        raise PluginError(f"plugin {plugin}: {unmarked[0]} is not marked as a hook; decorate it with @hookimpl")
    for name, options in marked.items():
        if name not in known:
            raise PluginError(f"plugin {plugin}: there is no hook {name!r}; {did_you_mean(name, known)}")
        if options.get("wrapper") or options.get("hookwrapper"):
            raise PluginError(f"plugin {plugin}: {name} is a hook wrapper; make it an ordinary hook")


def check_interface(module: ModuleType, plugin: str) -> None:
    """Check that a module states the version of the plugin interface, and that it is this one.

    Parameters
    ----------
    module : module
        A module with hooks.
    plugin : str
        Name of the plugin, for the message.

    Raises
    ------
    PluginError
        The version is missing, invalid or another one; names the plugin, both versions, and what to change.
    """
    stated, own = getattr(module, "evac_interface", None), hookspecs.INTERFACE
    if stated == own and isinstance(stated, int):
        return
    changes = "docs/plugins.md, section 'Interface versions', lists what changed"
    if stated is None:
        raise PluginError(
            f"plugin {plugin}: does not state which version of the plugin interface it was written for; {changes}; "
            f"adapt it to version {own}, then write `evac_interface = {own}` in the module"
        )
    if not isinstance(stated, int):
        raise PluginError(
            f"plugin {plugin}: evac_interface is {stated!r}, not a whole number; write `evac_interface = {own}`"
        )
    if stated > own:
        raise PluginError(
            f"plugin {plugin}: was written for version {stated} of the plugin interface, this evac has version {own}; "
            "install a later evac, or an earlier release of the plugin"
        )
    raise PluginError(
        f"plugin {plugin}: was written for version {stated} of the plugin interface, this evac has version {own}; "
        f"{changes}; adapt the plugin, then write `evac_interface = {own}`"
    )


def check_class(cls: Any, plugin: str) -> str:
    """Check that a class is a complete plugin class with a valid name, and return its kind.

    Parameters
    ----------
    cls : type
    plugin : str
        Name of the plugin, for the message.

    Returns
    -------
    str
        The kind, a key of `BASES`.

    Raises
    ------
    PluginError
        It is not; names the class and what is missing.
    """
    kind = kind_of(cls)
    if not kind:
        bases = ", ".join(base for _, base in BASES.values())
        raise PluginError(f"plugin {plugin}: {cls!r} is not a plugin; derive it from one of {bases}")
    missing = sorted(getattr(cls, "__abstractmethods__", ()))
    if missing:
        raise PluginError(
            f"plugin {plugin}: {cls.__name__} has no {missing[0]}(), which every {BASES[kind][1]} needs; add it"
        )
    name = getattr(cls, "name", "")
    if not isinstance(name, str) or not name.isidentifier() or name != name.lower():
        raise PluginError(
            f"plugin {plugin}: {cls.__name__}.name is {name!r}; it must be one word in lower case, such as 'my_plugin'"
        )
    if kind == "importer" and not _are_suffixes(getattr(cls, "suffixes", None)):
        raise PluginError(
            f"plugin {plugin}: {cls.__name__}.suffixes is {getattr(cls, 'suffixes', None)!r}; it must be a tuple of "
            "endings in lower case, such as ('.obj',)"
        )
    if kind == "exporter" and getattr(cls, "suffix", None) != "" and not _are_suffixes((cls.suffix,)):
        raise PluginError(
            f"plugin {plugin}: {cls.__name__}.suffix is {cls.suffix!r}; it must be an ending in lower case, such as "
            "'.csv', or empty for a folder"
        )
    if (kind, name) in RESERVED:
        raise PluginError(f"plugin {plugin}: {cls.__name__}.name {name!r} is a key of its section; choose another name")
    return kind


def _are_suffixes(value: Any) -> bool:
    return (
        isinstance(value, tuple)
        and len(value) > 0
        and all(isinstance(one, str) and one.startswith(".") and one == one.lower() for one in value)
    )


def kind_of(cls: Any) -> str:
    """Return the kind of a plugin class, or an empty string if it has none."""
    return next((kind for kind in BASES if is_a(kind, cls)), "")


def is_a(kind: str, item: Any) -> bool:
    """Return whether an object is a plugin class of a kind, without importing the base class."""
    return isinstance(item, type) and any((base.__module__, base.__qualname__) == BASES[kind] for base in item.__mro__)
