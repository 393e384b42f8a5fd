"""Commands on plugins, keys of files and compiled kernels: evac plugins, evac schema, evac cache."""

import argparse
import importlib
import inspect
import json
import pkgutil
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from evac.base.display import Display
from evac.base.errors import EvacError, PluginError
from evac.cli.cases import title_of
from evac.cli.inputs import declare_plugin
from evac.cli.main import BAD_INPUT
from evac.cli.screen import note, say, show_facts, shown

if TYPE_CHECKING:
    from evac.jit import Entry


#: Ends of lines within a paragraph or an item of a list of a docstring, whose formulas are indented farther.
JOINED = re.compile(r"(?<=[^\s-])\n {0,2}(?=[^\s-])")


def declare_plugins(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac plugins`."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="model, behaviour or other plugin to describe")
    parser.add_argument("--check", metavar="FILE", help="check everything in a plugin file")
    parser.add_argument("--case", metavar="CASE", help="with --check: check with this case, and say what ran in it")
    parser.add_argument("--verbose", action="store_true", help="show all parameters with their units and defaults")
    declare_plugin(parser)


def execute_plugins(arguments: argparse.Namespace) -> int:
    """List all registered plugins, describe one of them, or check a plugin file.

    `evac plugins --check FILE` applies the checks of `evac.conformance.check_plugin` to everything in a plugin file,
    and ends with status 2 if one of them fails. With `--case CASE`, they use this case, which may have data for the
    plugin, instead of a shipped one. The case is also run, to say which methods of the plugin ran in it.
    """
    if arguments.check is not None:
        return _check(arguments.check, arguments.plugins, arguments.case)
    from evac.base.parameters import did_you_mean
    from evac.contract.registry import Registry

    registry = Registry(arguments.plugins)
    entries = registry.describe()
    items = [item for entry in entries for item in entry["provides"]]
    for item in items:
        if item["kind"] == "case":  # a path may be wider than the terminal
            item["doc"] = title_of(registry.cases[item["name"]])
    names = [item["name"] for item in items]
    if arguments.name is not None and arguments.name not in names:
        hint = did_you_mean(arguments.name, names)
        raise PluginError(f"no plugin is named {arguments.name!r}; {hint}")
    if arguments.name is None and not arguments.verbose:
        for entry in entries:
            origin = f"  ({entry['source']}, {entry['origin']} {entry['version']})"
            for item in entry["provides"]:
                doc = item["doc"].partition(". ")[0].rstrip(".") + ("" if entry["origin"] == "built-in" else origin)
                say(f"{item['kind'].replace('_', ' ')} {item['name']}: {doc}", 1)
        return 0
    for entry in entries:
        items = [item for item in entry["provides"] if arguments.name in (None, item["name"])]
        if items or arguments.name is None:
            where = f"{entry['source']}, {entry['origin']} {entry['version']}"
            say(f"{entry['plugin']}  ({where})", style="bold")
        for item in items:
            _show(item, None if arguments.name is None else registry.get(item["kind"], item["name"]))
    return 0


def _check(file: str, others: list[str], case_name: str | None = None) -> int:
    """Check all plugins in a file, after those of --plugin; print a line for each; return 0, or 2 if one fails."""
    from evac.case.loading import load_case, run_plugin_files
    from evac.conformance import check_plugin, tried_in
    from evac.contract.registry import Registry

    registry, status = Registry([*others, file]), 0
    case = None if case_name is None else run_plugin_files(load_case(case_name, registry=registry))
    provided = list(registry.provided_by(Path(file).resolve()))
    for kind, name in provided:
        title = f"{kind.replace('_', ' ')} {name}"
        if kind == "case":
            say(f"{title}: is checked by: evac check {registry.get(kind, name)}")
            continue
        if kind == "hook":
            say(f"{title}: its arguments are valid; what it does is checked by a run: evac run CASE --plugin {file}")
            continue
        try:
            check_plugin(registry.get(kind, name), case)
        except EvacError as error:
            note(f"evac: {error}")
            status = BAD_INPUT
        else:
            more = (
                "" if case else "; with --case CASE, what runs in that case, and what has no effect there, is said too"
            )
            say(f"{title}: all checks passed{more}")
    if case is not None and not status:
        for line in tried_in(case, [(kind, name) for kind, name in provided if kind not in ("case", "hook")]):
            say(line.replace("_", " ", line.partition(" ")[0].count("_")))
    return status


def _show(item: dict[str, Any], plugin: Any) -> None:
    """Print one plugin with its parameters; with its whole description if `plugin` is given."""
    has_text = inspect.isclass(plugin) and plugin.__doc__
    doc = (inspect.getdoc(plugin) or "") if has_text else item["doc"]
    first, *others = JOINED.sub(" ", doc).split("\n")
    say(f"  {item['kind'].replace('_', ' ')} {item['name']}: {first}", indent=4)
    for line in others:
        say(line, indent=len(line) - len(line.lstrip(" -")))
    for name, parameter in item["parameters"].items():
        allowed = f" ({parameter['range']})" if parameter["range"] else ""
        value = f"{name} = {shown(parameter['default'])} {parameter['unit']}".rstrip()
        say(f"    {value}{allowed}: {parameter['doc']}", indent=8)


ACTIONS = {
    "show": "show the folder and its content (the default)",
    "compile": "compile all kernels of evac and of its plugins that are not in the folder",
    "clear": "remove all compiled kernels from the folder",
}


def declare_schema(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac schema`."""
    parser.add_argument("of", choices=("case", "plan"), help="case.toml or plan files")
    declare_plugin(parser)


def execute_schema(arguments: argparse.Namespace) -> int:
    """Print the JSON schema of case.toml or of plan files, with which text editors complete and check keys.

    The schema of a case has the parameters of all registered plugins. For a text editor, write it to a file:
    `evac schema case > case.schema.json`.
    """
    from evac.case.jsonschema import case_schema, plan_schema
    from evac.contract.registry import Registry

    schema = case_schema(Registry(arguments.plugins)) if arguments.of == "case" else plan_schema()
    print(json.dumps(schema, indent=1, ensure_ascii=False))
    return 0


def declare_cache(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac cache`."""
    parser.set_defaults(action="show")
    actions = parser.add_subparsers(metavar="ACTION")
    for name, summary in ACTIONS.items():
        action = actions.add_parser(name, help=summary, description=f"evac cache {name}: {summary}.")
        action.set_defaults(action=name)
        if name == "compile":
            declare_plugin(action)


def execute_cache(arguments: argparse.Namespace) -> int:
    """Show, fill or clear the folder of compiled kernels.

    Kernels are compiled when they are first needed, and kept in the user's cache folder, or in EVAC_CACHE_DIR if it is
    set.
    """
    if arguments.action == "compile":
        _compile_all(arguments.plugins)
    elif arguments.action == "clear":
        from evac.jit.store import user_store

        store = user_store()
        if store:
            store.clear()
    _show_cache()
    return 0


def _compile_all(plugins: list[str]) -> None:
    from evac.contract.registry import Registry
    from evac.jit.loading import addresses_of

    with Display() as display:
        display.phase("importing all modules")
        Registry(plugins)
        addresses_of(all_entries(), display.compiling)


def _show_cache() -> None:
    """Print the folder, the number and size of kernels, and the versions and processor they are compiled for."""
    from evac.jit.loading import host
    from evac.jit.store import exposure, user_store, versions

    store = user_store()
    files = store.entries() if store else []
    sizes = [path.stat().st_size for path in files if path.exists()]
    problem = exposure(store.folder) if store and store.folder.is_dir() else ""
    show_facts(
        {
            "folder": store.folder if store else "none: there is no home folder, and EVAC_CACHE_DIR is not set",
            **({"not used": f"the folder {problem}"} if problem else {}),
            "compiled kernels": len(files),
            "size": f"{sum(sizes) / 1e6:.2f} MB",
            "compiled by": versions().rpartition(",")[0],
            "compiled for": host().name,
        }
    )


def all_entries() -> "list[Entry]":
    """Return the kernels that runs may need: those of evac except its commands, and of the imported plugins."""
    import evac
    from evac.jit.kernels import entries_of

    for module in pkgutil.walk_packages(evac.__path__, "evac."):
        if module.name.split(".")[1] not in ("__main__", "cli", "conformance", "evidence"):
            importlib.import_module(module.name)
    modules = [module for module in sys.modules.values() if isinstance(module, ModuleType)]
    entries = [entry for module in modules for entry in entries_of(module)]
    return sorted(dict.fromkeys(entries), key=lambda entry: entry.label)
