"""The files of a result folder: their names, and the error if one cannot be written."""

import errno
import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evac.base.errors import ResultError
from evac.folder.manifest import TEMPORARY, check_replaceable, note_written

TRAJECTORY_NAME = "trajectory.evac"

SUMMARY_NAME = "summary.json"
EGRESS_NAME = "egress.csv"
EGRESS_PICTURE_NAME = "egress.png"
PEOPLE_NAME = "people.csv"
CROSSINGS_NAME = "crossings.csv"
FLOWS_NAME = "flows.csv"
RUNS_NAME = "runs.csv"
RUNS_STREAM_NAME = "runs.arrows"
RUNS_PARQUET_NAME = "runs.parquet"
RUNS_DIGEST_NAME = "runs.digest"
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

#: Pattern of the files of the building after a change, see `building_name`.
BUILDINGS = "building_*.vtm"
BUILDING_FOLDER = "building"
FRAMES_FOLDER = "frames"

#: Pattern of the files of single frames, see `frame_name`.
FRAMES = f"{FRAMES_FOLDER}/frame_*.vtp"

#: Default folder of `evac export`.
EXPORT_FOLDER = "export"

#: Default files of `evac render`.
PICTURE_NAME = "picture.png"
FILM_NAME = "film.gif"

#: The report of `evac report`.
REPORT_NAME = "report.html"

#: Key of a summary that lists the files of plugins, relative to the folder.
PLUGIN_FILES = "plugin_files"


def frame_name(k: int) -> str:
    """Return the path of frame `k` of the VTK animation, relative to the result folder."""
    return FRAMES.replace("*", f"{k:05d}")


def building_name(k: int) -> str:
    """Return the path of the building in VTK format, in its initial state for k = 0 and after changes for others."""
    return BUILDINGS.replace("*", f"{k:05d}") if k else BUILDING_NAME


def map_name(quantity: str) -> str:
    """Return the path of the map of a quantity, relative to the result folder."""
    return f"map_{quantity}.png"


def sync_file(path: Path) -> None:
    """Flush the content of a file to the disk."""
    _sync(path, os.O_RDWR)


def sync_folder(folder: Path) -> None:
    """Flush the entries of a folder to the disk, if the system supports it."""
    if os.name != "nt":
        _sync(folder, os.O_RDONLY)


@contextmanager
def replacing(path: Path, what: str, is_synced: bool = True) -> Iterator[Path]:
    """Give a temporary path to write to; the file then replaces `path` as a whole, when it is on the disk.

    A link at `path` is replaced, not followed. If the code within fails, the file at `path` stays as it was. In a
    result folder, only files of evac are replaced, and the manifest gets the digest of those that are synchronised.
    """
    with writing(what, path):
        if path.is_dir() and not path.is_symlink():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        check_replaceable(path)
        new = path.with_name(f"{TEMPORARY}{secrets.token_hex(4)}{path.suffix}")
        note_written([path, new])
        try:
            new.touch(exist_ok=False)
            yield new
            if is_synced:
                sync_file(new)
                digest = hashlib.sha256(new.read_bytes()).hexdigest()
            os.replace(new, path)
        finally:
            new.unlink(missing_ok=True)
        if is_synced:
            sync_folder(path.parent)
            note_written([path], sha256=digest)


@contextmanager
def draft_in(folder: Path) -> Iterator[Path]:
    """Give a temporary folder in a folder, whose files then replace those of the same names; links are replaced."""
    draft = folder / f"{TEMPORARY}{secrets.token_hex(4)}"
    note_written([draft])
    draft.mkdir()
    try:
        yield draft
        for path in sorted(draft.rglob("*")):
            new = folder / path.relative_to(draft)
            if path.is_dir():
                if new.is_symlink():
                    raise NotADirectoryError(errno.ENOTDIR, "is a link", str(new))
                new.mkdir(exist_ok=True)
            else:
                check_replaceable(new)
                note_written([new])
                os.replace(path, new)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _sync(path: Path, mode: int) -> None:
    descriptor = os.open(path, mode)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def writing(what: str, place: Path) -> Iterator[None]:
    """Convert an OSError to a ResultError that names what cannot be written and where."""
    try:
        yield
    except OSError as error:
        remedy = "correct this, or write to another place"
        if error.errno == errno.EBADF:
            remedy = "a plugin has closed a file that it has not opened, correct or remove the plugin"
        raise ResultError(f"{place}: cannot write {what}: {error}; {remedy}") from error


def content_of(path: Path) -> bytes:
    """Return the content of a file; a pipe or a device, whose reading might not end, is an OSError."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "not a file")
    return path.read_bytes()
