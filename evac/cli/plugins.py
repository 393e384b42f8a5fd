"""evac plugins: list all registered plugins, describe one of them, or check a plugin file.

`evac plugins --check FILE` applies the checks of `evac.conformance.check_plugin` to everything in a plugin file, and
ends with status 2 if one of them fails.
"""

import argparse
import inspect
import re
from pathlib import Path
from typing import Any

from evac.cli.inputs import declare_plugin
from evac.cli.screen import say, shown
from evac.cli.streams import note

#: Ends of lines within a paragraph or an item of a list of a docstring, whose formulas are indented farther.
JOINED = re.compile(r"(?<=[^\s-])\n {0,2}(?=[^\s-])")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="model, behaviour or other plugin to describe")
    parser.add_argument("--check", metavar="FILE", help="check everything in a plugin file")
    parser.add_argument("--verbose", action="store_true", help="show all parameters with their units and defaults")
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Print the origin of each plugin and what it provides, or only what has the given name; or check a file."""
    if arguments.check is not None:
        return _check(arguments.check, arguments.plugins)
    from evac.base.errors import PluginError
    from evac.base.parameters import did_you_mean
    from evac.contract.registry import Registry

    registry = Registry(arguments.plugins)
    entries = registry.describe()
    names = [item["name"] for entry in entries for item in entry["provides"]]
    if arguments.name is not None and arguments.name not in names:
        hint = did_you_mean(arguments.name, names)
        raise PluginError(f"no plugin is named {arguments.name!r}; {hint}")
    if arguments.name is None and not arguments.verbose:
        for entry in entries:
            told = f"  ({entry['source']}, {entry['origin']} {entry['version']})"
            for item in entry["provides"]:
                doc = item["doc"].partition(". ")[0].rstrip(".") + ("" if entry["origin"] == "built-in" else told)
                say(f"{item['kind'].replace('_', ' ')} {item['name']}: {doc}", 1)
        return 0
    for entry in entries:
        items = [item for item in entry["provides"] if arguments.name in (None, item["name"])]
        if items or arguments.name is None:
            where = f"{entry['source']}, {entry['origin']} {entry['version']}"
            say(f"{entry['plugin']}  ({where})", is_bold=True)
        for item in items:
            _show(item, None if arguments.name is None else registry.get(item["kind"], item["name"]))
    return 0


def _check(file: str, others: list[str]) -> int:
    """Check all plugins in a file and print a line for each; return 0, or 2 if a check has failed.

    Files given with --plugin are registered first, so that names that they take are refused.
    """
    from evac.base.errors import EvacError
    from evac.cli.main import BAD_INPUT
    from evac.conformance import check_plugin
    from evac.contract.registry import Registry

    registry, status = Registry([*others, file]), 0
    for kind, name in registry.provided_by(Path(file).resolve()):
        title = f"{kind.replace('_', ' ')} {name}"
        if kind == "case":
            say(f"{title}: is checked by: evac check {registry.get(kind, name)}")
            continue
        if kind == "hook":
            say(f"{title}: its arguments are valid; what it does is checked by a run: evac run CASE --plugin {file}")
            continue
        try:
            check_plugin(registry.get(kind, name))
        except EvacError as error:
            note(f"evac: {error}")
            status = BAD_INPUT
        else:
            say(f"{title}: all checks passed")
    return status


def _show(item: dict[str, Any], plugin: Any) -> None:
    """Print one plugin with its parameters; with its whole description if `plugin` is given."""
    has_text = inspect.isclass(plugin) and plugin.__doc__
    doc = (inspect.getdoc(plugin) or "") if has_text else item["doc"]
    first, *others = JOINED.sub(" ", doc).split("\n")
    say(f"  {item['kind'].replace('_', ' ')} {item['name']}: {first}", indent=4)
    for line in others:
        say(line, indent=len(line) - len(line.lstrip(" -")))
    for name, one in item["parameters"].items():
        allowed = f" ({one['range']})" if one["range"] else ""
        say(f"    {name} = {shown(one['default'])} {one['unit']}".rstrip() + f"{allowed}: {one['doc']}", indent=8)
