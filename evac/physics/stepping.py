"""The step loop, which is shared by all contact models; optional parts are called at the addresses in `State.parts`.

    advance                for each step, subdivided into parts if necessary
        open_step          save the state, to undo the step if it fails
        prepare_step       neighbour lists, desired directions, forces, free velocities, contact search
        apply_law          the law: sets bodies.solved and contacts.percussion, after searches and separations
        finish_step        contact forces, energy, motion, crossings of portals and exits
        undo_step          undo the step; return the number of parts to try next

Contact models written in NumPy make the same calls from Python, see `ContactModel.advance`.
"""

from evac.jit import AddressCall, Struct, inner, kernel
from evac.physics import tallies as at
from evac.physics.contact.contacts import (
    call_memory,
    find_contacts,
    keep_percussions,
    mark_start,
    normal_velocity,
    report_contact_force,
    set_reach,
)
from evac.physics.contact.neighbours import build_lists
from evac.physics.contact.percussions import call_separate
from evac.physics.extent import extent
from evac.physics.force import call_add_forces
from evac.physics.motion import add_contact_work, drive, move, save_bodies, set_desired
from evac.physics.state import State
from evac.physics.status import (
    CENTRES_PASSED,
    FIRST_MISSING_PART,
    NEEDS_SEPARATION,
    OK,
    SEARCH_AGAIN,
    SEPARATE,
    TOO_FAST,
    TOO_STIFF,
    WALL_CROSSED,
)

GREATEST_PARTS = 256  #: Largest number of parts that a step is divided into before the run is stopped.
MOST_CALLS = 100  #: Largest number of calls of a law in a sub-step; a law that needs more does not terminate.
FASTEST = 100.0  #: Largest speed [m/s]; only contacts that create energy lead to larger speeds, so the run is stopped.

#: Call a contact law with the state, its own parameters and the length of the sub-step [s]; it returns a status.
call_law = AddressCall([State, Struct, float], (int,))


@kernel
def advance(state: State) -> int:
    """Make all steps of the clock, subdividing steps that fail; return a status."""
    clock = state.clock
    while clock.now < clock.last:
        open_step(state)
        parts = clock.parts
        while True:
            status = _make_step(state, parts)
            if status == OK:
                break
            parts = undo_step(state, status, parts)
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
        status = prepare_step(state)
        if status == OK:
            status = apply_law(state)
        if status == OK:
            status = finish_step(state)
        if status != OK:
            return status
    return OK


@inner
def apply_law(state):
    """Call the law until it is done, after the searches and separations that it requests; return a status."""
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
    """Separate overlaps, with contact searches before and after; return a status."""
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
    """Set the time and length of a sub-step, and whether contact forces are reported after it."""
    clock = state.clock
    clock.h = clock.length / parts
    clock.time = clock.now * clock.length + part * clock.h
    clock.reports = 1 if clock.report_force and clock.now == clock.last - 1 and part == parts - 1 else 0


@kernel
def prepare_step(state: State) -> int:
    """Set the free velocities and find the contacts in reach; return a status."""
    bodies, traits, h = state.bodies, state.traits, state.clock.h
    set_desired(state.world, bodies)
    if state.parts.forces != 0:
        status = _renew_lists(state, state.forces.farthest, 0.0, 0.0)
        if status == OK:
            status = call_add_forces(state.parts.forces, state)
        if status != OK:
            return status
    if state.parts.body_forces != 0:
        status = _renew_lists(state, 0.0, state.body_forces.farthest, 0.0)
        if status == OK:
            status = call_add_forces(state.parts.body_forces, state)
        if status != OK:
            return status
    fastest = drive(state)
    bodies.relaxation_step = h
    bodies.fastest = fastest
    state.tally[at.GREATEST_SPEED] = max(state.tally[at.GREATEST_SPEED], fastest)
    if _is_too_fast(bodies, h, traits.longest_path * bodies.smallest):
        return TOO_FAST
    floor = max(traits.reach_floor, traits.reach_fastest * h * fastest)
    bodies.reach_floor = floor
    set_reach(bodies, h, traits.reach_share)
    status = search(state, 0.0, 2.0 * max(traits.reach_share * h * fastest, floor) + h * fastest)
    if status == OK:
        _tally_contacts(state)
    return status


