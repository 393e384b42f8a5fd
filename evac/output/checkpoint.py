"""The file of a checkpoint: a JSON header and arrays, under one checksum. Nothing in it is executed.

::

    EVACCHK1                     8 bytes
    length of the header         unsigned 64-bit, little-endian
    header                       JSON in UTF-8: "format", what the writer gave, and "arrays": name, type, shape
    arrays                       one behind the other, in the order of the header
    SHA-256 of all before        32 bytes
"""

import hashlib
import json
import math
import os
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.errors import ResultError
from evac.output.files import sync_folder, writing

MAGIC = b"EVACCHK1"
FORMAT = 1
_LENGTH = struct.Struct("<Q")
_DIGEST_BYTES = hashlib.sha256().digest_size
#: Kinds of numpy arrays that are kept: booleans, integers and floats, which are nothing but bytes.
_KINDS = "biuf"


def write_checkpoint(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a checkpoint beside `path`, see that it is on the disk, and only then put it in the place of the last one.

    Parameters
    ----------
    path : Path
    header : mapping
        JSON data; numbers may be infinite.
    arrays : mapping of str to array
        Of booleans, integers or floats.

    Raises
    ------
    ResultError
        The file cannot be written; the last one is still there. Or an array is of another type.
    """
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    for name, array in contiguous.items():
        if array.dtype.kind not in _KINDS:
            raise ResultError(f"{path}: array {name!r} is of type {array.dtype}; keep booleans, integers or floats")
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
    new = path.with_name(path.name + ".new")
    with writing("the checkpoint", path):
        with new.open("wb") as file:
            for part in (*parts, digest.digest()):
                file.write(part)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, path)
        sync_folder(path.parent)


def read_checkpoint(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of a checkpoint, after a look at its checksum.

    Raises
    ------
    ResultError
        It cannot be read, is damaged, or was written by another version of evac.
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
        if header["format"] != FORMAT:
            raise ResultError(
                f"{path}: checkpoints of format {header['format']!r} are unknown, this version reads format {FORMAT}; "
                "go on with the version of evac that wrote it, or run the case again"
            )
        return header, _arrays(memoryview(data)[start + length : end], header.pop("arrays"))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ResultError(f"{path}: the checkpoint is not as it should be: {error}; run the case again") from error


def _arrays(data: memoryview, listed: Iterable[tuple[str, str, list[int]]]) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays, which may be written to."""
    found: dict[str, NDArray[Any]] = {}
    start = 0
    for name, kind, shape in listed:
        dtype = np.dtype(kind)
        if dtype.kind not in _KINDS or any(length < 0 for length in shape):
            raise ValueError(f"array {name!r} is of type {kind} and shape {shape}")
        end = start + math.prod(shape) * dtype.itemsize
        array = np.frombuffer(data[start:end], dtype).reshape(shape)
        found[name] = array.astype(dtype.newbyteorder("="))
        start = end
    if start != len(data):
        raise ValueError(f"its arrays take {start} bytes, and there are {len(data)}")
    return found


def _plain(value: Any) -> Any:
    """Return a number or an array of numpy as JSON knows it."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise ResultError(
        f"{value!r} of a case cannot be kept in a checkpoint; give plain numbers, words, lists and tables"
    )
