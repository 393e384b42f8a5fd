"""evac render: draw a picture and a film of a run, off screen.

Also works during a run and after a run was killed.
"""

import argparse
import sys
from pathlib import Path

from evac.cli.inputs import declare_result, declare_service, trajectory_of
from evac.folder.files import FILM_NAME, PICTURE_NAME

#: Width and height of pictures and of films [pixels].
PICTURE_SIZE, FILM_SIZE = (1600, 1200), (960, 720)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_result(parser)
    what = "file to write: picture (.png, .jpg) or film (.gif, .mp4) (default: picture.png and film.gif in RESULT)"
    parser.add_argument("--out", type=Path, metavar="FILE", nargs="+", help=what)
    what = "oblique view, or view from above (default: 3d)"
    parser.add_argument("--view", choices=("3d", "plan"), default="3d", help=what)
    parser.add_argument("--level", metavar="NAME", action="append", help="only this level (may be repeated)")
    shown = ("group", "speed", "density", "contact_force", "waiting", "dose", "extinction", "visibility")
    what = f"what the colours of people show: {', '.join(shown)} (default: group)"
    parser.add_argument("--colour-by", metavar="QUANTITY", choices=shown, default="group", help=what)
    declare_service(parser)
    parser.add_argument("--time", type=float, metavar="S", help="time of the picture [s] (default: half of the run)")
    parser.add_argument("--fps", type=float, default=10.0, metavar="N", help="frames per second (default: 10)")
    parser.add_argument("--speed", type=float, default=5.0, metavar="N", help="speed-up of the film (default: 5)")
    what = "width and height in pixels (default: picture 1600 1200, film 960 720)"
    parser.add_argument("--size", type=int, nargs=2, metavar=("W", "H"), help=what)
    camera = parser.add_argument_group("camera of the 3d view")
    camera.add_argument("--azimuth", type=float, metavar="DEG", help="direction of the camera, counterclockwise from x")
    camera.add_argument("--elevation", type=float, metavar="DEG", help="angle of the view above the horizontal")
    camera.add_argument("--stretch", type=float, metavar="N", help="factor for heights (default: shows all storeys)")
    camera.add_argument("--zoom", type=float, default=1.0, metavar="N", help="magnification (default: 1)")


def execute(arguments: argparse.Namespace) -> int:
    """Draw the requested files."""
    from evac.cli.screen import show_warnings
    from evac.pictures.camera import Camera
    from evac.pictures.colouring import LEGEND_GROUPS
    from evac.pictures.render import FILMS, Renderer, number_of_pictures, render_animation, render_picture

    camera = Camera(arguments.azimuth, arguments.elevation, arguments.stretch, arguments.zoom)
    trajectory = trajectory_of(arguments)
    number_of_pictures(trajectory, arguments.fps, arguments.speed)  # refused before anything is drawn
    groups = len(trajectory.groups)
    if arguments.colour_by == "group" and groups > LEGEND_GROUPS:
        show_warnings([f"no legend, because {groups} groups are too many for one; try --colour-by speed"])
    for path in arguments.out or [trajectory.path.parent / name for name in (PICTURE_NAME, FILM_NAME)]:
        print(f"drawing {path}", file=sys.stderr, flush=True)
        is_film = path.suffix in FILMS
        size = tuple(arguments.size) if arguments.size else FILM_SIZE if is_film else PICTURE_SIZE
        colours = arguments.colour_by, arguments.service
        renderer = Renderer(trajectory, size, arguments.view, camera, arguments.level, *colours)
        if is_film:
            render_animation(renderer, path, arguments.fps, arguments.speed)
        else:
            render_picture(renderer, path, arguments.time)
    return 0
