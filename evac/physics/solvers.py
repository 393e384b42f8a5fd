"""The contact problem of a step and its solvers, with one residual and one stopping rule for all.

Find percussions P >= 0 such that with the velocity v = V + M^-1 sum_c P_c n_c each contact obeys its law

    NSM1:  w+ + b >= 0  complementary to P,           b = max(D, 0) / h
    NSM2:  P = K_N max(0, -(w+ + w-)/2) + mu,  0 <= mu complementary to w+ >= 0

with the normal velocity w+ after and w- before the step. Both have the closed local form of PHYSICS 3.3,
P = max(0, -(a + b)/omega, -(a + w-)/(omega + 2/K_N)), a being w+ without the contact's own percussion.
The residual is max_c omega_c |P_c - P_c^local| [m/s]; times h it is NSM1's gap error [m]. All solvers work on the
packed rows of `evac.physics.rows`.
"""

import math

from evac.jit import inner
from evac.physics.conjugate import LOOK_EVERY, conjugate_faces, conjugate_sweeps
from evac.physics.rows import (
    BEFORE,
    BIAS,
    INVERSE_I,
    INVERSE_J,
    NX,
    NY,
    SOFTNESS,
    SPRING,
    UNBOUNDED,
    pack,
    renew_velocity,
    row_residual,
    row_velocity,
    sweep_up,
    unpack,
)

UZAWA = 0
GAUSS_SEIDEL = 1
ACCELERATED_GRADIENT = 2
CONJUGATE_SWEEPS = 3
CONJUGATE_FACES = 4

#: In place of 2/K_N where K_N = 0: no third term in the local form.
INELASTIC = -1.0

#: Names of the solvers, in the order of their codes.
SOLVERS = ("uzawa", "gauss_seidel", "accelerated_gradient", "conjugate_sweeps", "conjugate_faces")


@inner
def residual(velocity, contacts, compliance, tangential):
    """Return max_c omega_c |P_c - P_c^local| [m/s] of velocities and percussions, tangential ones included."""
    worst = 0.0
    for c in range(contacts.count[0]):
        omega = contacts.omega[c]
        i, j = contacts.body[c], contacts.other[c]
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        vx, vy = velocity[i, 0], velocity[i, 1]
        if j >= 0:
            vx -= velocity[j, 0]
            vy -= velocity[j, 1]
        a = nx * vx + ny * vy - omega * contacts.impulse[c]
        local = max(0.0, -(a + contacts.bias[c]) / omega)
        if compliance >= 0.0:
            local = max(local, -(a + contacts.approach[c]) / (omega + compliance))
        worst = max(worst, omega * abs(contacts.impulse[c] - local))
        if contacts.sticky[c]:
            a = nx * vy - ny * vx - omega * contacts.friction[c]
            local = -tangential * (a + contacts.work[c, 5]) / (2.0 + tangential * omega)
            worst = max(worst, omega * abs(contacts.friction[c] - local))
    return worst


@inner
def solve(method, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit):
    """Solve the contact problem from the percussions in `contacts`; return (iterations, residual).

    Parameters
    ----------
    method : int
        Code of the solver.
    bodies : int
        Number of rows of the velocities.
    inverse_mass : (n,) [1/kg]
    free, velocity : (n, 2)
        V, and the velocity found [m/s].
    contacts : Contacts
    compliance : float
        2/K_N [1/kg]; INELASTIC for NSM1 and for K_N = 0.
    tangential : float
        K_T [kg].
    tolerance : float
        Of the residual [m/s].
    limit : int
        Greatest number of iterations.
    """
    if contacts.count[0] == 0:
        for i in range(bodies):
            velocity[i, 0] = free[i, 0]
            velocity[i, 1] = free[i, 1]
        return 0, 0.0
    rows = contacts.rows
    n = pack(contacts, bodies, inverse_mass, free, compliance, tangential)
    if method == UZAWA:
        iterations, found = uzawa(rows, n, bodies, free, tolerance, limit)
    elif method == GAUSS_SEIDEL:
        iterations, found = gauss_seidel(rows, n, tolerance, limit)
    elif method == ACCELERATED_GRADIENT:
        iterations, found = accelerated_gradient(rows, n, bodies, free, tolerance, limit)
    elif method == CONJUGATE_SWEEPS:
        iterations, found = conjugate_sweeps(rows, n, bodies, tolerance, limit)
    else:
        iterations, found = conjugate_faces(rows, n, bodies, tolerance, limit)
    unpack(contacts, bodies, velocity, tangential)
    return iterations, found


@inner
def solve_again(method, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit):
    """Solve cold by the strongest other method with four times the iterations, after `method` did not converge."""
    for c in range(contacts.count[0]):
        contacts.impulse[c] = 0.0
        contacts.friction[c] = 0.0
    stronger = CONJUGATE_FACES if method != CONJUGATE_FACES else CONJUGATE_SWEEPS
    return solve(stronger, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, 4 * limit)


@inner
def gauss_seidel(rows, n, tolerance, limit):
    """Projected Gauss-Seidel in the rows' order; return (iterations, residual)."""
    found = row_residual(rows, n)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        sweep_up(rows, n)
        if iteration % LOOK_EVERY == LOOK_EVERY - 1 or iteration == limit - 1:
            found = row_residual(rows, n)
    return limit, found


