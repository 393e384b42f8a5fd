"""The bytes of a trajectory file: start, header and heads of frames, in formats 1 and 2. See docs/trajectory.md."""

import json
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evac.base.errors import ResultError
from evac.folder.files import TRAJECTORY_NAME, TRAJECTORY_STARTS

MAGIC, MAGIC_1 = TRAJECTORY_STARTS
#: Fields of a record, float32 in little-endian order; x and y are relative to the header's origin.
FIELDS = ("person", "level", "x", "y", "velocity_x", "velocity_y", "contact_force")
RECORD_BYTES = 4 * len(FIELDS)
#: Greatest length of a header [bytes], much more than any building needs.
HEADER_BYTES_MAX = 2**28

LENGTH = struct.Struct("<I")
CHECK = struct.Struct("<I")  # CRC-32
FRAME = struct.Struct("<dII")  # time [s], number of the frame, number of records
FRAME_1 = struct.Struct("<dI")  # time [s], number of records
#: A frame's head: `FRAME`, its checksum, and that of the records.
FRAME_HEAD_BYTES = FRAME.size + 2 * CHECK.size
#: In format 1: `FRAME_1`, and the checksum of it and of the records together.
FRAME_HEAD_BYTES_1 = FRAME_1.size + CHECK.size


def damaged(path: Path, what: str) -> ResultError:
    """Return the error for a damaged file."""
    return ResultError(f"{path}: {what}; run the case again, or take an undamaged copy")


def pack_start(path: Path, header: Mapping[str, Any]) -> bytes:
    """Return the bytes up to the first frame.

    Raises
    ------
    ResultError
        The header is longer than `HEADER_BYTES_MAX`.
    """
    text = json.dumps(header, allow_nan=False).encode()
    if len(text) > HEADER_BYTES_MAX:
        raise ResultError(
            f"{path}: the building is too large for a trajectory: its header would have {len(text)} bytes, "
            f"{HEADER_BYTES_MAX} are allowed; use a coarser mesh, or disable the recorder: recorders.trajectory=false"
        )
    start = MAGIC + LENGTH.pack(len(text))
    return start + CHECK.pack(zlib.crc32(text, zlib.crc32(start))) + text


def read_header(path: Path, data: memoryview) -> tuple[dict[str, Any], int]:
    """Return the header of a file, without checking its content, and the byte at which the frames start.

    Parameters
    ----------
    path : Path
        For messages.
    data : memoryview
        The whole file.

    Raises
    ------
    ResultError
        The file is not a trajectory, its format is unknown, or its start is damaged or incomplete.
    """
    magic = bytes(data[: len(MAGIC)])
    if magic not in (MAGIC, MAGIC_1):
        raise ResultError(
            f"{path}: not a trajectory of evac (it does not start with {MAGIC.decode()}); give a {TRAJECTORY_NAME}"
        )
    number = 1 if magic == MAGIC_1 else 2
    first = len(MAGIC) + LENGTH.size + (0 if number == 1 else CHECK.size)
    length = LENGTH.unpack_from(data, len(MAGIC))[0] if len(data) >= first else 0
    if length > HEADER_BYTES_MAX:
        raise damaged(path, f"the header is damaged: its length, {length} bytes at byte {len(MAGIC)}, is not valid")
    if len(data) < first + length or len(data) < first:
        raise damaged(
            path,
            f"the header is incomplete: it should end at byte {first + length}, the file has {len(data)} bytes "
            "(the run was killed before its first frame, or the length at byte 8 is damaged)",
        )
    text = data[first : first + length]
    if number == 2:
        check = CHECK.unpack_from(data, len(MAGIC) + LENGTH.size)[0]
        if check != zlib.crc32(text, zlib.crc32(data[: len(MAGIC) + LENGTH.size])):
            raise damaged(path, f"the header is damaged: bytes 0 to {first + length} do not match their checksum")
    try:
        header = json.loads(bytes(text), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"the header is not valid JSON: {error}") from error
    found = header.get("format") if isinstance(header, dict) else header
    if not isinstance(header, dict) or found != number or isinstance(found, bool):
        raise ResultError(
            f"{path}: unknown trajectory format {found!r:.40}; this version reads formats 1 and 2; run the case again, "
            "or use the version of evac that wrote it"
        )
    return header, first + length


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not allowed in JSON")
