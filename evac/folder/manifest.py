"""The manifest of a result folder: what evac and its plugins have written there, and whether it is complete.

Each line is a table in JSON: ``{"file": NAME}`` for a file, relative to the folder, or ``{"is": STATE, "of": RESULT}``.
Only listed files are ever removed, and lines are only added, so that a kill leaves a manifest that can be read.
"""

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePath

#: Name of the manifest, and the beginning of the names of files that are being written.
MANIFEST_NAME = "manifest.jsonl"
TEMPORARY = ".evac-"

#: States of a folder: a run writes to it, it is complete, or it is the earlier result that is being replaced.
RUNNING, COMPLETE, REPLACED = "running", "complete", "replaced"


@dataclass(frozen=True)
class Manifest:
    """What a manifest says."""

    files: tuple[str, ...] = ()  # names relative to the folder, in the order in which they were written
    state: str = ""  # `RUNNING`, `COMPLETE`, `REPLACED`, or empty if there is no manifest
    result: str = ""  # name of the result folder to which the files belong


def read_manifest(folder: Path) -> Manifest:
    """Return what the manifest of a folder says; lines that are damaged are left out."""
    files: dict[str, None] = {}
    state = result = ""
    path = folder / MANIFEST_NAME
    try:
        is_own = path.is_file() and not path.is_symlink()
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if is_own else []
    except OSError:
        lines = []
    for line in lines:
        try:
            table = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(table, dict) and isinstance(table.get("file"), str):
            files[table["file"]] = None
        elif isinstance(table, dict) and isinstance(table.get("is"), str):
            state, result = table["is"], str(table.get("of", ""))
    return Manifest(tuple(files), state, result)


def mark(folder: Path, state: str, result: str) -> None:
    """Add the state of a folder to its manifest, which is created if missing."""
    _add(folder, [{"is": state, "of": result}], os.O_CREAT)


def note_written(paths: Iterable[Path]) -> None:
    """Add files to the manifest of the result folder that contains them, if they lie in one."""
    tables: dict[Path, list[dict[str, str]]] = {}
    for path in paths:
        folder = next((up for up in path.parents if (up / MANIFEST_NAME).is_file()), None)
        if folder is None:
            continue
        parts = path.relative_to(folder).parts
        for count in range(1, len(parts)):
            if folder.joinpath(*parts[:count]).is_symlink():
                raise OSError(f"{folder.joinpath(*parts[:count])} is a link, which is not followed")
        if not any(part.startswith(TEMPORARY) for part in parts):
            tables.setdefault(folder, []).append({"file": PurePath(*parts).as_posix()})
    for folder, lines in tables.items():
        _add(folder, lines, 0)


def _add(folder: Path, tables: list[dict[str, str]], flags: int) -> None:
    text = "".join(f"\n{json.dumps(table)}" for table in tables)  # a line that was cut before it is ended
    flags |= os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(folder / MANIFEST_NAME, flags, 0o666)
    try:
        os.write(descriptor, text.encode())
    finally:
        os.close(descriptor)
