"""The contact problem packed for solvers: one row per unknown percussion, with unit diagonal.

A normal percussion is one row, a tangential one (where a contact is sticky) another without a lower bound. Walls
are a last body that is never moved. Solvers work on scaled unknowns

    x = sqrt(omega) P  [J^1/2],    U = sqrt(m) v  [J^1/2]

so that a row is a unit vector, A on its body and B on the other one: its velocity w / sqrt(omega) is
A.U_i + B.U_j, a change of x moves U_i by A and U_j by B, and a body's mass is never looked at. A sweep then costs
some 3 ns a row; on the bundles of the step loop it cost ten times as much (memory and branches).

Columns of ``Rows.data``: A, B and the bias b over sqrt(omega), all that rigid rows need; of ``Rows.elastic``: velocity
before the step w- over sqrt(omega), s = omega / (omega + 2/K_N), 0 where the elastic term is absent, and the lower
bound of x. The local law (docs/physics.md) reads

    x = max(bound, x - (w + b), s (x - (w + w-)))

and a tangential row, with bound minus and b plus infinity, takes the last of the three alone.

What a sweep waits for is the chain from the velocities that one row leaves to those that the next one at the same
body leaves. It is kept short: multiplications and additions are fused, and what is computed is the change of x.
"""

import math

from evac.jit import fused, inner

AX, AY, BX, BY, BIAS = range(5)
BEFORE, SPRING, BOUND = range(3)

#: A look at the residual costs half a sweep. It is likely to be this share of the greatest change in a sweep, later
#: `CAUTION` of the share seen at the last look.
LIKELY, CAUTION = 0.5, 0.8


@inner
def pack(contacts, bodies, inverse_mass, free, compliance, tangential):
    """Fill the rows from the contacts, set velocities to the free ones plus percussions; return the number of rows."""
    rows = contacts.rows
    for i in range(bodies):
        rows.inverse_root[i] = math.sqrt(inverse_mass[i])
        for k in range(2):
            rows.free[i, k] = free[i, k] / rows.inverse_root[i]
    rows.inverse_root[bodies] = 0.0
    rows.free[bodies, 0] = 0.0
    rows.free[bodies, 1] = 0.0
    used = contacts.count[0] * 0
    rows.rigid[0] = 1 if compliance < 0.0 and tangential <= 0.0 else 0
    for c in range(contacts.count[0]):
        omega = contacts.omega[c]
        spring = omega / (omega + compliance) if compliance >= 0.0 else 0.0
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        bias, before, start = contacts.bias[c], contacts.velocity_before[c], contacts.percussion[c]
        _pack_row(contacts, rows, c, used, bodies, nx, ny, bias, before, spring, 0.0, start)
        used += 1
        if contacts.sticky[c] and tangential > 0.0:
            spring = omega / (omega + 2.0 / tangential)
            before, start = contacts.work[c, 2], contacts.friction[c]
            _pack_row(contacts, rows, c, used, bodies, -ny, nx, math.inf, before, spring, -math.inf, start)
            used += 1
    renew_velocity(rows, bodies, used)
    return used


@inner
def _pack_row(contacts, rows, c, r, bodies, nx, ny, bias, before, spring, bound, start):
    i = contacts.body[c]
    j = contacts.other[c] if contacts.other[c] >= 0 else bodies
    rows.body[r] = i
    rows.other[r] = j
    scale = math.sqrt(contacts.omega[c])
    rows.scale[r] = scale
    rows.percussion[r] = scale * start
    inverse = 1.0 / scale  # multiplications are several times cheaper than divisions
    own, others = inverse * rows.inverse_root[i], inverse * rows.inverse_root[j]
    rows.data[r, AX] = nx * own
    rows.data[r, AY] = ny * own
    rows.data[r, BX] = -nx * others
    rows.data[r, BY] = -ny * others
    rows.data[r, BIAS] = bias * inverse
    rows.elastic[r, BEFORE] = before * inverse
    rows.elastic[r, SPRING] = spring
    rows.elastic[r, BOUND] = bound


@inner
def unpack(contacts, bodies, velocity, tangential):
    """Copy percussions and velocities back; return whether all velocities are numbers."""
    rows = contacts.rows
    total = 0.0
    r = contacts.count[0] * 0
    for c in range(contacts.count[0]):
        contacts.percussion[c] = rows.percussion[r] / rows.scale[r]
        r += 1
        if contacts.sticky[c]:
            contacts.friction[c] = 0.0
            if tangential > 0.0:
                contacts.friction[c] = rows.percussion[r] / rows.scale[r]
                r += 1
    for i in range(bodies):
        velocity[i, 0] = rows.velocity[i, 0] * rows.inverse_root[i]
        velocity[i, 1] = rows.velocity[i, 1] * rows.inverse_root[i]
        total += velocity[i, 0] + velocity[i, 1]
    return math.isfinite(total)


