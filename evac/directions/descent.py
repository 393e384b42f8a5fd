"""Kernels for marched fields: directions of steepest descent, and path lengths along them."""

import math

import numpy as np

from evac.building.model.building import DOWN, FLAT, UP
from evac.jit import ByteGrid, FloatGrid, Floats, IntGrid, Ints, Longs, Pairs, Struct, Triples, inner, kernel

#: What `descend` takes if there are no labels.
ONE_LABEL = np.zeros((0, 0), np.int32)


@inner
def upwind_slope(one: float, near: float, far: float, spacing: float) -> float:
    """Return the descent per metre from `one` towards a neighbour `near` and the next one `far`; at least 0.

    It is of second order if the values decrease twice in a row, otherwise of first order. Only upwind nodes are used,
    so that neither walls nor the far side of a ridge influence it.
    """
    if near >= one:
        return 0.0
    if far < near:
        slope = (3.0 * one - 4.0 * near + far) / (2.0 * spacing)
        if slope > 0.0:
            return slope
    return (one - near) / spacing


@kernel
def descend(cost: FloatGrid, label: IntGrid, chosen: ByteGrid, spacing: float, direction: Pairs) -> None:
    """Compute the unit vectors (nx * ny, 2) of steepest descent of a cost (nx, ny), zero where no neighbour is lower.

    The cost is inf at nodes that are not walkable. Nodes with another `label` (nx, ny) are no neighbours; there may be
    no labels, `ONE_LABEL`. Only nodes that are `chosen` (nx, ny) are written.
    """
    nx, ny = cost.shape
    for i in range(2, nx - 2):
        for j in range(2, ny - 2):
            if not chosen[i, j] or cost[i, j] == math.inf:
                continue
            along_x = _descent_along(cost, label, i, j, 1, 0, spacing)
            along_y = _descent_along(cost, label, i, j, 0, 1, spacing)
            length = math.sqrt(along_x * along_x + along_y * along_y)
            if length > 0.0:
                direction[i * ny + j, 0] = along_x / length
                direction[i * ny + j, 1] = along_y / length


@inner
def _descent_along(cost: FloatGrid, label: IntGrid, i: int, j: int, x: int, y: int, spacing: float) -> float:
    """Return the descent per metre at node (i, j) along the axis (x, y), (1, 0) or (0, 1)."""
    after = _cost_beside(cost, label, i, j, x, y)
    before = _cost_beside(cost, label, i, j, -x, -y)
    step = 1 if after < before else -1
    far = _cost_beside(cost, label, i, j, 2 * step * x, 2 * step * y)
    slope: float = upwind_slope(cost[i, j], min(after, before), far, spacing)
    return step * slope


@inner
def _cost_beside(cost: FloatGrid, label: IntGrid, i: int, j: int, x: int, y: int) -> float:
    """Return the cost x and y nodes beside node (i, j), inf if the label is another one."""
    if label.shape[0] > 0 and label[i + x, j + y] != label[i, j]:
        return math.inf
    beside: float = cost[i + x, j + y]
    return beside


class Ways(Struct):
    """Data for path lengths along steepest descent: the packed nodes of all grids, and their levels."""

    level_of: Ints  # (nodes,)
    source: Ints  # (nodes,) node that each node represents, -1 for none
    twin: Ints  # (nodes,) for nodes on a portal, the node at the same position on the other level, otherwise -1
    cost: Floats  # (nodes,)
    stride: Ints  # (levels,) stride along x in packed arrays
    uphill: Pairs  # (levels, 2)
    cosine: Floats  # (levels,)
    spacing: float  # [m]


@kernel
def add_lengths(order: Longs, ways: Ways, lengths: Triples) -> None:
    """Compute the flat, up and down lengths (nodes, 3) [m], inf before, along the paths of steepest descent.

    Solves grad T . grad F = |grad T| c by first-order upwind differences, node by node in the order (n,) of ascending
    cost. For the length F of one use (flat, up, down), c is 1 / cos(slope) on levels with this use and 0 elsewhere.
    """
    # Repeated until no more lengths are found: if costs of two levels differ in the last digits, a node can precede one
    # that it depends on.
    found = -1
    before = -2
    while found > before:
        before = found
        found = 0
        for k in range(len(order)):
            _add_lengths_at(order[k], ways, lengths)
            if lengths[order[k], 0] < math.inf:
                found += 1


@inner
def _add_lengths_at(node: int, ways: Ways, lengths: Triples) -> None:
    """Compute the lengths of one node: the mean over its lower neighbours, weighted by the descent, plus one step."""
    total, greatest, squares = 0.0, 0.0, 0.0
    flat, up, down = 0.0, 0.0, 0.0
    step_x, step_y = 0.0, 0.0
    # The cell counts as part of the level that it leads to, since nodes on a portal are on two levels.
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
        # The path may continue beside the portal, where only the grid of the other level has nodes. If that one has no
        # lengths, the present ones stay: the path may begin here.
        if ways.twin[node] >= 0 and lengths[ways.twin[node], 0] < math.inf:
            for k in range(3):
                lengths[node, k] = lengths[ways.twin[node], k]
        return
    lengths[node, FLAT], lengths[node, UP], lengths[node, DOWN] = flat, up, down
    climb = step_x * ways.uphill[level, 0] + step_y * ways.uphill[level, 1]
    is_flat = ways.uphill[level, 0] == 0.0 and ways.uphill[level, 1] == 0.0
    use = FLAT if is_flat else UP if climb > 0.0 else DOWN
    lengths[node, use] += ways.spacing * math.sqrt(squares) / ways.cosine[level]
    for k in range(3):
        lengths[node, k] /= total


@inner
def _lower_neighbour(node: int, step: int, ways: Ways) -> tuple[int, float, float]:
    """Return the lower neighbour along an axis (-1 for none), the cost difference, and the direction to it (1, -1)."""
    sign = 1.0
    if ways.cost[node - step] < ways.cost[node + step]:
        step = -step
        sign = -1.0
    drop = ways.cost[node] - ways.cost[node + step]
    if not (drop > 0.0 and drop < math.inf):
        return -1, 0.0, sign
    return ways.source[node + step], drop, sign
