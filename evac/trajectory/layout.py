"""The columns of a trajectory file, an Arrow stream, and its header. See docs/trajectory.md."""

import json
from collections.abc import Mapping, Sequence
from mmap import mmap
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.ipc

from evac.base.errors import ResultError
from evac.building.model.cells import LevelField
from evac.folder.digests import MARK, PREFIX, read_sealed, sealed
from evac.folder.files import TRAJECTORY_NAME

FORMAT = 4

#: Key of the header, in the metadata of the schema.
TRAJECTORY_KEY = b"evac.trajectory"

#: Numbers that are recorded of each person; those from x on are in the column `motion`, and x and y are relative to the
#: header's origin.
FIELDS = ("person", "level", "x", "y", "velocity_x", "velocity_y", "contact_force")

#: The same in a case with `[dose]`: the greater one of the doses of gases and heat.
FIELDS_WITH_DOSE = (*FIELDS, "dose")

#: Greatest length of a header [bytes], much more than any building needs.
HEADER_BYTES_MAX = 2**28


def columns(people: int, levels: int, fields: Sequence[LevelField] = (), has_dose: bool = False) -> pa.Schema:
    """Return the columns of the trajectory of so many people on so many levels, with fields of behaviours."""
    motion = pa.list_(_required("item", pa.float32()), len(FIELDS) - 2 + has_dose)
    person = pa.struct(
        [
            _required("person", _row(people)),
            _required("level", _row(levels)),
            _required("started", pa.bool_()),
            _required("motion", motion),
        ]
    )
    return pa.schema(
        [
            _required("time", pa.float64()),
            _required("people", pa.list_(_required("item", person))),
            _required("changes", pa.utf8()),
            *(_required(f"field.{own.name}", pa.list_(_required("item", pa.float32()), own.size)) for own in fields),
        ]
    )


def _required(name: str, kind: pa.DataType) -> pa.Field:
    return pa.field(name, kind, nullable=False)


def _row(count: int) -> pa.DataType:
    """Return the smallest type for numbers from 0 to below `count`."""
    return pa.uint8() if count <= 2**8 else pa.uint16() if count <= 2**16 else pa.int32()


def damaged(path: Path, what: str) -> ResultError:
    """Return the error for a damaged file."""
    return ResultError(f"{path}: {what}; run the case again, or take an undamaged copy")


def pack_start(path: Path, header: Mapping[str, Any], schema: pa.Schema) -> bytes:
    """Return the bytes up to the first frame."""
    text = json.dumps(header, allow_nan=False, separators=(",", ":")).encode()
    if len(text) > HEADER_BYTES_MAX:
        raise ResultError(
            f"{path}: the building is too large for a trajectory: its header would have {len(text)} bytes, "
            f"{HEADER_BYTES_MAX} are allowed; use a coarser mesh, or disable the recorder: recorders.trajectory=false"
        )
    return sealed(schema.with_metadata({TRAJECTORY_KEY: text}).serialize().to_pybytes(), 0)


def read_start(path: Path, data: mmap) -> tuple[dict[str, Any], pa.Schema, int]:
    """Return the unchecked header of a file, its columns, and the byte at which the frames start."""
    if data[: len(MARK)] != MARK:
        raise ResultError(
            f"{path}: not a trajectory of evac, which is an Arrow stream (it does not start with four bytes FF); "
            f"give a {TRAJECTORY_NAME}"
        )
    record = read_sealed(data, 0, min(len(data), 2 * HEADER_BYTES_MAX))
    if record is None:
        end = PREFIX + int.from_bytes(data[len(MARK) : PREFIX], "little")
        raise damaged(
            path,
            f"the header is damaged (bytes 0 to {end} do not match their checksum)"
            if end <= len(data)
            else f"the header is incomplete: it should end at byte {end}, the file has {len(data)} bytes (the run was "
            f"killed before its first frame, or the length at byte {len(MARK)} is damaged)",
        )
    try:
        schema = pa.ipc.read_schema(pa.py_buffer(record))
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise damaged(path, f"the header is damaged: {_line(error)}") from error
    text = (schema.metadata or {}).get(TRAJECTORY_KEY)
    if text is None:
        raise ResultError(f"{path}: an Arrow stream, but not a trajectory of evac; give a {TRAJECTORY_NAME}")
    try:
        header = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"the header is not valid JSON: {error}") from error
    got = header.get("format") if isinstance(header, dict) else header
    if not isinstance(header, dict) or got != FORMAT or isinstance(got, bool):
        raise ResultError(
            f"{path}: unknown trajectory format {got!r:.40}; this version reads format {FORMAT}; run the case again, "
            "or use the version of evac that wrote it"
        )
    return header, schema.remove_metadata(), len(record)


def _line(error: Exception) -> str:
    """Return the first line of a message of Arrow."""
    return str(error).partition("\n")[0][:200]


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not allowed in JSON")
