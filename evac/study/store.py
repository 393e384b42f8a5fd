"""The files of a study from which it is continued or opened again: its identity and definition, and its rows.

The identity and the definition are written to study.json at the start. Only a study of the same identity can be
resumed; with the definition a study can be opened again. Each row is written as soon as its run is done, in columns
that data frame libraries read.

Rows are appended to ``runs.arrows``, an Arrow stream: each row is one record batch with a checksum, written with one
call, so that after a kill at most the last one is incomplete. The first record that is incomplete or damaged, and all
that follows it, is overwritten when rows are appended again. The manifest has the digest of a complete stream.
"""

import json
import math
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.ipc

from evac.base.errors import ResultError, in_one_line, naming, text_of, usable_path
from evac.building.model.building import Building
from evac.case.case import Case
from evac.folder import files
from evac.folder.files import differences, digest_of_data, digest_of_file, read_sealed, sealed
from evac.folder.textfiles import plain, read_json, write_json
from evac.results.ending import FAILED
from evac.results.results import versions
from evac.simulation.assembly import providers
from evac.simulation.shared import shared_key
from evac.study.execute import Row
from evac.study.points import Point, Seeds
from evac.study.stopping import Rule
from evac.trajectory.trajectory import building_from_json, building_to_json

SYNC_EVERY = 1.0  #: Longest time after which rows are forced to disk, when the next one is appended [s].
INDEXED = ("point", "run", "ended", "last_out")  #: Columns that tell which runs there are.

#: Columns that are fields of `Row`.
SAME = ("point", "run", "seed", "population_seed", "ended", "exit_time", "exit_used")

EXITS = pa.list_(pa.struct([("name", pa.string()), ("people", pa.int32()), ("last_out", pa.float64())]))


def _rows_of(**columns: pa.DataType) -> pa.DataType:
    return pa.list_(pa.struct(list(columns.items())))


#: Columns of what a run tells besides its times.
TOLD: dict[str, pa.DataType] = {
    "people": pa.int32(),
    "tables": _rows_of(table=pa.string(), row=pa.string(), column=pa.string(), value=pa.float64()),
    "compartments": _rows_of(
        name=pa.string(),
        people=pa.int32(),
        required=pa.float64(),
        available=pa.float64(),
        criterion=pa.string(),
        until=pa.float64(),
        least_margin=pa.float64(),
        least_margin_of=pa.int32(),
        least_margin_at=pa.float64(),
    ),
}


@dataclass(frozen=True)
class StoredRun:
    """Data of a stored run that is kept in memory."""

    last_out: float  # [s], infinite if people are left, NaN if the run failed
    offset: int  # in the stream


def schema_of(points: Sequence[Point]) -> pa.Schema:
    """Return the columns of the rows of a study, including one for each parameter."""
    keys = dict.fromkeys(key for point in points for key in point.parameters)
    kinds = {key: _kind([point.parameters.get(key) for point in points]) for key in keys}
    return pa.schema(
        [
            ("point", pa.int32()),
            ("run", pa.int32()),
            ("seed", pa.int64()),
            ("population_seed", pa.int64()),
            *kinds.items(),
            ("ended", pa.string()),
            ("blocked", pa.bool_()),
            ("time", pa.float64()),
            ("out", pa.int32()),
            ("last_out", pa.float64()),
            ("exits", EXITS),
            *TOLD.items(),
            ("maps", _rows_of(level=pa.string(), quantity=pa.string(), values=pa.list_(pa.float32()))),
            ("quality_warnings", pa.list_(pa.string())),
            ("error", pa.string()),
            ("exit_time", pa.list_(pa.float64())),
            ("exit_used", pa.list_(pa.int16())),
        ]
    )


