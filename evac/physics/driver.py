"""The step loop, one for all contact models: what they differ in is called at the addresses in `State.parts`.

    advance                for each step, in parts where it has to be cut
        open_step          remember what a failed step goes back to
        approach           lists, desired directions, forces, velocity if nobody touched, contacts in reach
        (the law)          fills bodies.solved and contacts.percussion, or asks for something first
        conclude           contact forces, energy, move, cross portals and exits
        cut                undo the step; how many parts to try next

Contact models written in numpy make the same calls from Python, see `ContactModel.advance`.
"""

import math

import numpy as np

from evac.jit import AddressCall, Struct, inner, kernel
from evac.physics import tallies as at
from evac.physics.contacts import (
    find_contacts,
    keep_percussions,
    report_contact_force,
    set_reach,
)
from evac.physics.drive import call_add_forces, call_drive, set_desired
from evac.physics.motion import add_contact_work, move, remember
from evac.physics.neighbours import build_lists
from evac.physics.overlaps import call_separate
from evac.physics.pieces import CHUNK, DRIVE, FIND, LIST, LOOK, MOVE, OPEN, REACH, call_team
from evac.physics.state import Bodies, Crowd, State
from evac.physics.status import (
    EVENTS_FULL,
    FIRST_MISSING_PART,
    NEEDS_SEPARATION,
    OK,
    SEARCH_AGAIN,
    SEPARATE,
    TOO_FAST,
    TOO_STIFF,
    WALL_CROSSED,
)

#: A step is cut into at most this many parts before the run is stopped.
GREATEST_PARTS = 256

#: A law that is not done when it has been called so often in a sub-step never is.
MOST_CALLS = 100

#: Nobody is thrown faster than this but by contacts that create energy: the run is stopped [m/s].
FASTEST = 100.0

#: Call a contact law: state, its own parameters, length of the sub-step [s]; a status.
call_law = AddressCall([State, Struct, float], (int,))


#: What bodies copy from the crowd at the start of a tick, and what is copied back at its end.
TAKEN = tuple(name for name in Crowd.kinds if name in Bodies.kinds)
WRITTEN = ("position", "velocity", "level", "distance", "contact_force")


def gather(state: State, crowd: Crowd, inside: int) -> None:
    """Copy the people in ``bodies.row`` to the bodies, and forget what holds for the tick before."""
    bodies = state.bodies
    rows = bodies.row[:inside].astype(np.intp)
    for name in TAKEN:
        given, kept = getattr(crowd, name), getattr(bodies, name)[:inside]
        np.take(given, rows, axis=0, out=kept, mode="clip")  # which, unlike "raise", writes without a buffer
    bodies.inverse_mass[:inside] = 1.0 if state.traits.overdamped else 1.0 / bodies.mass[:inside]
    bodies.smallest = bodies.radius[:inside].min(initial=math.inf)
    bodies.inside = inside
    bodies.taken_up_in = 0.0
    bodies.node[:inside] = -1
    state.warm_start.number = 0
    state.contacts.separation_failed = 0
    state.lists.stale = 1
    state.events.number = 0


def scatter(crowd: Crowd, bodies: Bodies) -> None:
    """Copy back what the steps wrote."""
    rows = bodies.row[: bodies.inside].astype(np.intp)
    for name in WRITTEN:
        written, found = getattr(crowd, name), getattr(bodies, name)
        if found.ndim == 2:  # pairs, which numpy assigns ten times faster where each is one number
            written, found = written.view(np.complex128)[:, 0], found.view(np.complex128)[:, 0]
        written[rows] = found[: bodies.inside]


@kernel
def advance(state: State) -> int:
    """Make the steps of the clock, cutting those that cannot be made whole; return a status."""
    clock = state.clock
    while clock.now < clock.last:
        open_step(state)
        parts = clock.parts
        while True:
            status = _make_step(state, parts)
            if status == OK:
                break
            parts = cut(state, status, parts)
            if parts == 0:
                return status
        clock.now += 1
        clock.parts = 1
    return OK


@inner
def _make_step(state, parts):
    """Make one step in `parts` sub-steps; return a status."""
    for part in range(parts):
        set_clock(state, part, parts)
        status = approach(state)
        if status == OK:
            status = _obey(state)
        if status == OK:
            status = conclude(state)
        if status != OK:
            return status
    return OK


@inner
def _obey(state):
    """Call the law, and do what it asks for before it is called again; return a status."""
    parts, clock = state.parts, state.clock
    clock.attempt = 0
    clock.searched = 0
    while True:
        status = call_law(parts.law, state, parts.parameters, clock.h)
        clock.attempt += 1
        if clock.attempt == MOST_CALLS:
            return status
        if status == SEARCH_AGAIN:
            keep_percussions(state.contacts, state.warm_start)
            status = search(state, 0.0, 3.0 * state.bodies.farthest_reach)
        elif status == SEPARATE:
            status = _separate(state)
        else:
            return status
        if status != OK:
            return status


