"""Percussions of a sub-step: packing of the contact problem, calls of the solver, unpacking; separation of overlaps.

Find percussions P >= 0 such that with the velocity v = V + M^-1 sum_c P_c n_c each contact obeys its law

    rigid:    w+ + b >= 0  complementary to P,           b = max(D, 0) / h
    elastic:  P = K_N max(0, -(w+ + w-)/2) + mu,  0 <= mu complementary to w+ >= 0

with the normal velocity w+ after and w- before the step. Both have the closed local form of docs/physics.md,
P = max(0, -(a + b)/omega, -(a + w-)/(omega + 2/K_N)), a being w+ without the contact's own percussion.
The residual is max_c omega_c |P_c - P_c^local| [m/s]; times h it is the error of the gaps of rigid contacts [m].
"""

import math

from evac.jit import AddressCall, inner, kernel
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
from evac.physics.motion import move
from evac.physics.state import State
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK

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
    """Replace velocities and residual by those of the percussions that a solver found; count failed solves."""
    # A solve has failed if percussions are not finite, or if the residual exceeds the tolerance [m/s] and the solver
    # has stated a smaller one.
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


#: Share of the tolerance above which overlaps are separated; a step may add another half of the tolerance.
SEPARATED = 0.4

#: Maximum number of iterations of a position solve, which may have no solution (a body squeezed between walls).
ITERATIONS = 2000

#: Search distance for contacts in units of the largest overlap: the minimum, and the factor of the square root of the
#: number of people, since displacements add up across a crowd; and its upper limit [m].
CHAIN = 20.0
ACROSS = 2.0
LONGEST_CHAIN = 0.1

#: Call `separate` at its address; it is loaded when overlaps must be separated for the first time.
call_separate = AddressCall([State, int], (int,))


@inner
def is_to_separate(state, tolerance, iterations):
    """Return whether overlaps must be separated before the law acts; note the tolerance [m] and the iteration limit."""
    contacts = state.contacts
    if contacts.separation_failed or state.clock.attempt > 0 or contacts.deepest <= SEPARATED * tolerance:
        return False
    contacts.separation_tolerance = tolerance
    contacts.separation_iterations = min(iterations, ITERATIONS)
    return True


@inner
def _widen_reach(state):
    """Extend the reach of bodies to the largest expected displacement by the separation."""
    bodies = state.bodies
    bodies.farthest_reach = 0.0
    deepest = state.contacts.deepest
    chain = min(max(CHAIN, ACROSS * math.sqrt(bodies.inside)) * deepest, LONGEST_CHAIN)
    for i in range(bodies.inside):
        bodies.reach[i] = max(bodies.reach[i], 2.0 * deepest, chain)
        bodies.farthest_reach = max(bodies.farthest_reach, bodies.reach[i])


@kernel
def separate(state: State, is_solve: int) -> int:
    """Separate the overlaps in two calls, each followed by a contact search; return a status.

    The first call extends the reaches, the second finds the displacements and moves. The displacements d are the
    smallest ones in the mass norm with D + G.d >= 0 for all contacts in reach, which is the problem of rigid contacts
    without time. They are applied only if they at least halve the deepest overlap; a squeezed body is not moved.
    """
    bodies, contacts, tally = state.bodies, state.contacts, state.tally
    if is_solve == 0:
        _widen_reach(state)
        return OK
    for c in range(contacts.number):
        contacts.bias[c] = contacts.gap[c]
        contacts.percussion[c] = 0.0
    for i in range(bodies.inside):
        bodies.spare[i, 0] = 0.0
        bodies.spare[i, 1] = 0.0
    enough = 0.5 * contacts.deepest
    tolerance = 0.1 * contacts.separation_tolerance
    limit = contacts.separation_iterations
    residual = find_percussions(state, bodies.spare, bodies.solved, 0.0, 0.0, tolerance, limit, enough)
    if state.problem.missing:
        return NEEDS_STRONGER_SOLVER
    if residual <= enough:
        tally[at.POSITION_CORRECTIONS] += 1.0
        return _displace(state)
    contacts.separation_failed = 1  # no further attempt before the next tick
    tally[at.FAILED_POSITION_CORRECTIONS] += 1.0
    return OK


@inner
def _displace(state):
    """Move all bodies by the displacement in ``bodies.solved``, without changing velocities or time."""
    # All bodies move by the same share of their displacements, so that no new overlaps arise: the largest share within
    # the reach of contacts and half a radius. The rest is left to later steps, since subdividing this one does not
    # help.
    bodies, events = state.bodies, state.events
    share = 1.0
    for i in range(bodies.inside):
        length = math.sqrt(bodies.solved[i, 0] ** 2 + bodies.solved[i, 1] ** 2)
        most = min(bodies.reach[i], 0.5 * bodies.contact_radius[i])
        if share * length > most:
            share = most / length
    for i in range(bodies.inside):
        for k in range(2):
            bodies.spare[i, k] = bodies.velocity[i, k]
            bodies.solved[i, k] *= share
    fired = events.number
    status = move(state, state.clock.time, 1.0, 0.0, False)
    for k in range(fired, events.number):
        events.time[k] = state.clock.time
    for i in range(bodies.inside):
        for k in range(2):
            bodies.velocity[i, k] = bodies.spare[i, k]
    return status
