"""The registry: finds plugins, checks them against the contract, and lists what they provide by name."""

import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any

import pluggy

from evac.base.errors import BuildingError, PluginError, fault, plugin_code, text_of, usable_path
from evac.base.parameters import Configurable, did_you_mean
from evac.contract import hooks
from evac.contract.hooks import KINDS
from evac.contract.requirements import (
    RETURNED_BY,
    RUN_HOOKS,
    check_answer,
    check_class,
    check_module,
    classes_in,
    kind_of,
)

if TYPE_CHECKING:
    from evac.building.importer import Importer

#: Prefix of the names of modules made from plugin files.
FILE_PREFIX = "evac_plugin_"


@dataclass(frozen=True)
class Provenance:
    """The origin of a plugin."""

    plugin: str  # name of its module, path of its file, or module and name of its class
    source: str  # ``"built-in"``, ``"distribution"``, ``"file"`` or ``"class"``
    origin: str  # the distribution's name, the file's path, or the class's module
    version: str  # version of the distribution; digest of the file's text; empty for a class


class _Manager(pluggy.PluginManager):
    """Looks for hooks among the functions of a module, since pluggy inspects every name at length."""

    def parse_hookimpl_opts(self, plugin: Any, name: str) -> Any:
        is_function = isinstance(vars(plugin).get(name), (FunctionType, MethodType))
        return super().parse_hookimpl_opts(plugin, name) if is_function else None


