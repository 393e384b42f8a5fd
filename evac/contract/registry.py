"""The registry: finds plugins, checks them against the contract, and lists what they provide by name."""

import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import pkgutil
import reprlib
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any

import pluggy

from evac.base.errors import BuildingError, PluginError, fault, plugin_code, text_of, usable_path
from evac.base.parameters import Configurable, Parameter, did_you_mean
from evac.contract import hooks
from evac.contract.hooks import PLUGIN_KINDS

if TYPE_CHECKING:
    from evac.building.importer import Importer

#: Kinds of what plugins provide, and the hook that returns each.
RETURNED_BY = {kind: f"evac_{kind}s" for kind in PLUGIN_KINDS} | {"case": "evac_building_cases"}

#: Names of all hooks, and of those that are called in every run.
HOOKS = [name for name in vars(hooks) if name.startswith("evac_")]
RUN_HOOKS = [name for name in HOOKS if name not in RETURNED_BY.values()]

RESERVED = {("contact_model", "model")}  #: Names that would hide a key of their section.


@cache
def hooks_in(module: ModuleType) -> dict[str, Any]:
    """Return the options of the functions of a module that are marked as hooks, by name."""
    functions = {name: item for name, item in vars(module).items() if isinstance(item, FunctionType | MethodType)}
    marks = {name: getattr(item, f"{hooks.hookimpl.project_name}_impl", None) for name, item in functions.items()}
    return {name: mark for name, mark in marks.items() if mark is not None}


def check_module(module: ModuleType, plugin: str) -> None:
    """Check that a module has plugin classes or valid hooks, and was written for this version of the interface."""
    what = f"plugin {plugin}"
    marked = hooks_in(module)
    unmarked = [name for name in HOOKS if name not in marked and hasattr(module, name)]
    if not (marked or unmarked or classes_in(module)):
        bases, known = ", ".join(kind.base for kind in PLUGIN_KINDS.values()), ", ".join(HOOKS)
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


@cache
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
        base = f"evac.{PLUGIN_KINDS[kind].base}"
        if not isinstance(item, type):
            got = f"an object of class {type(item).__name__}"
            raise fault(what, f"{returns} {got}", f"return the class itself, which must derive from {base}", hook)
        if kind_of(item) != kind:
            raise fault(what, f"{returns} {item.__name__}", f"derive it from {base}", hook)


def check_class(cls: Any, plugin: str) -> str:
    """Check that a class is a complete plugin class with a valid name, and return its kind, a key of `PLUGIN_KINDS`."""
    kind = kind_of(cls)
    if not kind:
        bases = ", ".join(known.base for known in PLUGIN_KINDS.values())
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
    what, name = f"plugin {plugin}", PLUGIN_KINDS[kind].base
    base = next(parent for parent in cls.__mro__ if (parent.__module__, parent.__qualname__) == PLUGIN_KINDS[kind][:2])
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
    return next((kind for kind, known in PLUGIN_KINDS.items() if known[:2] in bases), "")


FILE_PREFIX = "evac_plugin_"  #: Prefix of the names of modules made from plugin files.


@dataclass(frozen=True)
class Provenance:
    """The origin of a plugin."""

    plugin: str  # name of its module, path of its file, or module and name of its class
    source: str  # ``"built-in"``, ``"distribution"``, ``"file"`` or ``"class"``
    origin: str  # the distribution's name, the file's path, or the class's module
    version: str  # version of the distribution; digest of the file's text; empty for a class


class _Manager(pluggy.PluginManager):
    """Looks for hooks as `hooks_in`, since pluggy inspects every name of a module at length."""

    def parse_hookimpl_opts(self, plugin: Any, name: str) -> Any:
        return hooks_in(plugin).get(name)


class Registry:
    """All registered classes of plugins, by kind, and shipped cases.

    Parameters
    ----------
    plugin_files : iterable of path
        Python files to register after the built-in plugins and the installed ones.
    builtins : sequence of str, optional
        Modules to register first; all built-in plugins by default.

    Raises
    ------
    PluginError
        A plugin cannot be loaded, breaks the contract, or claims a name that is taken.
    """

    def __init__(self, plugin_files: Iterable[str | Path] = (), *, builtins: Sequence[str] | None = None) -> None:
        self._manager = _Manager("evac")
        self._manager.add_hookspecs(hooks)
        self.hook = self._manager.hook
        self.provenance: list[Provenance] = []  #: one for each plugin, in the order they were registered
        self._tables: dict[str, dict[str, Any]] = {kind: {} for kind in RETURNED_BY}
        #: classes by name, as those of the other kinds; do not modify
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
        self.cases: dict[str, Path] = self._tables["case"]  #: folder of each shipped case
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
        check_module(module, plugin)
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
    begin = tuple(PLUGIN_KINDS[kind].files if kind in PLUGIN_KINDS else kind for kind in kinds) or ("",)
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
