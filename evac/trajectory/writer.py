"""Writing of trajectory files, frame by frame. The format is specified in docs/trajectory.md."""

import json
from collections.abc import Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.change import Change
from evac.base.errors import SimulationError
from evac.building.model.cells import LevelField
from evac.folder.digests import sealed
from evac.folder.files import check_replaceable, note_written, writing
from evac.physics.state import Crowd
from evac.trajectory.trajectory import FIELDS, FIELDS_WITH_DOSE, FORMAT, TRAJECTORY_KEY, Recorded, Rows

NUMBER = pa.float32()


def columns(people: int, levels: int, fields: Sequence[LevelField] = (), has_dose: bool = False) -> pa.Schema:
    """Return the columns of the trajectory of so many people on so many levels, with fields of behaviours."""
    motion = pa.list_(_required("item", NUMBER), len(FIELDS) - 2 + has_dose)
    kinds = {"person": _row(people), "level": _row(levels), "started": pa.bool_(), "motion": motion}
    person = pa.struct([_required(name, kind) for name, kind in kinds.items()])
    return pa.schema(
        [
            _required("time", pa.float64()),
            _required("people", pa.list_(_required("item", person))),
            _required("changes", pa.utf8()),
            *(_required(f"field.{own.name}", pa.list_(_required("item", NUMBER), own.size)) for own in fields),
        ]
    )


def _required(name: str, kind: pa.DataType) -> pa.Field:
    return pa.field(name, kind, nullable=False)


def _row(count: int) -> pa.DataType:
    """Return the smallest type for numbers from 0 to below `count`."""
    return pa.uint8() if count <= 2**8 else pa.uint16() if count <= 2**16 else pa.int32()


