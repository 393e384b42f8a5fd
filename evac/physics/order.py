"""The order of bodies in memory: by place, so that neighbours are close to each other, or by travel time to an exit."""

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.directions.fields import columns_of
from evac.directions.sampling import sample_travel_times
from evac.physics.state import Crowd, World

#: Places are rounded to a grid of 1 / PER_METRE [m], which repeats every 2**28 / PER_METRE = 4 km.
PER_METRE = 65536

#: Shifts and masks that put a zero between any two of the lower 28 bits of a number.
_SPREAD = (
    (16, 0xFFF0000FFFF),
    (8, 0xF00FF00FF00FF),
    (4, 0xF0F0F0F0F0F0F),
    (2, 0x33333333333333),
    (1, 0x55555555555555),
)


def rows_by_travel_time(world: World, crowd: Crowd) -> NDArray[np.int64]:
    """Return the rows of the people inside, the nearest to their destination first, ties in order of rows."""
    rows = np.flatnonzero(crowd.level >= 0)
    travel_time = np.empty(len(rows))
    column = columns_of(world.fields, crowd.route[rows], crowd.contact_radius[rows])
    sample_travel_times(world.fields, crowd.position[rows], crowd.level[rows], column, travel_time)
    return rows[np.argsort(travel_time, kind="stable")]


def rows_by_place(crowd: Crowd) -> NDArray[np.int64]:
    """Return the rows of the people inside, level by level along Morton's curve, ties in order of rows."""
    rows = np.flatnonzero(crowd.level >= 0)
    position = np.take(crowd.position, rows, axis=0)
    return rows[np.argsort(along_curve(position, crowd.level[rows]), kind="stable")]


def along_curve(position: FloatArray, level: IntArray) -> NDArray[np.int64]:
    """Return how far along the curve places (n, 2) [m] on levels (n,) are: the bits of x and y in turns."""
    bits = np.floor(PER_METRE * position).astype(np.int64) & 0xFFFFFFF
    for shift, mask in _SPREAD:
        bits = (bits | bits << shift) & mask
    return level.astype(np.int64) << 56 | bits[:, 0] << 1 | bits[:, 1]
