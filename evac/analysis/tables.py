"""The recorded motion for other programs: one table, frames at equal intervals, and the objects of PedPy."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import IntArray
from evac.base.errors import ResultError
from evac.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    import pedpy


#: Columns of the table of motion, and their units; the last two only of runs in which they are recorded.
MOTION_COLUMNS = {
    "time": "s",
    "person": "",
    "group": "",
    "level": "",
    "x": "m",
    "y": "m",
    "z": "m",
    "velocity_x": "m/s",
    "velocity_y": "m/s",
    "velocity_z": "m/s",
    "speed": "m/s",
    "contact_force": "N",
    "crowd_pressure": "N/m",
    "dose": "",
    "extinction": "1/m",
}


def motion_table(trajectory: Trajectory) -> Mapping[str, NDArray[Any]]:
    """Return the `MOTION_COLUMNS` (r,): a row for each person inside at each recorded time, by time and then by person.

    Group and level are names, on a stair its own; the group of people without group is empty. ``dose`` is there with
    ``[dose]``, and ``extinction``, that of the cell in which each person is, with smoke. See
    `evac.trajectory.trajectory.Frame` for the others.
    """
    frames = [trajectory[k] for k in range(len(trajectory))]
    levels = np.array([level.title for level in trajectory.building.levels], dtype=object)
    groups = np.array([*trajectory.groups, ""], dtype=object)

    def column(name: str, kind: Any = np.float64) -> NDArray[Any]:
        return np.concatenate([np.zeros(0, kind), *(frame[name] for frame in frames)])  # type: ignore[literal-required]

    person, names = column("person", np.int32), ["z", "speed", "contact_force", "crowd_pressure"]
    position = np.concatenate([np.zeros((0, 2)), *(frame["position"] for frame in frames)])
    velocity = np.concatenate([np.zeros((0, 3)), *(frame["velocity"] for frame in frames)])
    table = {
        "time": np.repeat(trajectory.time, [len(frame["person"]) for frame in frames]),
        "person": person,
        "group": groups[trajectory.group[person]],
        "level": levels[column("level", np.int32)],
        **dict(zip("xy", position.T, strict=True)),
        **{f"velocity_{axis}": values for axis, values in zip("xyz", velocity.T, strict=True)},
        **{name: column(name) for name in names + ["dose"] * trajectory.has_dose},
    }
    if "extinction" in [field.name for field in trajectory.level_fields]:
        extinction = [trajectory.field_at_people("extinction", frame) for frame in frames]
        table["extinction"] = np.concatenate([np.zeros(0), *extinction])
    return {name: table[name] for name in MOTION_COLUMNS if name in table}


def regular_frames(trajectory: Trajectory) -> tuple[IntArray, float]:
    """Return the frames (f,) at multiples of the interval between the first two, and the frame rate [1/s].

    The last frame is left out if the run ended between two output times.
    """
    time = trajectory.time
    if len(time) < 2:
        raise ResultError(
            f"{trajectory.path}: {len(time)} recorded frames give no frame rate; record two or more: "
            "a longer run, or a smaller output.every"
        )
    interval = time[1] - time[0]
    number = (time - time[0]) / interval
    regular = np.abs(number - np.arange(len(time))) < 1e-6 * np.maximum(number, 1.0)
    if not regular[:-1].all():
        raise ResultError(
            f"{trajectory.path}: the recorded times are not at equal intervals from frame {int(regular.argmin())} on; "
            "run the case again"
        )
    return np.flatnonzero(regular).astype(np.int32), float(1.0 / interval)


def to_pedpy(trajectory: Trajectory, level: str | int) -> "tuple[pedpy.TrajectoryData, pedpy.WalkableArea]":
    """Return the motion on one level, and its plan, as objects of PedPy: TrajectoryData and WalkableArea.

    ``id`` is the person's row, ``frame`` counts recorded frames, ``x`` and ``y`` are in plan [m]. Only people on the
    level are in it; a person who leaves the level and returns has a gap in the frames.
    """
    try:
        import pandas as pd
        import pedpy
    except ImportError as error:
        raise ResultError(f"PedPy cannot be imported ({error}); install it with pip install evac[pedpy]") from error
    shown_level = trajectory.building.level_at(level)
    frames, frame_rate = regular_frames(trajectory)
    rows = []
    for number, k in enumerate(frames.tolist()):
        frame = trajectory[k]
        here = frame["level"] == shown_level.index
        person = frame["person"][here]
        rows.append(np.column_stack([person, np.full(len(person), number), frame["position"][here]]))
    table = np.concatenate(rows)
    if not len(table):
        raise ResultError(f"{trajectory.path}: nobody was ever on level {shown_level.name!r}; choose another one")
    data = pd.DataFrame(
        {"id": table[:, 0].astype(np.int64), "frame": table[:, 1].astype(np.int64), "x": table[:, 2], "y": table[:, 3]}
    )
    largest = max(shapely.get_parts(shown_level.polygon), key=lambda part: part.area)
    return pedpy.TrajectoryData(data=data, frame_rate=frame_rate), pedpy.WalkableArea(largest)
