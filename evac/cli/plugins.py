"""evac plugins: list all registered plugins with their parameters, units and defaults, or describe one."""

import argparse
import inspect
from typing import Any

from evac.cli.cases import declare_plugin
from evac.cli.screen import console, show_table, shown


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="name of one model, behaviour or other plugin")
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Print the origin of each plugin and what it provides, or only what has the given name."""
    from evac.errors import PluginError
    from evac.parameters import did_you_mean
    from evac.registry import Registry

    registry = Registry(arguments.plugins)
    entries = registry.describe()
    names = [item["name"] for entry in entries for item in entry["provides"]]
    if arguments.name is not None and arguments.name not in names:
        hint = did_you_mean(arguments.name, names)
        raise PluginError(f"no plugin is named {arguments.name!r}; {hint}")
    for entry in entries:
        items = [item for item in entry["provides"] if arguments.name in (None, item["name"])]
        if items or arguments.name is None:
            where = f"{entry['source']}, {entry['origin']} {entry['version']}"
            console().print(f"{entry['plugin']}  ({where})", style="bold")
        for item in items:
            _show(item, None if arguments.name is None else registry.get(item["kind"], item["name"]))
    return 0


def _show(item: dict[str, Any], plugin: Any) -> None:
    """Print one plugin with its parameters; with its whole description if `plugin` is given."""
    has_text = inspect.isclass(plugin) and plugin.__doc__
    doc = inspect.getdoc(plugin) if has_text else item["doc"]
    console().print(f"  {item['kind'].replace('_', ' ')} {item['name']}: {doc}")
    rows = [
        (f"    {name}", shown(parameter["default"]), parameter["unit"], parameter["range"], parameter["doc"])
        for name, parameter in item["parameters"].items()
    ]
    if rows:
        show_table("", ("    parameter", "default", "unit", "allowed", "meaning"), rows)
