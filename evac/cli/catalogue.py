"""evac list: list the cases shipped with evac and with installed plugins."""

import argparse
import tomllib
from pathlib import Path

from evac.base.errors import ScenarioError
from evac.cli.inputs import declare_plugin
from evac.cli.screen import show_facts, show_table


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Print name and title of each case, and where their folders are."""
    from evac.contract.registry import Registry, built_in

    cases = Registry(arguments.plugins, builtins=built_in("case")).cases
    show_table("Cases", ("name", "title"), [(name, _title(path)) for name, path in cases.items()])
    for number, parent in enumerate(dict.fromkeys(path.parent for path in cases.values())):
        show_facts({"" if number else "folders in": parent})
    return 0


def _title(folder: Path) -> str:
    path = folder / "case.toml"
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}; correct the file or remove its plugin") from error
