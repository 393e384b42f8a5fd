"""Kernels that interpolate the packed fields at positions."""

import math

from evac.directions.fields import CellWalls, PackedFields
from evac.jit import Floats, Ints, Pairs, inner, kernel

#: Lengths of the weighted mean of unit vectors below which they differ strongly, and below which they cancel.
AGREEING, CANCELLING = 0.9, 0.1

#: Nodes of a cell that differ by more than this multiple of the steepest increase along its side are divided by a wall.
LARGEST_RISE = 1.5 * math.sqrt(2.0)

#: Product of the distances of two points from a wall below which one of them counts as on the wall [m2].
TOUCHING = 1e-9


@inner
def cell_of(fields: PackedFields, position_x: float, position_y: float, level: int) -> tuple[int, int, float, float]:
    """Return the lower node (ix, iy) of the cell at a position and the fractions within it, clamped to the grid."""
    nx, ny = fields.shape[level, 0], fields.shape[level, 1]
    across = (position_x - fields.origin[level, 0]) / fields.spacing
    along = (position_y - fields.origin[level, 1]) / fields.spacing
    across = min(max(across, 0.0), nx - 1.0)
    along = min(max(along, 0.0), ny - 1.0)
    ix = min(int(across), nx - 2)
    iy = min(int(along), ny - 2)
    return ix, iy, across - ix, along - iy


@inner
def column_of(fields: PackedFields, route: int, radius: float) -> int:
    """Return the column of a route for a body, as `evac.directions.fields.columns_of`."""
    column = route
    for k in range(fields.width.shape[0]):
        if 2.0 * radius > fields.width[k]:
            column += fields.field_of.shape[1] // (fields.width.shape[0] + 1)
    return column


