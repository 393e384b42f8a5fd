"""Removing overlaps: a solve on positions that leaves velocities untouched."""

import math

from evac.jit import inner
from evac.physics import stepping
from evac.physics import tallies as at
from evac.physics.motion import move
from evac.physics.neighbours import OK
from evac.physics.solvers import INELASTIC, solve_or_retry

#: Iterations of a position solve: one that has no solution (a body squeezed between walls) never converges.
ITERATIONS = 2000

#: Contacts are looked for as far as so many overlaps in a row push somebody, at least, and times the square root of the
#: number of people, for across a crowd; but no farther than [m].
CHAIN = 20.0
ACROSS = 2.0
LONGEST_CHAIN = 0.1


@inner
def part_overlaps(world, bodies, lists, contacts, events, clock, tally, time, method, limit, tolerance):
    """Push bodies apart where an overlap exceeds two fifths of the tolerance; return a status.

    A step may add another half of it. The displacement is the least in the mass norm with D + G.d >= 0 for all
    contacts in reach, the NSM1 problem without time. It is taken only where it at least halves the deepest overlap;
    a squeezed body stays where it is. Contacts are searched again afterwards.
    """
    deepest = _deepest(contacts)
    if deepest <= 0.4 * tolerance or contacts.count[2] > 0:
        return OK
    n = bodies.count[0]
    longest = 0.0
    chain = min(max(CHAIN, ACROSS * math.sqrt(n)) * deepest, LONGEST_CHAIN)
    for i in range(n):
        bodies.reach[i] = max(bodies.reach[i], 2.0 * deepest, chain)
        longest = max(longest, bodies.reach[i])
    status = stepping.refresh(world, bodies, lists, tally, 0.0, 2.0 * longest)
    if status == OK:
        status = stepping.seek(world, bodies, lists, contacts)
    if status != OK:
        return status
    for c in range(contacts.count[0]):
        contacts.bias[c] = contacts.gap[c]
        contacts.percussion[c] = 0.0
    bodies.spare[:n] = 0.0
    _, found, _ = solve_or_retry(
        method,
        n,
        bodies.inverse_mass,
        bodies.spare,
        bodies.solved,
        contacts,
        INELASTIC,
        0.0,
        0.1 * tolerance,
        min(limit, ITERATIONS),
        0.5 * deepest,
    )
    if found <= 0.5 * deepest:
        status = _displace(world, bodies, lists, events, clock, time)
        tally[0, at.POSITION_CORRECTIONS] += 1.0
        if status == OK:
            status = stepping.refresh(world, bodies, lists, tally, 0.0, 2.0 * longest)
    else:
        contacts.count[2] = 1  # not again before the next tick
        tally[0, at.FAILED_POSITION_CORRECTIONS] += 1.0
    if status == OK:
        status = stepping.seek(world, bodies, lists, contacts)
    return status


@inner
def _deepest(contacts):
    """Return the greatest overlap among the contacts [m]."""
    deepest = 0.0
    for c in range(contacts.count[0]):
        deepest = max(deepest, -contacts.gap[c])
    return deepest


@inner
def _displace(world, bodies, lists, events, clock, time):
    """Move everybody along the displacement in ``bodies.solved``; velocities stay, and no time goes by.

    The same share of it for all, so that no overlap is made: as much as keeps everybody within the reach of contacts
    and within half a radius. What is left is done in the next steps, for it cannot be had by cutting this one.
    """
    n = bodies.count[0]
    share = 1.0
    for i in range(n):
        length = math.sqrt(bodies.solved[i, 0] ** 2 + bodies.solved[i, 1] ** 2)
        most = min(bodies.reach[i], 0.5 * bodies.radius[i])
        if share * length > most:
            share = most / length
    for i in range(n):
        for k in range(2):
            bodies.spare[i, k] = bodies.velocity[i, k]
            bodies.solved[i, k] *= share
    fired = events.count[0]
    status = move(world, bodies, lists, events, time, 1.0, 0.0, 0.0, clock.full)
    for k in range(fired, events.count[0]):
        events.time[k] = time
    for i in range(n):
        for k in range(2):
            bodies.velocity[i, k] = bodies.spare[i, k]
    return status