@inner
def _separate(state):
    """Separate overlaps, and search for contacts before and after; return a status."""
    if state.parts.separation == 0:
        return NEEDS_SEPARATION
    for is_solve in range(2):
        status = call_separate(state.parts.separation, state, is_solve)
        if status == OK:
            status = search(state, 0.0, 2.0 * state.bodies.farthest_reach)
        if status != OK:
            return status
    return OK


@kernel
def set_clock(state: State, part: int, parts: int) -> None:
    """Set time and length of a sub-step, and whether it is the last one before contact forces are wanted."""
    clock = state.clock
    clock.h = clock.step / parts
    clock.time = clock.now * clock.step + part * clock.h
    clock.reports = 1 if clock.report_force and clock.now == clock.last - 1 and part == parts - 1 else 0


@kernel
def approach(state: State) -> int:
    """Set the free velocities and find the contacts in reach; return a status."""
    bodies, traits, h = state.bodies, state.traits, state.clock.h
    if state.parts.team != 0:
        call_team(state.parts.team, state, LOOK)
    else:
        set_desired(state.world, bodies, 0, bodies.inside)
    if state.parts.forces != 0:
        status = _renew_lists(state, state.forces.farthest, 0.0)
        if status == OK:
            status = call_add_forces(state.parts.forces, state)
        if status != OK:
            return status
    if state.parts.team != 0:
        fastest = call_team(state.parts.team, state, DRIVE)
    else:
        fastest = call_drive(state.parts.drive, state, 0, bodies.inside)
    bodies.taken_up_in = h
    bodies.fastest = fastest
    state.tally[at.GREATEST_SPEED] = max(state.tally[at.GREATEST_SPEED], fastest)
    if _is_too_fast(bodies, h, traits.longest_path * bodies.smallest):
        return TOO_FAST
    floor = max(traits.reach_floor, traits.reach_fastest * h * fastest)
    bodies.reach_floor = floor
    if state.parts.team != 0:
        call_team(state.parts.team, state, REACH)
    else:
        set_reach(bodies, 0, bodies.inside, h, traits.reach_share)
    status = search(state, 0.0, 2.0 * max(traits.reach_share * h * fastest, floor) + h * fastest)
    if status == OK:
        _tally_contacts(state)
    return status


@inner
def search(state, pairs, contacts):
    """Find the contacts within the reaches as they are set, with lists that look as far as needed; return a status."""
    status = _renew_lists(state, pairs, contacts)
    if status != OK:
        return status
    if state.parts.team != 0:
        return int(call_team(state.parts.team, state, FIND))
    return find_contacts(state, 0, state.bodies.inside)


@inner
def _renew_lists(state, pairs, contacts):
    """Build the lists again if they are stale or do not reach as far as needed; return a status.

    `pairs` [m] is for forces between bodies, `contacts` [m] for contacts with bodies and walls; the latter follows
    speeds, so it gets a margin.
    """
    lists = state.lists
    if lists.pair_reach < max(pairs, contacts):
        lists.pair_reach = max(pairs, 1.25 * contacts)
        lists.stale = 1
    if lists.wall_reach < contacts:
        lists.wall_reach = 1.25 * contacts
        lists.stale = 1
    if lists.stale:
        if state.parts.team != 0:
            status = int(call_team(state.parts.team, state, LIST))
        else:
            status = build_lists(state.world, state.bodies, lists)
        if status == OK:
            state.tally[at.LIST_BUILDS] += 1.0
        return status
    return OK


@inner
def _speed(bodies, i):
    """Return the speed of body i in the step, before or after the drive, whichever is greater [m/s]."""
    free = bodies.free[i, 0] ** 2 + bodies.free[i, 1] ** 2
    return max(free, bodies.velocity[i, 0] ** 2 + bodies.velocity[i, 1] ** 2) ** 0.5


@inner
def _is_too_fast(bodies, h, limit):
    """Say whether a path in the step is longer than `limit` [m], the fastest body's among them, and note the body."""
    if h * bodies.fastest <= limit:
        return False
    for i in range(bodies.inside):
        if bodies.level[i] >= 0 and h * _speed(bodies, i) > limit:
            bodies.failed = i
            return True
    return False


