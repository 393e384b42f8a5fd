"""evac render: draw a picture and a film of a run, off screen.

Works on a run that goes on, and on what is left of a killed one, as well.
"""

import argparse
import sys
from pathlib import Path

from evac.cli.results import declare_result, trajectory_of
from evac.output.files import FILM_NAME, PICTURE_NAME


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_result(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        nargs="+",
        help="what to draw: .png or .jpg a picture, .gif or .mp4 a film (default: picture.png and film.gif in RESULT)",
    )
    parser.add_argument("--time", type=float, metavar="S", help="time of the picture [s] (default: half of the run)")
    parser.add_argument("--fps", type=float, default=10.0, metavar="N", help="pictures per second of the film (10)")
    parser.add_argument("--speed", type=float, default=5.0, metavar="N", help="simulated seconds per second (5)")
    parser.add_argument("--stretch", type=float, metavar="N", help="factor on heights (default: to look into storeys)")
    parser.add_argument("--colour-by", choices=("group", "speed"), default="group", help="what colours mean (group)")


def execute(arguments: argparse.Namespace) -> int:
    """Draw each file asked for."""
    from evac.cli.screen import show_warnings
    from evac.output.render import FILMS, render_animation, render_picture
    from evac.output.scene import LEGEND_GROUPS

    trajectory = trajectory_of(arguments)
    groups = len(trajectory.groups)
    if arguments.colour_by == "group" and groups > LEGEND_GROUPS:
        show_warnings([f"{groups} groups share fewer colours, so the picture has no legend; --colour-by speed has one"])
    look = {"stretch": arguments.stretch, "colour_by": arguments.colour_by}
    for path in arguments.out or [trajectory.path.parent / name for name in (PICTURE_NAME, FILM_NAME)]:
        print(f"drawing {path}", file=sys.stderr, flush=True)
        if path.suffix in FILMS:
            render_animation(trajectory, path, fps=arguments.fps, speed=arguments.speed, **look)
        else:
            render_picture(trajectory, path, time=arguments.time, **look)
    return 0