@inner
def search(state, pairs, contacts):
    """Find the contacts within the current reaches, rebuilding the lists if necessary; return a status."""
    status = _renew_lists(state, pairs, 0.0, contacts)
    if status != OK:
        return status
    status = find_contacts(state)
    if status == OK and state.parts.recall != 0:
        status = call_memory(state.parts.recall, state)
    return status


@inner
def _renew_lists(state, pairs, walls, contacts):
    """Rebuild the neighbour lists if they are stale or their reach is too short; return a status.

    `pairs` [m] is the reach of forces between bodies, `walls` [m] that of forces that depend on walls, `contacts` [m]
    that of contacts with bodies and walls. The latter varies with speeds, so a margin is added.
    """
    lists = state.lists
    if lists.pair_reach < max(pairs, contacts):
        lists.pair_reach = max(pairs, 1.25 * contacts)
        lists.stale = 1
    if lists.wall_reach < max(walls, contacts):
        lists.wall_reach = max(walls, 1.25 * contacts)
        lists.stale = 1
    if lists.stale:
        status = build_lists(state.world, state.bodies, lists)
        if status == OK:
            state.tally[at.LIST_BUILDS] += 1.0
        return status
    return OK


@inner
def _speed(bodies, i):
    """Return the larger of the speeds of body i before the step and after the drive [m/s]."""
    free = bodies.free[i, 0] ** 2 + bodies.free[i, 1] ** 2
    return max(free, bodies.velocity[i, 0] ** 2 + bodies.velocity[i, 1] ** 2) ** 0.5


@inner
def _is_too_fast(bodies, h, limit):
    """Return whether the free path of a body in the step exceeds `limit` [m]; note the body as failed."""
    if h * bodies.fastest <= limit:
        return False
    for i in range(bodies.inside):
        if bodies.level[i] >= 0 and h * _speed(bodies, i) > limit:
            bodies.failed = i
            return True
    return False


@inner
def _tally_contacts(state):
    """Count contacts and overlaps at the start of the sub-step, and record the deepest overlap with its place."""
    bodies, contacts, tally = state.bodies, state.contacts, state.tally
    deepest, overlaps, total = 0.0, 0, tally[at.OVERLAP_SUM]
    for c in range(contacts.number):
        overlap = -contacts.gap[c]
        overlaps += overlap >= 0.0
        total += max(overlap, 0.0)
        deepest = max(deepest, overlap)
        i, j = contacts.body[c], contacts.other[c]
        bodies.overlap[i] = max(bodies.overlap[i], overlap)
        if j >= 0:
            bodies.overlap[j] = max(bodies.overlap[j], overlap)
        if overlap > tally[at.GREATEST_OVERLAP]:
            if j >= 0 and bodies.row[j] > bodies.row[i]:
                i = j
            tally[at.GREATEST_OVERLAP] = overlap
            tally[at.DEEPEST_TIME] = state.clock.time
            tally[at.DEEPEST_PERSON] = bodies.row[i]
            tally[at.DEEPEST_LEVEL] = bodies.old_level[i]
            tally[at.DEEPEST_X] = bodies.old_position[i, 0]
            tally[at.DEEPEST_Y] = bodies.old_position[i, 1]
    contacts.deepest = deepest
    if state.clock.time == 0.0:
        for i in range(bodies.inside):
            bodies.mingled[i] = bodies.overlap[i] > 0.5 * bodies.smallest
    tally[at.CONTACTS] += overlaps
    tally[at.OVERLAPS] += overlaps
    tally[at.OVERLAP_SUM] = total


