"""The files of a result folder: their names, the manifest, and writing of each as a whole.

The manifest is the mark by which a folder and its files are evac's own. The first line names the format,
``{"evac": "manifest", "schema": 1, "version": VERSION}``; a file without it is not a manifest, whatever its name. Each
other line is a table in JSON: ``{"file": NAME}`` for a file that is written, relative to the folder,
``{"file": NAME, "sha256": DIGEST}`` when it is complete, or ``{"is": STATE, "of": RESULT}``. Only listed files are ever
replaced or removed. Lines are only added, so that a kill leaves a manifest that can be read.
"""

import errno
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import Any

from evac.base.errors import ResultError, check_regular

TRAJECTORY_NAME = "trajectory.evac"

SUMMARY_NAME = "summary.json"
EGRESS_NAME = "egress.csv"
EGRESS_PICTURE_NAME = "egress.png"
PEOPLE_NAME = "people.csv"
CROSSINGS_NAME = "crossings.csv"
FLOWS_NAME = "flows.csv"
RUNS_NAME = "runs.csv"
RUNS_STREAM_NAME = "runs.arrows"
STATISTICS_NAME = "statistics.csv"
SWEEP_PICTURE_NAME = "statistics.png"
STUDY_NAME = "study.json"
BUILDINGS_NAME = "buildings.json"
CHECKPOINT_NAME = "checkpoint.evac"
REPLAY_NAME = "replay.html"
ANIMATION_NAME = "animation.pvd"
BUILDING_NAME = "building.vtm"

BUILDING_FOLDER = "building"
FRAMES_FOLDER = "frames"


EXPORT_FOLDER = "export"  #: Default folder of `evac export`.

#: Default files of `evac render`.
PICTURE_NAME = "picture.png"
FILM_NAME = "film.gif"

REPORT_NAME = "report.html"  #: The report of `evac report`.

#: Name of the manifest, what its first line says, and the beginning of the names of files that are being written.
MANIFEST_NAME = "manifest.jsonl"
MARK = {"evac": "manifest", "schema": 1}
TEMPORARY = ".evac-"

RUNNING, COMPLETE = "running", "complete"  #: States of a folder: a run writes to it, or it is complete.


def frame_name(k: int) -> str:
    """Return the path of frame `k` of the VTK animation, relative to the result folder."""
    return f"{FRAMES_FOLDER}/frame_{k:05d}.vtp"


def building_name(k: int) -> str:
    """Return the path of the building in VTK format, in its initial state for k = 0 and after changes for others."""
    return f"building_{k:05d}.vtm" if k else BUILDING_NAME


def map_name(quantity: str) -> str:
    """Return the path of the map of a quantity, relative to the result folder."""
    return f"map_{quantity}.png"


def sync(path: Path) -> None:
    """Flush the content of a file, or the entries of a folder, which Windows does not support, to the disk."""
    is_folder = path.is_dir()
    if is_folder and os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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
                sync(new)
                digest = hashlib.sha256(new.read_bytes()).hexdigest()
            os.replace(new, path)
        finally:
            new.unlink(missing_ok=True)
        if is_synced:
            sync(path.parent)
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


@contextmanager
def writing(what: str, place: Path) -> Iterator[None]:
    """Convert an OSError to a ResultError that names what cannot be written and where."""
    try:
        yield
    except OSError as error:
        raise ResultError(f"{place}: cannot write {what}: {error}; correct this, or write to another place") from error


def content_of(path: Path) -> bytes:
    """Return the content of a file, see `check_regular`."""
    check_regular(path)
    return path.read_bytes()


@dataclass(frozen=True)
class Manifest:
    """What a manifest says."""

    files: dict[str, str] = field(default_factory=dict)  # SHA-256 of each file, or empty; names relative to the folder
    state: str = ""  # `RUNNING`, `COMPLETE`, or empty if there is no manifest
    result: str = ""  # name of the result folder to which the files belong


def read_manifest(folder: Path) -> Manifest:
    """Return what the manifest of a folder says; lines that are damaged are left out."""
    first, *lines = _text(folder).splitlines() or [""]
    files: dict[str, str] = {}
    state = result = ""
    if not _table(first).items() >= MARK.items():
        return Manifest()
    for table in map(_table, lines):
        if isinstance(name := table.get("file"), str):
            files[name] = str(table.get("sha256", ""))
        elif isinstance(table.get("is"), str):
            state, result = table["is"], str(table.get("of", ""))
    return Manifest(files, state, result)


def mark(folder: Path, state: str, result: str) -> None:
    """Add the state of a folder to its manifest, which is created if missing."""
    if not (is_there := bool(_text(folder, 1))) or _is_own(folder):
        first = [] if is_there else [{**MARK, "version": version("evac")}]
        _add(folder, [*first, {"is": state, "of": result}], os.O_CREAT)
    else:
        raise ResultError(f"{folder / MANIFEST_NAME}: is not a manifest of evac, which needs this name; move it away")


def note_written(paths: Iterable[Path], **more: str) -> None:
    """Add files to the manifest of the result folder that contains them, if they lie in one."""
    tables: dict[Path, list[dict[str, str]]] = {}
    for path in paths:
        folder = _folder_of(path)
        if folder is None:
            continue
        parts = path.relative_to(folder).parts
        for count in range(1, len(parts)):
            if folder.joinpath(*parts[:count]).is_symlink():
                raise OSError(f"{folder.joinpath(*parts[:count])} is a link, which is not followed")
        tables.setdefault(folder, []).append({"file": PurePath(*parts).as_posix(), **more})
    for folder, lines in tables.items():
        _add(folder, lines, 0)


def check_replaceable(path: Path) -> None:
    """Refuse a file in a result folder that the folder's manifest does not list."""
    if not os.path.lexists(path) or (folder := _folder_of(path)) is None:
        return
    line = json.dumps({"file": path.relative_to(folder).as_posix()}).removesuffix("}")
    if line not in _text(folder):  # not parsed, because animations have thousands of frames
        raise ResultError(f"{path}: exists, but evac has not written it; move it away, or give another file")


def _folder_of(path: Path) -> Path | None:
    """Return the result folder that contains a file."""
    return next((up for up in path.parents if (up / MANIFEST_NAME).is_file() and _is_own(up)), None)


def _is_own(folder: Path) -> bool:
    return _table(_text(folder, 200).partition("\n")[0]).items() >= MARK.items()


def _text(folder: Path, length: int = -1) -> str:
    """Return the beginning of a manifest; empty if there is none."""
    path = folder / MANIFEST_NAME
    try:
        if not path.is_file() or path.is_symlink():
            return ""
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(length)
    except OSError:
        return ""


def _table(line: str) -> dict[str, Any]:
    """Return the table of a line; empty if it is damaged."""
    try:
        table = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return table if isinstance(table, dict) else {}


def _add(folder: Path, tables: list[dict[str, Any]], flags: int) -> None:
    text = "".join(f"\n{json.dumps(table)}" for table in tables)  # a line that was cut before it is ended
    text = text if _text(folder, 1) else text[1:]
    flags |= os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(folder / MANIFEST_NAME, flags, 0o666)
    try:
        os.write(descriptor, text.encode())
    finally:
        os.close(descriptor)
