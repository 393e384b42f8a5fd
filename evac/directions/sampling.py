"""Kernels that read the packed fields at a position; called by every other kernel that walks."""

import math

import numpy as np

from evac.directions.fields import FloatArray, IntArray, OffsetArray
from evac.jit import kernel


@kernel
def cell_of(
    position_x: float,
    position_y: float,
    level: int,
    grid_origin: FloatArray,
    grid_shape: IntArray,
    grid_spacing: float,
) -> tuple[int, int, float, float]:
    """Return the lower node (ix, iy) of the cell at a position and the fractions in it, clamped to the grid."""
    across = (position_x - grid_origin[level, 0]) / grid_spacing
    along = (position_y - grid_origin[level, 1]) / grid_spacing
    across = min(max(across, 0.0), grid_shape[level, 0] - 1.0)
    along = min(max(along, 0.0), grid_shape[level, 1] - 1.0)
    ix = min(int(across), grid_shape[level, 0] - 2)
    iy = min(int(along), grid_shape[level, 1] - 2)
    return ix, iy, across - ix, along - iy


@kernel
def sample_travel_time(
    position_x: float,
    position_y: float,
    level: int,
    route: int,
    grid_origin: FloatArray,
    grid_shape: IntArray,
    grid_spacing: float,
    field_of: IntArray,
    field_offset: OffsetArray,
    travel_time: FloatArray,
) -> float:
    """Return the travel time [s] at a position: bilinear over the nodes that have one, inf without any."""
    row = field_of[level, route]
    if row < 0:
        return math.inf
    ix, iy, fx, fy = cell_of(position_x, position_y, level, grid_origin, grid_shape, grid_spacing)
    ny = grid_shape[level, 1]
    corner = field_offset[row] + ix * ny + iy
    total = 0.0
    weights = 0.0
    for a in range(2):
        for b in range(2):
            value = travel_time[corner + a * ny + b]
            weight = (fx if a else 1.0 - fx) * (fy if b else 1.0 - fy)
            if weight > 0.0 and value < math.inf:
                total += weight * value
                weights += weight
    if weights == 0.0:
        return math.inf
    return total / weights


@kernel
def sample_direction(
    position_x: float,
    position_y: float,
    level: int,
    route: int,
    grid_origin: FloatArray,
    grid_shape: IntArray,
    grid_spacing: float,
    field_of: IntArray,
    field_offset: OffsetArray,
    direction: FloatArray,
) -> tuple[float, float]:
    """Return the unit direction (ex, ey) at a position; (0, 0) where there is no way out.

    Bilinear over the unit vectors, normalised; the nearest node's where they cancel, as on the line
    between two equal ways round an obstacle.
    """
    row = field_of[level, route]
    if row < 0:
        return 0.0, 0.0
    ix, iy, fx, fy = cell_of(position_x, position_y, level, grid_origin, grid_shape, grid_spacing)
    ny = grid_shape[level, 1]
    n00 = field_offset[row] + ix * ny + iy
    n10 = n00 + ny
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
def sample_travel_times(
    position: FloatArray,
    level: IntArray,
    route: IntArray,
    grid_origin: FloatArray,
    grid_shape: IntArray,
    grid_spacing: float,
    field_of: IntArray,
    field_offset: OffsetArray,
    travel_time: FloatArray,
) -> FloatArray:
    """Return `sample_travel_time` of many positions (n, 2)."""
    found = np.empty(len(position))
    for p in range(len(position)):
        found[p] = sample_travel_time(
            position[p, 0],
            position[p, 1],
            level[p],
            route[p],
            grid_origin,
            grid_shape,
            grid_spacing,
            field_of,
            field_offset,
            travel_time,
        )
    return found


@kernel
def sample_directions(
    position: FloatArray,
    level: IntArray,
    route: IntArray,
    grid_origin: FloatArray,
    grid_shape: IntArray,
    grid_spacing: float,
    field_of: IntArray,
    field_offset: OffsetArray,
    direction: FloatArray,
) -> FloatArray:
    """Return `sample_direction` of many positions (n, 2)."""
    found = np.empty((len(position), 2))
    for p in range(len(position)):
        found[p, 0], found[p, 1] = sample_direction(
            position[p, 0],
            position[p, 1],
            level[p],
            route[p],
            grid_origin,
            grid_shape,
            grid_spacing,
            field_of,
            field_offset,
            direction,
        )
    return found
