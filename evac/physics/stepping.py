"""The parts of a sub-step that every contact model shares, in the order in which they are called.

gather                 once a tick: sort the people inside by travel time, copy them in
open_step              at the start of each step, and cut where it has to be made in parts
free_motion            lists, desired directions, forces at a distance, velocity if nobody touched
meet                   contacts in reach
(the contact law)      fills bodies.solved and contacts.percussion
finish                 energy, move, cross portals and exits
scatter                once a tick: copy back
"""

import numpy as np

from evac.directions.sampling import sample_travel_time
from evac.jit import inner, kernel
from evac.physics import tallies as at
from evac.physics.contacts import find_contacts, keep_percussions, report_contact_force, set_reach, set_velocity_before
from evac.physics.drive import add_forces, drive, drive_overdamped, set_desired
from evac.physics.motion import TOO_FAST, TOO_STIFF, WALL_CROSSED, add_work, move, restore, save
from evac.physics.neighbours import OK, build_lists, lists_are_stale

__all__ = ["TOO_FAST", "TOO_STIFF"]

#: A step is cut into at most this many parts before the run is stopped.
GREATEST_PARTS = 256

#: Nobody is thrown faster than this but by contacts that make energy: the run is stopped [m/s].
FASTEST = 100.0


@kernel
def gather(world, crowd, bodies, lists, contacts):
    """Copy the people inside to `bodies`, sorted by travel time to their exit, row breaking ties."""
    n = crowd.level.shape[0]
    inside = 0
    for p in range(n):
        if crowd.level[p] >= 0:
            inside += 1
    keys = np.empty(inside)
    rows = np.empty(inside, np.int32)
    k = 0
    for p in range(n):
        if crowd.level[p] >= 0:
            rows[k] = p
            x, y = crowd.position[p, 0], crowd.position[p, 1]
            keys[k] = sample_travel_time(world.fields, x, y, crowd.level[p], crowd.route[p])
            k += 1
    order = np.argsort(keys, kind="mergesort")
    for i in range(inside):
        p = rows[order[i]]
        bodies.row[i] = p
        for k in range(2):
            bodies.position[i, k] = crowd.position[p, k]
            bodies.velocity[i, k] = crowd.velocity[p, k]
            bodies.extra_direction[i, k] = crowd.extra_direction[p, k]
        for k in range(3):
            bodies.speed[i, k] = crowd.speed[p, k]
        bodies.level[i] = crowd.level[p]
        bodies.radius[i] = crowd.radius[p]
        bodies.mass[i] = crowd.mass[p]
        bodies.inverse_mass[i] = 1.0 / crowd.mass[p]
        bodies.tau[i] = crowd.tau[p]
        bodies.start_time[i] = crowd.start_time[p]
        bodies.route[i] = crowd.route[p]
        bodies.speed_factor[i] = crowd.speed_factor[p]
        bodies.distance[i] = crowd.distance[p]
        bodies.contact_force[i] = crowd.contact_force[p]
    bodies.count[0] = inside
    bodies.taken_up_in[0] = 0.0
    contacts.count[1] = 0
    contacts.count[2] = 0
    lists.stale[0] = 1
    return inside


@kernel
def scatter(crowd, bodies):
    """Copy back what the step loop wrote."""
    for i in range(bodies.count[0]):
        p = bodies.row[i]
        for k in range(2):
            crowd.position[p, k] = bodies.position[i, k]
            crowd.velocity[p, k] = bodies.velocity[i, k]
        crowd.level[p] = bodies.level[i]
        crowd.distance[p] = bodies.distance[i]
        crowd.contact_force[p] = bodies.contact_force[i]


@inner
def refresh(world, bodies, lists, tally, needed, contact):
    """Build the lists again if they are stale or do not reach as far as needed.

    `needed` [m] is for forces between bodies, `contact` [m] for contacts with bodies and walls; the latter follows
    speeds, so it gets a margin.
    """
    if lists.span[0] < max(needed, contact):
        lists.span[0] = max(needed, 1.25 * contact)
        lists.stale[0] = 1
    if lists.span[2] < contact:
        lists.span[2] = 1.25 * contact
        lists.stale[0] = 1
    if lists_are_stale(bodies, lists):
        tally[0, at.LIST_BUILDS] += 1.0
        return build_lists(world, bodies, lists)
    return OK


@inner
def free_motion(world, bodies, lists, forces, clock, tally, time, h, overdamped):
    """Set ``bodies.free``; return (status, greatest speed [m/s])."""
    set_desired(world, bodies)
    if forces.address.shape[0] > 0:
        status = refresh(world, bodies, lists, tally, clock.cutoff, 0.0)
        if status != OK:
            return status, 0.0
        add_forces(world, bodies, lists, forces, clock)
    fastest = drive_overdamped(world, bodies, time) if overdamped else drive(world, bodies, time, h, clock.explicit)
    tally[0, at.GREATEST_SPEED] = max(tally[0, at.GREATEST_SPEED], fastest)
    return OK, fastest


@inner
def meet(world, bodies, lists, contacts, tally, h, share, floor, fastest):
    """Find the contacts within `share` of the free paths (at least `floor`) beyond touching; return a status."""
    set_reach(bodies, h, share, floor)
    status = refresh(world, bodies, lists, tally, 0.0, 2.0 * max(share * h * fastest, floor) + h * fastest)
    if status != OK:
        return status
    return seek(world, bodies, lists, contacts)


