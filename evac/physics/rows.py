"""The contact problem packed for solvers: one row per unknown percussion, with unit diagonal.

A normal percussion is one row, a tangential one (where a contact is sticky) another without a lower bound. Walls
are a last body that is never moved. Solvers work on scaled unknowns

    x = sqrt(omega) P  [J^1/2],    U = sqrt(m) v  [J^1/2]

so that a row is a unit vector, A on its body and B on the other one: its velocity w / sqrt(omega) is
A.U_i + B.U_j, a change of x moves U_i by A and U_j by B, and a body's mass is never looked at. A sweep then costs
some 3 ns a row; on contacts and bodies it would cost ten times as much (memory and branches).

Columns of ``Problem.data``: A, B and the bias b over sqrt(omega), all that rigid rows need; of ``Problem.elastic``:
velocity before the step w- over sqrt(omega), s = omega / (omega + 2/K_N), 0 where the elastic term is absent, and the
lower bound of x. The local law (docs/physics.md) reads

    x = max(bound, x - (w + b), s (x - (w + w-)))

and a tangential row, with bound minus and b plus infinity, takes the last of the three alone.

What a sweep waits for is the chain from the velocities that one row leaves to those that the next one at the same
body leaves. It is kept short: multiplications and additions are fused, and what is computed is the change of x.
"""

import math

from evac.jit import AddressCall, fused, inner
from evac.physics.state import Problem

AX, AY, BX, BY, BIAS = range(5)
BEFORE, SPRING, BOUND = range(3)

#: Evaluating the residual costs half a sweep. It is likely to be this share of the greatest change in a sweep, later
#: `CAUTION` of the share seen the last time.
LIKELY, CAUTION = 0.5, 0.8

#: In place of 2/K_N where K_N = 0: no third term in the local form.
INELASTIC = -1.0

#: Call a solver: the problem, the residual wanted [m/s], the most iterations; it returns those made.
call_solver = AddressCall([Problem, float, int], (int,))


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
def sweep_up(rows):
    """Relax the rows in their order, away from the exit along the force chains; return the greatest change [m/s]."""
    change = 0.0
    rigid = rows.rigid == 1
    for r in range(rows.size):
        change = max(change, relax(rows, r, rigid))
    return change


@inner
def sweep_down(rows):
    """Relax the rows backwards; return the greatest change [m/s]."""
    change = 0.0
    rigid = rows.rigid == 1
    for r in range(rows.size - 1, -1, -1):
        change = max(change, relax(rows, r, rigid))
    return change


@inner
def row_residual(rows):
    """Return max omega |P - P_local| over the rows [m/s]."""
    worst = 0.0
    rigid = rows.rigid == 1
    for r in range(rows.size):
        change = law(rows, r, rows.percussion[r], rigid)
        worst = max(worst, abs(change) * rows.scale[r])
    return worst


@inner
def evaluate(rows, change, likely, tolerance):
    """Set the residual after a sweep with this greatest change; return its likely share of such a change.

    Where it is not likely to be within the tolerance both stay as they were.
    """
    if likely * change > tolerance:
        return likely
    rows.residual = row_residual(rows)
    return CAUTION * rows.residual / change if change > 0.0 else likely


@inner
def renew_velocity(rows):
    """Set the velocities to the free ones plus all percussions."""
    for i in range(rows.bodies + 1):
        rows.velocity[i, 0] = rows.free[i, 0]
        rows.velocity[i, 1] = rows.free[i, 1]
    for r in range(rows.size):
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, rows.percussion[r])


@inner
def keep(rows):
    """Keep percussions in `work_a` and velocities in `image_a`."""
    for r in range(rows.size):
        rows.work_a[r] = rows.percussion[r]
    for i in range(rows.bodies):
        for k in range(2):
            rows.image_a[i, k] = rows.velocity[i, k]


@inner
def momentum_after(momentum):
    """Return Nesterov's next momentum, and how much of the last step to go on by."""
    following = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
    return following, (momentum - 1.0) / following
