"""Trajectory files, reading and writing: header, with the building as JSON, and frames; see docs/trajectory.md."""

import json
import mmap
import os
import stat
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np
import pyarrow as pa
import pyarrow.ipc
from numpy.typing import NDArray
from shapely.geometry import mapping, shape
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change, Control, LiftOptions
from evac.base.defaults import CONTRAST
from evac.base.errors import ResultError, SimulationError, usable_path
from evac.base.parameters import did_you_mean
from evac.building.model.building import Area, Building, Door, Exit, Level, Place, Portal
from evac.building.model.cells import LevelField
from evac.building.model.findings import as_findings
from evac.building.model.links import building_at
from evac.folder.files import (
    MARK,
    PREFIX,
    TRAJECTORY_NAME,
    check_replaceable,
    note_written,
    read_sealed,
    sealed,
    writing,
)

if TYPE_CHECKING:
    from pandas import DataFrame
    from pedpy import TrajectoryData, WalkableArea

    from evac.analysis.maps import LevelMaps
    from evac.building.model.elevation import Ground
    from evac.physics.state import Crowd

FORMAT = 4

IN_MEMORY = Path("in memory")  #: Folder in messages about the trajectory of a run without one.
TRAJECTORY_KEY = b"evac.trajectory"  #: Key of the header, in the metadata of the schema.

#: Numbers that are recorded of each person; those from x on are in the column `motion`, and x and y are relative to the
#: header's origin.
FIELDS = ("person", "level", "x", "y", "velocity_x", "velocity_y", "contact_force")

#: The same in a case with `[dose]`: the greater one of the doses of gases and heat.
FIELDS_WITH_DOSE = (*FIELDS, "dose")

#: Classes of the parts of a building, by their key in the header.
PARTS = {"levels": Level, "portals": Portal, "exits": Exit, "areas": Area, "doors": Door, "places": Place}


def _floats(values: Any) -> FloatArray:
    return np.array(values, np.float64)


def _integers(values: Any) -> IntArray:
    return np.array(values, np.int32)


#: What is made of the values in JSON of attributes of parts; the others stay as they are.
READ: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("uphill", "segment", "segments"), _floats),
    **dict.fromkeys(("polygon", "shape"), shape),
    **{"triangles": _integers, "levels": tuple},
}


def building_to_json(building: Building) -> dict[str, Any]:
    """Return the building as lists, numbers and strings; floats are exact."""
    return {
        "source": building.source.name,
        "vertices": building.vertices.tolist(),
        **{key: [_part_to_json(part) for part in getattr(building, key)] for key in PARTS},
        "walls": building.walls.tolist(),
        "wall_level": building.wall_level.tolist(),
        "stairs": {name: list(levels) for name, levels in building.stairs.items()},
        "warnings": list(building.warnings),
        "closed": sorted(building.closed),
        "north": building.north,
        "moving": sorted(building.moving),
        **({"lifts": [_part_to_json(lift) for lift in building.lifts]} if building.lifts else {}),
        "controls": [[link, control.model_dump(exclude_none=True)] for link, control in building.controlled.items()],
    }


def _part_to_json(part: Any) -> dict[str, Any]:
    """Return the attributes of a level, portal, exit, area, door or place, without its index."""
    row: dict[str, Any] = {}
    for key in (one.name for one in fields(part) if one.name != "index"):
        value = getattr(part, key)
        is_shape = isinstance(value, BaseGeometry)
        row[key] = mapping(value) if is_shape else value.tolist() if isinstance(value, np.ndarray) else value
        row[key] = value.model_dump() if isinstance(value, LiftOptions) else row[key]
    return row


def building_from_json(data: Mapping[str, Any]) -> Building:
    """Return the building from the output of `building_to_json`."""
    parts: dict[str, Any] = {}
    for key, kind in PARTS.items():
        rows = [
            {name: READ[name](value) if name in READ else value for name, value in row.items()}
            for row in data.get(key, ())
        ]
        is_numbered = any(one.name == "index" for one in fields(kind))
        parts[key] = tuple(kind(**{"index": k} if is_numbered else {}, **row) for k, row in enumerate(rows))
    building = Building(
        source=Path(data["source"]),
        vertices=_floats(data["vertices"]),
        walls=_floats(data["walls"]).reshape(-1, 4),
        wall_level=_integers(data["wall_level"]),
        stairs={name: tuple(levels) for name, levels in data["stairs"].items()},
        findings=as_findings(tuple(data["warnings"])),
        closed=frozenset(data["closed"]),
        north=data.get("north"),
        moving=frozenset((level, x, y) for level, x, y in data.get("moving", ())),
        controls=frozenset((link, Control.model_validate(control)) for link, control in data.get("controls", ())),
        **parts,
    )
    return _with_lifts(building, data["lifts"]) if "lifts" in data else building


