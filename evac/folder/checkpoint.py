"""The file of a checkpoint: arrays in the format npz of numpy, with one checksum. Reading it executes no code.

One of the arrays, ``header``, is JSON in UTF-8. The archive is not compressed; the 32 bytes after it are its SHA-256.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from evac.base.errors import ResultError
from evac.folder.files import content_of, replacing

#: First bytes of an archive, and the number of the format of its header and arrays.
ARCHIVE = b"PK"
FORMAT = 3

#: Name of the array that is the header, and kinds of the others: booleans, integers and floats.
HEADER = "header"
KINDS = "biuf"

DIGEST_BYTES = hashlib.sha256().digest_size

#: A path; no system has one with this character.
FileName = Annotated[str, Field(pattern=r"^[^\x00]+$")]


class _Table(BaseModel):
    """A table of the header of a checkpoint."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


class RecordedFile(_Table):
    """A file that a recorder appends to: its length [bytes] and its SHA-256 up to there."""

    length: int = Field(ge=0)
    sha256: str


class CaseAtStart(_Table):
    """The case as it was at the start of the run, its file, and the plugin files given in addition."""

    table: dict[str, Any]
    source: FileName
    plugin_files: list[FileName]


class Header(_Table):
    """The header of a checkpoint, checked; docs/folder.md explains it."""

    title: str
    case: CaseAtStart
    every: float | None = Field(ge=0.0)
    full: bool
    made_with: dict[str, dict[str, str]]
    resumed: list[dict[str, Any]]
    time: float
    step: int
    wall_time: dict[str, Annotated[float, Field(ge=0.0)]]
    files: dict[FileName, RecordedFile]
    plugin_files: list[FileName]


def write_checkpoint(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a checkpoint to a temporary file, flush it to disk, and then replace the previous one atomically."""
    for name, array in arrays.items():
        if array.dtype.kind not in KINDS:
            raise ResultError(f"{path}: array {name!r} has type {array.dtype}; use booleans, integers or floats")
    text = json.dumps({**header, "format": FORMAT}, default=_plain)
    archive = io.BytesIO()
    np.savez(archive, **{**arrays, HEADER: np.frombuffer(text.encode(), np.uint8)})  # type: ignore[arg-type]
    with replacing(path, "the checkpoint") as new, new.open("wb") as file:
        file.write(archive.getbuffer())
        file.write(hashlib.sha256(archive.getbuffer()).digest())


def read_checkpoint(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of a checkpoint after verifying its checksum."""
    try:
        data = content_of(path)
    except OSError as error:
        raise ResultError(f"{path}: cannot read the checkpoint: {error}") from error
    if not data.startswith(ARCHIVE):
        raise ResultError(f"{path}: not a checkpoint of this evac (it does not start with {ARCHIVE.decode()})")
    archive = memoryview(data)[:-DIGEST_BYTES]
    if hashlib.sha256(archive).digest() != data[-DIGEST_BYTES:]:
        raise ResultError(f"{path}: the checkpoint is damaged (its checksum does not match); run the case again")
    try:
        with np.load(io.BytesIO(archive), allow_pickle=False) as file:
            arrays = {name.removesuffix(".npy"): file[name] for name in file.zip.namelist()}
        header = json.loads(arrays.pop(HEADER).tobytes())
    except (ValueError, LookupError) as error:
        raise ResultError(f"{path}: the checkpoint is not valid: {error}; run the case again") from error
    if (written := header.pop("format", None)) != FORMAT:
        raise ResultError(
            f"{path}: unknown checkpoint format {written!r:.40}, this version reads format {FORMAT}; "
            "resume with the version of evac that wrote it, or run the case again"
        )
    return header, arrays


def _plain(value: Any) -> Any:
    """Convert a number or an array of numpy to plain data for JSON."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise ResultError(
        f"{value!r} in a case cannot be saved in a checkpoint; use plain numbers, strings, lists and tables"
    )
