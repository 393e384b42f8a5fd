"""The contact problem of a step and its solvers, with one residual and one stopping rule for all.

Find percussions P >= 0 such that with the velocity v = V + M^-1 sum_c P_c n_c each contact obeys its law

    NSM1:  w+ + b >= 0  complementary to P,           b = max(D, 0) / h
    NSM2:  P = K_N max(0, -(w+ + w-)/2) + mu,  0 <= mu complementary to w+ >= 0

with the normal velocity w+ after and w- before the step. Both have the closed local form of PHYSICS 3.3,
P = max(0, -(a + b)/omega, -(a + w-)/(omega + 2/K_N)), a being w+ without the contact's own percussion.
The residual is max_c omega_c |P_c - P_c^local| [m/s]; times h it is NSM1's gap error [m].
"""

import math

from evac.jit import inner
from evac.physics.contacts import normal_velocity

UZAWA = 0
GAUSS_SEIDEL = 1
ACCELERATED = 2

#: In place of 2/K_N where K_N = 0: no third term in the local form.
INELASTIC = -1.0

#: Names of the solvers, in the order of their codes.
SOLVERS = ("uzawa", "gauss_seidel", "accelerated")


@inner
def local_percussion(a, approach, omega, bias, compliance):  # type: ignore[no-untyped-def]
    """Return the percussion that makes one contact obey its law; `compliance` is 2/K_N [1/kg] or INELASTIC."""
    percussion = max(0.0, -(a + bias) / omega)
    if compliance >= 0.0:
        percussion = max(percussion, -(a + approach) / (omega + compliance))
    return percussion


@inner
def apply_percussions(velocity, inverse_mass, contacts):  # type: ignore[no-untyped-def]
    """Add M^-1 sum_c P_c n_c (and the tangential percussions) to `velocity`."""
    for c in range(contacts.count[0]):
        push(velocity, inverse_mass, contacts, c, contacts.impulse[c])
        if contacts.sticky[c]:
            push_sideways(velocity, inverse_mass, contacts, c, contacts.friction[c])


@inner
def push(velocity, inverse_mass, contacts, c, percussion):  # type: ignore[no-untyped-def]
    """Apply a normal percussion to the bodies of contact c."""
    i = contacts.body[c]
    j = contacts.other[c]
    px = percussion * contacts.normal[c, 0]
    py = percussion * contacts.normal[c, 1]
    velocity[i, 0] += inverse_mass[i] * px
    velocity[i, 1] += inverse_mass[i] * py
    if j >= 0:
        velocity[j, 0] -= inverse_mass[j] * px
        velocity[j, 1] -= inverse_mass[j] * py


@inner
def push_sideways(velocity, inverse_mass, contacts, c, percussion):  # type: ignore[no-untyped-def]
    """Apply a tangential percussion along (-ny, nx) to the bodies of contact c."""
    i = contacts.body[c]
    j = contacts.other[c]
    px = -percussion * contacts.normal[c, 1]
    py = percussion * contacts.normal[c, 0]
    velocity[i, 0] += inverse_mass[i] * px
    velocity[i, 1] += inverse_mass[i] * py
    if j >= 0:
        velocity[j, 0] -= inverse_mass[j] * px
        velocity[j, 1] -= inverse_mass[j] * py


@inner
def tangential_velocity(velocity, contacts, c):  # type: ignore[no-untyped-def]
    """Return the velocity of contact c along (-ny, nx) [m/s]."""
    i = contacts.body[c]
    j = contacts.other[c]
    tx, ty = -contacts.normal[c, 1], contacts.normal[c, 0]
    w = tx * velocity[i, 0] + ty * velocity[i, 1]
    if j >= 0:
        w -= tx * velocity[j, 0] + ty * velocity[j, 1]
    return w


@inner
def residual(velocity, contacts, compliance, tangential):  # type: ignore[no-untyped-def]
    """Return max_c omega_c |P_c - P_c^local| [m/s], tangential percussions included."""
    worst = 0.0
    for c in range(contacts.count[0]):
        omega = contacts.omega[c]
        a = normal_velocity(velocity, contacts, c) - omega * contacts.impulse[c]
        local = local_percussion(a, contacts.approach[c], omega, contacts.bias[c], compliance)
        worst = max(worst, omega * abs(contacts.impulse[c] - local))
        if contacts.sticky[c]:
            w = tangential_velocity(velocity, contacts, c) - omega * contacts.friction[c]
            local = -tangential * (w + contacts.work[c, 5]) / (2.0 + tangential * omega)
            worst = max(worst, omega * abs(contacts.friction[c] - local))
    return worst