@inner
def gradient_step(rows, r, w, percussion, rate):
    """Return the projected step of length `rate` [kg] along the multiplier of row r (appendix 2 of the paper)."""
    new = percussion - rate * (w + rows.data[r, BIAS])
    spring = rows.data[r, SPRING]
    if spring > 0.0:
        compliance = (1.0 - spring) / (spring * rows.data[r, SOFTNESS])
        new = max(new, (percussion - rate * (w + rows.data[r, BEFORE])) / (1.0 + rate * compliance))
    if new < 0.0 and rows.data[r, BIAS] < UNBOUNDED:
        return 0.0
    return new


@inner
def uzawa(rows, n, bodies, free, tolerance, limit):
    """The paper's solver (appendix 2): projected gradient on the multipliers with the fixed step 0.95 of its bound.

    rho = 0.95 * 2 alpha / |C|^2 with alpha the least mass; h^2 rho of NSM1, whose rows are h G, is the same
    step on percussions. Returns (iterations, residual).
    """
    lightest = 0.0
    for r in range(n):
        lightest = max(lightest, rows.data[r, INVERSE_I], rows.data[r, INVERSE_J])
    rate = 1.9 / (lightest * constraint_norm(rows, n, bodies))
    found = row_residual(rows, n)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        for r in range(n):
            w = row_velocity(rows.velocity, rows.body[r], rows.other[r], rows.data, r)
            rows.impulse[r] = gradient_step(rows, r, w, rows.impulse[r], rate)
        renew_velocity(rows, bodies, free, n)
        if iteration % LOOK_EVERY == LOOK_EVERY - 1 or iteration == limit - 1:
            found = row_residual(rows, n)
    return limit, found


@inner
def accelerated_gradient(rows, n, bodies, free, tolerance, limit):
    """Nesterov's projected gradient with diagonal scaling and restart; return (iterations, residual).

    The step of a row is 1 over the sum of its row of G^T M^-1 G, bounded by the numbers of rows at its
    bodies, so the scaled gradient step never overshoots; the momentum starts anew where it points uphill.
    """
    _set_rates(rows, n, bodies)
    momentum = 1.0
    for r in range(n):
        rows.work[r, 1] = rows.impulse[r]
    found = row_residual(rows, n)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        uphill = 0.0
        for r in range(n):
            w = row_velocity(rows.velocity, rows.body[r], rows.other[r], rows.data, r)
            rows.work[r, 0] = gradient_step(rows, r, w, rows.impulse[r], rows.work[r, 2])
            uphill += (rows.impulse[r] - rows.work[r, 0]) * (rows.work[r, 0] - rows.work[r, 1]) / rows.work[r, 2]
        if uphill > 0.0:
            momentum = 1.0
        following = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
        share = (momentum - 1.0) / following
        momentum = following
        look = iteration % LOOK_EVERY == LOOK_EVERY - 1 or iteration == limit - 1
        for r in range(n):
            new = rows.work[r, 0]
            rows.impulse[r] = new if look else new + share * (new - rows.work[r, 1])
            rows.work[r, 3] = new + share * (new - rows.work[r, 1])
            rows.work[r, 1] = new
        renew_velocity(rows, bodies, free, n)
        if look:
            found = row_residual(rows, n)
            if found > tolerance and iteration < limit - 1:
                for r in range(n):
                    rows.impulse[r] = rows.work[r, 3]
                renew_velocity(rows, bodies, free, n)
    return limit, found


@inner
def _set_rates(rows, n, bodies):
    """Set column 2 of the work array to the step of each row."""
    for i in range(bodies + 1):
        rows.image[i, 0] = 0.0
    for r in range(n):
        rows.image[rows.body[r], 0] += 1.0
        rows.image[rows.other[r], 0] += 1.0
    for r in range(n):
        total = rows.data[r, INVERSE_I] * rows.image[rows.body[r], 0]
        total += rows.data[r, INVERSE_J] * rows.image[rows.other[r], 0]
        rows.work[r, 2] = 1.0 / total


@inner
def constraint_norm(rows, n, bodies):
    """Return lambda_max(G^T G) by power iteration, to a per cent: |C|^2 of the paper's bound."""
    for r in range(n):
        rows.work[r, 0] = 1.0 + 0.5 * math.sin(float(r))
    value = 0.0
    for _ in range(60):
        for i in range(bodies + 1):
            rows.image[i, 0] = 0.0
            rows.image[i, 1] = 0.0
        square = 0.0
        for r in range(n):
            square += rows.work[r, 0] ** 2
        norm = math.sqrt(square)
        for r in range(n):
            share = rows.work[r, 0] / norm
            i, j = rows.body[r], rows.other[r]
            rows.image[i, 0] += share * rows.data[r, NX]
            rows.image[i, 1] += share * rows.data[r, NY]
            if j < bodies:
                rows.image[j, 0] -= share * rows.data[r, NX]
                rows.image[j, 1] -= share * rows.data[r, NY]
        square = 0.0
        for i in range(bodies):
            square += rows.image[i, 0] ** 2 + rows.image[i, 1] ** 2
        done = abs(square - value) <= 1e-3 * square
        value = square
        if done:
            break
        for r in range(n):
            i, j = rows.body[r], rows.other[r]
            w = rows.data[r, NX] * rows.image[i, 0] + rows.data[r, NY] * rows.image[i, 1]
            if j < bodies:
                w -= rows.data[r, NX] * rows.image[j, 0] + rows.data[r, NY] * rows.image[j, 1]
            rows.work[r, 0] = w
    return value
