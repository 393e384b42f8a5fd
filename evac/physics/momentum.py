"""Nesterov's momentum: gradient steps, and Gauss-Seidel sweeps, that go on along their last step.

Both start the momentum anew where it points uphill (O'Donoghue and Candes, 2015). A sweep with momentum takes as
many iterations for a chain of contacts as it is long, a sweep without its square.
"""

import math

from evac.jit import inner
from evac.lanes import FOUR, fused_lanes, load, spread, total
from evac.physics.conjugate import conjugate_faces
from evac.physics.groups import dissolve, form, group_residual, rigid_energy, sweep_back, sweep_on
from evac.physics.rows import (
    AX,
    AY,
    BEFORE,
    BIAS,
    BOUND,
    BX,
    BY,
    CAUTION,
    LIKELY,
    SPRING,
    look,
    push_row,
    renew_velocity,
    row_energy,
    row_residual,
    row_velocity,
)

#: A rise of the energy by more than this share of it is no rounding.
RISE = 1e-10

#: Sweeps between two looks at the energy; two rises within `SOON` tell that even symmetric sweeps do not suit momentum.
WATCH, SOON = 16, 64


@inner
def gradient_step(rows, r, w, x, rate):
    """Return the projected step of length `rate` along the multiplier of row r (appendix 2 of the paper)."""
    new = x - rate * (w + rows.data[r, BIAS])
    spring = rows.elastic[r, SPRING]
    if spring > 0.0:
        new = max(new, (x - rate * (w + rows.elastic[r, BEFORE])) / (1.0 + rate * (1.0 - spring) / spring))
    return max(new, rows.elastic[r, BOUND])


@inner
def momentum_after(momentum):
    """Return Nesterov's next momentum, and how much of the last step to go on by."""
    following = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
    return following, (momentum - 1.0) / following


@inner
def accelerated_gradient(rows, n, bodies, tolerance, limit):
    """Nesterov's projected gradient with diagonal scaling and restart; return (iterations, residual).

    The step of a row is 1 over the sum of its row of G M^-1 G^T, bounded by the numbers of rows at its
    bodies, so the scaled gradient step never overshoots; the momentum starts anew where it points uphill.
    """
    _set_rates(rows, n, bodies)
    momentum, change = 1.0, math.inf
    for r in range(n):
        rows.work[1, r] = rows.percussion[r]
    found, likely = row_residual(rows, n), LIKELY
    iteration = n * 0
    while found > tolerance and iteration < limit:
        following, share = momentum_after(momentum)
        iteration += 1
        near = likely * change <= tolerance or iteration == limit
        uphill, change = _gradient_pass(rows, n, bodies, 0.0 if near else share)
        momentum = following if uphill <= 0.0 else 1.0
        if near:
            found, likely = look(rows, n, change, found, likely, math.inf)
            if found > tolerance and iteration < limit:
                for r in range(n):
                    rows.percussion[r] += share * (rows.percussion[r] - rows.work[3, r])
                renew_velocity(rows, bodies, n)
    return iteration, found


@inner
def _gradient_pass(rows, n, bodies, share):
    """Step all rows at once, go on by `share` of the step, renew velocities.

    Returns the slope along the last step and the greatest step [m/s]. Of the work array: 1 the percussions stepped
    to, 2 rates, 3 those stepped to before.
    """
    data, work, image = rows.data, rows.work, rows.image
    for i in range(bodies + 1):
        image[0, i, 0] = rows.free[i, 0]
        image[0, i, 1] = rows.free[i, 1]
    uphill, change = 0.0, 0.0
    for r in range(n):
        i, j = rows.body[r], rows.other[r]
        x = rows.percussion[r]
        new = gradient_step(rows, r, row_velocity(rows.velocity, i, j, data, r, 0.0), x, work[2, r])
        step = new - work[1, r]
        uphill += (x - new) * step / work[2, r]
        change = max(change, abs(new - x) * rows.scale[r])
        work[3, r] = work[1, r]
        work[1, r] = new
        new += share * step
        rows.percussion[r] = new
        push_row(image[0], i, j, data, r, new)
    for i in range(bodies):
        rows.velocity[i, 0] = image[0, i, 0]
        rows.velocity[i, 1] = image[0, i, 1]
    return uphill, change


@inner
def _set_rates(rows, n, bodies):
    """Set work 2 to the step of each row."""
    for i in range(bodies + 1):
        rows.image[0, i, 0] = 0.0
    for r in range(n):
        rows.image[0, rows.body[r], 0] += 1.0
        rows.image[0, rows.other[r], 0] += 1.0
    for r in range(n):
        data = rows.data[r]
        own = (data[AX] ** 2 + data[AY] ** 2) * rows.image[0, rows.body[r], 0]
        others = (data[BX] ** 2 + data[BY] ** 2) * rows.image[0, rows.other[r], 0]
        rows.work[2, r] = 1.0 / (own + others)