def _with_lifts(building: Building, rows: list[dict[str, Any]]) -> Building:
    """Return a building with the lifts of `building_to_json`."""
    from evac.building.model.lifts import Lift, with_lifts

    lifts = []
    for row in rows:
        own: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
        own |= {"doors": tuple(map(tuple, row["doors"])), "operation": LiftOptions.model_validate(row["operation"])}
        lifts.append(Lift(**own))
    return with_lifts(building, tuple(lifts))


class Rows(NamedTuple):
    """What is recorded at one time; the arrays of a file are views of it."""

    time: float  # [s]
    person: NDArray[Any]  # (c,) unsigned or int32: those who are inside, in ascending order
    level: NDArray[Any]  # (c,) unsigned or int32
    started: NDArray[np.bool_]  # (c,): whether the response time is over
    motion: NDArray[np.float32]  # (c, 5 or 6) float32: the numbers of the header's fields from x on
    changes: tuple[Change, ...]  # changes of the scene since the frame before
    fields: tuple[NDArray[np.float32], ...]  # tuple of (m,) float32: values of the fields of behaviours


@dataclass
class Recorded:
    """The trajectory of a run without a folder until now."""

    header: str = ""  # JSON; empty until the recorder has started
    rows: list[Rows] = field(default_factory=list)


class Frame(TypedDict):
    """The c people who are inside at one time."""

    time: float  #: [s]
    person: IntArray  #: (c,): index of the person
    level: IntArray  #: (c,): index in ``Building.levels``
    position: FloatArray  #: (c, 2): position in plan [m]
    z: FloatArray  #: (c,) [m]
    #: (c, 3): displacement in the last tick over its length, in space; the vertical component follows from the slope
    #: [m/s]
    velocity: FloatArray
    speed: FloatArray  #: (c,): magnitude of the velocity, on stairs along the slope [m/s]
    #: (c,): whether the response time of each person is over; False of those who stay at a place or have been stopped
    started: NDArray[np.bool_]
    contact_force: FloatArray  #: (c,): sum of the contact forces [N]
    #: (c,): contact force over the circumference of the body, 2 pi r, as in Helbing, Farkas and Vicsek (2000) [N/m]
    crowd_pressure: FloatArray
    dose: FloatArray  #: (c,): the greater one of the doses of gases and heat; 0 in a case without doses


