"""Kernels for times that are solved again during a run: densities, speeds, and one march through all levels."""

import math

from evac.building.model.building import DOWN, FLAT, UP
from evac.directions.fields import PackedFields
from evac.jit import ByteGrid, Bytes, FloatGrid, Floats, Ints, Longs, Pairs, Struct, inner, kernel

#: States of a node in a march: not reached yet, in the queue, final, and not part of it.
FAR, QUEUED, FINAL, APART = 0, 1, 2, 3

#: Half width of the kernel of densities, in standard deviations.
CUT = 3.0

#: Weidmann (1993): decline of the speed [1/m2], density at which people stand, and that of the greatest flow [1/m2].
DECLINE, JAM, BUSIEST = 1.913, 5.4, 1.75

#: Density below which people walk at their own speed; the law has 1 - 1e-16 there [1/m2].
NOBODY = 0.05

#: Share of the remaining time below which people do not notice that another way is shorter.
UNNOTICED = 0.05

#: Relative difference below which a time is not lower than another.
ROUNDING = 1e-9


class MarchState(Struct):
    """A march through the nodes of all levels: the level of each, what it represents, and its time so far."""

    level_of: Ints  # (nodes,)
    border: Longs  # (b,) nodes to solve that are next to others from which a march may begin: starts, other levels
    source: Ints  # (nodes,) node that each node represents, -1 for none, and where a portal does not lead to it
    beside: Ints  # (nodes,) as `source`, whether portals lead there or not
    # (nodes,) node beyond a portal or a door of one direction to which the time of a node goes on, -1 for none
    twin: Ints
    # jumps, by the node at which they end: node to which a time goes on after a time [s]; first jump of each node, -1
    # for none, or no node if there are no jumps
    jump_end: Longs
    jump_start: Longs
    jump_time: Floats
    first_jump: Ints
    stride: Ints  # (levels,) stride along x in packed arrays
    uphill: Pairs  # (levels, 2)
    slowness: FloatGrid  # (levels, 3) time per metre in plan, by use [s/m]
    factor: Floats  # (nodes,) factor of the slowness
    spacing: float  # [m]
    state: Bytes  # (nodes,) FAR, QUEUED, FINAL or APART
    time: Floats  # (nodes,) [s]
    exit: Ints  # (nodes,) exit that the way from a node ends at, or label of the car that it enters first, -1 for none
    label: Ints  # (levels,) label of a car that is entered on a level, -1 for other levels
    gate_at: Ints  # (nodes,) gate whose line a node is on, -1 for none; or no node if gates are not followed
    gate: Ints  # (nodes,) next gate on the way from a node, -1 for none; as `gate_at`
    walk: Floats  # (nodes,) time to this gate without other people [s]; as `gate_at`
    former: Ints  # (nodes,) that of the march before, -1 for none
    hesitation: float  # least time that the way to another exit than before must be shorter [s]
    before: Ints  # (nodes,) next node on the way
    leans: ByteGrid  # (levels, levels) whether times of one level follow from those of another
    heap: Ints  # (nodes,) queue of nodes, the lowest time first
    key: Floats  # (nodes,) their times
    place: Ints  # (nodes,) place of each node in the queue


@kernel
def deposit(fields: PackedFields, first: Longs, position: Pairs, level: Ints, width: float, sum: Floats) -> None:
    """Add the Gauss kernels of people to the densities (nodes,) of their levels [1/m2]; level -1 is left out.

    Node (ix, iy) of a level is number ``first + ix * ny + iy``.
    """
    reach, spacing = CUT * width, fields.spacing
    weight = 1.0 / (2.0 * math.pi * width * width)
    for i in range(level.shape[0]):
        at = level[i]
        if at < 0:
            continue
        nx, ny = fields.shape[at, 0], fields.shape[at, 1]
        x, y = (position[i, 0] - fields.origin[at, 0]) / spacing, (position[i, 1] - fields.origin[at, 1]) / spacing
        cells = reach / spacing
        low_x, high_x = max(0, math.ceil(x - cells)), min(nx - 1, math.floor(x + cells))
        low_y, high_y = max(0, math.ceil(y - cells)), min(ny - 1, math.floor(y + cells))
        scale = 0.5 * spacing * spacing / (width * width)
        for ix in range(low_x, high_x + 1):
            share = weight * math.exp(-scale * (ix - x) * (ix - x))
            # exp of the squares of equal steps: each follows from the one before by two products.
            value = share * math.exp(-scale * (low_y - y) * (low_y - y))
            ratio = math.exp(-scale * (2.0 * (low_y - y) + 1.0))
            change = math.exp(-2.0 * scale)
            node = first[at] + ix * ny
            for iy in range(low_y, high_y + 1):
                sum[node + iy] += value
                value *= ratio
                ratio *= change


