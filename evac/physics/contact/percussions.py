"""Percussions of a sub-step: packing of the contact problem, calls of the solver, and unpacking.

Find percussions P >= 0 such that with the velocity v = V + M^-1 sum_c P_c n_c each contact obeys its law

    rigid:    w+ + b >= 0  complementary to P,           b = max(D, 0) / h
    elastic:  P = K_N max(0, -(w+ + w-)/2) + mu,  0 <= mu complementary to w+ >= 0

with the normal velocity w+ after and w- before the step. Both have the closed local form of docs/physics.md,
P = max(0, -(a + b)/omega, -(a + w-)/(omega + 2/K_N)), a being w+ without the contact's own percussion.
The residual is max_c omega_c |P_c - P_c^local| [m/s]; times h it is the error of the gaps of rigid contacts [m].
"""

import math

from evac.jit import inner
from evac.physics import tallies as at
from evac.physics.contact.rows import (
    AX,
    AY,
    BEFORE,
    BIAS,
    BOUND,
    BX,
    BY,
    INELASTIC,
    SPRING,
    call_solver,
    renew_velocity,
    row_residual,
)

#: Rounding error of a residual, as a share.
SHARE = 1e-6

#: Distance in packed rows of consecutive unknowns.
APART = 8


@inner
def find_percussions(state, free, velocity, normal, tangential, tolerance, limit, enough):
    """Solve the contact problem from the percussions in the contacts; return the residual [m/s].

    With the free velocity (n, 2) V, K_N and K_T [kg], both 0 for rigid contacts, and the limit of iterations. If the
    residual exceeds `enough` [m/s], the problem is solved again by a stronger solver without warm start; if that solver
    is not loaded, ``problem.missing`` is set to 1.
    """
    problem, contacts = state.problem, state.contacts
    problem.missing = 0
    problem.retried = 0
    problem.iterations = 0
    if contacts.number == 0:
        for i in range(state.bodies.inside):
            velocity[i, 0] = free[i, 0]
            velocity[i, 1] = free[i, 1]
        return 0.0
    if state.parts.solver.solve == 0:  # the model is not a SolvedContactModel, so there is no packed problem
        problem.missing = 1
        return math.inf
    compliance = 2.0 / normal if normal > 0.0 else INELASTIC
    solve_once(state, state.parts.solver, free, velocity, compliance, tangential, tolerance, limit)
    if problem.residual <= enough:
        return problem.residual
    if state.parts.stronger.solve == 0:
        problem.missing = 1
        return problem.residual
    problem.retried = 1
    for c in range(contacts.number):
        contacts.percussion[c] = 0.0
        contacts.friction[c] = 0.0
    solve_once(state, state.parts.stronger, free, velocity, compliance, tangential, tolerance, limit)
    return problem.residual


@inner
def solve_once(state, solver, free, velocity, compliance, tangential, tolerance, limit):
    """Solve the problem once by a loaded solver; the compliance is 2/K_N [1/kg], or INELASTIC."""
    problem = state.problem
    pack(state, free, compliance, tangential)
    problem.iterations += call_solver(solver.solve, problem, tolerance, limit)
    if solver.is_checked:
        _check_solution(state, tolerance)
    if not _unpack(state, velocity, tangential):
        problem.residual = math.inf  # with NaN values, comparisons of residuals are all false


@inner
def _check_solution(state, tolerance):
    """Replace velocities and residual by those of the percussions that a solver found; count failed solves.

    A solve has failed if percussions are not finite, or if the residual exceeds the tolerance [m/s] and the solver has
    stated a smaller one.
    """
    problem = state.problem
    stated = problem.residual
    renew_velocity(problem)
    residual = row_residual(problem)
    total = 0.0
    for r in range(problem.size):
        total += problem.percussion[r]
    if not math.isfinite(total):
        residual = math.inf
    if not residual <= stated * (1.0 + SHARE):  # a stated residual may also be NaN
        problem.residual = residual
        if residual > tolerance:
            state.tally[at.FAILED_SOLVES] += 1.0