@inner
def _centres_pass(state):
    """Return whether the centres of two people pass each other in the sub-step; note one of them as failed."""
    # Only overlaps beyond a radius can be that deep, as no free path is longer than half a radius. People who overlap
    # from the start of the run are excepted.
    bodies, contacts, share = state.bodies, state.contacts, state.traits.old_share
    if contacts.deepest <= bodies.smallest:
        return False
    for c in range(contacts.number):
        i, j = contacts.body[c], contacts.other[c]
        if j < 0 or contacts.gap[c] > -bodies.smallest or bodies.mingled[i] & bodies.mingled[j]:
            continue
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        opening = (1.0 - share) * normal_velocity(bodies.solved, contacts, c) + share * contacts.velocity_before[c]
        distance = contacts.gap[c] + extent(bodies, i, -nx, -ny) + extent(bodies, j, nx, ny)
        if distance + state.clock.h * opening < 0.0:
            bodies.failed, bodies.other_failed = i, j
            return True
    return False


@kernel
def finish_step(state: State) -> int:
    """Report contact forces if requested, sum the work, keep percussions and memory, move; return a status."""
    bodies, contacts, tally, clock, traits = state.bodies, state.contacts, state.tally, state.clock, state.traits
    if _centres_pass(state):
        return CENTRES_PASSED
    if clock.reports and traits.reports_percussions:
        report_contact_force(bodies, contacts, 0.0 if traits.overdamped else 1.0 / clock.h)
    if not traits.overdamped:  # without inertia there is no kinetic energy to account for
        add_contact_work(bodies, contacts, tally)
    if traits.remembers:
        keep_percussions(contacts, state.warm_start)
    if state.parts.retain != 0:
        call_memory(state.parts.retain, state)
    tally[at.SUB_STEPS] += 1.0
    clock.h_before = clock.h
    return move(state, clock.time, clock.h, traits.old_share, True)


@kernel
def open_step(state: State) -> None:
    """Save bodies, sums, events, percussions and memory at the start of a step."""
    contacts = state.contacts
    save_bodies(state.bodies)
    for k in range(state.tally.shape[0]):
        state.tally_before[k] = state.tally[k]
    state.events.number_before = state.events.number
    state.clock.h_before_step = state.clock.h_before
    mark_start(state.warm_start)
    mark_start(state.memory)
    contacts.failed_before = contacts.separation_failed


@kernel
def undo_step(state: State, status: int, parts: int) -> int:
    """Undo the step; return the number of parts to try next, 0 if further subdivision does not help.

    The memory of contacts is again that of the start of the step. The sub-steps start without warm start percussions,
    except if the step is only repeated because a part had to be loaded. Neighbour lists that have been built are kept,
    and so is their count.
    """
    bodies, percussions, memory, tally = state.bodies, state.warm_start, state.memory, state.tally
    state.clock.parts = parts
    state.clock.h_before = state.clock.h_before_step
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
    state.events.number = state.events.number_before
    for k in range(tally.shape[0]):
        tally[k] = state.tally_before[k]
    tally[at.LIST_BUILDS] = builds
    memory.half = memory.half_before
    memory.number = memory.number_before
    percussions.half = percussions.half_before
    percussions.number = 0
    if status >= FIRST_MISSING_PART:
        percussions.number = percussions.number_before if parts == 1 else 0
        state.contacts.separation_failed = state.contacts.failed_before
        return 0
    if status == WALL_CROSSED:
        entry = at.WALL_CROSSINGS_PREVENTED
    elif status == TOO_FAST:
        entry = at.TOO_FAST_STEPS
    elif status == TOO_STIFF:
        entry = at.TOO_STIFF_STEPS
    elif status == CENTRES_PASSED:
        entry = at.PASSES_PREVENTED
    else:
        return 0
    tally[entry] += 1.0
    state.tally_before[entry] += 1.0
    return 2 * parts if parts < GREATEST_PARTS and not is_thrown else 0


CALLED_APART = [open_step, set_clock, prepare_step, finish_step, undo_step]  #: What `ContactModel.advance` calls.
