"""Arguments that name a case, and how it is loaded."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evac.case.case import Case


def declare_case(parser: argparse.ArgumentParser, metavar: str = "CASE") -> None:
    """Add CASE, --set, --seed and --plugin to a command."""
    parser.add_argument("case", metavar=metavar, help="a case.toml, a folder that holds one, or a shipped case")
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        nargs="+",
        action="extend",
        default=[],
        help="change keys of the case, such as simulation.duration=60 people.class_1.number=5",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers (simulation.seed)")
    declare_plugin(parser)


def declare_plugin(parser: argparse.ArgumentParser) -> None:
    """Add --plugin to a command."""
    parser.add_argument(
        "--plugin",
        dest="plugins",
        metavar="FILE",
        action="append",
        default=[],
        help="a Python file with a plugin, in addition to installed plugins (may be repeated)",
    )


def case_of(arguments: argparse.Namespace) -> "Case":
    """Load the case named by the arguments; plugin files named in the case are not executed.

    Raises
    ------
    ScenarioError, PluginError
        As `evac.load`.
    """
    from evac.base.errors import ScenarioError
    from evac.case.loading import load_case

    overrides = list(arguments.overrides)
    for override in overrides:
        shown = override.encode("utf-8", "backslashreplace").decode()
        if shown != override:
            raise ScenarioError(f"--set {shown}: not valid text in the encoding of this system; use UTF-8")
    if arguments.seed is not None:
        overrides.append(f"simulation.seed={arguments.seed}")
    case = arguments.loaded = load_case(arguments.case, overrides, arguments.plugins)
    return case


def note_unused_plugins(case: "Case") -> None:
    """Print a note for each plugin file in addition to the case none of whose models and behaviours the case uses."""
    from evac.case.trust import unused_files

    for path, tables in unused_files(case):
        print(f"note: plugin {path} is not used by the case: add {' or '.join(tables)}", file=sys.stderr)


def loaded_case(arguments: argparse.Namespace | None) -> "Case | None":
    """Return the case that `case_of` has loaded; None if there is none."""
    return getattr(arguments, "loaded", None)


def case_to_run(arguments: argparse.Namespace) -> "Case":
    """Load the case named by the arguments and execute its plugin files, see `with_plugin_files`."""
    return with_plugin_files(case_of(arguments))


def with_plugin_files(case: "Case") -> "Case":
    """Execute the plugin files named in a case, which must be in its folder, and print their paths.

    Raises
    ------
    ScenarioError, PluginError
        As `evac.case.trust.run_plugin_files`.
    """
    from evac.case.trust import run_plugin_files

    return run_plugin_files(case, announce_plugin_file)


def announce_plugin_file(path: Path) -> None:
    """Print the path of a plugin file of the case before it is executed."""
    print(f"running plugin file of the case: {path}", file=sys.stderr)


def default_folder(case: "Case") -> Path:
    """Return the default result folder: ``./CASE-result``."""
    name = case.folder.name if case.source.name == "case.toml" else case.source.stem
    return Path(f"{name}-result")