class RowStore:
    """The rows of one study in a folder, of which only `entries`, by point and run, are in memory.

    `dropped_bytes` is the number of bytes of incomplete or damaged rows at the end of the stream, which are ignored.
    """

    def __init__(self, folder: Path, points: Sequence[Point]) -> None:
        self.move(folder)
        self._points = points
        self.schema = schema_of(points)
        self.entries: dict[tuple[int, int], StoredRun] = {}
        self._file: Any = None
        self.dropped_bytes = 0
        self._end, self._synced = 0, 0.0
        with files.writing("the rows", folder):
            if self._path.is_file():
                self._index()

    def append(self, row: Row) -> None:
        """Write a row. It survives a kill of this process; a failure of the machine can lose those of `SYNC_EVERY`."""
        with files.writing("the rows", self._path):
            if self._file is None:
                files.note_written([self._path])
                self._file = self._path.open("r+b" if self._path.is_file() else "xb", buffering=0)
                self._file.truncate(self._end)
                self._file.seek(self._end)
                if not self._end:
                    self._write(self.schema.serialize())
            offset = self._end
            self._write(self._batch(row).serialize())
            self.entries[row.point, row.run] = StoredRun(row.last_out, offset)
            if time.monotonic() - self._synced > SYNC_EVERY:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()

    def forget_failed(self) -> None:
        """Forget the runs that failed, so that they are made again."""
        self.entries = {key: entry for key, entry in self.entries.items() if not math.isnan(entry.last_out)}

    def rows(self, wanted: Iterable[tuple[int, int]], columns: Sequence[str] = ()) -> Iterator[dict[str, Any]]:
        """Yield stored rows, given by keys of `entries`, as dictionaries of plain values and arrays, by default all."""
        names = list(columns) or self.schema.names
        for batch in self._batches(wanted, names):
            arrays = {name: batch.column(name) for name in names}
            for k in range(batch.num_rows):
                yield {name: _value(column, k) for name, column in arrays.items()}

    def complete(self) -> None:
        """Remove what follows the last whole row, and note the digest of the stream in the manifest."""
        with files.writing("the rows", self._path):
            os.truncate(self._path, self._end)
            files.note_written([self._path], sha256=digest_of_file(self._path))

    def table(self) -> pa.Table:
        """Return all rows as one table, sorted by point and run."""
        return pa.Table.from_batches(self._batches(sorted(self.entries), self.schema.names), self.schema)

    def move(self, folder: Path) -> None:
        """Set the new path of the renamed folder; the stream must be closed."""
        self._path = folder / files.RUNS_STREAM_NAME

    def close(self) -> None:
        """Close the stream."""
        if self._file is not None:
            os.fsync(self._file.fileno())
            self._file.close()
            self._file = None

    def _write(self, message: pa.Buffer) -> None:
        data = sealed(message.to_pybytes(), self._end)
        if self._file.write(data) != len(data):
            raise OSError("the disk is full")
        self._end += len(data)

    def _index(self) -> None:
        """Read the rows of the stream up to the first one that is incomplete or damaged."""
        size = self._path.stat().st_size
        with self._path.open("rb") as file:
            self.dropped_bytes = size
            record = read_sealed(file, 0, size)
            if record is None:
                return
            try:
                schema = pa.ipc.read_schema(pa.py_buffer(record))
            except (pa.ArrowException, OSError):
                return
            if not schema.equals(self.schema):
                raise ResultError(f"{self._path}: its columns are not those of this study; choose another folder")
            self._end = len(record)
            while (batch := self._batch_at(file, self._end, size)) is not None:
                point, run, ended, last_out = (batch.column(name)[0].as_py() for name in INDEXED)
                endless = math.nan if ended == FAILED else math.inf
                self.entries[point, run] = StoredRun(endless if last_out is None else last_out, self._end)
                self._end = file.tell()
            self.dropped_bytes = size - self._end

    def _batch_at(self, file: BinaryIO, place: int, end: int) -> pa.RecordBatch | None:
        """Return the row of the stream at a place; None if it is incomplete, damaged or not of this study."""
        record = read_sealed(file, place, end)
        if record is None:
            return None
        try:
            batch = pa.ipc.read_record_batch(pa.py_buffer(record), self.schema)
            batch.validate(full=True)
        except (pa.ArrowException, OSError):
            return None
        point, run = (batch.column(name).to_pylist() for name in ("point", "run"))
        is_one = len(point) == len(run) == 1 and None not in (*point, *run)
        return batch if is_one and 0 <= point[0] < len(self._points) and run[0] >= 0 else None

    def _batches(self, wanted: Iterable[tuple[int, int]], names: Sequence[str]) -> Iterator[pa.RecordBatch]:
        """Yield the rows `wanted`, in order."""
        for key in wanted:
            with self._path.open("rb") as file:
                batch = self._batch_at(file, self.entries[key].offset, os.fstat(file.fileno()).st_size)
            if batch is None:
                raise ResultError(
                    f"{self._path}: changed since it was opened; resume the study with --resume or resume=True"
                )
            yield batch.select(list(names))

    def _batch(self, row: Row) -> pa.RecordBatch:
        """Return a row as a record batch."""
        values: dict[str, Any] = {
            **{name: getattr(row, name) for name in SAME},
            "blocked": row.is_blocked,
            "time": _number(row.time),
            **row.told,
            "out": int(np.isfinite(row.exit_time).sum()),
            "last_out": _number(row.last_out),
            "exits": [{"name": name, "people": people, "last_out": last} for name, people, last in row.exits],
            "quality_warnings": list(row.quality_warnings),
            "maps": list(row.maps) or None,
            "error": None if row.error is None else text_of(row.error),
        }
        for key, value in self._points[row.point].parameters.items():
            is_text = value is not None and pa.types.is_string(self.schema.field(key).type)
            values[key] = str(value) if is_text else value
        columns = [pa.array([values.get(field.name)], field.type) for field in self.schema]
        return pa.RecordBatch.from_arrays(columns, schema=self.schema)


