"""Separating overlaps: a solve on positions that leaves velocities untouched."""

import math

from evac.jit import AddressCall, inner, kernel
from evac.physics import tallies as at
from evac.physics.motion import move
from evac.physics.percussions import find_percussions
from evac.physics.state import State
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK

#: A law asks for separation where an overlap exceeds this share of its tolerance; a step may add another half of it.
SHARE = 0.4

#: Iterations of a position solve: one that has no solution (a body squeezed between walls) never converges.
ITERATIONS = 2000

#: Contacts are looked for as far as so many overlaps in a row push somebody, at least, and times the square root of the
#: number of people, for across a crowd; but no farther than [m].
CHAIN = 20.0
ACROSS = 2.0
LONGEST_CHAIN = 0.1

#: Call `separate` at its address: it is loaded when overlaps have to be separated for the first time.
call_separate = AddressCall([State, int], (int,))


@inner
def is_to_separate(state, tolerance, iterations):
    """Say whether overlaps are to be separated before the law acts; note to what tolerance [m], and how long to try."""
    contacts = state.contacts
    if contacts.separation_failed or state.clock.attempt > 0 or contacts.deepest <= SHARE * tolerance:
        return False
    contacts.separation_tolerance = tolerance
    contacts.separation_iterations = min(iterations, ITERATIONS)
    return True


@inner
def _widen_reach(state):
    """Let bodies look as far as separating the overlaps may push somebody."""
    bodies = state.bodies
    bodies.farthest_reach = 0.0
    deepest = state.contacts.deepest
    chain = min(max(CHAIN, ACROSS * math.sqrt(bodies.inside)) * deepest, LONGEST_CHAIN)
    for i in range(bodies.inside):
        bodies.reach[i] = max(bodies.reach[i], 2.0 * deepest, chain)
        bodies.farthest_reach = max(bodies.farthest_reach, bodies.reach[i])


@kernel
def separate(state: State, is_solve: int) -> int:
    """Separate the overlaps in two calls, contacts being searched for after each; return a status.

    The first lets everybody look far enough, the second finds the displacements and moves. They are the least in the
    mass norm with D + G.d >= 0 for all contacts in reach, the NSM1 problem without time, and are taken only where they
    at least halve the deepest overlap; a squeezed body stays where it is.
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
    found = find_percussions(state, bodies.spare, bodies.solved, 0.0, 0.0, tolerance, limit, enough)
    if state.problem.missing:
        return NEEDS_STRONGER_SOLVER
    if found <= enough:
        tally[at.POSITION_CORRECTIONS] += 1.0
        return _displace(state)
    contacts.separation_failed = 1  # not again before the next tick
    tally[at.FAILED_POSITION_CORRECTIONS] += 1.0
    return OK


@inner
def _displace(state):
    """Move everybody along the displacement in ``bodies.solved``; velocities stay, and no time goes by.

    The same share of it for all, so that no overlap is made: as much as keeps everybody within the reach of contacts
    and within half a radius. What is left is done in the next steps, for it cannot be had by cutting this one.
    """
    bodies, events = state.bodies, state.events
    share = 1.0
    for i in range(bodies.inside):
        length = math.sqrt(bodies.solved[i, 0] ** 2 + bodies.solved[i, 1] ** 2)
        most = min(bodies.reach[i], 0.5 * bodies.radius[i])
        if share * length > most:
            share = most / length
    for i in range(bodies.inside):
        for k in range(2):
            bodies.spare[i, k] = bodies.velocity[i, k]
            bodies.solved[i, k] *= share
    fired = events.number
    status = move(state, 0, bodies.inside, state.clock.time, 1.0, 0.0, False)
    for k in range(fired, events.number):
        events.time[k] = state.clock.time
    for i in range(bodies.inside):
        for k in range(2):
            bodies.velocity[i, k] = bodies.spare[i, k]
    return status
