"""Phases of a step, each of which treats every body apart from the others.

The loop makes each phase by a call of `State.parts.phase`: of `make_alone`, which treats all bodies, or of a kernel of
`evac.physics.threads`, which shares them among threads. Sums over bodies are taken for each `CHUNK` of them, so that
results do not depend on which it is.
"""

from evac.jit import inner, kernel
from evac.physics.contact.contacts import find_contacts, set_reach, take_velocities
from evac.physics.contact.neighbours import list_neighbours, sort_into_cells
from evac.physics.drive import call_drive, set_desired
from evac.physics.motion import move, remember
from evac.physics.state import DRIVE, FIND, LIST, LOOK, MOVE, OPEN, REACH, TAKE, State, call_phase
from evac.physics.status import OK


@inner
def make_phase(state, phase, first, last):
    """Make a phase on some bodies; return a status, of `DRIVE` the greatest speed [m/s]."""
    bodies, clock, status = state.bodies, state.clock, OK
    if phase == OPEN:
        remember(bodies, first, last)
    elif phase == LOOK:
        set_desired(state.world, bodies, first, last)
    elif phase == DRIVE:
        return call_drive(state.parts.drive, state, first, last)
    elif phase == REACH:
        set_reach(bodies, first, last, clock.h, state.traits.reach_share)
    elif phase == LIST:
        status = list_neighbours(state.world, bodies, state.lists, first, last)
    elif phase == FIND:
        status = find_contacts(state, first, last)
    elif phase == TAKE:
        take_velocities(bodies, first, last)
    elif phase == MOVE:
        status = move(state, first, last, clock.time, clock.h, state.traits.old_share, True)
    return float(status)


@kernel
def make_alone(state: State, phase: int) -> float:
    """Make a phase on all bodies with one thread; return as `make_phase`."""
    return make_phase(state, phase, 0, state.bodies.inside)


@inner
def build_lists(state):
    """Build the neighbour lists; return OK, PAIRS_FULL or WALLS_FULL."""
    sort_into_cells(state.bodies, state.lists)
    status = int(call_phase(state.parts.phase, state, LIST))
    if status == OK:
        state.lists.stale = 0
    return status
