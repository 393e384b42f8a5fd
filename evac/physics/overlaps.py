"""Removing overlaps: a solve on positions that leaves velocities untouched."""

import math

from evac.jit import inner
from evac.physics import stepping
from evac.physics import tallies as at
from evac.physics.motion import move
from evac.physics.neighbours import OK
from evac.physics.solvers import INELASTIC, solve_or_retry

#: Iterations of a position solve: one that has no solution (a body squeezed between walls) never converges.
ITERATIONS = 600

#: Contacts are looked for as far as this many overlaps in a row push somebody, but no farther than [m].
CHAIN = 20.0
LONGEST_CHAIN = 0.1


@inner
def part_overlaps(world, bodies, lists, contacts, events, clock, tally, time, method, limit, tolerance):
    """Push bodies apart where an overlap exceeds half the tolerance; return a status.

    The displacement is the least in the mass norm with D + G.d >= 0 for all contacts in reach, the NSM1
    problem without time. It is taken only where it at least halves the deepest overlap; a squeezed body
    stays where it is. Contacts are searched again afterwards.
    """
    deepest = _deepest(contacts)
    if deepest <= 0.5 * tolerance or contacts.count[2] > 0:
        return OK
    n = bodies.count[0]
    longest = 0.0
    for i in range(n):
        bodies.reach[i] = max(bodies.reach[i], 2.0 * deepest, min(CHAIN * deepest, LONGEST_CHAIN))
        longest = max(longest, bodies.reach[i])
    status = stepping.refresh(world, bodies, lists, tally, 0.0, 2.0 * longest)
    if status == OK:
        status = stepping.seek(world, bodies, lists, contacts)
    if status != OK:
        return status
    for c in range(contacts.count[0]):
        contacts.bias[c] = contacts.gap[c]
        contacts.impulse[c] = 0.0
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
        # Along a chain of overlaps displacements add up; only where the solve left something they are kept short.
        farthest = 1e300 if found <= 0.1 * tolerance else 2.0 * deepest
        status = _displace(world, bodies, lists, events, clock, time, farthest)
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
def _displace(world, bodies, lists, events, clock, time, farthest):
    """Move everybody by the displacement in ``bodies.solved``; velocities stay, and no time goes by.

    At most `farthest` [m], and half a radius: what is left is done in the next steps, for it cannot be had by cutting
    this one.
    """
    n = bodies.count[0]
    for i in range(n):
        bodies.spare[i, 0] = bodies.velocity[i, 0]
        bodies.spare[i, 1] = bodies.velocity[i, 1]
        length = math.sqrt(bodies.solved[i, 0] ** 2 + bodies.solved[i, 1] ** 2)
        most = min(farthest, 0.5 * bodies.radius[i])
        if length > most:
            bodies.solved[i, 0] *= most / length
            bodies.solved[i, 1] *= most / length
    fired = events.count[0]
    status = move(world, bodies, lists, events, time, 1.0, 0.0, 0.0, clock.full)
    for k in range(fired, events.count[0]):
        events.time[k] = time
    for i in range(n):
        bodies.velocity[i, 0] = bodies.spare[i, 0]
        bodies.velocity[i, 1] = bodies.spare[i, 1]
    return status
