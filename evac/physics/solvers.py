"""The contact problem of a step and its solvers, with one residual and one stopping rule for all.

Find percussions P >= 0 such that with the velocity v = V + M^-1 sum_c P_c n_c each contact obeys its law

    NSM1:  w+ + b >= 0  complementary to P,           b = max(D, 0) / h
    NSM2:  P = K_N max(0, -(w+ + w-)/2) + mu,  0 <= mu complementary to w+ >= 0

with the normal velocity w+ after and w- before the step. Both have the closed local form of docs/physics.md,
P = max(0, -(a + b)/omega, -(a + w-)/(omega + 2/K_N)), a being w+ without the contact's own percussion.
The residual is max_c omega_c |P_c - P_c^local| [m/s]; times h it is NSM1's gap error [m]. All solvers work on the
packed rows of `evac.physics.rows`.
"""

import math

from evac.jit import inner
from evac.physics.conjugate import conjugate_faces, conjugate_sweeps
from evac.physics.momentum import accelerated_gradient, accelerated_sweeps, gradient_step
from evac.physics.rows import (
    LIKELY,
    look,
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
        a = nx * vx + ny * vy - omega * contacts.percussion[c]
        local = max(0.0, -(a + contacts.bias[c]) / omega)
        if compliance >= 0.0:
            local = max(local, -(a + contacts.velocity_before[c]) / (omega + compliance))
        worst = max(worst, omega * abs(contacts.percussion[c] - local))
        if contacts.sticky[c]:
            a = nx * vy - ny * vx - omega * contacts.friction[c]
            local = -tangential * (a + contacts.work[c, 2]) / (2.0 + tangential * omega)
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
        iterations, found = accelerated_sweeps(rows, contacts.groups, n, bodies, tolerance, limit)
    elif method == CONJUGATE_SWEEPS:
        iterations, found = conjugate_sweeps(rows, n, bodies, tolerance, limit)
    else:
        iterations, found = conjugate_faces(rows, n, bodies, tolerance, limit)
    if not unpack(contacts, bodies, velocity, tangential):
        found = math.inf  # where numbers are lost, the residual of a row compares as none
    return iterations, found


@inner
def solve_or_retry(
    method, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit, enough
):
    """Solve; where that leaves more than `enough` [m/s], solve again, cold, by a stronger method.

    That is the one that solves equations once it knows who pushes, best where masses differ by orders of magnitude;
    each of its iterations takes four times as long. Parameters as for `solve`; returns (iterations, residual, 1 if it
    was solved again).
    """
    iterations, found = solve(
        method, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit
    )
    if found <= enough:
        return iterations, found, 0
    for c in range(contacts.count[0]):
        contacts.percussion[c] = 0.0
        contacts.friction[c] = 0.0
    method = CONJUGATE_FACES if method != CONJUGATE_FACES else CONJUGATE_SWEEPS
    again, found = solve(
        method, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit
    )
    return iterations + again, found, 1


@inner
def gauss_seidel(rows, n, tolerance, limit):
    """Projected Gauss-Seidel in the rows' order; return (iterations, residual)."""
    found, likely = row_residual(rows, n), LIKELY
    iteration = n * 0
    while found > tolerance and iteration < limit:
        change = sweep_up(rows, n)
        iteration += 1
        found, likely = look(rows, n, change, found, likely, tolerance if iteration < limit else math.inf)
    return iteration, found


@inner
def uzawa(rows, n, bodies, tolerance, limit):
    """The paper's solver (appendix 2): projected gradient on the multipliers with the fixed step 0.95 of its bound.

    rho = 0.95 * 2 alpha / |C|^2 with alpha the least mass; h^2 rho of NSM1, whose rows are h G, is the same
    step on percussions. Returns (iterations, residual).
    """
    greatest = 0.0
    for i in range(bodies):
        greatest = max(greatest, rows.inverse_root[i])
    rate = 1.9 / (greatest * greatest * constraint_norm(rows, n, bodies))
    found, likely = row_residual(rows, n), LIKELY
    iteration = n * 0
    while found > tolerance and iteration < limit:
        change = 0.0
        for r in range(n):
            old, scale = rows.percussion[r], rows.scale[r]
            w = row_velocity(rows.velocity, rows.body[r], rows.other[r], rows.data, r, 0.0)
            rows.percussion[r] = gradient_step(rows, r, w, old, rate * scale * scale)
            change = max(change, abs(rows.percussion[r] - old) * scale)
        renew_velocity(rows, bodies, n)
        iteration += 1
        found, likely = look(rows, n, change, found, likely, tolerance if iteration < limit else math.inf)
    return iteration, found


@inner
def constraint_norm(rows, n, bodies):
    """Return lambda_max(G^T G) by power iteration, to a per cent: |C|^2 of the paper's bound."""
    for r in range(n):
        rows.work[0, r] = 1.0 + 0.5 * math.sin(float(r))
    value = 0.0
    for _ in range(60):
        for i in range(bodies + 1):
            rows.image[0, i, 0] = 0.0
            rows.image[0, i, 1] = 0.0
        square = 0.0
        for r in range(n):
            square += rows.work[0, r] ** 2
        norm = math.sqrt(square)
        for r in range(n):
            push_row(rows.image[0], rows.body[r], rows.other[r], rows.data, r, rows.work[0, r] * rows.scale[r] / norm)
        square = 0.0
        for i in range(bodies):
            for k in range(2):
                rows.image[0, i, k] /= rows.inverse_root[i]  # rows hold A = n / sqrt(omega m), the bound asks for n
                square += rows.image[0, i, k] ** 2
                rows.image[0, i, k] /= rows.inverse_root[i]
        done = abs(square - value) <= 1e-3 * square
        value = square
        if done:
            break
        for r in range(n):
            rows.work[0, r] = rows.scale[r] * row_velocity(
                rows.image[0], rows.body[r], rows.other[r], rows.data, r, 0.0
            )
    return value
