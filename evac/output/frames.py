"""The frames of a trajectory file: where each starts, checksums, and the range and order of everything in them."""

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray
from evac.errors import ResultError
from evac.output.layout import (
    CHECK,
    FIELDS,
    FRAME,
    FRAME_1,
    FRAME_HEAD_BYTES,
    FRAME_HEAD_BYTES_1,
    RECORD_BYTES,
)

Records = NDArray[np.float32]


@dataclass(frozen=True)
class Bounds:
    """What the numbers of a file must keep to.

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
        Whether the head can be believed, so that `end` is where the next frame starts.
    check : int
        Checksum of the records.
    salt : int
        What that checksum starts from.
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
    """Return times and records of all whole frames; the records are views of `data`.

    What a killed run or a failure of the system leaves behind the last whole frame is passed over: a frame that is cut
    off, a last frame whose records do not match their checksum, zeros up to the end of the file.

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
        Byte at which the last whole frame ends.

    Raises
    ------
    ResultError
        A frame before the last is damaged, or holds numbers that cannot be; names frame and byte.
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
    """Return a head of format 2: its own checksum tells whether it can be believed."""
    time, stated, count = FRAME.unpack_from(data, start)
    own, check = (CHECK.unpack_from(data, start + FRAME.size + at)[0] for at in (0, CHECK.size))
    is_sound = own == zlib.crc32(data[start : start + FRAME.size]) and stated == number and count <= people
    first = start + FRAME_HEAD_BYTES
    return _Head(time, first, first + RECORD_BYTES * count, is_sound, check, 0)


def _head_1(data: memoryview, start: int, number: int, people: int) -> _Head:
    """Return a head of format 1: one checksum is over head and records."""
    time, count = FRAME_1.unpack_from(data, start)
    check = CHECK.unpack_from(data, start + FRAME_1.size)[0]
    first = start + FRAME_HEAD_BYTES_1
    salt = zlib.crc32(data[start : start + FRAME_1.size])
    return _Head(time, first, first + RECORD_BYTES * count, count <= people, check, salt)


def _is_blank(rest: memoryview) -> bool:
    """Return whether nothing follows but zeros, as a file system may leave them after a power failure."""
    return not np.frombuffer(rest, np.uint8).any()


def _fault(time: float, before: float | None, rows: Records, bounds: Bounds) -> str:
    """Return what is impossible in a frame whose checksum matches; nothing if all can be."""
    if not 0.0 <= time < np.inf:
        return f"its time is {time!r} s"
    if before is not None and time <= before:
        return f"its time, {time!r} s, is not after that of the frame before, {before!r} s"
    if not rows.size:
        return ""
    columns = np.ascontiguousarray(rows.T)  # of which numpy takes extremes ten times faster
    least, greatest = columns.min(axis=1), columns.max(axis=1)
    if not (np.isfinite(least) & np.isfinite(greatest)).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        return f"{FIELDS[column]} of record {row} is {rows[row, column]}"
    if (np.floor(columns[:2]) != columns[:2]).any():
        return "a person or a level is no whole number"
    if least[0] < 0 or greatest[0] >= bounds.people or (np.diff(columns[0]) <= 0).any():
        return f"persons are not in ascending order from 0 to {bounds.people - 1}"
    if least[1] < 0 or greatest[1] >= bounds.levels:
        return f"a level is not in 0 to {bounds.levels - 1}"
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