class Registry:
    """All registered classes of plugins, by kind, and shipped cases.

    Parameters
    ----------
    plugin_files : iterable of path
        Python files to register after the built-in plugins and the installed ones.
    builtins : sequence of str, optional
        Modules to register first; all built-in plugins by default.

    Attributes
    ----------
    hook
        pluggy's caller of the hooks in `evac.contract.hooks`.
    contact_models, solvers, forces, behaviours, recorders, importers, exporters, condition_sources, smoke_laws,
    dispatchers : dict of str to class
        Classes by name; do not modify.
    cases : dict of str to Path
        Folder of each shipped case.
    provenance : list of Provenance
        One for each plugin, in the order they were registered.

    Raises
    ------
    PluginError
        A plugin cannot be loaded, breaks the contract, or claims a name that is taken.
    """

    def __init__(self, plugin_files: Iterable[str | Path] = (), *, builtins: Sequence[str] | None = None) -> None:
        self._manager = _Manager("evac")
        self._manager.add_hookspecs(hooks)
        self.hook = self._manager.hook
        self.provenance: list[Provenance] = []
        self._tables: dict[str, dict[str, Any]] = {kind: {} for kind in RETURNED_BY}
        self.contact_models: dict[str, type[Any]] = self._tables["contact_model"]
        self.solvers: dict[str, type[Any]] = self._tables["solver"]
        self.forces: dict[str, type[Any]] = self._tables["force"]
        self.behaviours: dict[str, type[Any]] = self._tables["behaviour"]
        self.recorders: dict[str, type[Any]] = self._tables["recorder"]
        self.importers: dict[str, type[Any]] = self._tables["importer"]
        self.exporters: dict[str, type[Any]] = self._tables["exporter"]
        self.condition_sources: dict[str, type[Any]] = self._tables["condition_source"]
        self.smoke_laws: dict[str, type[Any]] = self._tables["smoke_law"]
        self.dispatchers: dict[str, type[Any]] = self._tables["dispatcher"]
        self.cases: dict[str, Path] = self._tables["case"]
        self._owners: dict[tuple[str, str], str] = {}
        version = importlib.metadata.version("evac")
        for name in built_in() if builtins is None else builtins:
            with plugin_code(f"built-in plugin {name} cannot be loaded", None):
                module = importlib.import_module(name)
            self._register(module, Provenance(name, "built-in", "evac", version))
        for entry in _installed(tuple(sys.path)):
            origin = entry.dist.name if entry.dist else "unknown"
            with plugin_code(f"plugin {entry.value} of distribution {origin} cannot be loaded", None):
                module = entry.load()
            self._register(
                module, Provenance(entry.value, "distribution", origin, entry.dist.version if entry.dist else "")
            )
        for path in plugin_files:
            self.add_file(path)

    def get(self, kind: str, name: str) -> Any:
        """Return what is registered as `name` of a kind, a key of `RETURNED_BY`; `PluginError` names the closest."""
        table = self._tables[kind]
        if name not in table:
            raise PluginError(f"unknown {kind.replace('_', ' ')} {name!r}; {did_you_mean(name, list(table))}")
        return table[name]

    def add_file(self, path: str | Path) -> None:
        """Register the plugin in a Python file; a file registered before is left alone."""
        path = usable_path(path, PluginError).resolve()
        try:
            text = path.read_bytes()
        except OSError as error:
            raise PluginError(f"plugin file {text_of(path)}: {error.strerror}; check the path") from None
        provenance = Provenance(str(path), "file", str(path), hashlib.sha256(text).hexdigest()[:16])
        if provenance not in self.provenance:
            with plugin_code(f"plugin file {path} cannot be loaded", path):
                module = _module_of(path, text)
            self._register(module, provenance)

    def add_class(self, cls: type[Any]) -> None:
        """Register one class of a plugin without its module; one registered before is left alone."""
        kind = check_class(cls, cls.__module__)
        if self._tables[kind].get(cls.name) is not cls:
            plugin = f"{cls.__module__}.{cls.__qualname__}"
            self._enter(kind, cls.name, cls, plugin, cls)
            self.provenance.append(Provenance(plugin, "class", cls.__module__, ""))

    def names_of_classes(self) -> list[str]:
        """Return module and name of each plugin that was registered with `add_class`."""
        return [source.plugin for source in self.provenance if source.source == "class"]

    def files(self) -> tuple[Path, ...]:
        """Return the plugin files, in the order they were registered."""
        return tuple(Path(source.origin) for source in self.provenance if source.source == "file")

    def importer_for(self, path: Path, without: Collection[str] = ()) -> "type[Importer]":
        """Return the importer of a file by the ending of its name; of several, the one registered last."""
        used: list[type[Importer]] = [cls for name, cls in self.importers.items() if name not in without]
        for cls in reversed(used):
            if path.name.lower().endswith(cls.suffixes):
                return cls
        known = sorted({suffix for cls in used for suffix in cls.suffixes})
        raise BuildingError(
            f"{path}: no importer reads files ending in {path.suffix.lower()!r}; use one of {', '.join(known)}, or a "
            "plugin with an importer"
        )

    def calls(self, hook: str, **given: Any) -> list[tuple[str, "partial[Any]"]]:
        """Return name and bound function of each plugin with a hook, so that the caller handles failures one by one."""
        calls = getattr(self.hook, hook).get_hookimpls()
        return [(call.plugin_name, partial(call.function, *map(given.__getitem__, call.argnames))) for call in calls]

    def call_all(self, hook: str, **given: Any) -> None:
        """Call a hook of every plugin that has it, the last registered first; `PluginError` names one that fails."""
        for plugin, call in reversed(self.calls(hook, **given)):
            with plugin_code(f"{plugin}: {hook}", call.func):
                call()

    def providers(self, used: Iterable[Configurable]) -> list[str]:
        """Return name and version of the plugins that provide some objects, and of those with hooks in every run."""
        owners = {self._owners[kind_of(type(plugin)), plugin.name] for plugin in used}
        for hook in RUN_HOOKS:
            owners.update(implementation.plugin_name for implementation in getattr(self.hook, hook).get_hookimpls())
        return [f"{entry.plugin} {entry.version}" for entry in self.provenance if entry.plugin in owners]

    def provided_by(self, path: Path) -> list[tuple[str, str]]:
        """Return kind and name of all that a plugin file (resolved) provides, and its hooks of every run as "hook"."""
        module = self._manager.get_plugin(str(path))
        hooks = [("hook", hook) for hook in RUN_HOOKS if hasattr(module, hook)]
        return [key for key, owner in self._owners.items() if owner == str(path)] + hooks

    def describe(self) -> list[dict[str, Any]]:
        """Return one dict per plugin: plugin, source, origin, version, and what it provides with its parameters."""
        return [
            {
                "plugin": provenance.plugin,
                "source": provenance.source,
                "origin": provenance.origin,
                "version": provenance.version,
                "provides": [
                    _description(kind, name, self._tables[kind][name])
                    for (kind, name), owner in self._owners.items()
                    if owner == provenance.plugin
                ],
            }
            for provenance in self.provenance
        ]

    def _register(self, module: ModuleType, provenance: Provenance) -> None:
        """Check `module` against the contract, register it and enter what it provides in the tables."""
        plugin = provenance.plugin
        check_module(self._manager, module, plugin)
        try:
            self._manager.register(module, name=plugin)
            self._manager.check_pending()
        except (pluggy.PluginValidationError, ValueError) as error:
            remedy = "see evac.contract.hooks for the hooks and their arguments"
            raise fault(f"plugin {plugin}", text_of(error), remedy, module) from error
        self.provenance.append(provenance)
        returning = {kind: getattr(module, hook) for kind, hook in RETURNED_BY.items() if hasattr(module, hook)}
        for kind, function in returning.items():
            with plugin_code(f"plugin {plugin}: {function.__name__}()", function):
                answer = function()
            check_answer(kind, answer, function, plugin)
            for item in answer:
                if kind != "case":
                    self._enter(check_class(item, plugin), item.name, item, plugin, item)
                    continue
                folder = Path(item)
                if not (folder / "case.toml").is_file():
                    text = f"{folder}, the folder of a case, has no case.toml"
                    raise fault(f"plugin {plugin}", text, "add it", function)
                self._enter("case", folder.name, folder, plugin, function)
        if not returning.keys() - {"case"}:
            for cls in classes_in(module):
                self._enter(check_class(cls, plugin), cls.name, cls, plugin, cls)

    def _enter(self, kind: str, name: str, item: Any, plugin: str, origin: Any) -> None:
        """Enter a class or a folder in its table; `origin` is the code of the plugin that provides it."""
        if (kind, name) in self._owners:
            wrong = f"{kind.replace('_', ' ')} {name!r} is provided by {self._owners[kind, name]} already"
            raise fault(f"plugin {plugin}", wrong, "choose another name, or remove one of the plugins", origin)
        self._owners[kind, name] = plugin
        self._tables[kind][name] = item