@dataclass(frozen=True)
class Trajectory:
    """The content of a trajectory file."""

    path: Path
    header: dict[str, Any]  #: header of the file, see docs/trajectory.md
    building: Building  #: as it was at the start; `building_at` returns it at other times
    group: IntArray  #: (n,) int32: index in ``groups`` of each person, -1 for none
    groups: tuple[str, ...]
    radius: FloatArray  #: (n,) float64 [m]
    height: FloatArray  #: (n,) float64 [m]
    time: FloatArray  #: (f,) float64 [s]
    rows: tuple[Rows, ...] = field(repr=False)  #: what is recorded at each time
    level_fields: tuple[LevelField, ...]  #: the fields of behaviours, without values, which `field` returns
    end: int  #: byte at which the last complete frame ends; 0 for a trajectory in memory
    dropped_bytes: int  #: number of bytes after it, which are ignored; 0 for a complete file

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.rows)

    def __repr__(self) -> str:
        end = f" from {self.time[0]:g} to {self.time[-1]:g} s" if len(self) else ""
        return f"<Trajectory {self.path}: {self.number_of_people} people, {len(self)} recorded times{end}>"

    @cached_property
    def frame(self) -> "DataFrame":
        """One row for each person and recorded time, with the columns of `evac.analysis.tables.motion_table`."""
        from pandas import DataFrame

        from evac.analysis.tables import motion_table

        return DataFrame(motion_table(self))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on data that were ignored at the end of the file; empty for a complete file."""
        if not self.dropped_bytes:
            return ()
        return (
            f"{self.path}: {self.dropped_bytes} bytes after the last complete frame, from byte {self.end} on, are "
            "ignored; the run was killed or has not ended",
        )

    @property
    def number_of_people(self) -> int:
        """Number of all people."""
        return len(self.radius)

    @cached_property
    def records(self) -> tuple[NDArray[np.float32], ...]:
        """What is recorded of the people inside, (c, 7 or 8) float32 for each time: the header's fields."""
        return tuple(np.column_stack([r.person, r.level, r.motion]).astype(np.float32) for r in self.rows)

    @property
    def has_dose(self) -> bool:
        """Whether the doses of people are recorded."""
        return len(self.header["fields"]) == len(FIELDS_WITH_DOSE)

    @property
    def contrast(self) -> float:
        """Visibility times extinction coefficient in the case: 3 for things that reflect light, 8 for lit signs."""
        return float(self.header.get("contrast", CONTRAST))

    @cached_property
    def _first_seen(self) -> NDArray[np.int64]:
        """Number of the first frame in which each person is inside, (n,); the number of frames for nobody seen."""
        first = np.full(self.number_of_people, len(self), np.int64)
        for k in reversed(range(len(self))):
            first[self.rows[k].person] = k
        return first

    def out_at(self, k: int) -> int:
        """Return the number of people who have left until frame `k`; people who arrive count once a frame has them."""
        arriving = [name in self.header.get("arriving", ()) for name in self.groups]
        is_here = (self._first_seen <= k) | (self.group < 0) | ~np.array([*arriving, False])[self.group]
        return int(is_here.sum()) - len(self.rows[k].person)

    @cached_property
    def changes(self) -> tuple[Change, ...]:
        """Changes of the scene during the run, in order of time."""
        return tuple(change for rows in self.rows for change in rows.changes)

    def field(self, name: str) -> LevelField:
        """Return a field of a behaviour, whose values are (f, m) for f recorded times and the m cells of all levels.

        Parameters
        ----------
        name : str

        Raises
        ------
        ResultError
            No behaviour of the run had a field of this name.
        """
        names = [level_field.name for level_field in self.level_fields]
        if name not in names:
            raise ResultError(f"{self.path}: there is no field {name!r}; {did_you_mean(name, names)}")
        field = copy(self.level_fields[names.index(name)])
        field.values = np.array([rows.fields[names.index(name)] for rows in self.rows], np.float64)
        return field

    def field_at_people(self, name: str, frame: Frame) -> FloatArray:
        """Return the values (c,) of a field in the cells in which the people of a frame are.

        Parameters
        ----------
        name : str
            Name of one of `level_fields`.
        frame : Frame
        """
        number = [level_field.name for level_field in self.level_fields].index(name)
        field = copy(self.level_fields[number])
        field.values = self.rows[self.nearest(frame["time"])].fields[number].astype(np.float64)
        return field.at(frame["level"], frame["position"])

    def building_at(self, time: float) -> Building:
        """Return the building as it is at `time` [s], with what changes of the scene have closed, opened or slowed."""
        return self._buildings[bisect_right(self.changes, time, key=lambda change: change.time)]

    @cached_property
    def _buildings(self) -> list[Building]:
        """The building before all changes and after each of them; the same one for equal conditions."""
        buildings, known = [self.building], {self.building.condition: self.building}
        for change in self.changes:
            after = building_at(buildings[-1], [change], change.time)
            buildings.append(known.setdefault(after.condition, after))
        return buildings

    @cached_property
    def origin(self) -> FloatArray:
        """Origin of the recorded positions in plan, (2,) [m]."""
        return np.array(self.header["origin"], np.float64)

    @cached_property
    def _grounds(self) -> "tuple[list[Ground], FloatArray]":
        """The ground of each level, and the rise of each per metre along x and y, (levels, 2)."""
        from evac.building.model.elevation import gradients, ground_of

        building = self.building
        return [ground_of(building.vertices, level) for level in building.levels], gradients(building)

    def __getitem__(self, k: int) -> Frame:
        """Return the people inside in frame `k`; negative indices count from the end."""
        from evac.building.model.elevation import heights_on, in_space

        grounds, gradients = self._grounds
        rows = self.rows[k]
        motion = rows.motion.astype(np.float64)
        person, level = rows.person.astype(np.int32), rows.level.astype(np.int32)
        position = motion[:, :2] + self.origin
        velocity = in_space(gradients, level, motion[:, 2:4])
        return Frame(
            time=float(self.time[k]),
            person=person,
            level=level,
            position=position,
            z=heights_on(grounds, level, position) + self._risen(float(self.time[k]), level),
            velocity=velocity,
            speed=np.linalg.norm(velocity, axis=1),
            started=rows.started,
            contact_force=motion[:, 4],
            crowd_pressure=motion[:, 4] / (2.0 * np.pi * self.radius[person]),
            dose=motion[:, 5] if self.has_dose else np.zeros(len(person)),
        )

    def _risen(self, time: float, level: IntArray) -> FloatArray | float:
        """Return how far people on some levels are above these at a time, in cars that ride, (c,) [m]."""
        if not self.building.lifts:
            return 0.0
        from evac.building.model.lifts import cars_at

        off = np.zeros(len(self.building.levels))
        for car in cars_at(self.building, self.changes, time):
            off[car.level] = car.rise
        return np.asarray(off[level])

    def maps(self, levels: "Iterable[str | int] | None" = None, **options: Any) -> "Mapping[str, LevelMaps]":
        """Return maps of density, speed, flow, ... of levels: see `evac.analysis.maps.level_maps`."""
        from evac.analysis.maps import level_maps

        return level_maps(self, levels, **options)

    def to_pedpy(self, level: str | int) -> "tuple[TrajectoryData, WalkableArea]":
        """Return the motion on a level and its walkable area for PedPy: see `evac.analysis.tables.to_pedpy`."""
        from evac.analysis.tables import to_pedpy

        return to_pedpy(self, level)

    def nearest(self, time: float) -> int:
        """Return the index of the frame nearest to `time` [s]."""
        return int(np.abs(self.time - time).argmin())

    @cached_property
    def position(self) -> FloatArray:
        """Plan positions, (f, n, 2) [m]; NaN for people who are out."""
        return self._padded("position", (2,))

    @cached_property
    def z(self) -> FloatArray:
        """Heights, (f, n) [m]; NaN for people who are out."""
        return self._padded("z", ())

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities in space, (f, n, 3) [m/s]; NaN for people who are out."""
        return self._padded("velocity", (3,))

    @cached_property
    def speed(self) -> FloatArray:
        """Speeds, along the slope on stairs, (f, n) [m/s]; NaN for people who are out."""
        return self._padded("speed", ())

    @cached_property
    def contact_force(self) -> FloatArray:
        """Sums of contact forces, (f, n) [N]; NaN for people who are out."""
        return self._padded("contact_force", ())

    @cached_property
    def crowd_pressure(self) -> FloatArray:
        """Contact forces over the circumference of the body, (f, n) [N/m]; NaN for people who are out."""
        return self._padded("crowd_pressure", ())

    @cached_property
    def dose(self) -> FloatArray:
        """Greater doses, of gases or heat, (f, n); 0 in a case without doses, NaN for people who are out."""
        return self._padded("dose", ())

    @cached_property
    def level(self) -> IntArray:
        """Levels, (f, n) int32; -1 for people who are out."""
        level = np.nan_to_num(self._padded("level", ()), nan=-1.0).astype(np.int32)
        level.flags.writeable = False
        return level

    @cached_property
    def _frames(self) -> list[Frame]:
        return [self[k] for k in range(len(self))]

    def _padded(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        values = np.full((len(self), self.number_of_people, *shape), np.nan)
        for k, frame in enumerate(self._frames):
            values[k, frame["person"]] = frame[name]  # type: ignore[literal-required]
        values.flags.writeable = False
        return values


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory file, or that of a result folder; an incomplete last frame of a killed run is ignored.

    The file is mapped into memory: everything is checked once, and records are read from the file when they are used.
    The file must not be truncated while the trajectory is in use; it may grow or be removed.

    Raises
    ------
    ResultError
        The file does not exist, is not a trajectory of a known format, or is damaged before its last frame.
    """
    path = usable_path(path, ResultError)
    path = path / TRAJECTORY_NAME if path.is_dir() else path
    data = _mapped(path)
    header, schema, start = _read_header(path, data)
    rows, end = _read_frames(path, data, schema, start)
    return _trajectory(path, header, rows, end, len(data) - end)


