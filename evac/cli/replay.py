"""evac replay: write the replay of a run, a page for the browser.

Every run writes replay.html unless output.replay is false. This command writes it from a recorded trajectory, also of
a killed run, to another place or with fewer states.
"""

import argparse
from pathlib import Path

from evac.cli.inputs import declare_result, trajectory_of
from evac.folder.files import REPLAY_NAME


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_result(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="the page (default: replay.html in RESULT)")
    what = "time between two states [s] (default: all that were recorded)"
    parser.add_argument("--every", type=float, metavar="S", help=what)


def execute(arguments: argparse.Namespace) -> int:
    """Write the page."""
    from evac.replay.writer import replay_trajectory

    trajectory = trajectory_of(arguments)
    path = arguments.out or trajectory.path.parent / REPLAY_NAME
    frames = replay_trajectory(trajectory, path, arguments.every)
    print(f"{frames} states up to {trajectory.time[-1]:.2f} s, {path.stat().st_size / 1000:.0f} kB in {path}")
    return 0
