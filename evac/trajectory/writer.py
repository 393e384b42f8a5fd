"""Writing of trajectory files, frame by frame. The format is specified in docs/trajectory.md."""

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError, SimulationError
from evac.folder.files import writing
from evac.folder.manifest import note_written
from evac.physics.state import Crowd
from evac.trajectory.layout import CHECK, FIELDS, FRAME, FRAME_HEAD_BYTES, RECORD_BYTES, damaged, pack_start
from evac.trajectory.trajectory import Trajectory, read_up_to


def read_to_continue(path: Path, length: int | None) -> Trajectory:
    """Read the part of a trajectory file that `TrajectoryWriter.reopen` keeps.

    Raises
    ------
    ResultError
        The file is damaged or too short, no frame ends there, or it is of format 1.
    """
    before = read_up_to(path, length)
    if before.dropped_bytes:
        raise damaged(path, f"no frame ends at byte {before.end + before.dropped_bytes}")
    if before.header["format"] != 2:
        raise ResultError(f"{path}: trajectory format 1 can be read, not continued; run the case again")
    return before


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

    Attributes
    ----------
    path : Path
    length : int
        Number of bytes written: the end of the last frame, or of the header if there is none. See `reopen`.
    frames : int
        Number of frames written.

    Raises
    ------
    ResultError
        The file cannot be written.
    """

    def __init__(self, path: Path, header: Mapping[str, Any], origin: FloatArray) -> None:
        origin = np.asarray(origin, np.float64)
        start = pack_start(path, {**header, "format": 2, "fields": FIELDS, "origin": origin.tolist()})
        self._set_up(path, origin, len(header["radius"]), 0, 0)
        with writing("the trajectory", path):
            path.parent.mkdir(parents=True, exist_ok=True)
            note_written([path])
            path.unlink(missing_ok=True)  # a link is not followed
            self._file = path.open("xb", buffering=0)
            self._write(memoryview(start))

    @classmethod
    def reopen(cls, path: Path, length: int | None = None) -> Self:
        """Return a writer that appends to a file, after reading and checking the part that is kept.

        Parameters
        ----------
        path : Path
        length : int, optional
            `length` of the earlier writer, to which the file is truncated. By default the whole file is kept.

        Raises
        ------
        ResultError
            The file is damaged or too short, no frame ends there, it is of format 1, or it cannot be written.
        """
        before = read_to_continue(path, length)
        writer = cls.__new__(cls)
        writer._set_up(path, before.origin, before.number_of_people, before.end, len(before))
        del before  # some systems cannot truncate a mapped file
        with writing("the trajectory", path):
            writer._file = path.open("r+b", buffering=0)
            writer._file.truncate(writer.length)
            writer._file.seek(writer.length)
        return writer

    def _set_up(self, path: Path, origin: FloatArray, people: int, length: int, frames: int) -> None:
        self.path, self.length, self.frames = path, length, frames
        self._origin = origin
        self._buffer = bytearray(FRAME_HEAD_BYTES + RECORD_BYTES * people)
        self._view = memoryview(self._buffer)
        self._records = np.frombuffer(self._buffer, "<f4", offset=FRAME_HEAD_BYTES).reshape(people, len(FIELDS))

    def append(self, time: float, crowd: Crowd, velocity: FloatArray) -> None:
        """Write one frame with all people who are inside at `time`.

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
        SimulationError
            A number is NaN, or infinite as float32.
        """
        rows = np.flatnonzero(crowd.level >= 0)
        records = self._records[: rows.size]
        with np.errstate(over="ignore"):  # reported below
            records[:, 0] = rows
            records[:, 1] = crowd.level[rows]
            records[:, 2:4] = crowd.position[rows] - self._origin
            records[:, 4:6] = velocity[rows]
            records[:, 6] = crowd.contact_force[rows]
        if not np.isfinite(records).all():
            row, column = np.argwhere(~np.isfinite(records))[0]
            raise SimulationError(
                f"t = {time:.3f} s: {FIELDS[column]} of person {rows[row]} is {records[row, column]} and cannot be "
                "recorded; correct the plugin that sets it, or choose a smaller step"
            )
        first, end = FRAME_HEAD_BYTES, FRAME_HEAD_BYTES + RECORD_BYTES * rows.size
        FRAME.pack_into(self._buffer, 0, time, self.frames, rows.size)
        CHECK.pack_into(self._buffer, FRAME.size, zlib.crc32(self._view[: FRAME.size]))
        CHECK.pack_into(self._buffer, FRAME.size + CHECK.size, zlib.crc32(self._view[first:end]))
        with writing(f"the trajectory at {time:.3f} s", self.path):
            self._write(self._view[:end])
        self.frames += 1

    def _write(self, data: memoryview) -> None:
        """Write all bytes, in several calls if the system writes only a part."""
        written = 0
        while written < len(data):
            written += self._file.write(data[written:])
        self.length += written

    def close(self) -> None:
        """Close the file."""
        self._file.close()
