"""Conversion of a recorded level to PedPy, to measure densities, speeds, flows and fundamental diagrams.

PedPy (https://pedpy.readthedocs.io) is installed with ``pip install evac[pedpy]``.
"""

from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.analysis.tables import regular_frames
from evac.base.errors import ResultError
from evac.building.model.storeys import level_of
from evac.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    import pedpy


def to_pedpy(trajectory: Trajectory, level: str | int) -> "tuple[pedpy.TrajectoryData, pedpy.WalkableArea]":
    """Return the motion on one level and its floor as objects of PedPy.

    Returns
    -------
    motion : pedpy.TrajectoryData
        ``id`` is the person's row, ``frame`` counts recorded frames, ``x`` and ``y`` are in plan [m]. Only people on
        the level are in it; a person who leaves the level and returns has a gap in the frames.
    area : pedpy.WalkableArea
        The plan of the level.
    """
    try:
        import pandas as pd
        import pedpy
    except ImportError as error:
        raise ResultError(f"PedPy cannot be imported ({error}); install it with pip install evac[pedpy]") from error
    shown_level = level_of(trajectory.building, level)
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
