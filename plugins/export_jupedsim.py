"""Exporter "jupedsim": JuPedSim SQLite databases (version 2), one for each level."""

import zlib
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import numpy as np
import shapely

from evac.analysis.tables import regular_frames
from evac.base.errors import ResultError
from evac.building.model.building import Level
from evac.export.exporter import Exporter, file_stems
from evac.trajectory.trajectory import Trajectory

VERSION = 2  #: Version of the schema, as used by jupedsim 1.0 to 1.3 and read by PedPy and the viewer of JuPedSim.

TABLES = """
CREATE TABLE trajectory_data (
    frame INTEGER NOT NULL, id INTEGER NOT NULL,
    pos_x REAL NOT NULL, pos_y REAL NOT NULL, ori_x REAL NOT NULL, ori_y REAL NOT NULL);
CREATE TABLE metadata (key TEXT NOT NULL UNIQUE PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE geometry (hash INTEGER NOT NULL, wkt TEXT NOT NULL);
CREATE UNIQUE INDEX geometry_hash ON geometry(hash);
CREATE TABLE frame_data (frame INTEGER NOT NULL, geometry_hash INTEGER NOT NULL);
CREATE INDEX frame_id_idx ON trajectory_data(frame, id);
"""

#: Speed below which people keep their previous orientation, since the direction of the velocity is undefined [m/s].
STANDING = 0.05


class JupedsimExporter(Exporter):
    """JuPedSim SQLite files (version 2), one for each level on which people were recorded."""

    name = "jupedsim"

    def write(self, trajectory: Trajectory, path: Path) -> Iterable[Path]:
        """Write ``LEVEL.sqlite`` for each level on which people were recorded.

        ``id`` is the row of the person; ``frame`` counts recorded frames; positions are in plan [m]; the orientation is
        the direction of the last velocity larger than `STANDING`.
        """
        frames, frame_rate = regular_frames(trajectory)
        rows = _rows(trajectory, frames.tolist())
        levels = trajectory.building.levels
        written = []
        for level, stem in zip(levels, file_stems(level.name for level in levels), strict=True):
            here = rows[rows[:, 0] == level.index, 1:]
            if len(here):
                written.append(path / f"{stem}.sqlite")
                _write(written[-1], level, here, len(frames), frame_rate)
        if not written:
            raise ResultError(f"{trajectory.path}: nobody was inside at any recorded time; there is nothing to export")
        return written


def _rows(trajectory: Trajectory, frames: list[int]) -> np.ndarray:
    """Return level, frame, person, x, y and orientation (2) of all people in all frames, (r, 7)."""
    orientation = np.tile([1.0, 0.0], (trajectory.number_of_people, 1))
    rows = []
    for number, k in enumerate(frames):
        frame = trajectory[k]
        person, velocity = frame["person"], frame["velocity"][:, :2]
        speed = np.linalg.norm(velocity, axis=1)
        moving = speed > STANDING
        orientation[person[moving]] = velocity[moving] / speed[moving, None]
        rows.append(
            np.column_stack(
                [frame["level"], np.full(len(person), number), person, frame["position"], orientation[person]]
            )
        )
    return np.concatenate(rows)


def _write(path: Path, level: Level, rows: np.ndarray, frames: int, frame_rate: float) -> None:
    """Write one database; convert SQLite errors to OSError, as for other files."""
    import sqlite3

    # A geometry collection of polygons, as written by JuPedSim.
    wkt = shapely.to_wkt(shapely.GeometryCollection(list(shapely.get_parts(level.polygon))), rounding_precision=-1)
    key = zlib.crc32(wkt.encode())
    sides = zip(("xmin", "ymin", "xmax", "ymax"), level.polygon.bounds, strict=True)
    metadata = {"version": VERSION, "fps": frame_rate, **dict(sides)}
    path.unlink(missing_ok=True)
    try:
        with closing(sqlite3.connect(path)) as base:
            base.executescript(TABLES)
            with base:
                base.executemany("INSERT INTO metadata VALUES (?, ?)", ((k, str(v)) for k, v in metadata.items()))
                base.execute("INSERT INTO geometry VALUES (?, ?)", (key, wkt))
                base.executemany("INSERT INTO frame_data VALUES (?, ?)", ((frame, key) for frame in range(frames)))
                typed = ((int(frame), int(person), *place) for frame, person, *place in rows.tolist())
                base.executemany("INSERT INTO trajectory_data VALUES (?, ?, ?, ?, ?, ?)", typed)
    except sqlite3.Error as error:
        raise OSError(f"{path}: {error}") from error
