"""The files of a result folder: their names, the manifest, writing of each as a whole, and digests of files and data.

The manifest is the mark by which a folder and its files are evac's own. The first line names the format,
``{"evac": "manifest", "schema": 1, "version": VERSION}``; a file without it is not a manifest, whatever its name. Each
other line is a table in JSON: ``{"file": NAME}`` for a file that is written, relative to the folder,
``{"file": NAME, "sha256": DIGEST}`` when it is complete, or ``{"is": STATE, "of": RESULT}``. Only listed files are ever
replaced or removed. Lines are only added, so that a kill leaves a manifest that can be read.

A record of an Arrow stream is a message in its encapsulated form: four bytes FF, the length of the metadata, the
metadata, and the body. `sealed` appends a seal to the metadata, where readers of Arrow expect padding: the length of
the record, and a digest of the record and its place in the stream. Without it, a changed byte could be read as another
number, or crash Arrow.
"""

import errno
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from mmap import mmap
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from evac.base.errors import EvacError, ResultError, check_regular

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
MEDIAN_REPLAY_NAME = "replay-median.html"
WORST_REPLAY_NAME = "replay-worst.html"
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
FIRST = {"evac": "manifest", "schema": 1}
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
    damaged: int = 0  # number of lines that are not valid


def read_manifest(folder: Path) -> Manifest:
    """Return what the manifest of a folder says; lines that are damaged are left out."""
    first, *lines = _text(folder).splitlines() or [""]
    files: dict[str, str] = {}
    state = result = ""
    if not _table(first).items() >= FIRST.items():
        return Manifest()
    tables = [_table(line) for line in lines]
    for table in tables:
        if isinstance(name := table.get("file"), str):
            files[name] = str(table.get("sha256", ""))
        elif isinstance(table.get("is"), str):
            state, result = table["is"], str(table.get("of", ""))
    return Manifest(files, state, result, tables.count({}))


def mark(folder: Path, state: str, result: str) -> None:
    """Add the state of a folder to its manifest, which is created if missing."""
    if not (is_there := bool(_text(folder, 1))) or _is_own(folder):
        first = [] if is_there else [{**FIRST, "version": version("evac")}]
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
    return _table(_text(folder, 200).partition("\n")[0]).items() >= FIRST.items()


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


CHUNK = 1 << 20  #: Bytes that are read at once.


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal text."""
    try:
        check_regular(path)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise EvacError(f"{path}: cannot be read: {error.strerror}; check the path") from error


def digest_of_data(content: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of the keys, as hexadecimal text."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def differences(before: Any, now: Any, *key: str) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Yield the keys, and the two values, of everything in which plain data differ; None stands for a missing value."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys([*before, *now]):
            yield from differences(before.get(name), now.get(name), *key, name)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, values in enumerate(zip(before, now, strict=True)):
            yield from differences(*values, *key, str(index))
    elif before != now:
        yield key, before, now


class RunningDigest:
    """The SHA-256 of the beginning of a file that grows; bytes that were read before are not read again."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.length = 0  # number of bytes so far

    def extend(self, path: Path, length: int) -> str:
        """Return the digest of the first `length` bytes of a file as hexadecimal text."""
        if length < self.length:  # written anew
            self._hash, self.length = hashlib.sha256(), 0
        with writing("its digest", path):
            check_regular(path)
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
            with open(descriptor, "rb") as file:
                file.seek(self.length)
                while self.length < length:
                    data = file.read(min(CHUNK, length - self.length))
                    if not data:
                        raise ResultError(f"{path}: has {self.length} bytes, not {length}; run the case again")
                    self._hash.update(data)
                    self.length += len(data)
        return self._hash.hexdigest()


#: Four bytes with which a record begins, and the size of these and the length of the metadata.
MARK = b"\xff\xff\xff\xff"
PREFIX = 8

#: Sizes of the length and the digest in a seal; their sum is a multiple of 8, to which Arrow aligns bodies.
LENGTH, DIGEST = 8, 16
SEAL = LENGTH + DIGEST


def sealed(message: bytes, place: int) -> bytes:
    """Return an encapsulated Arrow message as a record that begins at a place in the stream [bytes]."""
    end = PREFIX + int.from_bytes(message[4:PREFIX], "little")
    length = len(message) + SEAL
    head = MARK + (end - PREFIX + SEAL).to_bytes(4, "little") + message[PREFIX:end] + length.to_bytes(LENGTH, "little")
    body = message[end:]
    return head + _digest(head, body, place) + body


def read_sealed(file: BinaryIO | mmap, place: int, end: int) -> bytes | None:
    """Return the record that begins at a place in a stream of `end` bytes; None if it is incomplete or damaged."""
    file.seek(place)
    prefix = file.read(PREFIX)
    size = int.from_bytes(prefix[4:], "little")
    if len(prefix) < PREFIX or prefix[:4] != MARK or not SEAL <= size <= end - place - PREFIX:
        return None
    metadata = file.read(size)
    head, seal = prefix + metadata[:-DIGEST], metadata[-DIGEST:]
    length = int.from_bytes(head[-LENGTH:], "little")
    if not PREFIX + size <= length <= end - place:
        return None
    body = file.read(length - PREFIX - size)
    return head + seal + body if seal == _digest(head, body, place) else None


def _digest(head: bytes, body: bytes, place: int) -> bytes:
    digest = hashlib.blake2b(head, digest_size=DIGEST, salt=place.to_bytes(16, "little"))
    digest.update(body)
    return digest.digest()
