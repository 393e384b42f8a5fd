"""The manifest of a result folder: the mark by which a folder and its files are evac's own.

The first line names the format, ``{"evac": "manifest", "schema": 1, "version": VERSION}``; a file without it is not a
manifest, whatever its name. Each other line is a table in JSON: ``{"file": NAME}`` for a file that is written, relative
to the folder, ``{"file": NAME, "sha256": DIGEST}`` when it is complete, or ``{"is": STATE, "of": RESULT}``. Only listed
files are ever replaced or removed. Lines are only added, so that a kill leaves a manifest that can be read.
"""

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import Any

from evac.base.errors import ResultError

#: Name of the manifest, what its first line says, and the beginning of the names of files that are being written.
MANIFEST_NAME = "manifest.jsonl"
MARK = {"evac": "manifest", "schema": 1}
TEMPORARY = ".evac-"

#: States of a folder: a run writes to it, or it is complete.
RUNNING, COMPLETE = "running", "complete"


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
        raise ResultError(f"{path}: exists, but evac has not written it; move it away, or give another file (--out)")


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
