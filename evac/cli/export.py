"""evac export: write what a run recorded in another format.

Works on a run that goes on, and on what is left of a killed one, as well.
"""

import argparse
from pathlib import Path

from evac.cli.results import declare_result, trajectory_of


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_result(parser)
    parser.add_argument("--vtk", action="store_true", required=True, help="as a VTK animation for ParaView (.pvd)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to (default: the result folder)")


def execute(arguments: argparse.Namespace) -> int:
    """Write animation.pvd and its files."""
    from evac.output.vtk_export import export_vtk

    trajectory = trajectory_of(arguments)
    path = export_vtk(trajectory, arguments.out or trajectory.path.parent)
    print(f"{len(trajectory)} frames up to {trajectory.time[-1]:.2f} s in {path}")
    return 0
