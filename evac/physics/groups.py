"""Rows in groups of four that share no body, so that a sweep relaxes four at a time.

Each row is put into one of the open groups in which neither of its bodies is, the next row into one some way on: the
rows of a body, which follow each other, come to stand apart, and a sweep does not wait for the velocities that it has
just written. When no open group will take a row, new ones are opened; so the order remains about that of the rows.
Lanes left free hold a row without effect, at the wall. In a crowd they are few. Where many contacts are of one body,
which takes a group for each, there would be many; then no groups are formed.
"""

from evac.jit import inner
from evac.lanes import (
    FOUR,
    fused_lanes,
    gather,
    greatest,
    larger,
    load,
    magnitude,
    scatter,
    spread,
    store,
    total,
)
from evac.physics.rows import BEFORE, BIAS, BOUND, SPRING

#: Groups that are open at a time, one for each bit of a body's mask; the lanes in them.
OPEN = 8
LANES_OPEN = OPEN * FOUR

#: There may be this many lanes for each row, and some more.
ROOM, SPARE = 1.25, 8 * LANES_OPEN

#: The next row looks for a group from so many groups on.
STRIDE = 3

#: Numbers of a group in its flat arrays.
DATA, ELASTIC = 5 * FOUR, 3 * FOUR


@inner
def form(rows, groups, n, bodies):
    """Put the rows into groups; return how many groups there are, or 0 where too many lanes would be free."""
    lanes = _assign(rows, groups, n, bodies)
    count = n * 0
    for first in range(0, lanes, FOUR):
        if groups.row[first] == n:
            continue  # groups fill from their first lane
        for lane in range(FOUR):
            r = groups.row[first + lane]
            groups.row[FOUR * count + lane] = r
            if r < n:
                _copy(rows, groups, r, count, lane)
            else:
                _blank(groups, bodies, count, lane)
        count += 1
    return count


@inner
def _assign(rows, groups, n, bodies):
    """Write the row of each lane, n for none; return the number of lanes, 0 where too many would be free."""
    mask, block, filled = groups.mask, groups.block, groups.filled
    for i in range(bodies + 1):
        block[i] = -1
    lanes = _open(groups, n, n * 0)
    opened, full, at = n * 0, n * 0, n * 0
    r = n * 0
    while r < n:
        i, j = rows.body[r], rows.other[r]
        for k in (i, j):
            if block[k] != opened:
                block[k] = opened
                mask[k] = 0
        taken = full | mask[i] | (mask[j] if j < bodies else 0)
        group = _next_free(taken, at)
        if group < 0:
            if lanes + LANES_OPEN > ROOM * n + SPARE:
                return n * 0
            lanes = _open(groups, n, lanes)
            opened += 1
            full = n * 0
            continue
        bit = 1 << group
        mask[i] |= bit
        mask[j] |= bit
        groups.row[lanes - LANES_OPEN + FOUR * group + filled[group]] = r
        filled[group] += 1
        if filled[group] == FOUR:
            full |= bit
        at = (group + STRIDE) % OPEN
        r += 1
    return lanes


@inner
def _open(groups, n, lanes):
    """Open groups behind `lanes` lanes, all free; return the lanes then."""
    for k in range(lanes, lanes + LANES_OPEN):
        groups.row[k] = n
    for group in range(OPEN):
        groups.filled[group] = 0
    return lanes + LANES_OPEN


@inner
def _next_free(taken, at):
    """Return the first group from `at` on, around, whose bit is not set, or -1."""
    for k in range(OPEN):
        group = (at + k) % OPEN
        if (taken >> group) & 1 == 0:
            return group
    return -1


@inner
def _copy(rows, groups, r, group, lane):
    """Copy row r into a lane of a group."""
    at = FOUR * group + lane
    groups.body[at] = 2 * rows.body[r]
    groups.other[at] = 2 * rows.other[r]
    for k in range(5):
        groups.data[DATA * group + FOUR * k + lane] = rows.data[r, k]
    if not rows.rigid[0]:
        for k in range(3):
            groups.elastic[ELASTIC * group + FOUR * k + lane] = rows.elastic[r, k]
    groups.scale[at] = rows.scale[r]
    groups.percussion[at] = rows.percussion[r]


@inner
def _blank(groups, bodies, group, lane):
    """Make a lane of a group a row without effect, at the wall."""
    at = FOUR * group + lane
    groups.body[at] = 2 * bodies
    groups.other[at] = 2 * bodies
    for k in range(5):
        groups.data[DATA * group + FOUR * k + lane] = 0.0
    for k in range(3):
        groups.elastic[ELASTIC * group + FOUR * k + lane] = 0.0
    groups.scale[at] = 0.0
    groups.percussion[at] = 0.0


