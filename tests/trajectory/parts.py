"""Trajectory files as their parts, which tests change and put together again under checksums that match."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.ipc

from evac.folder.digests import PREFIX, SEAL, sealed
from evac.trajectory.layout import columns

#: Columns of two people on five levels.
SCHEMA = columns(2, 5)


@dataclass
class Frame:
    """A frame: its time, the numbers of the people inside, eight for each, the text of its changes, and fields."""

    time: float
    people: list[list[float]]
    changes: str = ""
    fields: list[list[float]] = field(default_factory=list)


@dataclass
class Parts:
    """A trajectory file in parts, each of which can be changed on its own."""

    header: Any
    schema: pa.Schema = SCHEMA
    frames: list[Frame] = field(default_factory=list)

    def records(self) -> list[bytes]:
        """Return the file in records."""
        text = (
            self.header if isinstance(self.header, bytes) else json.dumps(self.header, separators=(",", ":")).encode()
        )
        messages = [self.schema.with_metadata({b"evac.trajectory": text}).serialize()]
        messages += [self._batch(frame).serialize() for frame in self.frames]
        records, place = [], 0
        for message in messages:
            records.append(sealed(message.to_pybytes(), place))
            place += len(records[-1])
        return records

    def seal(self) -> bytes:
        """Return the file."""
        return b"".join(self.records())

    def _batch(self, frame: Frame) -> pa.RecordBatch:
        kinds = self.schema.field("people").type.value_type
        whole = [np.array([p[k] for p in frame.people], kinds.field(k).type.to_pandas_dtype()) for k in range(3)]
        motion = pa.array(np.array([p[3:] for p in frame.people], "<f4").ravel())
        # Of types that allow no missing values, as the schema says.
        children = [*map(pa.array, whole), pa.FixedSizeListArray.from_arrays(motion, type=kinds[3].type)]
        people = pa.StructArray.from_arrays(children, fields=list(kinds))
        rows = pa.ListArray.from_arrays(pa.array([0, len(people)], pa.int32()), people, self.schema.types[1])
        fields = [
            pa.FixedSizeListArray.from_arrays(pa.array(np.array(values, "<f4")), type=kind)
            for kind, values in zip(self.schema.types[3:], frame.fields, strict=True)
        ]
        arrays = [pa.array([frame.time]), rows, pa.array([frame.changes]), *fields]
        return pa.RecordBatch.from_arrays(arrays, schema=self.schema)


def with_header(text: bytes) -> bytes:
    """Return a file without frames, with the given text for a header."""
    return Parts(text).seal()


def parts_of(data: bytes) -> Parts:
    """Take a file apart."""
    with pa.ipc.open_stream(data) as stream:
        header = json.loads(stream.schema.metadata[b"evac.trajectory"])
        frames = []
        for batch in stream:
            (row,) = batch.to_pylist()
            people = [[p["person"], p["level"], p["started"], *p["motion"]] for p in row["people"]]
            frames.append(Frame(row["time"], people, row["changes"], [*row.values()][3:]))
        return Parts(header, stream.schema.remove_metadata(), frames)


def places_of(data: bytes) -> list[int]:
    """Return the bytes at which the records of a file begin, and its end."""
    places = [0]
    while places[-1] < len(data):
        end = places[-1] + PREFIX + int.from_bytes(data[places[-1] + 4 : places[-1] + PREFIX], "little")
        places.append(places[-1] + int.from_bytes(data[end - SEAL : end - SEAL + 8], "little"))
    return places


def unsealed(record: bytes) -> bytes:
    """Return the Arrow message of a record."""
    end = PREFIX + int.from_bytes(record[4:PREFIX], "little")
    return record[:4] + (end - PREFIX - SEAL).to_bytes(4, "little") + record[PREFIX : end - SEAL] + record[end:]
