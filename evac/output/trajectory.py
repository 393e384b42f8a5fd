"""The trajectory file: a JSON header, then append-only frames. Byte by byte in docs/trajectory.md."""

import json
import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray, IntArray
from evac.building.model import Building
from evac.errors import ResultError
from evac.output.files import TRAJECTORY_NAME, writing
from evac.output.header import building_from_json
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from pedpy import TrajectoryData, WalkableArea

    from evac.output.maps import LevelMaps

MAGIC = b"EVACTRJ1"
#: One float32 each, little-endian; x and y count from the header's origin.
FIELDS = ("person", "level", "x", "y", "velocity_x", "velocity_y", "contact_force")
RECORD_BYTES = 4 * len(FIELDS)
_HEADER_LENGTH = struct.Struct("<I")
_STAMP = struct.Struct("<dI")  # time [s], number of records
_CHECK = struct.Struct("<I")  # CRC-32 of the stamp and the records
FRAME_HEAD_BYTES = _STAMP.size + _CHECK.size


class TrajectoryWriter:
    """Writes a header at once and then one frame after the other, each handed to the system before returning.

    Parameters
    ----------
    path : Path
        Replaced if it is there; its folder is made if it is not.
    header : mapping
        JSON data: ``title``, ``building`` (`evac.output.header.building_to_json`), ``groups`` (list of names),
        ``group`` (list: row of ``groups`` per person, -1 for none), ``radius`` (list [m]) and what else is
        worth keeping. Format, fields and origin are added.
    origin : (2,) float64 [m]
        Plan point that the recorded positions count from, so that float32 is fine enough anywhere on Earth.

    Raises
    ------
    ResultError
        The file cannot be written.
    """

    def __init__(self, path: Path, header: Mapping[str, Any], origin: FloatArray) -> None:
        self.path = path
        self._origin = np.asarray(origin, np.float64)
        people = len(header["radius"])
        self._buffer = bytearray(FRAME_HEAD_BYTES + RECORD_BYTES * people)
        self._view = memoryview(self._buffer)
        self._records = np.frombuffer(self._buffer, "<f4", offset=FRAME_HEAD_BYTES).reshape(people, len(FIELDS))
        layout = {"format": 1, "fields": FIELDS, "origin": self._origin.tolist()}
        text = json.dumps({**header, **layout}, allow_nan=False).encode()
        with writing("the trajectory", path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb")
            self._file.write(MAGIC + _HEADER_LENGTH.pack(len(text)) + text)
            self._file.flush()

    def append(self, time: float, crowd: Crowd, velocity: FloatArray) -> None:
        """Write one frame: everybody who is inside at `time`.

        Parameters
        ----------
        time : float [s]
        crowd : Crowd
        velocity : (n, 2)
            Velocities to record, in plan [m/s]: `Simulation.displacement_velocity`.

        Raises
        ------
        ResultError
            The file cannot be written, for example because the disk is full.
        """
        rows = np.flatnonzero(crowd.level >= 0)
        records = self._records[: rows.size]
        records[:, 0] = rows
        records[:, 1] = crowd.level[rows]
        records[:, 2:4] = crowd.position[rows] - self._origin
        records[:, 4:6] = velocity[rows]
        records[:, 6] = crowd.contact_force[rows]
        end = FRAME_HEAD_BYTES + RECORD_BYTES * rows.size
        _STAMP.pack_into(self._buffer, 0, time, rows.size)
        check = zlib.crc32(self._view[FRAME_HEAD_BYTES:end], zlib.crc32(self._view[: _STAMP.size]))
        _CHECK.pack_into(self._buffer, _STAMP.size, check)
        with writing(f"the trajectory at {time:.3f} s", self.path):
            self._file.write(self._view[:end])
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Frame(TypedDict):
    """Everybody who is inside at one time; c rows.

    Attributes
    ----------
    time : float [s]
    person : (c,) int32
        Row of the per-person arrays.
    level : (c,) int32
        Row of ``Building.levels``.
    position : (c, 2) float64 [m]
        In plan.
    z : (c,) float64 [m]
    velocity : (c, 3) float64 [m/s]
        Displacement over the last tick, in space; its vertical part is that of the slope.
    speed : (c,) float64 [m/s]
        Length of the velocity, so along the slope on stairs.
    contact_force : (c,) float64 [N]
        Sum of the contact forces.
    crowd_pressure : (c,) float64 [N/m]
        Contact force over the circumference of the body, 2 pi r, as in Helbing, Farkas and Vicsek (2000).
    """

    time: float
    person: IntArray
    level: IntArray
    position: FloatArray
    z: FloatArray
    velocity: FloatArray
    speed: FloatArray
    contact_force: FloatArray
    crowd_pressure: FloatArray


@dataclass(frozen=True)
class Trajectory:
    """A trajectory file as it was read.

    Attributes
    ----------
    path : Path
    header : dict
        As written, see docs/trajectory.md.
    building : Building
    group : (n,) int32
        Row of ``groups`` of each person, -1 for none.
    groups : tuple of str
    radius : (n,) float64 [m]
    time : (f,) float64 [s]
    records : tuple of (c, 7) float32
        The records of each frame, columns `FIELDS`.
    dropped_bytes : int
        Length of the torn last frame that was left out; 0 where the file ends as it should.
    """

    path: Path
    header: dict[str, Any]
    building: Building
    group: IntArray
    groups: tuple[str, ...]
    radius: FloatArray
    time: FloatArray
    records: tuple[NDArray[np.float32], ...]
    dropped_bytes: int

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.records)

    @property
    def people(self) -> int:
        """Number of people at the start, inside or not."""
        return len(self.radius)

    @cached_property
    def origin(self) -> FloatArray:
        """Plan point that the recorded positions count from, (2,) [m]."""
        return np.array(self.header["origin"], np.float64)

    @cached_property
    def _climb(self) -> FloatArray:
        """Rise per metre of plan, (levels, 2): velocity . climb is the vertical velocity."""
        return np.array([np.tan(level.slope) * level.uphill for level in self.building.levels]).reshape(-1, 2)

    def frame(self, k: int) -> Frame:
        """Return frame `k`; negative counts from the end."""
        from evac.building.elevation import elevation

        records = self.records[k].astype(np.float64)
        level = records[:, 1].astype(np.int32)
        position = records[:, 2:4] + self.origin
        plan_velocity = records[:, 4:6]
        rise = np.einsum("ij,ij->i", plan_velocity, self._climb[level])
        velocity = np.column_stack([plan_velocity, rise])
        person = records[:, 0].astype(np.int32)
        return Frame(
            time=float(self.time[k]),
            person=person,
            level=level,
            position=position,
            z=elevation(self.building, level, position),
            velocity=velocity,
            speed=np.linalg.norm(velocity, axis=1),
            contact_force=records[:, 6],
            crowd_pressure=records[:, 6] / (2.0 * np.pi * self.radius[person]),
        )

    def maps(self, levels: "Iterable[str | int] | None" = None, **options: Any) -> "Mapping[str, LevelMaps]":
        """Return maps of density, speed, flow, ... of levels: see `evac.output.maps.level_maps`."""
        from evac.output.maps import level_maps

        return level_maps(self, levels, **options)

    def to_pedpy(self, level: str | int) -> "tuple[TrajectoryData, WalkableArea]":
        """Return the motion on a level and its floor as PedPy takes them: see `evac.output.pedpy_data.to_pedpy`."""
        from evac.output.pedpy_data import to_pedpy

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
    def level(self) -> IntArray:
        """Levels, (f, n) int32; -1 for people who are out."""
        return np.nan_to_num(self._padded("level", ()), nan=-1.0).astype(np.int32)

    @cached_property
    def _frames(self) -> list[Frame]:
        return [self.frame(k) for k in range(len(self))]

    def _padded(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        values = np.full((len(self), self.people, *shape), np.nan)
        for k, frame in enumerate(self._frames):
            values[k, frame["person"]] = frame[name]  # type: ignore[literal-required]
        return values


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory file, or that of a result folder; a torn last frame is left out.

    Raises
    ------
    ResultError
        The file is not there, is no trajectory of this format, or is damaged before its last frame.
    """
    path = Path(path)
    path = path / TRAJECTORY_NAME if path.is_dir() else path
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ResultError(f"{path}: cannot read the trajectory: {error}") from error
    header, start = _read_header(path, data)
    try:
        building = building_from_json(header["building"])
        radius = np.array(header["radius"], np.float64)
        group, groups = np.array(header["group"], np.int32), tuple(header["groups"])
        np.array(header["origin"], np.float64).reshape(2)
    except KeyError as error:
        raise _damaged(path, f"the header lacks {error}; the file was not written by this version") from error
    except (AttributeError, TypeError, ValueError, IndexError) as error:
        raise _damaged(path, f"the header is damaged: {error}") from error
    time, records, end = _read_frames(path, data, start, len(radius))
    return Trajectory(path, header, building, group, groups, radius, time, records, len(data) - end)


def _damaged(path: Path, what: str) -> ResultError:
    return ResultError(f"{path}: {what}; run the case again, or take an undamaged copy")


def _read_header(path: Path, data: bytes) -> tuple[dict[str, Any], int]:
    """Return the header and the byte at which the frames start."""
    if not data.startswith(MAGIC):
        raise ResultError(
            f"{path}: not a trajectory of evac (it does not start with {MAGIC.decode()}); name a {TRAJECTORY_NAME}"
        )
    first = len(MAGIC) + _HEADER_LENGTH.size
    end = first + (_HEADER_LENGTH.unpack_from(data, len(MAGIC))[0] if len(data) >= first else 0)
    if len(data) < max(end, first):
        raise ResultError(f"{path}: the header is cut off, the run ended before its first frame; run the case again")
    try:
        header = json.loads(data[first:end])
    except ValueError as error:
        raise _damaged(path, f"the header is no JSON: {error}") from error
    if not isinstance(header, dict) or header.get("format") != 1:
        found = header.get("format") if isinstance(header, dict) else header
        raise ResultError(
            f"{path}: trajectory format {found!r} is unknown; this version reads format 1; run the case again with it"
        )
    if header.get("fields") != list(FIELDS):
        raise _damaged(path, f"the header's fields are {header.get('fields')!r}; they must be {list(FIELDS)}")
    return header, end


def _read_frames(
    path: Path, data: bytes, start: int, people: int
) -> tuple[FloatArray, tuple[NDArray[np.float32], ...], int]:
    """Return times and records of the whole frames from byte `start`, and the byte at which they end."""
    view = memoryview(data)
    times: list[float] = []
    records: list[NDArray[np.float32]] = []
    while start + FRAME_HEAD_BYTES <= len(data):
        time, count = _STAMP.unpack_from(data, start)
        first = start + FRAME_HEAD_BYTES
        end = first + RECORD_BYTES * count
        if end > len(data) and count <= people:
            break
        check = _CHECK.unpack_from(data, start + _STAMP.size)[0]
        if count > people or check != zlib.crc32(view[first:end], zlib.crc32(view[start : start + _STAMP.size])):
            if end == len(data):
                break
            raise _damaged(path, f"frame {len(times)} at byte {start} is damaged (its checksum does not match)")
        times.append(time)
        records.append(np.frombuffer(data, "<f4", count * len(FIELDS), first).reshape(count, len(FIELDS)))
        start = end
    return np.array(times, np.float64), tuple(records), start
