"""evac export: write a recorded run in the format of another program.

Also works during a run and after a run was killed. Formats are plugins: `evac plugins` lists them.
"""

import argparse
from pathlib import Path

from evac.base.errors import counted
from evac.cli.inputs import declare_plugin, declare_result, declare_set, trajectory_of, values_of
from evac.cli.streams import note


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_result(parser)
    what = "vtk (default), jupedsim, csv, parquet, geojson, or from a plugin"
    parser.add_argument("--to", default="vtk", metavar="FORMAT", help=what)
    what = "file, or folder for formats with several files (default: RESULT/export/..., for vtk RESULT)"
    parser.add_argument("--out", type=Path, metavar="PATH", help=what)
    declare_set(parser, "parameters of the exporter", "NAME=VALUE")
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Write the files and print the paths of those that a user opens."""
    from evac.contract.registry import Registry, built_in
    from evac.export.exporter import export

    registry = Registry(arguments.plugins, builtins=built_in("exporter"))
    exporter = registry.get("exporter", arguments.to)(**values_of("--set", arguments.set))
    trajectory = trajectory_of(arguments)
    for path in export(trajectory, exporter, arguments.out):
        print(path)
    if len(trajectory):
        note(f"{counted(len(trajectory), 'frame')} up to {trajectory.time[-1]:.2f} s")
    return 0
