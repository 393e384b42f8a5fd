"""evac map: draw maps of a run: density, speed, flow, waiting, time to clear, contact pressure, usage.

Each map is a picture with the plans of all storeys. Also works during a run and after a run was killed.
"""

import argparse
from pathlib import Path

from evac.cli.inputs import declare_result, declare_service, maps_of, trajectory_of


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_result(parser)
    what = "density, max_density, speed, flow, waiting, time_to_clear, contact_pressure, usage (default: all)"
    parser.add_argument("--of", metavar="MAP,...", default="all", help=what)
    parser.add_argument("--level", metavar="NAME", action="append", help="only this level (may be repeated)")
    parser.add_argument("--from", dest="start", type=float, metavar="S", help="evaluate from this time on [s]")
    parser.add_argument("--to", dest="end", type=float, metavar="S", help="evaluate up to this time [s]")
    parser.add_argument("--spacing", type=float, metavar="M", help="width of the cells of the grid [m] (default: 0.2)")
    parser.add_argument("--kernel", type=float, metavar="M", help="radius of the Gaussian kernel [m] (default: 0.7)")
    declare_service(parser)
    what = "folder, or file for a single map: .png, .jpg, .svg or .pdf (default: RESULT/map_NAME.png)"
    parser.add_argument("--out", type=Path, metavar="PATH", help=what)


def execute(arguments: argparse.Namespace) -> int:
    """Draw the maps and print the paths of the files."""
    from evac.analysis.maps import KERNEL_RADIUS, SPACING, level_maps
    from evac.base.errors import ResultError

    quantities = maps_of("--of", arguments.of)
    trajectory = trajectory_of(arguments)
    maps = level_maps(
        trajectory,
        arguments.level,
        spacing=SPACING if arguments.spacing is None else arguments.spacing,
        kernel_radius=KERNEL_RADIUS if arguments.kernel is None else arguments.kernel,
        start=arguments.start,
        end=arguments.end,
    )
    from evac.pictures.map_pictures import FORMATS, write_maps

    out = arguments.out or trajectory.path.parent
    if out.suffix and not out.is_dir() and (out.suffix.lower() not in FORMATS or len(quantities) > 1):
        advice = "several maps need a folder" if len(quantities) > 1 else f"use {', '.join(FORMATS)}, or a folder"
        raise ResultError(f"{out}: cannot draw to this file; {advice}")
    for path in write_maps(trajectory, maps, quantities, out, arguments.level, arguments.service):
        print(path)
    return 0
