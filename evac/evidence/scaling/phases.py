"""Kernels that repeat one phase of a step on a crowd as it stands, to time the phases apart."""

from evac.jit import kernel
from evac.physics import stepping
from evac.physics.motion import restore, save
from evac.physics.neighbours import build_lists


@kernel
def repeat_lists(world, bodies, lists, repeats):
    """Build the neighbour lists so many times; return the last status."""
    status = 0
    for _ in range(repeats):
        status = build_lists(world, bodies, lists)
    return status


@kernel
def repeat_search(world, bodies, lists, contacts, tally, repeats):
    """Find the contacts within the reaches of the last step so many times; return the last status."""
    status = 0
    for _ in range(repeats):
        status = stepping.seek(world, bodies, lists, contacts)
    return status


@kernel
def repeat_drive(world, bodies, lists, forces, clock, tally, time, overdamped, repeats):
    """Set the desired directions and free velocities so many times; return the last status."""
    status = 0
    for _ in range(repeats):
        status, _fastest = stepping.free_motion(
            world, bodies, lists, forces, clock, tally, time, clock.step, overdamped
        )
    return status


@kernel
def repeat_move(world, bodies, lists, contacts, events, clock, tally, time, old_share, repeats):
    """Save, sum the work, move and go back so many times; return the last status."""
    status = 0
    fired = events.count[0]
    for _ in range(repeats):
        save(bodies)
        status = stepping.finish(world, bodies, lists, contacts, events, clock, tally, time, clock.step, old_share)
        restore(bodies, lists)
        events.count[0] = fired
    return status