@inner
def walls_in_cell(walls: CellWalls, level: int, column: int, cell: int) -> tuple[int, int]:
    """Return the range (first, last + 1) in ``walls.wall`` of the walls through a cell (ix * ny + iy) of a level."""
    low, high = 0, walls.cell.shape[0]
    if high == 0:
        return 0, 0
    wanted = walls.offset[level, column] + cell
    while low < high:
        middle = (low + high) // 2
        if walls.cell[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    if low == walls.cell.shape[0] or walls.cell[low] != wanted:
        return 0, 0
    return walls.start[low], walls.start[low + 1]


@inner
def sample_travel_time(fields: PackedFields, position_x: float, position_y: float, level: int, column: int) -> float:
    """Return the travel time [s] at a position, inf where the destination cannot be reached.

    Bilinear over the nodes of the cell with finite values; only over visible ones if they differ too much for one cell.
    """
    row = fields.field_of[level, column]
    if row < 0:
        return math.inf
    ix, iy, fx, fy = cell_of(fields, position_x, position_y, level)
    ny = fields.shape[level, 1]
    corner = fields.offset[row] + ix * ny + iy
    low, high = math.inf, -math.inf
    for a in range(2):
        for b in range(2):
            value = fields.travel_time[corner + a * ny + b]
            low, high = min(low, value), max(high, value)
    first, last = 0, 0
    if high - low > LARGEST_RISE * fields.spacing * fields.walls.steepest:
        first, last = walls_in_cell(fields.walls, level, column, ix * ny + iy)
    total = 0.0
    weights = 0.0
    for a in range(2):
        for b in range(2):
            value = fields.travel_time[corner + a * ny + b]
            weight = (fx if a else 1.0 - fx) * (fy if b else 1.0 - fy)
            if (
                weight > 0.0
                and value < math.inf
                and not _is_corner_hidden(fields, level, ix, iy, a, b, fx, fy, first, last)
            ):
                total += weight * value
                weights += weight
    if weights == 0.0:
        return math.inf
    return total / weights


@inner
def node_at(
    fields: PackedFields, position_x: float, position_y: float, level: int, column: int
) -> tuple[int, int, int, float, float]:
    """Return `cell_of` a position behind the number of its lower node in the field of a column, -1 without one."""
    row = fields.field_of[level, column]
    if row < 0:
        return -1, 0, 0, 0.0, 0.0
    ix, iy, fx, fy = cell_of(fields, position_x, position_y, level)
    return fields.offset[row] + ix * fields.shape[level, 1] + iy, ix, iy, fx, fy


@inner
def sample_direction(
    fields: PackedFields, position_x: float, position_y: float, level: int, column: int
) -> tuple[float, float]:
    """Return the unit direction (ex, ey) at a position; (0, 0) where the destination cannot be reached.

    The bilinear interpolation of unit vectors is normalised. Where the vectors cancel, as between two equal ways around
    an obstacle, the direction of the nearest node is used. Where they differ strongly, only visible nodes are used.
    """
    node, ix, iy, fx, fy = node_at(fields, position_x, position_y, level, column)
    if node < 0:
        return 0.0, 0.0
    high = node + fields.shape[level, 1]
    return direction_in_cell(fields, level, column, node, ix, iy, fx, fy, fields.direction, node, high)


@inner
def direction_in_cell(
    fields: PackedFields,
    level: int,
    column: int,
    node: int,
    ix: int,
    iy: int,
    fx: float,
    fy: float,
    direction: Pairs,
    low: int,
    high: int,
) -> tuple[float, float]:
    """Return `sample_direction` in a cell whose nodes are in rows of `direction`: `low`, `high` at the greater x.

    Each is followed by the row of the node at the greater y.
    """
    w11 = fx * fy
    w10 = fx - w11
    w01 = fy - w11
    w00 = 1.0 - fx - w01
    ex = w00 * direction[low, 0] + w10 * direction[high, 0] + w01 * direction[low + 1, 0] + w11 * direction[high + 1, 0]
    ey = w00 * direction[low, 1] + w10 * direction[high, 1] + w01 * direction[low + 1, 1] + w11 * direction[high + 1, 1]
    length = math.sqrt(ex * ex + ey * ey)
    if length < AGREEING:
        ny = fields.shape[level, 1]
        first, last = walls_in_cell(fields.walls, level, column, ix * ny + iy)
        if first < last:
            return _direction_in_sight(fields, level, node, ix, iy, fx, fy, first, last)
    if length < CANCELLING:
        nearest = (high if fx >= 0.5 else low) + (1 if fy >= 0.5 else 0)
        return direction[nearest, 0], direction[nearest, 1]
    return ex / length, ey / length


@inner
def _direction_in_sight(
    fields: PackedFields, level: int, n00: int, ix: int, iy: int, fx: float, fy: float, first: int, last: int
) -> tuple[float, float]:
    """Return the direction as in `sample_direction`, from the nodes of a cell not hidden by walls first to last."""
    ny = fields.shape[level, 1]
    ex, ey, total = 0.0, 0.0, 0.0
    heaviest = -1.0
    nearest = n00 + (ny if fx >= 0.5 else 0) + (1 if fy >= 0.5 else 0)
    for a in range(2):
        for b in range(2):
            weight = (fx if a else 1.0 - fx) * (fy if b else 1.0 - fy)
            if _is_corner_hidden(fields, level, ix, iy, a, b, fx, fy, first, last):
                continue
            node = n00 + a * ny + b
            ex += weight * fields.direction[node, 0]
            ey += weight * fields.direction[node, 1]
            total += weight
            if weight > heaviest:
                heaviest, nearest = weight, node
    length = math.sqrt(ex * ex + ey * ey)
    if length <= CANCELLING * total:
        return fields.direction[nearest, 0], fields.direction[nearest, 1]
    return ex / length, ey / length


@inner
def _is_corner_hidden(
    fields: PackedFields, level: int, ix: int, iy: int, a: int, b: int, fx: float, fy: float, first: int, last: int
) -> bool:
    """Return whether one of the walls first to last is between node (ix + a, iy + b) and the position (fx, fy)."""
    # A wall that ends at or passes through one of them does not hide it. A point nearer than about 1e-9 m to a wall
    # counts as on it, which covers rounding errors.
    x0 = fields.origin[level, 0] + fields.spacing * ix
    y0 = fields.origin[level, 1] + fields.spacing * iy
    ax, ay = x0 + fx * fields.spacing, y0 + fy * fields.spacing
    bx, by = x0 + a * fields.spacing, y0 + b * fields.spacing
    wall = fields.walls.wall
    for k in range(first, last):
        x1, y1, x2, y2 = wall[k, 0], wall[k, 1], wall[k, 2], wall[k, 3]
        across_x, across_y = x2 - x1, y2 - y1
        side_a = across_x * (ay - y1) - across_y * (ax - x1)
        side_b = across_x * (by - y1) - across_y * (bx - x1)
        if side_a * side_b >= -TOUCHING * (across_x * across_x + across_y * across_y):
            continue
        side_1 = (bx - ax) * (y1 - ay) - (by - ay) * (x1 - ax)
        side_2 = (bx - ax) * (y2 - ay) - (by - ay) * (x2 - ax)
        if side_1 * side_2 <= 0.0:
            return True
    return False


@kernel
def sample_travel_times(fields: PackedFields, position: Pairs, level: Ints, column: Ints, found: Floats) -> None:
    """Write `sample_travel_time` of many positions (n, 2) to `found` (n,)."""
    for p in range(len(position)):
        found[p] = sample_travel_time(fields, position[p, 0], position[p, 1], level[p], column[p])


@kernel
def sample_directions(fields: PackedFields, position: Pairs, level: Ints, column: Ints, found: Pairs) -> None:
    """Write `sample_direction` of many positions (n, 2) to `found` (n, 2)."""
    for p in range(len(position)):
        found[p, 0], found[p, 1] = sample_direction(fields, position[p, 0], position[p, 1], level[p], column[p])
