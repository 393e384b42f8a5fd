"""Kernels on marched fields: directions of steepest descent, and the lengths of the way down."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray, IndexArray, IntArray
from evac.building.model import DOWN, FLAT, UP
from evac.jit import kernel


@kernel
def upwind_slope(one: float, near: float, far: float, spacing: float) -> float:
    """Return the descent [1/m] from `one` towards a neighbour `near` and the next, `far`; at least 0.

    Of second order where the values fall twice in a row, else of first; only nodes that the wave
    came from take part, so that neither walls nor the far side of a ridge bend it.
    """
    if near >= one:
        return 0.0
    if far < near:
        slope = (3.0 * one - 4.0 * near + far) / (2.0 * spacing)
        if slope > 0.0:
            return slope
    return (one - near) / spacing


#: Nodes around a node that a fit beside a slanted wall takes part in, to each side.
WINDOW = 3

#: A cost that differs by more than this many times the slope lies behind a wall.
STEEPEST = 1.5


@kernel
def is_beside_slant(cost: FloatArray, i: int, j: int) -> bool:
    """Say whether a node stands beside a wall that steps back within the window: one that is not along the grid."""
    nx, ny = cost.shape
    for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        if cost[i + di, j + dj] < math.inf:
            continue
        for way in (1, -1):
            for k in range(1, WINDOW + 1):
                a, b = i + way * k * dj, j + way * k * di
                if not (0 < a < nx - 1 and 0 < b < ny - 1) or cost[a, b] == math.inf:
                    break
                if cost[a + di, b + dj] < math.inf:
                    return True
    return False


@kernel
def is_near_slant(cost: FloatArray, i: int, j: int) -> bool:
    """Say whether a node stands beside a slanted wall, or next to a node that does: both got the wave late."""
    for di, dj in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        if cost[i + di, j + dj] < math.inf and is_beside_slant(cost, i + di, j + dj):
            return True
    return False


@kernel
def fit_descent(cost: FloatArray, i: int, j: int, limit: float) -> tuple[float, float]:
    """Return the descent of the plane through a node that fits the lower ones around it best; (0, 0) if too few do.

    Beside a slanted wall the grid's steps leave a node with neighbours along one axis only. Least squares over the
    nodes linked to it within the window, whose cost is lower by at most `limit` for each cell of distance.
    """
    side = 2 * WINDOW + 1
    linked = np.zeros((side, side), np.bool_)
    linked[WINDOW, WINDOW] = True
    grown = True
    while grown:
        grown = False
        for a in range(side):
            for b in range(side):
                if linked[a, b] or cost[i + a - WINDOW, j + b - WINDOW] == math.inf:
                    continue
                if (
                    (a > 0 and linked[a - 1, b])
                    or (a + 1 < side and linked[a + 1, b])
                    or (b > 0 and linked[a, b - 1])
                    or (b + 1 < side and linked[a, b + 1])
                ):
                    linked[a, b] = True
                    grown = True
    xx, xy, yy, xd, yd = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(side):
        for b in range(side):
            x, y = a - WINDOW, b - WINDOW
            drop = cost[i, j] - cost[i + x, j + y]
            if not linked[a, b] or drop <= 0.0 or drop > limit * math.sqrt(x * x + y * y):
                continue
            xx += x * x
            xy += x * y
            yy += y * y
            xd += x * drop
            yd += y * drop
    determinant = xx * yy - xy * xy
    # Nodes nearly in one line leave the slope across it open.
    if determinant < 0.02 * (xx + yy) ** 2:
        return 0.0, 0.0
    return (yy * xd - xy * yd) / determinant, (xx * yd - xy * xd) / determinant


@kernel
def descend(cost: FloatArray, chosen: NDArray[np.bool_], spacing: float, is_plain: bool, direction: FloatArray) -> None:
    """Write the unit vectors of steepest descent of a grid.

    Parameters
    ----------
    cost : (nx, ny) float64
        inf where nobody walks.
    chosen : (nx, ny) bool
        Nodes to write; the others stay.
    spacing : float [m]
    is_plain : bool
        Whether the cost of a metre is the same on all of a level: then nodes beside slanted walls are fitted.
    direction : (nx, ny, 2) float64
        Written: zero where no neighbour is lower.
    """
    nx, ny = cost.shape
    for i in range(2, nx - 2):
        for j in range(2, ny - 2):
            one = cost[i, j]
            if not chosen[i, j] or one == math.inf:
                continue
            step = 1 if cost[i + 1, j] < cost[i - 1, j] else -1
            along_x = step * upwind_slope(one, cost[i + step, j], cost[i + 2 * step, j], spacing)
            step = 1 if cost[i, j + 1] < cost[i, j - 1] else -1
            along_y = step * upwind_slope(one, cost[i, j + step], cost[i, j + 2 * step], spacing)
            length = math.sqrt(along_x * along_x + along_y * along_y)
            if is_plain and is_near_slant(cost, i, j):
                fitted_x, fitted_y = fit_descent(cost, i, j, STEEPEST * length * spacing)
                if fitted_x != 0.0 or fitted_y != 0.0:
                    along_x, along_y = fitted_x, fitted_y
                    length = math.sqrt(along_x * along_x + along_y * along_y)
            if length > 0.0:
                direction[i, j, 0] = along_x / length
                direction[i, j, 1] = along_y / length


class Ways(NamedTuple):
    """What the ways of steepest descent lead over: the nodes of all grids, packed, and their levels."""

    level_of: IntArray  # (nodes,)
    source: IndexArray  # (nodes,) the node that each node stands for; -1 for none
    twin: IndexArray  # (nodes,) for a node on a portal the one at its place on the other level, else -1
    cost: FloatArray  # (nodes,)
    stride: IntArray  # (levels,) distance in packed arrays of two neighbours along x
    uphill: FloatArray  # (levels, 2)
    cosine: FloatArray  # (levels,)
    spacing: float  # [m]


@kernel
def add_lengths(order: IndexArray, ways: Ways, lengths: FloatArray) -> None:
    """Add up the flat, up and down lengths along the ways of steepest descent.

    Solves grad T . grad F = |grad T| c by first order upwind differences, node by node from the exit
    outwards; c is the length along the slope of a metre in plan where F is the length in use, else 0.

    Parameters
    ----------
    order : (n,) int64
        Own nodes with a finite cost, cheapest first.
    ways : Ways
    lengths : (nodes, 3) float64 [m]
        Written at the nodes of `order`; inf before.
    """
    # Again until no more are found: where costs of two levels differ in the last digits a node can come
    # before one that it depends on.
    found = -1
    before = -2
    while found > before:
        before = found
        found = 0
        for node in order:
            _add_lengths_at(node, ways, lengths)
            found += lengths[node, 0] < math.inf


@kernel
def is_lowest(nodes: IndexArray, ways: Ways) -> NDArray[np.bool_]:
    """Say of nodes (n,) whether no neighbour is lower; one on a portal has neighbours on the other level too."""
    found = np.empty(nodes.shape[0], np.bool_)
    for k in range(nodes.shape[0]):
        node = nodes[k]
        along_x, _, _ = _lower_neighbour(node, ways.stride[ways.level_of[node]], ways)
        along_y, _, _ = _lower_neighbour(node, 1, ways)
        found[k] = along_x < 0 and along_y < 0 and ways.twin[node] < 0
    return found


@kernel
def _add_lengths_at(node: int, ways: Ways, lengths: FloatArray) -> None:
    """Write the lengths of one node: the mean of its lower neighbours', weighted by the drop, and a step."""
    total, greatest, squares = 0.0, 0.0, 0.0
    flat, up, down = 0.0, 0.0, 0.0
    step_x, step_y = 0.0, 0.0
    # The cell walked through counts as the level it leads to: a node on a portal stands on two.
    level = ways.level_of[node]
    for axis in range(2):
        lower, drop, sign = _lower_neighbour(node, ways.stride[ways.level_of[node]] if axis == 0 else 1, ways)
        if lower < 0 or lengths[lower, 0] == math.inf:
            continue
        if axis == 0:
            step_x = sign * drop
        else:
            step_y = sign * drop
        if drop > greatest:
            greatest = drop
            level = ways.level_of[lower]
        total += drop
        squares += drop * drop
        flat += drop * lengths[lower, 0]
        up += drop * lengths[lower, 1]
        down += drop * lengths[lower, 2]
    if total == 0.0:
        # The way may go on beside the portal, where only the other level's grid has nodes.
        if ways.twin[node] >= 0:
            lengths[node] = lengths[ways.twin[node]]
        return
    lengths[node, FLAT], lengths[node, UP], lengths[node, DOWN] = flat, up, down
    climb = step_x * ways.uphill[level, 0] + step_y * ways.uphill[level, 1]
    is_flat = ways.uphill[level, 0] == 0.0 and ways.uphill[level, 1] == 0.0
    use = FLAT if is_flat else UP if climb > 0.0 else DOWN
    lengths[node, use] += ways.spacing * math.sqrt(squares) / ways.cosine[level]
    for k in range(3):
        lengths[node, k] /= total


@kernel
def _lower_neighbour(node: int, step: int, ways: Ways) -> tuple[int, float, float]:
    """Return the lower neighbour along an axis (-1 for none), how much lower it is, and the direction to it (1, -1)."""
    sign = 1.0
    if ways.cost[node - step] < ways.cost[node + step]:
        step = -step
        sign = -1.0
    drop = ways.cost[node] - ways.cost[node + step]
    if not (drop > 0.0 and drop < math.inf):
        return -1, 0.0, sign
    return ways.source[node + step], drop, sign
