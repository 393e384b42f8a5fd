"""Frames at equal intervals, for programs that use a frame rate instead of times."""

import numpy as np

from evac.base.arrays import IntArray
from evac.base.errors import ResultError
from evac.trajectory.trajectory import Trajectory


def regular_frames(trajectory: Trajectory) -> tuple[IntArray, float]:
    """Return the frames at multiples of the interval between the first two, and the frame rate.

    The last frame is left out if the run ended between two output times.

    Returns
    -------
    frames : (f,) int32
        Rows of ``trajectory.time``.
    frame_rate : float [1/s]

    Raises
    ------
    ResultError
        Fewer than two frames were recorded, or frames other than the last are not at equal intervals.
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