@kernel
def average(
    first: Longs, is_near: Bytes, to: Longs, of: Longs, now: Floats, weight: Floats, gain: float, density: Floats
) -> None:
    """Average the densities (nodes,) of levels with the sums of kernels `now` (nodes,) times their weights.

    The nodes of level k are ``first[k]`` to ``first[k + 1]``. Levels (levels,) without people near them are left out if
    their densities are zero; others are marked. The sums of nodes `of` are added to those of nodes `to` before. `gain`
    is the weight of the density now.
    """
    for k in range(len(to)):
        now[to[k]] += now[of[k]]
    for k in range(len(is_near)):
        node = first[k]
        while is_near[k] == 0 and node < first[k + 1]:
            is_near[k] = density[node] != 0.0
            node += 1
        for node in range(first[k], first[k + 1] if is_near[k] else first[k]):
            mean = density[node] + gain * (now[node] * weight[node] - density[node])
            density[node] = 0.0 if mean < NOBODY * 1e-3 else mean


@inner
def speed_at(density: float, floor: float) -> float:
    """Return the relative speed at a density: that of Weidmann, and above the density of the greatest flow, that flow.

    In a queue people advance as fast as it is served, however dense they stand.
    """
    if density < NOBODY:
        return 1.0
    speed = 1.0 - math.exp(-DECLINE * (1.0 / min(density, BUSIEST) - 1.0 / JAM))
    return max(floor, speed * min(1.0, BUSIEST / density))


@kernel
def find_speeds(
    first: int,
    stop: int,
    density: Floats,
    floor: float,
    waves: MarchState,
    queues: FloatGrid,
    step: float,
    former: Floats,
    speed: Floats,
) -> float:
    """Find the relative speeds (nodes,) of the nodes `first` to `stop` of a level; return how much they differ from the
    former ones.

    They follow from the density (nodes,) [1/m2], and are then at least `floor`, and from the queues (gates, bins): the
    relative speed before each gate by the time to it, in bins of `step` [s].
    """
    differences, delay = 0.0, 1.0 / (waves.spacing * waves.spacing)
    has_gates = waves.gate.shape[0] > 0
    for node in range(first, stop):
        if waves.state[node] == APART:
            speed[node] = former[node]
            continue
        value = speed_at(density[node], floor)
        if has_gates and waves.gate[node] >= 0:
            queue = min(int(waves.walk[node] / step), queues.shape[1] - 1)
            value = min(value, queues[waves.gate[node], queue])
        speed[node] = value
        if value < 1.0 or former[node] < 1.0:
            differences += abs(1.0 / value - 1.0 / former[node])
            delay += 1.0 / former[node] - 1.0
    return differences / delay


@kernel
def find_queues(people: FloatGrid, capacity: Floats, step: float, queues: FloatGrid) -> None:
    """Find the relative speeds (gates, bins) before gates, each of which people pass one after another.

    `people` (gates, bins) are on the way to each gate, by their time to it in bins of `step` [s]; `capacity` (gates,)
    pass each in a second [1/s].
    """
    for gate in range(people.shape[0]):
        end = 0.0  # of the time at which those before have passed
        for k in range(people.shape[1]):
            later = max((k + 1) * step, end + people[gate, k] / capacity[gate])
            queues[gate, k] = min(1.0, step / (later - end)) if later > end else 1.0
            end = later


@inner
def rise(waves: MarchState, k: int, node: int, time: float) -> None:
    """Put a node at place k of the queue, or nearer to its front."""
    while k > 0:
        above = (k - 1) // 2
        if waves.key[above] <= time:
            break
        waves.heap[k], waves.key[k] = waves.heap[above], waves.key[above]
        waves.place[waves.heap[k]] = k
        k = above
    waves.heap[k], waves.key[k], waves.place[node] = node, time, k


