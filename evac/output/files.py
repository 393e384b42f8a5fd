"""The files of a result folder: what each is called, and what is said where one cannot be written."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evac.errors import ResultError

TRAJECTORY_NAME = "trajectory.evac"
SUMMARY_NAME = "summary.json"
EGRESS_NAME = "egress.csv"
EGRESS_PICTURE_NAME = "egress.png"
PEOPLE_NAME = "people.csv"
RUNS_NAME = "runs.csv"
RUNS_STREAM_NAME = "runs.arrows"
RUNS_PARQUET_NAME = "runs.parquet"
STATISTICS_NAME = "statistics.csv"
CONVERGENCE_NAME = "convergence.csv"
SWEEP_PICTURE_NAME = "statistics.png"
STUDY_NAME = "study.json"
CHECKPOINT_NAME = "checkpoint.evac"
REPLAY_NAME = "replay.html"
MEDIAN_REPLAY_NAME = "replay-median.html"
WORST_REPLAY_NAME = "replay-worst.html"
ANIMATION_NAME = "animation.pvd"
BUILDING_NAME = "building.vtm"
BUILDING_FOLDER = "building"
FRAMES_FOLDER = "frames"

#: Pattern of the files of single frames, see `frame_name`.
FRAMES = f"{FRAMES_FOLDER}/frame_*.vtp"

#: Pattern of the files of the parts of a building.
BUILDING_PARTS = f"{BUILDING_FOLDER}/*.vtp"

#: Where `evac export` writes if no place is named, and the patterns of what it writes there.
EXPORT_FOLDER = "export"
EXPORTS = (f"{EXPORT_FOLDER}/*.*", f"{EXPORT_FOLDER}/*/*.*")

#: Pattern of the pictures of maps, see `map_name`.
MAPS = "map_*.png"

#: What `evac render` draws if nothing else is named.
PICTURE_NAME = "picture.png"
FILM_NAME = "film.gif"

#: Key of a summary that lists the files of plugins, relative to the folder.
PLUGIN_FILES = "plugin_files"

#: What a run writes to its folder, besides files of plugins, which its summary lists.
WRITTEN = (
    EGRESS_NAME,
    EGRESS_PICTURE_NAME,
    PEOPLE_NAME,
    RUNS_NAME,
    RUNS_STREAM_NAME,
    RUNS_PARQUET_NAME,
    "runs.new",
    STATISTICS_NAME,
    CONVERGENCE_NAME,
    SWEEP_PICTURE_NAME,
    REPLAY_NAME,
    MEDIAN_REPLAY_NAME,
    WORST_REPLAY_NAME,
    ANIMATION_NAME,
    BUILDING_NAME,
    BUILDING_PARTS,
    FRAMES,
    MAPS,
    *EXPORTS,
    PICTURE_NAME,
    FILM_NAME,
    STUDY_NAME,
    f"{CHECKPOINT_NAME}.new",
    CHECKPOINT_NAME,
    SUMMARY_NAME,  # these two last: while one is there, the folder is known to be evac's
    TRAJECTORY_NAME,
)


def frame_name(k: int) -> str:
    """Return the file of frame `k` of the VTK animation, relative to the result folder."""
    return FRAMES.replace("*", f"{k:05d}")


def map_name(quantity: str) -> str:
    """Return the picture of the map of a quantity, relative to the result folder."""
    return MAPS.replace("*", quantity)


def sync_file(path: Path) -> None:
    """See that a file is on the disk as the system has it now."""
    _sync(path, os.O_RDWR)


def sync_folder(folder: Path) -> None:
    """See that names and renames in a folder are on the disk, where the system lets one ask for it."""
    if os.name != "nt":
        _sync(folder, os.O_RDONLY)


def _sync(path: Path, mode: int) -> None:
    descriptor = os.open(path, mode)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def writing(what: str, place: Path) -> Iterator[None]:
    """Say what cannot be written, and where, if the system refuses.

    Parameters
    ----------
    what : str
        Such as ``"the results"``.
    place : Path
        File or folder.

    Raises
    ------
    ResultError
        In place of any OSError.
    """
    try:
        yield
    except OSError as error:
        raise ResultError(f"{place}: cannot write {what}: {error}; mend that or write somewhere else") from error
