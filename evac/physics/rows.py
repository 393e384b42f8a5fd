"""The contact problem packed for solvers: one row of eight numbers per unknown percussion.

A normal percussion is one row, a tangential one (where a contact is sticky) another without a lower bound. Walls
are a last body of infinite mass. A sweep then costs 3 to 4 ns a row; on the bundles of the step loop it cost
ten times as much (memory and branches).

Columns of ``Rows.data``: normal x and y, 1/omega, bias b, inverse masses of both bodies, velocity before the
step w-, and s = omega / (omega + 2/K_N), 0 where the elastic term is absent. The local law of PHYSICS 3.3 reads

    P = max(0, P - (w + b)/omega, s (P - (w + w-)/omega))

and a tangential row, which has b = UNBOUNDED, takes the last of the three alone.
"""

from evac.jit import inner

NX, NY, SOFTNESS, BIAS, INVERSE_I, INVERSE_J, BEFORE, SPRING = range(8)

#: Bias of a row without lower bound.
UNBOUNDED = 1e300


@inner
def pack(contacts, bodies, inverse_mass, free, compliance, tangential):
    """Fill the rows from the contacts, set velocities to the free ones plus percussions; return the number of rows."""
    rows = contacts.rows
    for i in range(bodies):
        rows.velocity[i, 0] = free[i, 0]
        rows.velocity[i, 1] = free[i, 1]
        rows.mass[i] = 1.0 / inverse_mass[i]
    rows.velocity[bodies, 0] = 0.0
    rows.velocity[bodies, 1] = 0.0
    rows.mass[bodies] = 0.0
    used = contacts.count[0] * 0
    for c in range(contacts.count[0]):
        omega = contacts.omega[c]
        spring = omega / (omega + compliance) if compliance >= 0.0 else 0.0
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        bias, before, start = contacts.bias[c], contacts.approach[c], contacts.impulse[c]
        _pack_row(contacts, rows, c, used, bodies, inverse_mass, nx, ny, bias, before, spring, start)
        used += 1
        if contacts.sticky[c] and tangential > 0.0:
            spring = omega / (omega + 2.0 / tangential)
            start, before = contacts.friction[c], contacts.work[c, 5]
            _pack_row(contacts, rows, c, used, bodies, inverse_mass, -ny, nx, UNBOUNDED, before, spring, start)
            used += 1
    for r in range(used):
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, rows.impulse[r])
    return used


@inner
def _pack_row(contacts, rows, c, r, bodies, inverse_mass, nx, ny, bias, before, spring, start):
    i, j = contacts.body[c], contacts.other[c]
    rows.body[r] = i
    rows.other[r] = j if j >= 0 else bodies
    rows.impulse[r] = start
    rows.data[r, NX] = nx
    rows.data[r, NY] = ny
    rows.data[r, SOFTNESS] = 1.0 / contacts.omega[c]
    rows.data[r, BIAS] = bias
    rows.data[r, INVERSE_I] = inverse_mass[i]
    rows.data[r, INVERSE_J] = inverse_mass[j] if j >= 0 else 0.0
    rows.data[r, BEFORE] = before
    rows.data[r, SPRING] = spring


@inner
def unpack(contacts, bodies, velocity, tangential):
    """Copy percussions and velocities back."""
    rows = contacts.rows
    r = contacts.count[0] * 0
    for c in range(contacts.count[0]):
        contacts.impulse[c] = rows.impulse[r]
        r += 1
        if contacts.sticky[c]:
            contacts.friction[c] = 0.0
            if tangential > 0.0:
                contacts.friction[c] = rows.impulse[r]
                r += 1
    for i in range(bodies):
        velocity[i, 0] = rows.velocity[i, 0]
        velocity[i, 1] = rows.velocity[i, 1]


@inner
def push_row(velocity, i, j, data, r, percussion):
    """Apply a percussion along row r."""
    px = percussion * data[r, NX]
    py = percussion * data[r, NY]
    velocity[i, 0] += data[r, INVERSE_I] * px
    velocity[i, 1] += data[r, INVERSE_I] * py
    velocity[j, 0] -= data[r, INVERSE_J] * px
    velocity[j, 1] -= data[r, INVERSE_J] * py


@inner
def row_velocity(velocity, i, j, data, r):
    """Return the velocity along row r, positive when it opens [m/s]."""
    return data[r, NX] * (velocity[i, 0] - velocity[j, 0]) + data[r, NY] * (velocity[i, 1] - velocity[j, 1])


@inner
def law(data, r, w, percussion):
    """Return the percussion that makes row r obey its law with all others held, w being its velocity now."""
    softness = data[r, SOFTNESS]
    new = max(
        percussion - (w + data[r, BIAS]) * softness,
        data[r, SPRING] * (percussion - (w + data[r, BEFORE]) * softness),
    )
    if new < 0.0 and data[r, BIAS] < UNBOUNDED:
        return 0.0
    return new


@inner
def relax(rows, r):
    """Make row r obey its law."""
    i, j = rows.body[r], rows.other[r]
    old = rows.impulse[r]
    new = law(rows.data, r, row_velocity(rows.velocity, i, j, rows.data, r), old)
    if new != old:
        rows.impulse[r] = new
        push_row(rows.velocity, i, j, rows.data, r, new - old)


@inner
def sweep_up(rows, n):
    """Relax the rows in their order: along the chains of force, away from the exit."""
    for r in range(n):
        relax(rows, r)


@inner
def sweep_down(rows, n):
    """Relax the rows backwards."""
    for r in range(n - 1, -1, -1):
        relax(rows, r)


@inner
def row_residual(rows, n):
    """Return max omega |P - P_local| over the rows [m/s]."""
    worst = 0.0
    for r in range(n):
        old = rows.impulse[r]
        new = law(rows.data, r, row_velocity(rows.velocity, rows.body[r], rows.other[r], rows.data, r), old)
        worst = max(worst, abs(new - old) / rows.data[r, SOFTNESS])
    return worst


@inner
def renew_velocity(rows, bodies, free, n):
    """Set the velocities to the free ones plus all percussions."""
    for i in range(bodies):
        rows.velocity[i, 0] = free[i, 0]
        rows.velocity[i, 1] = free[i, 1]
    rows.velocity[bodies, 0] = 0.0
    rows.velocity[bodies, 1] = 0.0
    for r in range(n):
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, rows.impulse[r])
