"""evac plugins: list all registered plugins with their parameters, units and defaults."""

import argparse

from evac.cli.cases import declare_plugin
from evac.cli.screen import console, show_table, shown


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Print the origin of each plugin and what it provides."""
    from evac.registry import Registry

    for entry in Registry(arguments.plugins).describe():
        console().print(f"{entry['plugin']}  ({entry['source']}, {entry['origin']} {entry['version']})", style="bold")
        for item in entry["provides"]:
            console().print(f"  {item['kind'].replace('_', ' ')} {item['name']}: {item['doc']}")
            rows = [
                (f"    {name}", shown(parameter["default"]), parameter["unit"], parameter["range"], parameter["doc"])
                for name, parameter in item["parameters"].items()
            ]
            if rows:
                show_table("", ("    parameter", "default", "unit", "allowed", "meaning"), rows)
    return 0