@inner
def pack(state, free, compliance, tangential):
    """Fill the rows from the contacts, and set velocities to the free ones plus the effect of percussions."""
    problem, contacts, n = state.problem, state.contacts, state.bodies.inside
    for i in range(n):
        problem.inverse_root[i] = math.sqrt(state.bodies.inverse_mass[i])
        for k in range(2):
            problem.free[i, k] = free[i, k] / problem.inverse_root[i]
    problem.bodies = n
    problem.rigid = 1 if compliance < 0.0 and tangential <= 0.0 else 0
    problem.size = contacts.number
    if tangential > 0.0:
        for c in range(contacts.number):
            problem.size += 1 if contacts.sticky[c] else 0  # a byte, whose sum would overflow in Python
    problem.ends = n + 1
    problem.inverse_root[n] = problem.free[n, 0] = problem.free[n, 1] = 0.0
    used = 0
    for c in range(contacts.number):
        omega = contacts.omega[c]
        spring = omega / (omega + compliance) if compliance >= 0.0 else 0.0
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        bias, before, start = contacts.bias[c], contacts.velocity_before[c], contacts.percussion[c]
        j = contacts.other[c] if contacts.other[c] >= 0 else n
        r = problem.row[used] = interleaved(used, problem.size)
        _pack_row(problem, contacts, c, r, j, nx, ny, bias, before, spring, 0.0, start)
        used += 1
        if contacts.sticky[c] and tangential > 0.0:
            spring = omega / (omega + 2.0 / tangential)
            before, start = contacts.slide_before[c], contacts.friction[c]
            r = problem.row[used] = interleaved(used, problem.size)
            _pack_row(problem, contacts, c, r, j, -ny, nx, math.inf, before, spring, -math.inf, start)
            used += 1
    renew_velocity(problem)


@inner
def interleaved(k, rows):
    """Return the row of the k-th unknown: in each full part, consecutive unknowns are `APART` rows apart.

    Unknowns of a body are consecutive; in a sweep over adjacent rows, each would wait for the velocity just written.
    """
    within = k % (APART * APART)
    part = k - within
    if part + APART * APART > rows:
        return k
    return part + APART * (within % APART) + within // APART


@inner
def _pack_row(problem, contacts, c, r, j, nx, ny, bias, before, spring, bound, start):
    i = contacts.body[c]
    problem.body[r] = i
    problem.other[r] = j
    scale = math.sqrt(contacts.omega[c])
    problem.scale[r] = scale
    problem.percussion[r] = scale * start
    inverse = 1.0 / scale  # multiplications are several times cheaper than divisions
    own, others = inverse * problem.inverse_root[i], inverse * problem.inverse_root[j]
    problem.data[r, AX] = nx * own
    problem.data[r, AY] = ny * own
    problem.data[r, BX] = -nx * others
    problem.data[r, BY] = -ny * others
    problem.data[r, BIAS] = bias * inverse
    problem.elastic[r, BEFORE] = before * inverse
    problem.elastic[r, SPRING] = spring
    problem.elastic[r, BOUND] = bound


@inner
def _unpack(state, velocity, tangential):
    """Copy percussions and velocities back; return whether all velocities are finite."""
    problem, contacts = state.problem, state.contacts
    total = 0.0
    used = 0
    for c in range(contacts.number):
        r = problem.row[used]
        contacts.percussion[c] = problem.percussion[r] / problem.scale[r]
        used += 1
        if contacts.sticky[c]:
            contacts.friction[c] = 0.0
            if tangential > 0.0:
                r = problem.row[used]
                contacts.friction[c] = problem.percussion[r] / problem.scale[r]
                used += 1
    for i in range(problem.bodies):
        velocity[i, 0] = problem.velocity[i, 0] * problem.inverse_root[i]
        velocity[i, 1] = problem.velocity[i, 1] * problem.inverse_root[i]
        total += velocity[i, 0] + velocity[i, 1]
    return math.isfinite(total)
