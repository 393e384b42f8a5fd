"""The bodies of a tick: copied from the crowd and back, in the order of places, or of travel times to an exit."""

import math
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray, pairs_of
from evac.directions.fields import columns_of
from evac.directions.sampling import sample_travel_times
from evac.physics.state import Bodies, Crowd, State, World

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


#: Arrays of the bodies that are copied from the crowd at the start of a tick, and back at its end.
_taken = attrgetter(*(name for name in Crowd.kinds if name in Bodies.kinds))
_written = attrgetter("position", "velocity", "level", "distance", "overlap", "mingled", "contact_force", "passing")


def rows_by_travel_time(world: World, crowd: Crowd) -> NDArray[np.int64]:
    """Return the rows of the people inside, the nearest to their destination first, ties in order of rows."""
    rows = np.flatnonzero(crowd.level >= 0)
    travel_time = np.empty(len(rows))
    column = columns_of(world.fields, crowd.route[rows], crowd.contact_radius[rows])
    sample_travel_times(world.fields, crowd.position.take(rows, 0), crowd.level[rows], column, travel_time)
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


def gather(state: State, crowd: Crowd, inside: int) -> None:
    """Copy the people in ``bodies.row`` to the bodies, and reset the data of the previous tick."""
    bodies = state.bodies
    rows = bodies.row[:inside].astype(np.intp)
    for given, kept in zip(_taken(crowd), _taken(bodies), strict=True):
        given.take(rows, 0, kept[:inside], "clip")  # which, unlike "raise", writes without a buffer
    bodies.column[:inside] = columns_of(state.world.fields, crowd.route[rows], bodies.contact_radius[:inside])
    mass = 1.0 if state.traits.overdamped else bodies.mass[:inside]
    bodies.inverse_mass[:inside] = 1.0 / mass / bodies.firmness[:inside]
    bodies.lightest = 1.0 / bodies.inverse_mass[:inside].max(initial=1e-300)
    bodies.smallest = bodies.contact_radius[:inside].min(initial=math.inf)
    bodies.inside = inside
    bodies.mingled[:inside] &= bodies.overlap[:inside] > 0.5 * bodies.smallest
    bodies.overlap[:inside] = 0.0
    bodies.relaxation_step = 0.0
    bodies.node[:inside] = -1
    state.warm_start.number = 0
    state.contacts.separation_failed = 0
    state.lists.stale = 1
    state.events.number = 0


def scatter(crowd: Crowd, bodies: Bodies) -> None:
    """Copy the results of the steps back to the crowd."""
    rows = bodies.row[: bodies.inside].astype(np.intp)
    for written, source in zip(_written(crowd), _written(bodies), strict=True):
        if source.ndim == 2:
            written, source = pairs_of(written), pairs_of(source)
        written[rows] = source[: bodies.inside]