@inner
def dissolve(rows, groups, n, count):
    """Copy the percussions of the groups back to the rows."""
    for lane in range(FOUR * count):
        if groups.row[lane] < n:
            rows.percussion[groups.row[lane]] = groups.percussion[lane]


@inner
def _law(groups, g, w, x, rigid):
    """Return the changes of x after which the rows of group g, at velocities w, obey their law."""
    bias = load(groups.data, DATA * g + FOUR * BIAS)
    if rigid:
        return larger(-(w + bias), -x)
    first = ELASTIC * g
    spring = load(groups.elastic, first + FOUR * SPRING)
    held = (spring - spread(1.0)) * x - spring * load(groups.elastic, first + FOUR * BEFORE)
    elastic = fused_lanes(-spring, w, held)
    return larger(larger(-(w + bias), elastic), load(groups.elastic, first + FOUR * BOUND) - x)


@inner
def _velocities(groups, velocity, g):
    """Return the scaled velocities along the rows of group g, positive when they open."""
    at, first = FOUR * g, DATA * g
    ux, uy = gather(velocity, groups.body, at)
    vx, vy = gather(velocity, groups.other, at)
    own = fused_lanes(load(groups.data, first), ux, load(groups.data, first + FOUR) * uy)
    return own + fused_lanes(load(groups.data, first + 2 * FOUR), vx, load(groups.data, first + 3 * FOUR) * vy)


@inner
def _push(groups, velocity, g, change):
    """Apply changes of x along the rows of group g."""
    # All loads before the first store, so that the compiler may keep what `_velocities` has loaded.
    at, first = FOUR * g, DATA * g
    ax, ay = load(groups.data, first), load(groups.data, first + FOUR)
    bx, by = load(groups.data, first + 2 * FOUR), load(groups.data, first + 3 * FOUR)
    ux, uy = gather(velocity, groups.body, at)
    vx, vy = gather(velocity, groups.other, at)
    scatter(velocity, groups.body, at, fused_lanes(ax, change, ux), fused_lanes(ay, change, uy))
    scatter(velocity, groups.other, at, fused_lanes(bx, change, vx), fused_lanes(by, change, vy))


@inner
def _relax(groups, velocity, g, x, rigid):
    """Let the rows of group g obey their law, from x; return the changes of x."""
    change = _law(groups, g, _velocities(groups, velocity, g), x, rigid)
    _push(groups, velocity, g, change)
    return change


@inner
def sweep_on(rows, groups, count, share):
    """Sweep up from x gone on by `share` of its last step.

    Returns the slope along the last step and the greatest change of a row [m/s].
    """
    velocity = rows.velocity.reshape(-1)
    rigid = rows.rigid[0] == 1
    shares, uphill, change_most = spread(share), spread(0.0), spread(0.0)
    for g in range(count):
        at = FOUR * g
        old = load(groups.percussion, at)
        start = fused_lanes(shares, old - load(groups.last, at), old)
        change = _relax(groups, velocity, g, start, rigid)
        new = start + change
        store(groups.last, at, old)
        store(groups.percussion, at, new)
        uphill = fused_lanes(-change, new - old, uphill)
        change_most = larger(magnitude(change) * load(groups.scale, at), change_most)
    return total(uphill), greatest(change_most)


@inner
def sweep_back(rows, groups, count):
    """Sweep down behind a sweep up; return its part of the slope along the last step, and its greatest change [m/s]."""
    velocity = rows.velocity.reshape(-1)
    rigid = rows.rigid[0] == 1
    uphill, change_most = spread(0.0), spread(0.0)
    for g in range(count - 1, -1, -1):
        at = FOUR * g
        x = load(groups.percussion, at)
        change = _relax(groups, velocity, g, x, rigid)
        new = x + change
        store(groups.percussion, at, new)
        uphill = fused_lanes(-change, new - load(groups.last, at), uphill)
        change_most = larger(magnitude(change) * load(groups.scale, at), change_most)
    return total(uphill), greatest(change_most)


@inner
def group_residual(rows, groups, count):
    """Return max omega |P - P_local| over the rows in groups [m/s]."""
    velocity = rows.velocity.reshape(-1)
    rigid = rows.rigid[0] == 1
    worst = spread(0.0)
    for g in range(count):
        at = FOUR * g
        change = _law(groups, g, _velocities(groups, velocity, g), load(groups.percussion, at), rigid)
        worst = larger(magnitude(change) * load(groups.scale, at), worst)
    return greatest(worst)


@inner
def rigid_energy(groups, count):
    """Return the energies of the rows in groups where all are rigid [J]."""
    found = spread(0.0)
    for g in range(count):
        found = fused_lanes(load(groups.data, DATA * g + FOUR * BIAS), load(groups.percussion, FOUR * g), found)
    return total(found)
