"""Arguments that name a case or a result folder, and how these are read."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.base.errors import ResultError, ScenarioError
from evac.cli.screen import note, show_warnings

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.trajectory.trajectory import Trajectory


def declare_case(parser: argparse.ArgumentParser, metavar: str = "CASE") -> None:
    """Add CASE, --set, --seed and --plugin to a command."""
    parser.add_argument("case", metavar=metavar, help="a case.toml, a folder that contains one, or a shipped case")
    declare_set(parser, "change keys of the case, such as simulation.duration=60 people.class_1.number=5")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers (simulation.seed)")
    declare_plugin(parser)


def declare_set(parser: argparse.ArgumentParser, what: str, metavar: str = "KEY=VALUE", option: str = "--set") -> None:
    """Add --set, or another option with such values, to a command."""
    dest = option.lstrip("-")
    parser.add_argument(option, dest=dest, metavar=metavar, nargs="+", action="extend", default=[], help=what)


def values_of(option: str, words: list[str]) -> dict[str, Any]:
    """Return values given to an option as NAME=VALUE."""
    if not words:
        return {}
    from evac.case.overrides import parsed

    pairs, faults = parsed(words)
    if faults:
        raise ScenarioError(f"{option} {faults[0].key[0]}: {faults[0].text}")
    return dict(pairs)


def declare_plugin(parser: argparse.ArgumentParser) -> None:
    """Add --plugin to a command."""
    what = "a Python file with a plugin, in addition to installed plugins (may be repeated)"
    parser.add_argument("--plugin", dest="plugins", metavar="FILE", action="append", default=[], help=what)


def declare_result(parser: argparse.ArgumentParser) -> None:
    """Add RESULT to a command."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder or trajectory file")


def declare_service(parser: argparse.ArgumentParser) -> None:
    """Add --service to a command."""
    what = "colour densities by the levels of service of Fruin or of Weidmann"
    parser.add_argument("--service", choices=("fruin", "weidmann"), default="", help=what)


def positive(text: str) -> int:
    """Parse a whole number, at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError("must be a whole number, at least 1")
    return int(text)


def maps_of(option: str, words: str) -> tuple[str, ...]:
    """Return the names of maps given to an option, separated by commas, or of all maps."""
    from evac.analysis.maps import QUANTITIES
    from evac.base.parameters import did_you_mean

    names = tuple(QUANTITIES) if words == "all" else tuple(words.split(","))
    for name in names:
        if name not in QUANTITIES:
            raise ResultError(f"{option} {name}: there is no such map; {did_you_mean(name, list(QUANTITIES))}")
    return names


def case_of(arguments: argparse.Namespace) -> "Case":
    """Load the case named by the arguments; plugin files named in the case are not executed."""
    from evac.case.loading import load_case

    overrides = list(arguments.set)
    for override in overrides:
        shown = override.encode("utf-8", "backslashreplace").decode()
        if shown != override:
            raise ScenarioError(f"--set {shown}: not valid text in the encoding of this system; use UTF-8")
    if arguments.seed is not None:
        overrides.append(f"simulation.seed={arguments.seed}")
    return load_case(arguments.case, overrides, arguments.plugins)


def case_to_run(arguments: argparse.Namespace) -> "Case":
    """Load the case named by the arguments and execute its plugin files, see `with_plugin_files`."""
    return with_plugin_files(case_of(arguments))


def with_plugin_files(case: "Case") -> "Case":
    """Execute the plugin files named in a case, which must be in its folder, and print their paths."""
    from evac.case.loading import run_plugin_files

    return run_plugin_files(case, announce_plugin_file)


def announce_plugin_file(path: Path) -> None:
    """Print the path of a plugin file of the case before it is executed."""
    note(f"running plugin file of the case: {path}")


def default_folder(case: "Case", what: str = "result") -> Path:
    """Return the default result folder, ``./CASE-result``, or with another word at its end."""
    return Path(f"{case.name}-{what}")


def trajectory_of(arguments: argparse.Namespace) -> "Trajectory":
    """Read the trajectory of RESULT, or, with a note, of RESULT.running if the run has not ended."""
    from evac.folder.resultfolder import check_result, find_result
    from evac.trajectory.trajectory import read_trajectory

    place = find_result(arguments.result)
    check_result(place)
    if place != arguments.result:
        note(f"evac: {arguments.result} does not exist yet; reading {place} of a run that has not ended")
    trajectory = read_trajectory(place)
    show_warnings(trajectory.warnings)
    return trajectory
