"""Writing of trajectory files, frame by frame. The format is specified in docs/trajectory.md."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IndexArray, IntArray
from evac.base.change import Change
from evac.base.errors import SimulationError
from evac.building.model.cells import LevelField
from evac.folder.digests import sealed
from evac.folder.files import writing
from evac.folder.manifest import check_replaceable, note_written
from evac.physics.state import Crowd
from evac.trajectory.header import fields_to_json
from evac.trajectory.layout import FIELDS, FIELDS_WITH_DOSE, FORMAT, columns, damaged, pack_start
from evac.trajectory.trajectory import Trajectory, read_up_to


def read_to_continue(path: Path, length: int | None) -> Trajectory:
    """Read the part of a trajectory file that `TrajectoryWriter.reopen` keeps."""
    before = read_up_to(path, length)
    if before.dropped_bytes:
        raise damaged(path, f"no frame ends at byte {before.end + before.dropped_bytes}")
    return before


NUMBER = pa.float32()


class TrajectoryWriter:
    """Writes the header and then one frame after the other, each without buffering.

    Parameters
    ----------
    path : Path
        File, which is replaced if it exists; its folder is created if missing.
    header : mapping
        JSON data: ``title``, ``building`` (`evac.trajectory.header.building_to_json`), ``groups`` (list of names),
        ``group`` (list: index in ``groups`` per person, -1 for none), ``radius`` (list [m]) and any other keys.
        Format, fields and origin are added.
    origin : (2,) float64 [m]
        Origin of the recorded positions in plan, so that float32 is precise enough for all coordinate systems.
    fields : sequence of LevelField
        The fields of behaviours, whose values are recorded in each frame.
    has_dose : bool
        Whether the doses of people are recorded.

    Attributes
    ----------
    path : Path
    length : int
        Number of bytes written: the end of the last frame, or of the header if there is none. See `reopen`.
    frames, changes : int
        Numbers of frames and of changes written.
    """

    def __init__(
        self,
        path: Path,
        header: Mapping[str, Any],
        origin: FloatArray,
        fields: Sequence[LevelField] = (),
        has_dose: bool = False,
    ) -> None:
        origin = np.asarray(origin, np.float64)
        schema = columns(len(header["radius"]), len(header["building"]["levels"]), fields, has_dose)
        names = FIELDS_WITH_DOSE if has_dose else FIELDS
        given = {**header, "format": FORMAT, "fields": names, "origin": origin.tolist()}
        given["level_fields"] = fields_to_json(fields)
        start = pack_start(path, given, schema)
        self._set_up(path, origin, schema, 0, 0, 0)
        with writing("the trajectory", path):
            path.parent.mkdir(parents=True, exist_ok=True)
            check_replaceable(path)
            note_written([path])
            path.unlink(missing_ok=True)  # a link is not followed
            self._file = path.open("xb", buffering=0)
            self._write(start)

    @classmethod
    def reopen(cls, path: Path, length: int | None = None) -> Self:
        """Return a writer that appends to a file, after reading and checking the part that is kept."""
        before = read_to_continue(path, length)
        writer = cls.__new__(cls)
        schema = columns(before.number_of_people, len(before.building.levels), before.level_fields, before.has_dose)
        writer._set_up(path, before.origin, schema, before.end, len(before), len(before.changes))
        del before  # some systems cannot truncate a mapped file
        with writing("the trajectory", path):
            writer._file = path.open("r+b", buffering=0)
            writer._file.truncate(writer.length)
            writer._file.seek(writer.length)
        return writer

    def _set_up(
        self, path: Path, origin: FloatArray, schema: pa.Schema, length: int, frames: int, changes: int
    ) -> None:
        self.path, self.length, self.frames, self.changes = path, length, frames, changes
        self._origin, self._schema = origin, schema
        # Asking Arrow for types takes as long as writing a frame.
        self._kinds = schema.types
        self._one = schema.field("people").type.value_type
        self._whole: list[tuple[pa.DataType, np.dtype[Any]]] = [
            (kind.type, np.dtype(kind.type.to_pandas_dtype())) for kind in (self._one[0], self._one[1])
        ]
        self._motion = self._one[3].type

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
        """Write one frame with all people who are inside at `time`.

        Parameters
        ----------
        time : float [s]
        crowd : Crowd
        velocity : (n, 2)
            Velocities to record, in plan [m/s]: `Simulation.displacement_velocity`.
        changes : sequence of Change
            Changes of the scene since the frame before.
        fields : sequence of LevelField
            Those given at first, with their present values.
        dose : (n,) float64, optional
            Doses of all people, if they are recorded.
        standing : (n,) bool, optional
            Those who do not walk on: see `Simulation.standing`; nobody if not given.
        """
        rows = np.flatnonzero(crowd.level >= 0)
        motion = np.empty((rows.size, self._motion.list_size), "<f4")
        with np.errstate(over="ignore"):  # reported below
            motion[:, :2] = crowd.position[rows] - self._origin
            motion[:, 2:4] = velocity[rows]
            motion[:, 4] = crowd.contact_force[rows]
            if dose is not None:
                motion[:, 5] = dose[rows]
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
        text = json.dumps([change.as_row() for change in changes]).encode() if changes else b""
        whole, started = (rows, crowd.level[rows]), crowd.start_time[rows] <= time
        if standing is not None:
            started &= ~standing[rows]
        batch = self._batch(time, whole, started, motion, text, values)
        with writing(f"the trajectory at {time:.3f} s", self.path):
            self._write(sealed(batch.serialize().to_pybytes(), self.length))
        self.frames += 1
        self.changes += len(changes)

    def _batch(
        self,
        time: float,
        whole: tuple[IndexArray, IntArray],
        started: NDArray[np.bool_],
        motion: NDArray[np.float32],
        changes: bytes,
        fields: Sequence[NDArray[np.float32]],
    ) -> pa.RecordBatch:
        """Return a batch of one frame, made from buffers because `pyarrow.array` would import pandas."""
        count = len(motion)
        rows = [
            _array(kind, count, np.asarray(values, dtype))
            for (kind, dtype), values in zip(self._whole, whole, strict=True)
        ]
        rows += [_array(self._one[2].type, count, np.packbits(started, bitorder="little"))]
        people = pa.Array.from_buffers(
            self._one, count, [None], children=[*rows, _vectors(self._motion, count, motion)]
        )
        kinds = self._kinds
        return pa.RecordBatch.from_arrays(
            [
                _array(kinds[0], 1, np.array([time], "<f8")),
                pa.Array.from_buffers(kinds[1], 1, [None, pa.py_buffer(_ends(count))], children=[people]),
                pa.Array.from_buffers(kinds[2], 1, [None, pa.py_buffer(_ends(len(changes))), pa.py_buffer(changes)]),
                *(_vectors(kind, 1, values) for kind, values in zip(kinds[3:], fields, strict=True)),
            ],
            schema=self._schema,
        )

    def _write(self, record: bytes) -> None:
        """Write all bytes, in several calls if the system writes only a part."""
        data, written = memoryview(record), 0
        while written < len(data):
            written += self._file.write(data[written:])
        self.length += written

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _array(kind: pa.DataType, length: int, values: NDArray[Any]) -> pa.Array:
    return pa.Array.from_buffers(kind, length, [None, pa.py_buffer(values)])


def _vectors(kind: pa.DataType, length: int, values: NDArray[np.float32]) -> pa.Array:
    """Return an array of lists of a fixed number of numbers."""
    return pa.Array.from_buffers(kind, length, [None], children=[_array(NUMBER, values.size, values)])


def _ends(length: int) -> NDArray[np.int32]:
    """Return where the only item of an array of lists begins and ends."""
    return np.array([0, length], "<i4")