@inner
def relax(velocity, inverse_mass, contacts, c, compliance, tangential):  # type: ignore[no-untyped-def]
    """Make contact c obey its law with all others held; return the change of velocity [m/s]."""
    omega = contacts.omega[c]
    old = contacts.impulse[c]
    a = normal_velocity(velocity, contacts, c) - omega * old
    new = local_percussion(a, contacts.approach[c], omega, contacts.bias[c], compliance)
    change = omega * abs(new - old)
    if new != old:
        contacts.impulse[c] = new
        push(velocity, inverse_mass, contacts, c, new - old)
    if contacts.sticky[c]:
        old = contacts.friction[c]
        w = tangential_velocity(velocity, contacts, c) - omega * old
        new = -tangential * (w + contacts.work[c, 5]) / (2.0 + tangential * omega)
        contacts.friction[c] = new
        push_sideways(velocity, inverse_mass, contacts, c, new - old)
        change = max(change, omega * abs(new - old))
    return change


@inner
def gauss_seidel(velocity, inverse_mass, contacts, compliance, tangential, tolerance, limit):  # type: ignore[no-untyped-def]
    """Projected Gauss-Seidel in the contacts' order; return (iterations, residual)."""
    found = residual(velocity, contacts, compliance, tangential)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        change = 0.0
        for c in range(contacts.count[0]):
            change = max(change, relax(velocity, inverse_mass, contacts, c, compliance, tangential))
        if change <= 2.0 * tolerance or iteration % 16 == 15:
            found = residual(velocity, contacts, compliance, tangential)
    return limit, residual(velocity, contacts, compliance, tangential)


@inner
def accelerated(velocity, inverse_mass, contacts, bodies, compliance, tangential, tolerance, limit):  # type: ignore[no-untyped-def]
    """Nonlinear conjugate gradients (Fletcher-Reeves, restarted) around a symmetric Gauss-Seidel sweep.

    One iteration sweeps the contacts forwards and backwards and then goes on along the conjugate
    direction of the sweeps (the nonsmooth nonlinear conjugate gradient method of Silcowitz-Hansen,
    Niebe and Erleben, 2010). Sweeps run in the order of travel time, along the force chains. Returns
    (iterations, residual), always judged behind a sweep.
    """
    n = contacts.count[0]
    work = contacts.work  # columns: P before, direction of P; friction before, direction of friction
    image = contacts.work_velocity  # velocity before the sweep, image of the direction
    for c in range(n):
        work[c, 1] = 0.0
        work[c, 3] = 0.0
    for i in range(bodies):
        image[i, 2] = 0.0
        image[i, 3] = 0.0
    before = 0.0
    found = residual(velocity, contacts, compliance, tangential)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        for c in range(n):
            work[c, 0] = contacts.impulse[c]
            work[c, 2] = contacts.friction[c]
        for i in range(bodies):
            image[i, 0] = velocity[i, 0]
            image[i, 1] = velocity[i, 1]
        change = 0.0
        for c in range(n):
            relax(velocity, inverse_mass, contacts, c, compliance, tangential)
        for c in range(n - 1, -1, -1):
            change = max(change, relax(velocity, inverse_mass, contacts, c, compliance, tangential))
        if change <= 2.0 * tolerance or iteration % 8 == 7:
            found = residual(velocity, contacts, compliance, tangential)
            if found <= tolerance:
                return iteration + 1, found
        now = 0.0
        for c in range(n):
            now += contacts.omega[c] * (contacts.impulse[c] - work[c, 0]) ** 2
            if contacts.sticky[c]:
                now += contacts.omega[c] * (contacts.friction[c] - work[c, 2]) ** 2
        beta = now / before if before > 0.0 else 0.0
        if beta > 1.0:
            beta = 0.0
        before = now
        _go_on(velocity, contacts, work, image, bodies, beta)
    for c in range(n):
        relax(velocity, inverse_mass, contacts, c, compliance, tangential)
    return limit, residual(velocity, contacts, compliance, tangential)


@inner
def _go_on(velocity, contacts, work, image, bodies, beta):  # type: ignore[no-untyped-def]
    """Renew the conjugate direction and its velocity image, and step along the old one by beta."""
    for c in range(contacts.count[0]):
        step = beta * work[c, 1]
        work[c, 1] = step + contacts.impulse[c] - work[c, 0]
        contacts.impulse[c] += step
        if contacts.sticky[c]:
            step = beta * work[c, 3]
            work[c, 3] = step + contacts.friction[c] - work[c, 2]
            contacts.friction[c] += step
    for i in range(bodies):
        for k in range(2):
            step = beta * image[i, 2 + k]
            image[i, 2 + k] = step + velocity[i, k] - image[i, k]
            velocity[i, k] += step