@inner
def _tally_contacts(state):
    """Count the contacts and their overlaps as the sub-step begins; the deepest is placed where the step began.

    Of two people it is told of the one with the greater row, whatever the order of bodies.
    """
    bodies, contacts, tally = state.bodies, state.contacts, state.tally
    deepest, overlaps, total = 0.0, 0, tally[at.OVERLAP_SUM]
    for c in range(contacts.number):
        overlap = -contacts.gap[c]
        overlaps += overlap >= 0.0
        total += max(overlap, 0.0)
        deepest = max(deepest, overlap)
        if overlap > tally[at.GREATEST_OVERLAP]:
            i, j = contacts.body[c], contacts.other[c]
            if j >= 0 and bodies.row[j] > bodies.row[i]:
                i = j
            tally[at.GREATEST_OVERLAP] = overlap
            tally[at.DEEPEST_TIME] = state.clock.time
            tally[at.DEEPEST_PERSON] = bodies.row[i]
            tally[at.DEEPEST_LEVEL] = bodies.old_level[i]
            tally[at.DEEPEST_X] = bodies.old_position[i, 0]
            tally[at.DEEPEST_Y] = bodies.old_position[i, 1]
    contacts.deepest = deepest
    tally[at.CONTACTS] += overlaps
    tally[at.OVERLAPS] += overlaps
    tally[at.OVERLAP_SUM] = total


@kernel
def conclude(state: State) -> int:
    """Report contact forces if asked for, sum the work, remember the percussions, move; return a status."""
    bodies, contacts, tally, clock, traits = state.bodies, state.contacts, state.tally, state.clock, state.traits
    if clock.reports and traits.reports_percussions:
        report_contact_force(bodies, contacts, 0.0 if traits.overdamped else 1.0 / clock.h)
    if not traits.overdamped:  # without inertia there is no kinetic energy to account for
        add_contact_work(bodies, contacts, tally)
    if traits.remembers:
        keep_percussions(contacts, state.warm_start)
    tally[at.SUB_STEPS] += 1.0
    if state.parts.team != 0:
        status = int(call_team(state.parts.team, state, MOVE))
    else:
        status = move(state, 0, bodies.inside, clock.time, clock.h, traits.old_share, True)
    if status == OK and not traits.overdamped:
        for chunk in range((bodies.inside + CHUNK - 1) // CHUNK):
            tally[at.DRIVING_WORK] += bodies.work[chunk]
    return status


@kernel
def open_step(state: State) -> None:
    """Remember bodies, sums, events and percussions at the start of a step."""
    bodies, memory = state.bodies, state.warm_start
    if state.parts.team != 0:
        call_team(state.parts.team, state, OPEN)
    else:
        remember(bodies, 0, bodies.inside)
    for k in range(state.tally.shape[0]):
        state.tally_before[k] = state.tally[k]
    state.events.number_before = state.events.number
    memory.half_before = memory.half
    memory.number_before = memory.number
    memory.failed_before = state.contacts.separation_failed


@kernel
def cut(state: State, status: int, parts: int) -> int:
    """Go back to the start of the step; return the number of parts to try next, 0 if more do not help.

    Sub-steps start without percussions; only a step that waits for a part to be loaded is made again as it was. Lists
    that have been built stay, and so does their count; after a move that failed they are stale, since other threads may
    have moved bodies that one thread had not come to.
    """
    bodies, memory, tally = state.bodies, state.warm_start, state.tally
    state.clock.parts = parts
    builds = tally[at.LIST_BUILDS]
    # Contacts that create energy create more with smaller sub-steps.
    is_thrown = status == TOO_FAST and _speed(bodies, bodies.failed) > FASTEST
    for i in range(bodies.inside):
        for k in range(2):
            bodies.position[i, k] = bodies.old_position[i, k]
            bodies.velocity[i, k] = bodies.old_velocity[i, k]
        bodies.distance[i] = bodies.old_distance[i]
        if bodies.level[i] != bodies.old_level[i]:
            bodies.level[i] = bodies.old_level[i]
            state.lists.stale = 1
    if status in (WALL_CROSSED, TOO_FAST, EVENTS_FULL):
        state.lists.stale = 1
    state.events.number = state.events.number_before
    for k in range(tally.shape[0]):
        tally[k] = state.tally_before[k]
    tally[at.LIST_BUILDS] = builds
    memory.half = memory.half_before
    memory.number = 0
    if status >= FIRST_MISSING_PART:
        memory.number = memory.number_before if parts == 1 else 0
        state.contacts.separation_failed = memory.failed_before
        return 0
    if status == WALL_CROSSED:
        entry = at.WALL_CROSSINGS_PREVENTED
    elif status == TOO_FAST:
        entry = at.TOO_FAST_STEPS
    elif status == TOO_STIFF:
        entry = at.TOO_STIFF_STEPS
    else:
        return 0
    tally[entry] += 1.0
    state.tally_before[entry] += 1.0
    return 2 * parts if parts < GREATEST_PARTS and not is_thrown else 0