def _kind(values: Sequence[Any]) -> pa.DataType:
    """Return the type of a column for the values of a parameter; text, unless all are numbers or all are booleans."""
    kinds = {type(value) for value in values if value is not None}
    if kinds in ({bool}, {int}):
        return pa.bool_() if kinds == {bool} else pa.int64()
    return pa.float64() if kinds <= {int, float} else pa.string()


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _value(column: pa.Array, k: int) -> Any:
    """Return a value of a column; a list of numbers as an array."""
    kind = column.type
    if pa.types.is_list(kind) and (pa.types.is_floating(kind.value_type) or pa.types.is_integer(kind.value_type)):
        return column[k].values.to_numpy(zero_copy_only=False)
    return column[k].as_py()


def identity_of(points: Sequence[Point], seeds: Seeds, digests: Sequence[str]) -> dict[str, Any]:
    """Return what identifies a study: case, building, parameters, plugins, seeds, versions; not how many runs."""
    case = points[0].case
    return {
        "case": plain(_settings(case)),
        "parameters": [plain(point.parameters) for point in points],
        "points": list(digests),
        "plugins": sorted({name for point in points for name in providers(point.case)}),
        "first_seed": seeds.first,
        "repetitions": seeds.repetitions,
        "versions": plain(versions()),
    }


def digest_of(case: Case, key: str) -> str:
    """Return a digest of everything that the runs of a point depend on except the seeds; includes the building."""
    return digest_of_data(plain([_settings(case), providers(case), key]))


def key_of(case: Case) -> str:
    """Return the key of the shared scene of a point."""
    with naming(case.source):
        return shared_key(case)


def definition_of(points: Sequence[Point], rule: Rule) -> dict[str, Any]:
    """Return what opens a study again, in addition to its identity: its cases, and the rule for the number of runs."""
    bases = {id(point.base): point.base for point in points}
    numbers = {key: number for number, key in enumerate(bases)}
    cases = [base() if callable(base) else base for base in bases.values()]
    return {
        "rule": asdict(rule),
        "cases": [{"table": case.table, "source": str(case.source), "plugin_files": _files(case)} for case in cases],
        "case_of_point": [numbers[id(point.base)] for point in points],
    }


