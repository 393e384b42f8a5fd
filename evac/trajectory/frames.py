"""The frames of a trajectory file: checks of their checksums, numbers and order."""

import json
from mmap import mmap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.ipc
from numpy.typing import NDArray

from evac.base.change import Change
from evac.base.errors import BuildingError, ResultError
from evac.building.model.building import Building
from evac.building.model.links import building_at
from evac.folder.digests import MARK, read_sealed
from evac.trajectory.layout import FIELDS_WITH_DOSE, HEADER_BYTES_MAX, damaged

#: Positions farther than this outside the bounding rectangle of the building are treated as damage [m].
FAR_OUTSIDE = 1000.0


class Rows(NamedTuple):
    """What is recorded at one time; the arrays are views of the file."""

    time: float  # [s]
    person: NDArray[Any]  # (c,) unsigned or int32: those who are inside, in ascending order
    level: NDArray[Any]  # (c,) unsigned or int32
    started: NDArray[np.bool_]  # (c,): whether the response time is over
    motion: NDArray[np.float32]  # (c, 5 or 6) float32: the numbers of the header's fields from x on
    changes: tuple[Change, ...]  # changes of the scene since the frame before
    fields: tuple[NDArray[np.float32], ...]  # tuple of (m,) float32: values of the fields of behaviours


class FrameError(ValueError):
    """A frame is invalid; says why."""


class FrameReader:
    """Reads the frames of a file.

    Parameters
    ----------
    path : Path
        For messages.
    data : mmap
        The whole file.
    schema : pyarrow.Schema
    people : int
    building : Building
    origin : (2,) float64 [m]

    Attributes
    ----------
    frames : list of Rows
        Those that have been read.
    end : int
        Byte at which the last one ends.
    """

    def __init__(
        self, path: Path, data: mmap, schema: pa.Schema, people: int, building: Building, origin: NDArray[np.float64]
    ) -> None:
        self.frames: list[Rows] = []
        self.end = 0
        self._path, self._data, self._schema = path, data, schema
        self._building, self._people = building, people
        plan = building.vertices[:, :2] - origin
        self._changed = [0.0]  # time of the last change
        self._low, self._high = plan.min(axis=0) - FAR_OUTSIDE, plan.max(axis=0) + FAR_OUTSIDE

    def read(self, start: int) -> None:
        """Read all complete frames from a byte on.

        Data that a killed run or a system failure may leave after the last complete frame are ignored: a frame that is
        incomplete or does not match its checksum, if no other one begins behind it.
        """
        whole, most = pa.py_buffer(self._data), HEADER_BYTES_MAX + 32 * self._people
        self.end = start
        while self.end < len(self._data):
            record = read_sealed(self._data, self.end, min(len(self._data), self.end + most))
            if record is None:
                if self._data.find(MARK, self.end + len(MARK)) < 0:
                    return
                raise self._damaged("its checksum does not match")
            try:
                self.frames.append(self._checked(whole.slice(self.end, len(record))))
            except FrameError as error:
                raise self._damaged(str(error)) from error
            self.end += len(record)

    def _checked(self, record: pa.Buffer) -> Rows:
        """Return the content of a frame whose checksum matches."""
        try:
            batch = pa.ipc.read_record_batch(record, self._schema)
            batch.validate(full=True)
        except (pa.ArrowException, OSError) as error:
            raise FrameError(f"Arrow cannot read it: {str(error).partition(chr(10))[0]:.200}") from error
        if batch.num_rows != 1:
            raise FrameError(f"it has {batch.num_rows} rows instead of one")
        time, people, changes, *lists = batch.columns
        one, fields = people.flatten(), [values.flatten() for values in lists]
        person, level, started, motion = one.flatten()
        parts = (time, people, changes, one, person, level, started, motion, motion.flatten(), *lists, *fields)
        if any(array.null_count for array in parts):
            raise FrameError("a value is missing")
        rows = Rows(
            time[0].as_py(),
            _numbers(person),
            _numbers(level),
            _bits(started),
            _numbers(motion.flatten()).reshape(-1, motion.type.list_size),
            (),
            tuple(_numbers(values) for values in fields),
        )
        self._check_numbers(rows)
        return rows._replace(changes=self._changes(changes[0].as_py(), rows.time))

    def _check_numbers(self, rows: Rows) -> None:
        time, person, motion = rows.time, rows.person, rows.motion
        before = self.frames[-1].time if self.frames else None
        if not 0.0 <= time < np.inf:
            raise FrameError(f"its time is {time!r} s")
        if before is not None and time <= before:
            raise FrameError(f"its time, {time!r} s, is not after that of the frame before, {before!r} s")
        if not all(np.isfinite(values).all() for values in rows.fields):
            raise FrameError("a value of a field is not finite")
        if not person.size:
            return
        columns = np.ascontiguousarray(motion.T)  # for which numpy computes extrema ten times faster
        least, greatest = columns.min(axis=1), columns.max(axis=1)
        if not (np.isfinite(least) & np.isfinite(greatest)).all():
            row, column = np.argwhere(~np.isfinite(motion))[0]
            raise FrameError(f"{FIELDS_WITH_DOSE[2 + column]} of record {row} is {motion[row, column]}")
        if person[0] < 0 or person[-1] >= self._people or (person[1:] <= person[:-1]).any():
            raise FrameError(f"persons are not in ascending order from 0 to {self._people - 1}")
        if rows.level.min() < 0 or rows.level.max() >= len(self._building.levels):
            raise FrameError(f"a level is not between 0 and {len(self._building.levels) - 1}")
        if (least[:2] < self._low).any() or (greatest[:2] > self._high).any():
            far = ((motion[:, :2] < self._low) | (motion[:, :2] > self._high)).any(axis=1)
            raise FrameError(f"person {person[far.argmax()]} is far outside the building")

    def _changes(self, text: str, time: float) -> tuple[Change, ...]:
        """Return the changes of a frame at `time` [s], which are in order of time."""
        try:
            found = json.loads(text) if text else []
            if not isinstance(found, list):
                raise ValueError("not a list")
            changes = tuple(Change.from_row(row) for row in found)
            building_at(self._building, changes, np.inf)
        except (ValueError, RecursionError, BuildingError) as error:
            raise FrameError(f"its changes cannot be read: {error}") from error
        times = [*self._changed, *(change.time for change in changes), time]
        if changes and sorted(times) != times:
            raise FrameError(f"its changes, at {times[:-1]} s, are not in order of time up to {time!r} s")
        self._changed = times[-2:-1]
        return changes

    def _damaged(self, what: str) -> ResultError:
        number = len(self.frames)
        cut = "no frame is"
        if number:
            cut = f"a copy cut to {self.end} bytes holds the {number} frames up to {self.frames[-1].time:.2f} s"
        return damaged(self._path, f"frame {number} at byte {self.end} is damaged ({what}; {cut} before it)")


def _bits(array: pa.Array) -> NDArray[np.bool_]:
    """Return an array of truth values."""
    bits = np.frombuffer(array.buffers()[1] or b"", np.uint8)
    return np.unpackbits(bits, bitorder="little")[array.offset : array.offset + len(array)].astype(np.bool_)


def _numbers(array: pa.Array) -> NDArray[Any]:
    """Return an array of numbers as a view; its method `to_numpy` would import pandas."""
    dtype = np.dtype(array.type.to_pandas_dtype())
    if not len(array):
        return np.empty(0, dtype)
    return np.frombuffer(array.buffers()[1], dtype, len(array), array.offset * dtype.itemsize)
