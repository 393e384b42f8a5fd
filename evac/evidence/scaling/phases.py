"""Kernels that repeat one phase of a step on a crowd as it stands, to time the phases apart."""

from evac.jit import kernel
from evac.physics.contact.contacts import find_contacts
from evac.physics.contact.neighbours import build_lists
from evac.physics.motion import drive, set_desired
from evac.physics.state import State
from evac.physics.status import OK
from evac.physics.stepping import finish_step, open_step, undo_step


@kernel
def repeat_lists(state: State, repeats: int) -> int:
    """Build the neighbour lists so many times; return the last status."""
    status = OK
    for _ in range(repeats):
        status = build_lists(state.world, state.bodies, state.lists)
    return status


@kernel
def repeat_search(state: State, repeats: int) -> int:
    """Find the contacts within the reaches of the last step so many times; return the last status."""
    status = OK
    for _ in range(repeats):
        status = find_contacts(state)
    return status


@kernel
def repeat_drive(state: State, repeats: int) -> int:
    """Set the desired directions and free velocities so many times; return a status, OK."""
    for _ in range(repeats):
        set_desired(state.world, state.bodies)
        drive(state)
    return OK


@kernel
def repeat_move(state: State, repeats: int) -> int:
    """Save, sum the work, keep the percussions, move and go back so many times; return the last status."""
    status = OK
    for _ in range(repeats):
        open_step(state)
        status = finish_step(state)
        undo_step(state, OK, 1)
    return status
