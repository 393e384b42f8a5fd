"""The file of a checkpoint: a JSON header and arrays with one checksum. Reading it executes no code.

::

    EVACCHK1                     8 bytes
    length of the header         unsigned 64-bit, little-endian
    header                       JSON in UTF-8: "format", the given header, and "arrays": name, type, shape
    arrays                       one after the other, in the order of the header
    SHA-256 of all before        32 bytes
"""

import hashlib
import json
import math
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from evac.base.errors import ResultError
from evac.folder.files import replacing

MAGIC = b"EVACCHK1"
FORMAT = 2
_LENGTH = struct.Struct("<Q")
_DIGEST_BYTES = hashlib.sha256().digest_size
#: Kinds of numpy arrays that can be saved: booleans, integers and floats.
_KINDS = "biuf"


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
    """The header of a checkpoint, checked; docs/results.md explains it."""

    title: str
    case: CaseAtStart
    every: float | None = Field(ge=0.0)
    full: bool
    routes: list[str]
    made_with: dict[str, dict[str, str]]
    resumed: list[dict[str, Any]]
    time: float
    step: int
    wall_time: dict[str, Annotated[float, Field(ge=0.0)]]
    files: dict[FileName, RecordedFile]
    plugin_files: list[FileName]


def write_checkpoint(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a checkpoint to a temporary file, flush it to disk, and then replace the previous one atomically.

    Parameters
    ----------
    path : Path
    header : mapping
        JSON data; numbers may be infinite.
    arrays : mapping of str to array
        Arrays of booleans, integers or floats.

    Raises
    ------
    ResultError
        The file cannot be written, in which case the previous one is kept, or an array has another type.
    """
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    for name, array in contiguous.items():
        if array.dtype.kind not in _KINDS:
            raise ResultError(f"{path}: array {name!r} has type {array.dtype}; use booleans, integers or floats")
    little = {name: array.astype(array.dtype.newbyteorder("<"), copy=False) for name, array in contiguous.items()}
    listed = [[name, array.dtype.str, list(np.shape(arrays[name]))] for name, array in little.items()]
    text = json.dumps({**header, "format": FORMAT, "arrays": listed}, default=_plain).encode()
    parts: list[Any] = [
        MAGIC,
        _LENGTH.pack(len(text)),
        text,
        *(array.data.cast("B") for array in little.values() if array.size),
    ]
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    with replacing(path, "the checkpoint") as new, new.open("wb") as file:
        for part in (*parts, digest.digest()):
            file.write(part)


def read_checkpoint(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of a checkpoint after verifying its checksum.

    Raises
    ------
    ResultError
        The file cannot be read, is damaged, or was written by another version of evac.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ResultError(f"{path}: cannot read the checkpoint: {error}") from error
    if not data.startswith(MAGIC):
        raise ResultError(f"{path}: not a checkpoint of this evac (it does not start with {MAGIC.decode()})")
    start, end = len(MAGIC) + _LENGTH.size, len(data) - _DIGEST_BYTES
    if end < start or hashlib.sha256(memoryview(data)[:end]).digest() != data[end:]:
        raise ResultError(f"{path}: the checkpoint is damaged (its checksum does not match); run the case again")
    try:
        length = _LENGTH.unpack_from(data, len(MAGIC))[0]
        header = json.loads(data[start : start + length])
        if (found := header.pop("format")) != FORMAT:
            raise ResultError(
                f"{path}: unknown checkpoint format {found!r:.40}, this version reads format {FORMAT}; "
                "resume with the version of evac that wrote it, or run the case again"
            )
        return header, _arrays(memoryview(data)[start + length : end], header.pop("arrays"))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ResultError(f"{path}: the checkpoint is not valid: {error}; run the case again") from error


def _arrays(data: memoryview, listed: Iterable[tuple[str, str, list[int]]]) -> dict[str, NDArray[Any]]:
    """Return writable copies of the arrays."""
    found: dict[str, NDArray[Any]] = {}
    start = 0
    for name, kind, shape in listed:
        dtype = np.dtype(kind)
        if not isinstance(name, str) or dtype.kind not in _KINDS or any(length < 0 for length in shape):
            raise ValueError(f"array {name!r} is of type {kind} and shape {shape}")
        end = start + math.prod(shape) * dtype.itemsize
        array = np.frombuffer(data[start:end], dtype).reshape(shape)
        found[name] = array.astype(dtype.newbyteorder("="))
        start = end
    if start != len(data):
        raise ValueError(f"its arrays have {start} bytes, but the file contains {len(data)}")
    return found


def _plain(value: Any) -> Any:
    """Convert a number or an array of numpy to plain data for JSON."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise ResultError(
        f"{value!r} in a case cannot be saved in a checkpoint; use plain numbers, strings, lists and tables"
    )
