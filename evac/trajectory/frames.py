"""The frames of a trajectory file: positions in the file, checksums, and checks of range and order."""

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.trajectory.layout import CHECK, FIELDS, FRAME, FRAME_1, FRAME_HEAD_BYTES, FRAME_HEAD_BYTES_1, RECORD_BYTES

Records = NDArray[np.float32]


@dataclass(frozen=True)
class Bounds:
    """Bounds of the numbers in a file.

    Attributes
    ----------
    people : int
    levels : int
    low, high : (2,) float64 [m]
        Range of positions, from the header's origin.
    """

    people: int
    levels: int
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True)
class _Head:
    """The head of a frame.

    Attributes
    ----------
    time : float [s]
    first, end : int
        Bytes at which the records start and end.
    is_sound : bool
        Whether the head is valid, so that the next frame starts at `end`.
    check : int
        Checksum of the records.
    salt : int
        Initial value of that checksum.
    """

    time: float
    first: int
    end: int
    is_sound: bool
    check: int
    salt: int


def read_frames(
    path: Path, data: memoryview, start: int, form: int, bounds: Bounds
) -> tuple[FloatArray, tuple[Records, ...], int]:
    """Return times and records of all complete frames; the records are views of `data`.

    Data that a killed run or a system failure may leave after the last complete frame are ignored: an incomplete
    frame, a last frame whose records do not match their checksum, zeros up to the end of the file.

    Parameters
    ----------
    path : Path
        For messages.
    data : memoryview
        The whole file.
    start : int
        Byte of the first frame.
    form : int
        Format of the file, 1 or 2.
    bounds : Bounds

    Returns
    -------
    time : (f,) float64 [s]
    records : tuple of (c, 7) float32
    end : int
        Byte at which the last complete frame ends.

    Raises
    ------
    ResultError
        A frame before the last is damaged, or contains invalid numbers; names frame and byte.
    """
    read_head, head_bytes = (_head_1, FRAME_HEAD_BYTES_1) if form == 1 else (_head, FRAME_HEAD_BYTES)
    times: list[float] = []
    records: list[Records] = []
    while start + head_bytes <= len(data):
        head = read_head(data, start, len(times), bounds.people)
        if head.is_sound and head.end > len(data):
            break
        if not head.is_sound or head.check != zlib.crc32(data[head.first : head.end], head.salt):
            if _is_blank(data[head.end if head.is_sound else start :]):
                break
            raise _damaged_frame(path, len(times), start, "its checksum does not match")
        rows = np.frombuffer(data, "<f4", (head.end - head.first) // 4, head.first).reshape(-1, len(FIELDS))
        fault = _fault(head.time, times[-1] if times else None, rows, bounds)
        if fault:
            raise _damaged_frame(path, len(times), start, fault)
        times.append(head.time)
        records.append(rows)
        start = head.end
    return np.array(times, np.float64), tuple(records), start


def _head(data: memoryview, start: int, number: int, people: int) -> _Head:
    """Return a head of format 2, which has a checksum of its own."""
    time, stated, count = FRAME.unpack_from(data, start)
    own, check = (CHECK.unpack_from(data, start + FRAME.size + at)[0] for at in (0, CHECK.size))
    is_sound = own == zlib.crc32(data[start : start + FRAME.size]) and stated == number and count <= people
    first = start + FRAME_HEAD_BYTES
    return _Head(time, first, first + RECORD_BYTES * count, is_sound, check, 0)


def _head_1(data: memoryview, start: int, number: int, people: int) -> _Head:
    """Return a head of format 1, which has one checksum for head and records."""
    time, count = FRAME_1.unpack_from(data, start)
    check = CHECK.unpack_from(data, start + FRAME_1.size)[0]
    first = start + FRAME_HEAD_BYTES_1
    salt = zlib.crc32(data[start : start + FRAME_1.size])
    return _Head(time, first, first + RECORD_BYTES * count, count <= people, check, salt)


def _is_blank(rest: memoryview) -> bool:
    """Return whether only zeros follow, which a file system may leave after a power failure."""
    return not np.frombuffer(rest, np.uint8).any()


def _fault(time: float, before: float | None, rows: Records, bounds: Bounds) -> str:
    """Return what is invalid in a frame whose checksum matches; empty if it is valid."""
    if not 0.0 <= time < np.inf:
        return f"its time is {time!r} s"
    if before is not None and time <= before:
        return f"its time, {time!r} s, is not after that of the frame before, {before!r} s"
    if not rows.size:
        return ""
    columns = np.ascontiguousarray(rows.T)  # for which numpy computes extrema ten times faster
    least, greatest = columns.min(axis=1), columns.max(axis=1)
    if not (np.isfinite(least) & np.isfinite(greatest)).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        return f"{FIELDS[column]} of record {row} is {rows[row, column]}"
    if (np.floor(columns[:2]) != columns[:2]).any():
        return "a person or a level is not a whole number"
    if least[0] < 0 or greatest[0] >= bounds.people or (np.diff(columns[0]) <= 0).any():
        return f"persons are not in ascending order from 0 to {bounds.people - 1}"
    if least[1] < 0 or greatest[1] >= bounds.levels:
        return f"a level is not between 0 and {bounds.levels - 1}"
    if (least[2:4] < bounds.low).any() or (greatest[2:4] > bounds.high).any():
        row = np.flatnonzero(((rows[:, 2:4] < bounds.low) | (rows[:, 2:4] > bounds.high)).any(axis=1))[0]
        return f"person {rows[row, 0]:.0f} is far outside the building"
    return ""


def _damaged_frame(path: Path, number: int, start: int, what: str) -> ResultError:
    before = f"a copy cut to {start} bytes holds the {number} frames before it" if number else "no frame is before it"
    return ResultError(
        f"{path}: frame {number} at byte {start} is damaged ({what}); run the case again, or take an undamaged copy; "
        f"{before}"
    )
