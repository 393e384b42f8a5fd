"""Separation of overlaps by a solve on positions, which leaves velocities unchanged."""

import math

from evac.jit import AddressCall, inner, kernel
from evac.physics import tallies as at
from evac.physics.contact.percussions import find_percussions
from evac.physics.motion import move
from evac.physics.state import State
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK

#: Share of the tolerance above which overlaps are separated; a step may add another half of the tolerance.
SHARE = 0.4

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
    if contacts.separation_failed or state.clock.attempt > 0 or contacts.deepest <= SHARE * tolerance:
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
    """Move all bodies by the displacement in ``bodies.solved``, without changing velocities or time.

    All bodies move by the same share of their displacements, so that no new overlaps arise: the largest share within
    the reach of contacts and half a radius. The rest is left to later steps, since subdividing this one does not help.
    """
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
