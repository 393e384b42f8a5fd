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
    AX,
    AY,
    BEFORE,
    BIAS,
    BOUND,
    CX,
    CY,
    SPRING,
    law,
    pack,
    push_row,
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
ACCELERATED_SWEEPS = 5

#: In place of 2/K_N where K_N = 0: no third term in the local form.
INELASTIC = -1.0

#: Names of the solvers, in the order of their codes.
SOLVERS = (
    "uzawa",
    "gauss_seidel",
    "accelerated_gradient",
    "conjugate_sweeps",
    "conjugate_faces",
    "accelerated_sweeps",
)


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
        iterations, found = uzawa(rows, n, bodies, tolerance, limit)
    elif method == GAUSS_SEIDEL:
        iterations, found = gauss_seidel(rows, n, tolerance, limit)
    elif method == ACCELERATED_GRADIENT:
        iterations, found = accelerated_gradient(rows, n, bodies, tolerance, limit)
    elif method == ACCELERATED_SWEEPS:
        iterations, found = accelerated_sweeps(rows, n, bodies, tolerance, limit)
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
def gradient_step(rows, r, w, x, rate):
    """Return the projected step of length `rate` along the multiplier of row r (appendix 2 of the paper)."""
    data = rows.data
    new = x - rate * (w + data[r, BIAS])
    spring = data[r, SPRING]
    if spring > 0.0:
        new = max(new, (x - rate * (w + data[r, BEFORE])) / (1.0 + rate * (1.0 - spring) / spring))
    return max(new, data[r, BOUND])


@inner
def uzawa(rows, n, bodies, tolerance, limit):
    """The paper's solver (appendix 2): projected gradient on the multipliers with the fixed step 0.95 of its bound.

    rho = 0.95 * 2 alpha / |C|^2 with alpha the least mass; h^2 rho of NSM1, whose rows are h G, is the same
    step on percussions. Returns (iterations, residual).
    """
    least = rows.root[0]
    for i in range(bodies):
        least = min(least, rows.root[i])
    rate = 1.9 * least * least / constraint_norm(rows, n, bodies)
    found = row_residual(rows, n)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        for r in range(n):
            w = row_velocity(rows.velocity, rows.body[r], rows.other[r], rows.data, r)
            rows.impulse[r] = gradient_step(rows, r, w, rows.impulse[r], rate * rows.scale[r] * rows.scale[r])
        renew_velocity(rows, bodies, n)
        if iteration % LOOK_EVERY == LOOK_EVERY - 1 or iteration == limit - 1:
            found = row_residual(rows, n)
    return limit, found


@inner
def momentum_after(momentum):
    """Return Nesterov's next momentum, and how much of the last step to go on by."""
    following = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
    return following, (momentum - 1.0) / following


@inner
def accelerated_gradient(rows, n, bodies, tolerance, limit):
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
        following, share = momentum_after(momentum)
        look = iteration % LOOK_EVERY == LOOK_EVERY - 1 or iteration == limit - 1
        uphill = _gradient_pass(rows, n, bodies, 0.0 if look else share)
        momentum = following if uphill <= 0.0 else 1.0
        if look:
            found = row_residual(rows, n)
            if found > tolerance and iteration < limit - 1:
                for r in range(n):
                    rows.impulse[r] += share * (rows.impulse[r] - rows.work[r, 3])
                renew_velocity(rows, bodies, n)
    return limit, found


@inner
def _gradient_pass(rows, n, bodies, share):
    """Step all rows at once, go on by `share` of the step, renew velocities; return the slope along the last step.

    Columns of the work array: 1 the percussions stepped to, 2 rates, 3 those stepped to before.
    """
    data, work, image = rows.data, rows.work, rows.image
    for i in range(bodies + 1):
        image[i, 0] = rows.free[i, 0]
        image[i, 1] = rows.free[i, 1]
    uphill = 0.0
    for r in range(n):
        i, j = rows.body[r], rows.other[r]
        x = rows.impulse[r]
        new = gradient_step(rows, r, row_velocity(rows.velocity, i, j, data, r), x, work[r, 2])
        step = new - work[r, 1]
        uphill += (x - new) * step / work[r, 2]
        work[r, 3] = work[r, 1]
        work[r, 1] = new
        new += share * step
        rows.impulse[r] = new
        push_row(image, i, j, data, r, new)
    for i in range(bodies):
        rows.velocity[i, 0] = image[i, 0]
        rows.velocity[i, 1] = image[i, 1]
    return uphill


@inner
def _set_rates(rows, n, bodies):
    """Set column 2 of the work array to the step of each row."""
    for i in range(bodies + 1):
        rows.image[i, 0] = 0.0
    for r in range(n):
        rows.image[rows.body[r], 0] += 1.0
        rows.image[rows.other[r], 0] += 1.0
    for r in range(n):
        data = rows.data[r]
        total = (data[AX] ** 2 + data[AY] ** 2) * rows.image[rows.body[r], 0]
        total += (data[CX] ** 2 + data[CY] ** 2) * rows.image[rows.other[r], 0]
        rows.work[r, 2] = 1.0 / total


@inner
def accelerated_sweeps(rows, n, bodies, tolerance, limit):
    """Gauss-Seidel sweeps with Nesterov's momentum and restart; return (iterations, residual).

    Every sweep starts from percussions and velocities extrapolated from the last two, and the momentum starts anew
    where it points uphill, as for gradients (O'Donoghue and Candes, 2015). No bound of a step is needed.
    """
    for r in range(n):
        rows.work[r, 0] = rows.impulse[r]
    for i in range(bodies):
        rows.image[i, 0] = rows.velocity[i, 0]
        rows.image[i, 1] = rows.velocity[i, 1]
    momentum, share = 1.0, 0.0
    found = row_residual(rows, n)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        uphill = _sweep_on(rows, n, share)
        if iteration % LOOK_EVERY == LOOK_EVERY - 1 or iteration == limit - 1:
            found = row_residual(rows, n)
            if found <= tolerance:
                return iteration + 1, found
        momentum, share = momentum_after(momentum if uphill <= 0.0 else 1.0)
        for i in range(bodies):
            for k in range(2):
                new = rows.velocity[i, k]
                rows.velocity[i, k] = new + share * (new - rows.image[i, k])
                rows.image[i, k] = new
    return limit, found


@inner
def _sweep_on(rows, n, share):
    """Sweep up from x gone on by `share` of its last step; return the slope along the last step."""
    data = rows.data
    uphill = 0.0
    for r in range(n):
        i, j = rows.body[r], rows.other[r]
        old = rows.impulse[r]
        start = old + share * (old - rows.work[r, 0])
        new = law(data, r, row_velocity(rows.velocity, i, j, data, r), start)
        change = new - start
        push_row(rows.velocity, i, j, data, r, change)
        rows.work[r, 0] = old
        rows.impulse[r] = new
        uphill -= change * (new - old)
    return uphill


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
            push_row(rows.image, rows.body[r], rows.other[r], rows.data, r, rows.work[r, 0] * rows.scale[r] / norm)
        square = 0.0
        for i in range(bodies):
            for k in range(2):
                rows.image[i, k] *= rows.root[i]  # rows hold A = n / sqrt(omega m), the bound asks for n
                square += rows.image[i, k] ** 2
                rows.image[i, k] *= rows.root[i]
        done = abs(square - value) <= 1e-3 * square
        value = square
        if done:
            break
        for r in range(n):
            rows.work[r, 0] = rows.scale[r] * row_velocity(rows.image, rows.body[r], rows.other[r], rows.data, r)
    return value
