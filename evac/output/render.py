"""Pictures and films of a trajectory, drawn off screen."""

import importlib.util
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evac.errors import ResultError
from evac.output.files import writing
from evac.output.scene import COLOURS, Scene
from evac.output.trajectory import Trajectory

PICTURES = (".png", ".jpg", ".jpeg")
FILMS = (".gif", ".mp4")


def render_picture(
    trajectory: Trajectory,
    path: Path,
    time: float | None = None,
    size: tuple[int, int] = (1600, 1200),
    stretch: float | None = None,
    colour_by: str = "group",
) -> None:
    """Draw the frame nearest to `time` [s], by default the one in the middle of the run, to a PNG or JPEG file.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
    time : float, optional
    size : tuple of int
        Width and height [pixels].
    stretch : float, optional
        Factor on heights that pulls storeys apart; by default as much as it takes to look into each.
    colour_by : str
        ``"group"`` or ``"speed"``.

    Raises
    ------
    ResultError
        The trajectory has no frame, or none at that time, the file's ending is unknown, `stretch` is not greater
        than 0, or the file cannot be written.
    """
    _check(trajectory, path, PICTURES, colour_by, stretch)
    first, last = float(trajectory.time[0]), float(trajectory.time[-1])
    if time is not None and not first <= time <= last:
        raise ResultError(
            f"{trajectory.path}: no picture of t = {time:g} s; it was recorded from {first:g} to {last:g} s"
        )
    middle = 0.5 * last
    scene = Scene(trajectory, size, stretch, colour_by)
    try:
        image = scene.show(trajectory.nearest(middle if time is None else time))
    finally:
        scene.close()
    with writing("the picture", path):
        Image.fromarray(image).save(path)


def render_animation(
    trajectory: Trajectory,
    path: Path,
    fps: float = 10.0,
    speed: float = 5.0,
    size: tuple[int, int] = (960, 720),
    stretch: float | None = None,
    colour_by: str = "group",
) -> None:
    """Draw the whole run to an animated GIF, or to an MP4 film where imageio-ffmpeg is installed.

    Parameters
    ----------
    trajectory, path, size, stretch, colour_by
        As for `render_picture`; width and height of an MP4 film must be even.
    fps : float
        Pictures per second of the film.
    speed : float
        Simulated seconds per second of the film; each picture shows the nearest recorded frame.

    Raises
    ------
    ResultError
        The trajectory has no frame, `fps` or `speed` is not positive, the file's ending is unknown, an MP4
        film is asked for without imageio-ffmpeg, or the file cannot be written.
    """
    _check(trajectory, path, FILMS, colour_by, stretch)
    if not (fps > 0 and speed > 0):
        raise ResultError(f"fps and speed of a film must be greater than 0, got {fps} and {speed}")
    if path.suffix == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ResultError(f"{path}: an MP4 film needs imageio-ffmpeg (pip install imageio-ffmpeg); or ask for a .gif")
    count = 1 + math.ceil(float(trajectory.time[-1]) * fps / speed)
    chosen = [trajectory.nearest(k * speed / fps) for k in range(count)]
    scene = Scene(trajectory, size, stretch, colour_by)
    write = _write_gif if path.suffix == ".gif" else _write_mp4
    try:
        with writing("the film", path):
            write(path, (scene.show(k) for k in chosen), fps)
    finally:
        scene.close()


def _check(trajectory: Trajectory, path: Path, endings: tuple[str, ...], colour_by: str, stretch: float | None) -> None:
    if not len(trajectory):
        raise ResultError(f"{trajectory.path}: no frame to draw; the run ended before its first output")
    if path.suffix not in endings:
        raise ResultError(f"{path}: unknown ending {path.suffix!r}; use {' or '.join(endings)}")
    if colour_by not in COLOURS:
        raise ResultError(f"people cannot be coloured by {colour_by!r}; use {' or '.join(COLOURS)}")
    if stretch is not None and not 0.0 < stretch < math.inf:
        raise ResultError(
            f"heights cannot be stretched by {stretch:g}: the factor must be greater than 0; 1 draws them true"
        )


def _write_gif(path: Path, images: Iterator[NDArray[np.uint8]], fps: float) -> None:
    """Write with one palette for all pictures, so that nothing flickers; legend and scale bring in every colour."""
    first = Image.fromarray(next(images)).quantize(255, Image.Quantize.MAXCOVERAGE, 2, dither=Image.Dither.NONE)
    rest = (Image.fromarray(image).quantize(palette=first, dither=Image.Dither.NONE) for image in images)
    first.save(path, save_all=True, append_images=rest, duration=1000.0 / fps, loop=0)


def _write_mp4(path: Path, images: Iterator[NDArray[np.uint8]], fps: float) -> None:
    film: Any = imageio.get_writer(path, format="FFMPEG", fps=fps, macro_block_size=2)
    with film:
        for image in images:
            film.append_data(image)