@inner
def accelerated_sweeps(rows, groups, n, bodies, tolerance, limit):
    """Gauss-Seidel sweeps with Nesterov's momentum and restart; return (iterations, residual).

    Every sweep starts from percussions and velocities extrapolated from the last two, and the momentum starts anew
    where it points uphill. No bound of a step is needed, but sweeps in one direction with momentum need not go down:
    in orderly crowds, bodies in rows, they swing ever farther. Where the energy has risen between two looks, sweeps
    start again from the look before and run back and forth from then on: a symmetric sweep is a step in a metric in
    which momentum does go down, but costs two. Where the energy soon rises again, they go on by at most half the
    share of the last step: plain sweeps, which cannot rise, are what that tends to. Sweeps relax four rows at a time
    (`evac.physics.groups`); where many of them are of one body, conjugate gradients on faces, better there, take their
    place.
    """
    found = row_residual(rows, n)
    if found <= tolerance or limit < 1:
        return n * 0, found
    count = form(rows, groups, n, bodies)
    if count == 0:
        return conjugate_faces(rows, n, bodies, tolerance, limit)
    momentum, share, most = 1.0, 0.0, 1.0
    back = False
    likely = LIKELY
    looked, risen = n * 0, -SOON
    accepted = energy(rows, groups, n, bodies, count)
    _keep(rows, groups, bodies, count)
    _take_back(rows, groups, bodies, count)
    iteration = n * 0
    while found > tolerance and iteration < limit:
        _go_on(rows, bodies, share)
        uphill, change = sweep_on(rows, groups, count, share)
        iteration += 1
        if back and iteration < limit:
            further, change = sweep_back(rows, groups, count)
            uphill += further
            iteration += 1
        if iteration >= looked + WATCH or iteration >= limit:
            looked = iteration
            now = energy(rows, groups, n, bodies, count)
            if now <= accepted + RISE * max(abs(accepted), abs(now)):
                accepted = now
                _keep(rows, groups, bodies, count)
            else:
                _take_back(rows, groups, bodies, count)
                if back and iteration - risen <= SOON:
                    most *= 0.5
                back = True
                risen = iteration
                uphill = 1.0
        if likely * change <= tolerance or iteration >= limit:
            found = group_residual(rows, groups, count)
            likely = CAUTION * found / change if change > 0.0 else likely
        momentum, share = momentum_after(momentum if uphill <= 0.0 else 1.0)
        share = min(share, most)
    dissolve(rows, groups, n, count)
    return iteration, found


@inner
def _go_on(rows, bodies, share):
    """Go on by `share` of the last step of the velocities."""
    velocity, before = rows.velocity.reshape(-1), rows.image[0].reshape(-1)  # one flat loop is three times as fast
    for k in range(2 * bodies):
        now = velocity[k]
        velocity[k] = now + share * (now - before[k])
        before[k] = now


@inner
def _keep(rows, groups, bodies, count):
    """Keep percussions and velocities, for `_take_back`."""
    for k in range(FOUR * count):
        groups.kept[k] = groups.percussion[k]
    for i in range(bodies):
        for k in range(2):
            rows.image[1, i, k] = rows.velocity[i, k]


@inner
def _take_back(rows, groups, bodies, count):
    """Return to the percussions and velocities kept, at rest."""
    for k in range(FOUR * count):
        groups.percussion[k] = groups.kept[k]
        groups.last[k] = groups.kept[k]
    for i in range(bodies):
        for k in range(2):
            rows.velocity[i, k] = rows.image[1, i, k]
            rows.image[0, i, k] = rows.image[1, i, k]


@inner
def energy(rows, groups, n, bodies, count):
    """Return what percussions obeying their laws make least: kinetic energy and the rows' own energies [J]."""
    velocity = rows.velocity.reshape(-1)
    squares, whole = spread(0.0), 2 * bodies // FOUR * FOUR
    for k in range(0, whole, FOUR):
        four = load(velocity, k)
        squares = fused_lanes(four, four, squares)
    found = total(squares)
    for k in range(whole, 2 * bodies):
        found += velocity[k] ** 2
    found *= 0.5
    if rows.rigid[0]:
        return found + rigid_energy(groups, count)
    for k in range(FOUR * count):
        r = groups.row[k]
        if r < n:
            found += row_energy(rows, r, groups.percussion[k])
    return found