class TrajectoryWriter:
    """Writes the header and then one frame after the other, each without buffering.

    The header is JSON data, to which format, fields and origin are added. With a `length` [bytes], the file exists and
    is continued after so many bytes; with `memory`, frames are kept there as arrays, and the path is only a name.
    Positions are relative to the origin, so that float32 is precise enough. The attribute `length` counts the bytes
    written.
    """

    def __init__(
        self,
        path: Path,
        header: Mapping[str, Any],
        origin: FloatArray,
        fields: Sequence[LevelField] = (),
        has_dose: bool = False,
        length: int = 0,
        memory: Recorded | None = None,
    ) -> None:
        self.path, self.length, self.memory = path, length, memory
        self._origin = np.asarray(origin, np.float64)
        self._schema = columns(len(header["radius"]), len(header["building"]["levels"]), fields, has_dose)
        # Asking Arrow for types takes as long as writing a frame.
        self._kinds = self._schema.types
        self._one = self._kinds[1].value_type
        self._of_person = [field.type for field in self._one]
        self._whole = [np.dtype(kind.to_pandas_dtype()) for kind in self._of_person[:2]]
        self._file: FileIO
        with writing("the trajectory", path):
            if length:
                self._file = path.open("r+b", buffering=0)
                self._file.seek(length)
                self._file.truncate()
                return
            names = FIELDS_WITH_DOSE if has_dose else FIELDS
            given = {**header, "format": FORMAT, "fields": names, "origin": self._origin.tolist()}
            given["level_fields"] = [{"name": own.name, "unit": own.unit, "spacing": own.spacing} for own in fields]
            text = json.dumps(given, allow_nan=False, separators=(",", ":"))
            if memory is not None:
                memory.header = text
                return
            path.parent.mkdir(parents=True, exist_ok=True)
            check_replaceable(path)
            note_written([path])
            path.unlink(missing_ok=True)  # a link is not followed
            self._file = path.open("xb", buffering=0)
            self._write(self._schema.with_metadata({TRAJECTORY_KEY: text}).serialize())

    def append(
        self,
        time: float,
        crowd: Crowd,
        velocity: FloatArray,
        changes: Sequence[Change] = (),
        fields: Sequence[LevelField] = (),
        dose: FloatArray | None = None,
        standing: NDArray[np.bool_] | None = None,
    ) -> None:
        """Write one frame with all people who are inside; changes are those since the frame before."""
        rows = np.flatnonzero(crowd.level >= 0)
        motion = np.empty((rows.size, self._of_person[3].list_size), "<f4")
        with np.errstate(over="ignore"):  # reported below
            motion[:, :2] = crowd.position.take(rows, 0) - self._origin
            motion[:, 2:4] = velocity.take(rows, 0)
            motion[:, 4] = crowd.contact_force.take(rows)
            if dose is not None:
                motion[:, 5] = dose.take(rows)
            values = [field.values.astype("<f4") for field in fields]
        if not np.isfinite(motion).all():
            row, column = np.argwhere(~np.isfinite(motion))[0]
            raise SimulationError(
                f"t = {time:.3f} s: {FIELDS_WITH_DOSE[2 + column]} of person {rows[row]} is {motion[row, column]} and "
                "cannot be recorded; correct the plugin that sets it, or choose a smaller step"
            )
        for field, numbers in zip(fields, values, strict=True):
            if not np.isfinite(numbers).all():
                raise SimulationError(
                    f"t = {time:.3f} s: a value of field {field.name!r} is too large to be recorded; use another unit"
                )
        started = crowd.start_time.take(rows) <= time
        if standing is not None:
            started &= ~standing.take(rows)
        person, level = rows.astype(self._whole[0]), crowd.level.take(rows).astype(self._whole[1])
        for array in (person, level, motion, *values):
            array.flags.writeable = False
        recorded = Rows(time, person, level, started, motion, tuple(changes), tuple(values))
        if self.memory is not None:
            self.memory.rows.append(recorded)
            return
        with writing(f"the trajectory at {time:.3f} s", self.path):
            self._write(self._batch(recorded).serialize())

    def _batch(self, rows: Rows) -> pa.RecordBatch:
        """Return a batch of one frame, made from buffers because `pyarrow.array` would import pandas."""
        count, changes = len(rows.person), [change.as_row() for change in rows.changes]
        text = json.dumps(changes).encode() if changes else b""
        started = np.packbits(rows.started, bitorder="little")
        people: list[NDArray[Any]] = [rows.person, rows.level, started, rows.motion]
        of_person = [_array(kind, count, values) for kind, values in zip(self._of_person, people, strict=True)]
        inside = pa.Array.from_buffers(self._one, count, [None], children=of_person)
        time_kind, people_kind, changes_kind, *field_kinds = self._kinds
        arrays = [
            _array(time_kind, 1, np.array([rows.time], "<f8")),
            pa.Array.from_buffers(people_kind, 1, [None, _ends(count)], children=[inside]),
            pa.Array.from_buffers(changes_kind, 1, [None, _ends(len(text)), pa.py_buffer(text)]),
            *(_array(kind, 1, values) for kind, values in zip(field_kinds, rows.fields, strict=True)),
        ]
        return pa.RecordBatch.from_arrays(arrays, schema=self._schema)

    def _write(self, message: pa.Buffer) -> None:
        """Write a record, in several calls if the system writes only a part."""
        data, written = memoryview(sealed(message.to_pybytes(), self.length)), 0
        while written < len(data):
            written += self._file.write(data[written:])
        self.length += written

    def close(self) -> None:
        """Close the file; what is in memory remains."""
        if self.memory is None:
            self._file.close()


def _array(kind: pa.DataType, length: int, values: NDArray[Any]) -> pa.Array:
    """Return an array of numbers, or of lists of a fixed number of numbers."""
    if values.dtype == np.float32:
        numbers = pa.Array.from_buffers(NUMBER, values.size, [None, pa.py_buffer(values)])
        return pa.Array.from_buffers(kind, length, [None], children=[numbers])
    return pa.Array.from_buffers(kind, length, [None, pa.py_buffer(values)])


def _ends(length: int) -> pa.Buffer:
    """Return where the only item of an array of lists begins and ends."""
    return pa.py_buffer(np.array([0, length], "<i4"))