@inner
def push_row(velocity, i, j, data, r, change):
    """Apply a change of x along row r."""
    # All loads before the first store, so that the compiler may keep what `row_velocity` has loaded.
    ux, uy, vx, vy = velocity[i, 0], velocity[i, 1], velocity[j, 0], velocity[j, 1]
    velocity[i, 0] = fused(data[r, AX], change, ux)
    velocity[i, 1] = fused(data[r, AY], change, uy)
    velocity[j, 0] = fused(data[r, BX], change, vx)
    velocity[j, 1] = fused(data[r, BY], change, vy)


@inner
def row_velocity(velocity, i, j, data, r, start):
    """Return `start` plus the scaled velocity along row r, positive when it opens."""
    own = fused(data[r, AX], velocity[i, 0], data[r, AY] * velocity[i, 1])
    return own + fused(data[r, BX], velocity[j, 0], fused(data[r, BY], velocity[j, 1], start))


@inner
def law(rows, r, x, rigid):
    """Return the change of x after which row r obeys its law, with all others held.

    `rigid` is that of the rows, read before a loop over them, so that the loop is compiled for either: a sweep over
    rigid rows, those of NSM1 and of NSM2 with K_N = 0, is a quarter cheaper.
    """
    data, i, j = rows.data, rows.body[r], rows.other[r]
    if rigid:
        return max(-row_velocity(rows.velocity, i, j, data, r, data[r, BIAS]), -x)
    w = row_velocity(rows.velocity, i, j, data, r, 0.0)
    spring = rows.elastic[r, SPRING]
    elastic = fused(-spring, w, (spring - 1.0) * x - spring * rows.elastic[r, BEFORE])
    return max(max(-w - data[r, BIAS], elastic), rows.elastic[r, BOUND] - x)


@inner
def row_energy(rows, r, x):
    """Return the energy whose slope along x is minus the velocity that the law asks of row r [J].

    The slope is min(b, w- + (1/s - 1) x): that of the elastic term up to where the rigid one takes over.
    """
    spring, bias, before = rows.elastic[r, SPRING], rows.data[r, BIAS], rows.elastic[r, BEFORE]
    if spring <= 0.0 or before >= bias:
        return bias * x
    compliance = (1.0 - spring) / spring
    if before + compliance * x <= bias:
        return x * (before + 0.5 * compliance * x)
    edge = (bias - before) / compliance
    return edge * (before + 0.5 * compliance * edge) + bias * (x - edge)


@inner
def relax(rows, r, rigid):
    """Make row r obey its law; return how far it was from that [m/s]."""
    x = rows.percussion[r]
    change = law(rows, r, x, rigid)
    push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, change)
    rows.percussion[r] = x + change
    return abs(change) * rows.scale[r]


@inner
def sweep_up(rows, n):
    """Relax the rows in their order, away from the exit along the force chains; return the greatest change [m/s]."""
    change = 0.0
    rigid = rows.rigid[0] == 1
    for r in range(n):
        change = max(change, relax(rows, r, rigid))
    return change


@inner
def sweep_down(rows, n):
    """Relax the rows backwards; return the greatest change [m/s]."""
    change = 0.0
    rigid = rows.rigid[0] == 1
    for r in range(n - 1, -1, -1):
        change = max(change, relax(rows, r, rigid))
    return change


@inner
def row_residual(rows, n):
    """Return max omega |P - P_local| over the rows [m/s]."""
    worst = 0.0
    rigid = rows.rigid[0] == 1
    for r in range(n):
        change = law(rows, r, rows.percussion[r], rigid)
        worst = max(worst, abs(change) * rows.scale[r])
    return worst


@inner
def look(rows, n, change, found, likely, tolerance):
    """Return the residual behind a sweep with this greatest change, and its likely share of such a change.

    Where it is not likely to be within the tolerance both are returned as they were.
    """
    if likely * change > tolerance:
        return found, likely
    found = row_residual(rows, n)
    return found, CAUTION * found / change if change > 0.0 else likely


@inner
def renew_velocity(rows, bodies, n):
    """Set the velocities to the free ones plus all percussions."""
    for i in range(bodies + 1):
        rows.velocity[i, 0] = rows.free[i, 0]
        rows.velocity[i, 1] = rows.free[i, 1]
    for r in range(n):
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, rows.percussion[r])


@inner
def keep(rows, n, bodies, place):
    """Keep percussions in the work array and velocities in the image, both at `place`."""
    for r in range(n):
        rows.work[place, r] = rows.percussion[r]
    for i in range(bodies):
        for k in range(2):
            rows.image[place, i, k] = rows.velocity[i, k]