def _files(case: Case) -> list[str]:
    """Return all plugin files of a case: those of its registry, and those that have not been run."""
    return [str(path) for path in dict.fromkeys((*case.registry.files(), *case.plugin_files))]


def write_identity(folder: Path, identity: Mapping[str, Any], definition: Mapping[str, Any]) -> None:
    """Write study.json, with a digest of its content."""
    content = json.loads(json.dumps({**identity, "definition": definition}, default=plain))
    text = json.dumps({**content, "digest": digest_of_data(content)}, indent=2)
    with files.replacing(folder / files.STUDY_NAME, "the study") as new:
        new.write_text(text + "\n", encoding="utf-8")


def read_identity(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the identity and the definition of a study."""
    path = usable_path(folder, ResultError) / files.STUDY_NAME
    if not path.is_file():
        raise ResultError(f"{path}: no such file; name a result folder of `evac repeat` or `evac sweep`")
    try:
        identity = json.loads(path.read_text(encoding="utf-8"))
        digest, definition = identity.pop("digest"), identity["definition"]
    except (OSError, ValueError, AttributeError, LookupError, TypeError, RecursionError) as error:
        raise ResultError(f"{path}: cannot be read: {in_one_line(error)}; start the study again") from error
    if digest != digest_of_data(identity):
        raise ResultError(f"{path}: damaged, its digest differs; start the study again")
    del identity["definition"]
    return identity, definition


def write_buildings(folder: Path, buildings: Mapping[str, Building], keys: Sequence[str]) -> None:
    """Write buildings, and which of them each of the first points has; none for a point without one."""
    numbers = {key: number for number, key in enumerate(buildings)}
    parts = [building_to_json(building) for building in buildings.values()]
    content = {"of_point": [numbers.get(key) for key in keys], "buildings": parts}
    write_json(folder / files.BUILDINGS_NAME, plain(content), "the buildings")


def read_buildings(folder: Path, points: int) -> list[Building | None]:
    """Return the building of each point, None where none is written."""
    path = folder / files.BUILDINGS_NAME
    if not path.is_file():
        return [None] * points
    data = read_json(path)
    try:
        buildings = [building_from_json(table) for table in data["buildings"]]
        of_points = [None if number is None else buildings[number] for number in data["of_point"]]
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ResultError(f"{path}: not the buildings of a study: {in_one_line(error)}; make it again") from error
    return (of_points + [None] * points)[:points]


def check_rows(folder: Path) -> None:
    """Refuse the rows of a complete study that have changed."""
    path, digest = folder / files.RUNS_STREAM_NAME, files.read_manifest(folder).files.get(files.RUNS_STREAM_NAME)
    if digest and digest_of_file(path) != digest:
        raise ResultError(f"{path}: damaged; the same study with --resume or resume=True makes the lost runs again")


def check_identity(folder: Path, identity: Mapping[str, Any]) -> None:
    """Check that a folder contains this study."""
    stored, _ = read_identity(folder)
    changes = list(differences(stored, json.loads(json.dumps(identity))))
    if not changes:
        return
    listed = [
        f"{'.'.join(key)} was {_short(old)} and is {_short(new)}" for key, old, new in changes if key[0] != "points"
    ] or ["the file of the building has changed"]
    shown = "\n".join(f"  {line}" for line in listed[:10])
    more = f"\n  and {len(listed) - 10} more" if len(listed) > 10 else ""
    raise ResultError(
        f"{folder}: contains the runs of another study, which cannot be resumed:\n{shown}{more}\nundo the changes, or "
        "choose another folder"
    )


def _settings(case: Case) -> dict[str, Any]:
    """Return the settings of a case without its seeds, which the study sets."""
    table = case.to_dict()
    for name in ("seed", "population_seed"):
        table["simulation"].pop(name, None)
    return table


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