def trajectory_in_memory(recorded: Recorded) -> Trajectory:
    """Return the trajectory of a run without a folder."""
    return _trajectory(IN_MEMORY / TRAJECTORY_NAME, json.loads(recorded.header), recorded.rows)


def _trajectory(
    path: Path, header: dict[str, Any], rows: Sequence[Rows], end: int = 0, dropped_bytes: int = 0
) -> Trajectory:
    building = building_from_json(header["building"])
    group, time = np.array(header["group"], np.int32), np.array([one.time for one in rows], np.float64)
    radius, height = np.array(header["radius"], np.float64), np.array(header["height"], np.float64)
    for array in (group, radius, height, time):
        array.flags.writeable = False
    fields = (LevelField(building, own["name"], own["unit"], own["spacing"]) for own in header["level_fields"])
    return Trajectory(
        path=path,
        header=header,
        building=building,
        group=group,
        groups=tuple(header["groups"]),
        radius=radius,
        height=height,
        time=time,
        rows=tuple(rows),
        level_fields=tuple(fields),
        end=end,
        dropped_bytes=dropped_bytes,
    )


def continued(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory with the frames that its run has written since it was read, which alone are read."""
    data = _mapped(trajectory.path)
    _, schema, _ = _read_header(trajectory.path, data)
    frames, end = _read_frames(trajectory.path, data, schema, trajectory.end)
    rows = (*trajectory.rows, *frames)
    return replace(
        trajectory, rows=rows, time=np.array([row.time for row in rows]), end=end, dropped_bytes=len(data) - end
    )


def _mapped(path: Path) -> mmap.mmap:
    """Return the bytes of a file, mapped into memory."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise ResultError(f"{path}: not a file; give a {TRAJECTORY_NAME} or the folder that contains one")
        with path.open("rb") as file:
            if not os.fstat(file.fileno()).st_size:  # which cannot be mapped
                raise _damaged(path, "the file is empty")
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError as error:
        raise ResultError(
            f"{path}: no such file; check the path, or run the case with output.trajectory = true"
        ) from error
    except OSError as error:
        raise ResultError(f"{path}: cannot read the trajectory: {error.strerror}; check the path") from error


def _read_header(path: Path, data: mmap.mmap) -> tuple[dict[str, Any], pa.Schema, int]:
    """Return the header of a file, its columns, and the byte at which the frames start."""
    if data[: len(MARK)] != MARK:
        raise ResultError(
            f"{path}: not a trajectory of evac, which is an Arrow stream (it does not start with four bytes FF); "
            f"give a {TRAJECTORY_NAME}"
        )
    record = read_sealed(data, 0, len(data))
    if record is None:
        end = PREFIX + int.from_bytes(data[len(MARK) : PREFIX], "little")
        what = "it does not match its checksum" if end <= len(data) else f"it should end at byte {end} of {len(data)}"
        raise _damaged(path, f"the header is damaged or incomplete: {what}")
    schema = pa.ipc.read_schema(pa.py_buffer(record))
    header = json.loads((schema.metadata or {}).get(TRAJECTORY_KEY, b"{}"))
    if (found := header.get("format")) != FORMAT:
        raise ResultError(
            f"{path}: unknown trajectory format {found!r:.40}; this version reads format {FORMAT}; run the case again, "
            "or use the version of evac that wrote it"
        )
    return header, schema.remove_metadata(), len(record)


def _read_frames(path: Path, data: mmap.mmap, schema: pa.Schema, end: int) -> tuple[list[Rows], int]:
    """Return all frames from a byte on, and the byte at which the last one ends."""
    # A frame that is incomplete or does not match its checksum is left out, as a kill or a failure of the system leaves
    # it, if no other one begins behind it.
    frames: list[Rows] = []
    whole = pa.py_buffer(data)
    while (record := read_sealed(data, end, len(data))) is not None:
        frames.append(_rows(pa.ipc.read_record_batch(whole.slice(end, len(record)), schema)))
        end += len(record)
    if data.find(MARK, end + len(MARK)) >= 0:
        last = f"up to {frames[-1].time:.2f} s" if frames else "none"
        what = f"frame {len(frames)} at byte {end} is damaged: it does not match its checksum"
        raise _damaged(path, f"{what}; a copy cut to {end} bytes holds the frames before it, {last}")
    return frames, end


def _rows(batch: pa.RecordBatch) -> Rows:
    """Return the content of a frame."""
    time, people, changes, *fields = batch.columns
    person, level, started, motion = people.values.flatten()  # the method of lists would import pyarrow.compute
    bits = np.frombuffer(started.buffers()[1] or b"", np.uint8)
    return Rows(
        time[0].as_py(),
        _numbers(person),
        _numbers(level),
        np.unpackbits(bits, count=len(started), bitorder="little").astype(np.bool_),
        _numbers(motion.values).reshape(-1, motion.type.list_size),
        tuple(map(Change.from_row, json.loads(changes[0].as_py() or "[]"))),
        tuple(_numbers(values.values) for values in fields),
    )


def _numbers(array: pa.Array) -> NDArray[Any]:
    """Return an array of numbers as a view; its method `to_numpy` would import pandas."""
    dtype = np.dtype(array.type.to_pandas_dtype())
    return np.frombuffer(array.buffers()[1] or b"", dtype, len(array), array.offset * dtype.itemsize)


def _damaged(path: Path, what: str) -> ResultError:
    return ResultError(f"{path}: {what}; run the case again, or take an undamaged copy")


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
        crowd: "Crowd",
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
        for one, numbers in zip(fields, values, strict=True):
            if not np.isfinite(numbers).all():
                raise SimulationError(
                    f"t = {time:.3f} s: a value of field {one.name!r} is too large to be recorded; use another unit"
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