@inner
def constraint_norm(contacts, image, bodies):  # type: ignore[no-untyped-def]
    """Return lambda_max(G^T G) by power iteration, to a per cent: |C|^2 of the paper's bound."""
    n = contacts.count[0]
    for c in range(n):
        contacts.work[c, 0] = 1.0 + 0.5 * math.sin(float(c))
    value = 0.0
    for _ in range(60):
        for i in range(bodies):
            image[i, 2] = 0.0
            image[i, 3] = 0.0
        norm = 0.0
        for c in range(n):
            norm += contacts.work[c, 0] ** 2
        norm = math.sqrt(norm)
        for c in range(n):
            share = contacts.work[c, 0] / norm
            i, j = contacts.body[c], contacts.other[c]
            image[i, 2] += share * contacts.normal[c, 0]
            image[i, 3] += share * contacts.normal[c, 1]
            if j >= 0:
                image[j, 2] -= share * contacts.normal[c, 0]
                image[j, 3] -= share * contacts.normal[c, 1]
        square = 0.0
        for i in range(bodies):
            square += image[i, 2] ** 2 + image[i, 3] ** 2
        done = abs(square - value) <= 1e-3 * square
        value = square
        if done:
            break
        for c in range(n):
            i, j = contacts.body[c], contacts.other[c]
            w = contacts.normal[c, 0] * image[i, 2] + contacts.normal[c, 1] * image[i, 3]
            if j >= 0:
                w -= contacts.normal[c, 0] * image[j, 2] + contacts.normal[c, 1] * image[j, 3]
            contacts.work[c, 0] = w
    return value


@inner
def uzawa(velocity, free, inverse_mass, contacts, bodies, compliance, tangential, tolerance, limit):  # type: ignore[no-untyped-def]
    """The paper's solver (appendix 2): projected gradient on the multipliers with the fixed step 0.95 of its bound.

    rho = 0.95 * 2 alpha / |C|^2 with alpha the least mass; h^2 rho of NSM1, whose rows are h G, is the same
    step on percussions. Returns (iterations, residual).
    """
    n = contacts.count[0]
    lightest = 0.0
    for c in range(n):
        lightest = max(lightest, inverse_mass[contacts.body[c]])
        if contacts.other[c] >= 0:
            lightest = max(lightest, inverse_mass[contacts.other[c]])
    rho = 1.9 / (lightest * constraint_norm(contacts, contacts.work_velocity, bodies))
    found = residual(velocity, contacts, compliance, tangential)
    for iteration in range(limit):
        if found <= tolerance:
            return iteration, found
        for c in range(n):
            w = normal_velocity(velocity, contacts, c)
            new = max(0.0, contacts.impulse[c] - rho * (w + contacts.bias[c]))
            if compliance >= 0.0:
                spring = (contacts.impulse[c] - rho * (w + contacts.approach[c])) / (1.0 + rho * compliance)
                new = max(new, spring)
            if contacts.sticky[c]:
                slide = tangential_velocity(velocity, contacts, c) + contacts.work[c, 5]
                contacts.friction[c] = (contacts.friction[c] - rho * slide) / (1.0 + 2.0 * rho / tangential)
            contacts.impulse[c] = new
        for i in range(bodies):
            velocity[i, 0] = free[i, 0]
            velocity[i, 1] = free[i, 1]
        apply_percussions(velocity, inverse_mass, contacts)
        found = residual(velocity, contacts, compliance, tangential)
    return limit, found


@inner
def solve(method, bodies, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit):  # type: ignore[no-untyped-def]
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
    for i in range(bodies):
        velocity[i, 0] = free[i, 0]
        velocity[i, 1] = free[i, 1]
    if contacts.count[0] == 0:
        return 0, 0.0
    apply_percussions(velocity, inverse_mass, contacts)
    if method == UZAWA:
        return uzawa(
            velocity, free, inverse_mass, contacts, bodies, compliance, tangential, tolerance, limit
        )
    if method == GAUSS_SEIDEL:
        return gauss_seidel(velocity, inverse_mass, contacts, compliance, tangential, tolerance, limit)
    return accelerated(velocity, inverse_mass, contacts, bodies, compliance, tangential, tolerance, limit)