@inner
def seek(world, bodies, lists, contacts):
    """Find the contacts within the reaches as they are set; return a status."""
    status = find_contacts(world, bodies, lists, contacts)
    if status != OK:
        return status
    set_velocity_before(bodies, contacts)
    for c in range(contacts.count[0]):
        contacts.bias[c] = 0.0
        contacts.friction[c] = 0.0
        contacts.sticky[c] = 0
    return OK


@inner
def _speed(bodies, i):
    """Return the speed of body i in the step, before or after the drive, whichever is greater [m/s]."""
    free = bodies.free[i, 0] ** 2 + bodies.free[i, 1] ** 2
    return max(free, bodies.velocity[i, 0] ** 2 + bodies.velocity[i, 1] ** 2) ** 0.5


@inner
def is_too_fast(bodies, h, fastest, limit):
    """Say whether a path in the step is longer than `limit` [m], the fastest body's among them, and note the body."""
    if h * fastest <= limit:
        return False
    for i in range(bodies.count[0]):
        if bodies.level[i] >= 0 and h * _speed(bodies, i) > limit:
            bodies.count[1] = i
            return True
    return False


@inner
def tally_contacts(contacts, tally):
    """Count the contacts and their overlaps at the start of the step."""
    for c in range(contacts.count[0]):
        if contacts.gap[c] <= 0.0:
            tally[0, at.CONTACTS] += 1.0
            if -contacts.gap[c] > tally[0, at.GREATEST_OVERLAP]:
                tally[0, at.GREATEST_OVERLAP] = -contacts.gap[c]
                tally[0, at.DEEPEST_BODY] = 1.0 + contacts.body[c]
            tally[0, at.OVERLAP_SUM] -= contacts.gap[c]
            tally[0, at.OVERLAPS] += 1.0


@inner
def _place_deepest(bodies, tally, time):
    """Note time and place of a greatest overlap that this sub-step has found: where the body was as the step began."""
    i = int(tally[0, at.DEEPEST_BODY]) - 1
    tally[0, at.DEEPEST_BODY] = 0.0
    tally[0, at.DEEPEST_TIME] = time
    tally[0, at.DEEPEST_PERSON] = bodies.row[i]
    tally[0, at.DEEPEST_LEVEL] = bodies.old_level[i]
    tally[0, at.DEEPEST_X] = bodies.old_position[i, 0]
    tally[0, at.DEEPEST_Y] = bodies.old_position[i, 1]


@inner
def take_free(bodies):
    """Let the free velocity be the velocity after the step, as it is without contacts."""
    for i in range(bodies.count[0]):
        bodies.solved[i, 0] = bodies.free[i, 0]
        bodies.solved[i, 1] = bodies.free[i, 1]


@inner
def finish(world, bodies, lists, contacts, events, clock, tally, time, h, old_share):
    """Sum the work, keep the percussions for a warm start, move; return a status."""
    if tally[0, at.DEEPEST_BODY] > 0.0:
        _place_deepest(bodies, tally, time)
    add_work(bodies, contacts, tally[0, at.DRIVING_WORK : at.CONTACT_CREATION + 1])
    keep_percussions(contacts)
    tally[0, at.SUB_STEPS] += 1.0
    return move(world, bodies, lists, events, time, h, old_share, 1.0, clock.full)


@inner
def report_force(bodies, contacts, clock, step, part, parts, weight):
    """Sum the contact forces at the last sub-step before an output."""
    if clock.report_force and step == clock.last - 1 and part == parts - 1:
        report_contact_force(bodies, contacts, weight)


@kernel
def open_step(bodies, events, tally):
    """Remember bodies and sums at the start of a step; return the number of events so far."""
    save(bodies)
    for k in range(tally.shape[1]):
        tally[1, k] = tally[0, k]
    return events.count[0]


@kernel
def cut(bodies, lists, contacts, events, tally, fired, status, parts):
    """Go back to the start of the step; return the number of parts to try next, 0 if more do not help."""
    # Percussions that make energy make the more of it the smaller the parts.
    is_thrown = status == TOO_FAST and _speed(bodies, bodies.count[1]) > FASTEST
    restore(bodies, lists)
    events.count[0] = fired
    contacts.count[1] = 0
    for k in range(tally.shape[1]):
        tally[0, k] = tally[1, k]
    if status == WALL_CROSSED:
        entry = at.WALL_CROSSINGS_PREVENTED
    elif status == TOO_FAST:
        entry = at.TOO_FAST_STEPS
    elif status == TOO_STIFF:
        entry = at.TOO_STIFF_STEPS
    else:
        return 0
    tally[0, entry] += 1.0
    tally[1, entry] += 1.0
    return 2 * parts if parts < GREATEST_PARTS and not is_thrown else 0


# Parts bundled for contact models that are written in numpy and call them from Python.


@kernel
def approach(world, bodies, lists, contacts, forces, clock, tally, time, h, share, floor, overdamped):
    """Set the free velocities and find the contacts of a sub-step; return a status."""
    status, fastest = free_motion(world, bodies, lists, forces, clock, tally, time, h, overdamped)
    if status != OK:
        return status
    smallest = 1e300
    for i in range(bodies.count[0]):
        smallest = min(smallest, bodies.radius[i])
    if is_too_fast(bodies, h, fastest, 0.5 * smallest):
        return TOO_FAST
    return meet(world, bodies, lists, contacts, tally, h, share, floor, fastest)


@kernel
def conclude(world, bodies, lists, contacts, events, clock, tally, time, h, old_share, is_last):
    """Report forces, count overlaps, sum work and move after a sub-step; return a status."""
    if clock.report_force and is_last:
        report_contact_force(bodies, contacts, 1.0 / h)
    tally_contacts(contacts, tally)
    return finish(world, bodies, lists, contacts, events, clock, tally, time, h, old_share)
