"""evac cache: show, fill or clear the folder of compiled kernels.

Kernels are compiled when they are first needed, and kept in the user's cache folder, or in EVAC_CACHE_DIR if it is set.
"""

import argparse
import importlib
import json
import pkgutil
import sys
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evac.jit import Entry

ACTIONS = {
    "show": "show the folder and its content (the default)",
    "compile": "compile all kernels of evac and of its plugins that are not in the folder",
    "clear": "remove all compiled kernels from the folder",
}


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.set_defaults(action="show")
    actions = parser.add_subparsers(metavar="ACTION")
    for name, summary in ACTIONS.items():
        action = actions.add_parser(name, help=summary, description=f"evac cache {name}: {summary}.")
        action.set_defaults(action=name)
        if name == "compile":
            from evac.cli.inputs import declare_plugin

            declare_plugin(action)


def execute(arguments: argparse.Namespace) -> int:
    """Execute the action and return 0."""
    if arguments.action == "compile":
        _compile(arguments.plugins)
    elif arguments.action == "clear":
        from evac.jit.store import user_store

        store = user_store()
        if store:
            store.clear()
    _show()
    return 0


def _compile(plugins: list[str]) -> None:
    from evac.base.display import Display
    from evac.contract.registry import Registry
    from evac.jit.loading import addresses_of

    with Display() as display:
        display.phase("importing all modules")
        Registry(plugins)
        addresses_of(all_entries(), display.compiling)


def _show() -> None:
    """Print the folder, the number and size of kernels, and the versions and processor they are compiled for."""
    from evac.cli.screen import show_facts
    from evac.jit.digest import versions
    from evac.jit.processor import host
    from evac.jit.store import exposure, user_store

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
            "kernels in the wheel": _shipped(),
        }
    )


def _shipped() -> str:
    """Return the number of kernels in the wheel, and whether they are used."""
    from evac.jit.digest import versions
    from evac.jit.loading import SHIPPED
    from evac.jit.processor import generic, missing_features

    kernels = len(SHIPPED.entries())
    if not kernels:
        return "none"
    about = json.loads((SHIPPED.folder / "about.json").read_text(encoding="utf-8"))
    text = f"{kernels} for {about['processor']}"
    if about["triple"] != generic().triple:
        return f"{text}, not used: they are for {about['triple']}"
    if about["versions"] != versions():
        return f"{text}, not used: they were compiled by {about['versions'].rpartition(',')[0]}"
    if missing_features():
        return f"{text}, not used: this processor has no {', '.join(missing_features())}"
    return f"{text}, used"


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
