"""evac export: write what a run recorded in another format.

Works on what is left of a killed run as well.
"""

import argparse
from pathlib import Path


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder or trajectory file")
    parser.add_argument("--vtk", action="store_true", required=True, help="as a VTK animation for ParaView (.pvd)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to (default: the result folder)")


def execute(arguments: argparse.Namespace) -> int:
    """Write animation.pvd and its files."""
    from evac.cli.screen import show_warnings
    from evac.output.trajectory import read_trajectory
    from evac.output.vtk_export import export_vtk

    trajectory = read_trajectory(arguments.result)
    show_warnings(trajectory.warnings)
    path = export_vtk(trajectory, arguments.out or trajectory.path.parent)
    print(f"{len(trajectory)} frames up to {trajectory.time[-1]:.2f} s in {path}")
    return 0
