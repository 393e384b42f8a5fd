"""The recorded motion as programs for tables and measurements need it: one table, or frames at equal intervals."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import IntArray
from evac.base.errors import ResultError
from evac.trajectory.trajectory import Trajectory

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
    """Return the motion of all people: a row for each person inside at each recorded time.

    Returns
    -------
    mapping of str to (r,) array
        The columns `MOTION_COLUMNS`, sorted by time and then by person. Group and level are names; the group of
        people without group is empty. ``dose`` is there with ``[dose]``, and ``extinction``, that of the cell in which
        each person is, with smoke. See `evac.trajectory.trajectory.Frame` for the others.

    Examples
    --------
    >>> import pandas as pd  # doctest: +SKIP
    >>> table = pd.DataFrame(motion_table(trajectory))  # doctest: +SKIP
    """
    frames = [trajectory[k] for k in range(len(trajectory))]
    levels = np.array([level.name for level in trajectory.building.levels], dtype=object)
    groups = np.array([*trajectory.groups, ""], dtype=object)

    def column(name: str, kind: Any = np.float64) -> NDArray[Any]:
        return np.concatenate([np.zeros(0, kind), *(frame[name] for frame in frames)])  # type: ignore[literal-required]

    person, names = column("person", np.int32), ["z", "speed", "contact_force", "crowd_pressure"]
    position = np.concatenate([np.zeros((0, 2)), *(frame["position"] for frame in frames)])
    velocity = np.concatenate([np.zeros((0, 3)), *(frame["velocity"] for frame in frames)])
    found = {
        "time": np.repeat(trajectory.time, [len(frame["person"]) for frame in frames]),
        "person": person,
        "group": groups[trajectory.group[person]],
        "level": levels[column("level", np.int32)],
        **dict(zip("xy", position.T, strict=True)),
        **{f"velocity_{axis}": values for axis, values in zip("xyz", velocity.T, strict=True)},
        **{name: column(name) for name in names + ["dose"] * trajectory.has_dose},
    }
    if "extinction" in [field.name for field in trajectory.level_fields]:
        met = [trajectory.field_at_people("extinction", frame) for frame in frames]
        found["extinction"] = np.concatenate([np.zeros(0), *met])
    return {name: found[name] for name in MOTION_COLUMNS if name in found}


def regular_frames(trajectory: Trajectory) -> tuple[IntArray, float]:
    """Return the frames at multiples of the interval between the first two, and the frame rate.

    The last frame is left out if the run ended between two output times.

    Returns
    -------
    frames : (f,) int32
        Rows of ``trajectory.time``.
    frame_rate : float [1/s]
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