@inner
def take_first(waves: MarchState, size: int) -> int:
    """Take the node at the front of a queue, of which `size` are left; return it."""
    first, node, time = waves.heap[0], waves.heap[size], waves.key[size]
    waves.key[size] = math.inf  # beside the last one, so that the lower of two is found without a branch
    k, below = 0, 1
    while below < size:
        below += waves.key[below + 1] < waves.key[below]
        if waves.key[below] >= time:
            break
        waves.heap[k], waves.key[k] = waves.heap[below], waves.key[below]
        waves.place[waves.heap[k]] = k
        k, below = below, 2 * below + 1
    waves.heap[k], waves.key[k], waves.place[node] = node, time, k
    return int(first)


@inner
def time_from(waves: MarchState, node: int, other: int) -> float:
    """Return the time at a final neighbour, and the hesitation if the way would end at another exit than before."""
    here, there = waves.former[node], waves.exit[other]
    time: float = waves.time[other]
    if here >= 0 and there != here and waves.former[other] == there:
        time += max(waves.hesitation, UNNOTICED * time)
    return time


@inner
def lower_side(waves: MarchState, node: int, step: int) -> tuple[int, int, float]:
    """Return the lower final neighbour of a node along an axis (-1 for none), the step to it, and its time."""
    found, way, least = -1, step, math.inf
    for sign in (-1, 1):
        other = waves.source[node + sign * step]
        if other >= 0 and waves.state[other] == FINAL:
            time = time_from(waves, node, other)
            if time < least:
                found, way, least = other, sign * step, time
    return found, way, least


@inner
def upwind(waves: MarchState, node: int, way: int, time: float) -> tuple[float, float]:
    """Return weight and time of an upwind difference: a (T - t)^2 is the squared increase along an axis.

    It is of second order if the next node but one is final and lower.
    """
    far = waves.source[node + 2 * way]
    if far >= 0 and waves.state[far] == FINAL:
        beyond = time_from(waves, node, far)
        if beyond <= time:
            return 2.25, (4.0 * time - beyond) / 3.0
    return 1.0, time


@inner
def slowness_at(waves: MarchState, node: int, one: int, way_one: int, two: int, way_two: int) -> float:
    """Return the time per metre at a node, whose way leads towards its lower neighbours."""
    level = waves.level_of[node]
    up_x, up_y = waves.uphill[level, 0], waves.uphill[level, 1]
    use = FLAT
    if up_x != 0.0 or up_y != 0.0:
        climb = 0.0
        if one >= 0:
            climb += up_x if way_one > 0 else -up_x
        if two >= 0:
            climb += up_y if way_two > 0 else -up_y
        use = UP if climb > 0.0 else DOWN
    slowness: float = waves.slowness[level, use] * waves.factor[node]
    return slowness


@inner
def solve_at(waves: MarchState, node: int) -> tuple[float, int]:
    """Return the time at a node that follows from its final neighbours, and the lowest of them."""
    one, way_one, time_one = lower_side(waves, node, waves.stride[waves.level_of[node]])
    two, way_two, time_two = lower_side(waves, node, 1)
    if one < 0 and two < 0:
        return math.inf, -1
    cost = waves.spacing * slowness_at(waves, node, one, way_one, two, way_two)
    a, t, b, s = 1.0, time_one, 1.0, time_two
    if one >= 0:
        a, t = upwind(waves, node, way_one, time_one)
    if two >= 0:
        b, s = upwind(waves, node, way_two, time_two)
    if one >= 0 and two >= 0:
        # a (T - t)^2 + b (T - s)^2 = cost^2, with T above the times of both neighbours.
        total, gap = a + b, s - t
        inside = total * cost * cost - a * b * gap * gap
        if inside >= 0.0:
            time = (a * t + b * s + math.sqrt(inside)) / total
            if time >= time_one and time >= time_two:
                return time, one if time_one <= time_two else two
    if time_one <= time_two:
        return max(t + cost / math.sqrt(a), time_one), one
    return max(s + cost / math.sqrt(b), time_two), two


