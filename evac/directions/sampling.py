"""Kernels that read the packed fields at a position; called by every other kernel that walks."""

import math

import numpy as np

from evac.directions.fields import FloatArray, IntArray, PackedFields
from evac.jit import kernel


@kernel
def cell_of(fields: PackedFields, position_x: float, position_y: float, level: int) -> tuple[int, int, float, float]:
    """Return the lower node (ix, iy) of the cell at a position and the fractions in it, clamped to the grid."""
    nx, ny = fields.shape[level, 0], fields.shape[level, 1]
    across = (position_x - fields.origin[level, 0]) / fields.spacing
    along = (position_y - fields.origin[level, 1]) / fields.spacing
    across = min(max(across, 0.0), nx - 1.0)
    along = min(max(along, 0.0), ny - 1.0)
    ix = min(int(across), nx - 2)
    iy = min(int(along), ny - 2)
    return ix, iy, across - ix, along - iy


@kernel
def sample_travel_time(fields: PackedFields, position_x: float, position_y: float, level: int, route: int) -> float:
    """Return the travel time [s] at a position: bilinear over the nodes that have one, inf without any."""
    row = fields.field_of[level, route]
    if row < 0:
        return math.inf
    ix, iy, fx, fy = cell_of(fields, position_x, position_y, level)
    ny = fields.shape[level, 1]
    corner = fields.offset[row] + ix * ny + iy
    total = 0.0
    weights = 0.0
    for a in range(2):
        for b in range(2):
            value = fields.travel_time[corner + a * ny + b]
            weight = (fx if a else 1.0 - fx) * (fy if b else 1.0 - fy)
            if weight > 0.0 and value < math.inf:
                total += weight * value
                weights += weight
    if weights == 0.0:
        return math.inf
    return total / weights


@kernel
def sample_direction(
    fields: PackedFields, position_x: float, position_y: float, level: int, route: int
) -> tuple[float, float]:
    """Return the unit direction (ex, ey) at a position; (0, 0) where there is no way out.

    Bilinear over the unit vectors, normalised; the nearest node's where they cancel, as on the line
    between two equal ways round an obstacle.
    """
    row = fields.field_of[level, route]
    if row < 0:
        return 0.0, 0.0
    ix, iy, fx, fy = cell_of(fields, position_x, position_y, level)
    ny = fields.shape[level, 1]
    n00 = fields.offset[row] + ix * ny + iy
    n10 = n00 + ny
    direction = fields.direction
    w11 = fx * fy
    w10 = fx - w11
    w01 = fy - w11
    w00 = 1.0 - fx - w01
    ex = w00 * direction[n00, 0] + w10 * direction[n10, 0] + w01 * direction[n00 + 1, 0] + w11 * direction[n10 + 1, 0]
    ey = w00 * direction[n00, 1] + w10 * direction[n10, 1] + w01 * direction[n00 + 1, 1] + w11 * direction[n10 + 1, 1]
    length = math.sqrt(ex * ex + ey * ey)
    if length < 0.1:
        nearest = n00 + (ny if fx >= 0.5 else 0) + (1 if fy >= 0.5 else 0)
        return direction[nearest, 0], direction[nearest, 1]
    return ex / length, ey / length


@kernel
def sample_travel_times(fields: PackedFields, position: FloatArray, level: IntArray, route: IntArray) -> FloatArray:
    """Return `sample_travel_time` of many positions (n, 2)."""
    found = np.empty(len(position))
    for p in range(len(position)):
        found[p] = sample_travel_time(fields, position[p, 0], position[p, 1], level[p], route[p])
    return found


@kernel
def sample_directions(fields: PackedFields, position: FloatArray, level: IntArray, route: IntArray) -> FloatArray:
    """Return `sample_direction` of many positions (n, 2)."""
    found = np.empty((len(position), 2))
    for p in range(len(position)):
        found[p, 0], found[p, 1] = sample_direction(fields, position[p, 0], position[p, 1], level[p], route[p])
    return found