def built_in(*kinds: str) -> list[str]:
    """Return the modules of built-in plugins, or of those of some kinds, by their files, without importing any."""
    places = importlib.import_module("evac_plugins").__path__
    begin = tuple(KINDS[kind].files if kind in KINDS else kind for kind in kinds) or ("",)
    return [f"evac_plugins.{module.name}" for module in pkgutil.iter_modules(places) if module.name.startswith(begin)]


@cache
def _installed(path: tuple[str, ...]) -> list[importlib.metadata.EntryPoint]:
    """Return the entry points of installed plugins, which are read again if the search path has changed."""
    return sorted(importlib.metadata.entry_points(group="evac"), key=lambda entry: entry.name)


def _module_of(path: Path, text: bytes) -> ModuleType:
    """Import a file under a unique name, which stays in `sys.modules` because numba's cache requires it."""
    digest = hashlib.sha256(str(path).encode() + text).hexdigest()[:16]
    name = f"{FILE_PREFIX}{path.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"plugin file {path}: not a Python file; use a file whose name ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def create(word: str, cls: Any, parameters: Mapping[str, Any]) -> Any:
    """Return an object of a plugin class with its parameters; `word` names its kind in errors."""
    with plugin_code(f"{word} {cls.name!r}: cannot be made", cls):
        return cls(**parameters)


def is_plugin_file(path: str) -> bool:
    """Return whether a plugin has been imported from that file."""
    modules = list(sys.modules.items())
    return any(getattr(module, "__file__", None) == path for name, module in modules if name.startswith(FILE_PREFIX))


def _description(kind: str, name: str, item: Any) -> dict[str, Any]:
    """Return kind, name, first line of the docstring and parameters of a registered class or case."""
    if kind == "case":
        return {"kind": kind, "name": name, "doc": str(item), "parameters": {}}
    parameters = {
        key: {"default": value.default, "unit": value.unit, "range": value.range, "doc": value.doc}
        for key, value in item.declared().items()
    }
    return {
        "kind": kind,
        "name": name,
        "doc": (inspect.getdoc(item) or "").partition("\n")[0],
        "parameters": parameters,
    }