@inner
def offer(waves: MarchState, node: int, time: float, near: int, size: int) -> int:
    """Give a node that is not final a time if it is lower than its own; return the length of the queue."""
    if time < waves.time[node]:
        waves.time[node] = time
        waves.before[node] = near
        place = waves.place[node]
        if waves.state[node] == FAR:
            waves.state[node] = QUEUED
            place = size
            size += 1
        rise(waves, place, node, time)
    return size


@inner
def jump_from(waves: MarchState, node: int, level: Bytes, lowered: Bytes, size: int) -> int:
    """Let the time of a node go on by the jumps that end there; return the length of the queue."""
    k = waves.first_jump[node]
    while 0 <= k < waves.jump_end.shape[0] and waves.jump_end[k] == node:
        other, time = waves.jump_start[k], waves.time[node] + waves.jump_time[k]
        here = waves.level_of[other]
        if waves.state[other] == FAR or waves.state[other] == QUEUED:
            size = offer(waves, other, time, node, size)
        elif waves.state[other] == FINAL and not level[here] and time < waves.time[other] * (1.0 - ROUNDING):
            lowered[here] = 1
        k += 1
    return size


@kernel
def march_waves(waves: MarchState, level: Bytes, needed: Bytes, missing: int, least: float, lowered: Bytes) -> None:
    """March through some levels, from the nodes that are final, until the times on all needed levels are known.

    Nodes that are to be solved are FAR with an infinite time; all nodes of levels that are not marked in `level`
    (levels,) are FINAL or APART. `missing` nodes of those in `needed` (levels,) must become FINAL, and the march goes
    up to the time `least` [s] in any case. Other levels on which times would decrease are marked in `lowered`
    (levels,).
    """
    size, has_gates = 0, waves.gate_at.shape[0] > 0
    for k in range(waves.border.shape[0]):
        node = waves.border[k]
        if not level[waves.level_of[node]]:
            continue
        time, near = solve_at(waves, node)
        if time < math.inf:
            size = offer(waves, node, time, near, size)
        other = waves.twin[node]
        if other >= 0 and waves.twin[other] == node and waves.state[other] == FINAL:
            size = offer(waves, node, waves.time[other], other, size)
    for k in range(waves.jump_end.shape[0]):
        node, other = waves.jump_start[k], waves.jump_end[k]
        if level[waves.level_of[node]] and waves.state[node] != APART and waves.state[other] == FINAL:
            size = offer(waves, node, waves.time[other] + waves.jump_time[k], other, size)
    while size > 0 and (missing > 0 or waves.key[0] <= least):
        size -= 1
        node = take_first(waves, size)
        waves.state[node] = FINAL
        near, here = waves.before[node], waves.level_of[node]
        is_car = waves.label[here] >= 0 and waves.level_of[near] != here
        waves.exit[node] = waves.label[here] if is_car else waves.exit[near]
        if has_gates and waves.gate_at[node] >= 0:
            waves.gate[node] = waves.gate_at[node]
            waves.walk[node] = 0.0
        elif has_gates:
            waves.gate[node] = waves.gate[near]
            waves.walk[node] = waves.walk[near] + (waves.time[node] - waves.time[near]) / waves.factor[node]
        missing -= needed[here]
        if waves.level_of[near] != here:
            waves.leans[here, waves.level_of[near]] = 1
        other = waves.twin[node]
        if other >= 0:
            if waves.state[other] == FAR or waves.state[other] == QUEUED:
                size = offer(waves, other, waves.time[node], node, size)
            elif (
                waves.state[other] == FINAL
                and not level[waves.level_of[other]]
                and waves.time[node] < waves.time[other] * (1.0 - ROUNDING)
            ):
                lowered[waves.level_of[other]] = 1
        if waves.first_jump.shape[0] > 0:
            size = jump_from(waves, node, level, lowered, size)
        stride = waves.stride[here]
        for k in range(4):
            step = (stride if k < 2 else 1) * (1 - 2 * (k % 2))
            other = waves.beside[node + step]
            if other < 0 or waves.state[other] == APART:
                continue
            if waves.state[other] != FINAL:
                time, near = solve_at(waves, other)
                if time < math.inf:
                    size = offer(waves, other, time, near, size)
            elif not level[waves.level_of[other]]:
                time, near = solve_at(waves, other)
                if time < waves.time[other] * (1.0 - ROUNDING):
                    lowered[waves.level_of[other]] = 1
