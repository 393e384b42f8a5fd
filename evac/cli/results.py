"""Arguments that name a result folder, and how its trajectory is read."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evac.trajectory.trajectory import Trajectory


def declare_result(parser: argparse.ArgumentParser) -> None:
    """Add RESULT to a command."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder or trajectory file")


def trajectory_of(arguments: argparse.Namespace) -> "Trajectory":
    """Read the trajectory of RESULT, or, with a note, of RESULT.running if the run has not ended.

    Raises
    ------
    ResultError
        As `evac.read_trajectory`.
    """
    from evac.cli.screen import show_warnings
    from evac.folder.resultfolder import check_result, find_result
    from evac.trajectory.trajectory import read_trajectory

    place = find_result(arguments.result)
    check_result(place)
    if place != arguments.result:
        print(
            f"evac: {arguments.result} does not exist yet; reading {place} of a run that has not ended", file=sys.stderr
        )
    trajectory = read_trajectory(place)
    show_warnings(trajectory.warnings)
    return trajectory
