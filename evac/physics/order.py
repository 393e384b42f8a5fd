"""The bodies of a tick: copied from the crowd and back, in the order of places, or of travel times to an exit."""

import math

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.directions.sampling import column_of, sample_travel_time
from evac.jit import kernel
from evac.physics.state import Bodies, Crowd, State

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


def rows_by_travel_time(state: State, crowd: Crowd) -> IntArray:
    """Return the rows of the people inside, the nearest to their destination first, ties in order of rows."""
    bodies, inside = state.bodies, find_travel_times(state, crowd)
    rows: IntArray = bodies.row[:inside][np.argsort(bodies.distance[:inside], kind="stable")]
    return rows


@kernel
def find_travel_times(state: State, crowd: Crowd) -> int:
    """Write the rows of the people inside to the bodies, and their travel times [s] as distances; return the number."""
    bodies, fields, inside = state.bodies, state.world.fields, 0
    for p in range(len(crowd.level)):
        if crowd.level[p] >= 0:
            x, y = crowd.position[p, 0], crowd.position[p, 1]
            column = column_of(fields, crowd.route[p], crowd.contact_radius[p])
            bodies.row[inside] = p
            bodies.distance[inside] = sample_travel_time(fields, x, y, crowd.level[p], column)
            inside += 1
    return inside


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


@kernel
def gather(state: State, crowd: Crowd, inside: int) -> None:
    """Copy the people in ``bodies.row`` to the bodies, and reset the data of the previous tick."""
    bodies, fields = state.bodies, state.world.fields
    lightest, smallest = 1e-300, math.inf
    for b in range(inside):
        p = bodies.row[b]
        for k in range(2):
            bodies.position[b, k], bodies.velocity[b, k] = crowd.position[p, k], crowd.velocity[p, k]
            bodies.extra_direction[b, k], bodies.ahead[b, k] = crowd.extra_direction[p, k], crowd.ahead[p, k]
        for k in range(3):
            bodies.speed[b, k] = crowd.speed[p, k]
        bodies.level[b], bodies.group[b], bodies.passing[b] = crowd.level[p], crowd.group[p], crowd.passing[p]
        bodies.contact_radius[b], bodies.mass[b], bodies.tau[b] = crowd.contact_radius[p], crowd.mass[p], crowd.tau[p]
        bodies.start_time[b], bodies.speed_factor[b] = crowd.start_time[p], crowd.speed_factor[p]
        bodies.distance[b], bodies.contact_force[b] = crowd.distance[p], crowd.contact_force[p]
        bodies.firmness[b] = crowd.firmness[p]
        bodies.column[b] = column_of(fields, crowd.route[p], crowd.contact_radius[p])
        bodies.inverse_mass[b] = 1.0 / (1.0 if state.traits.overdamped else bodies.mass[b]) / bodies.firmness[b]
        lightest = max(lightest, bodies.inverse_mass[b])
        smallest = min(smallest, bodies.contact_radius[b])
        bodies.node[b] = -1
    for b in range(inside):
        p = bodies.row[b]
        bodies.mingled[b] = 1 if crowd.mingled[p] and crowd.overlap[p] > 0.5 * smallest else 0
        bodies.overlap[b] = 0.0
    bodies.lightest, bodies.smallest, bodies.inside = 1.0 / lightest, smallest, inside
    bodies.relaxation_step = 0.0
    state.warm_start.number = 0
    state.contacts.separation_failed = 0
    state.lists.stale = 1
    state.events.number = 0


@kernel
def scatter(crowd: Crowd, bodies: Bodies) -> None:
    """Copy the results of the steps back to the crowd."""
    for b in range(bodies.inside):
        p = bodies.row[b]
        for k in range(2):
            crowd.position[p, k], crowd.velocity[p, k] = bodies.position[b, k], bodies.velocity[b, k]
        crowd.level[p], crowd.passing[p], crowd.mingled[p] = bodies.level[b], bodies.passing[b], bodies.mingled[b]
        crowd.distance[p], crowd.overlap[p] = bodies.distance[b], bodies.overlap[b]
        crowd.contact_force[p] = bodies.contact_force[b]
