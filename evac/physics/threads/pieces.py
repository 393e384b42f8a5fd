"""How the phases of a step are divided among threads: consecutive bodies, a piece for each.

Pieces begin where chunks of bodies do. What is added up over bodies is added up for each chunk and then over the
chunks, so that sums do not depend on the number of threads.
"""

from evac.jit import AddressCall, inner
from evac.physics.state import State

#: Bodies whose sums are taken together.
CHUNK = 64

#: Phases of a step; those of a solver follow behind `SOLVE`.
OPEN, LOOK, DRIVE, REACH, LIST, JOIN_LISTS, FIND, JOIN_CONTACTS, TAKE, MOVE, JOIN_EVENTS, LEAVE, SOLVE = range(13)

#: The word of a phase is (number MOST_BLOCKS + blocks) PHASES + phase, with the number of phases before and the number
#: of blocks of a contact problem (`evac.physics.contact.blocks`). Threads read it at once.
PHASES, MOST_BLOCKS = 64, 16

#: Columns of `Team.found`: status, numbers of pairs, walls, contacts and events, room for pairs, body that failed.
STATUS, PAIRS, WALLS, CONTACTS, EVENTS, ROOM, FAILED = range(7)

#: Make a phase on all bodies with several threads, see `evac.physics.threads.team.conduct`;
#: a status, or the greatest speed [m/s].
call_team = AddressCall([State, int], (float,))


@inner
def piece_of(bodies, number, threads):
    """Return the first body of a thread's piece, and one past the last."""
    chunks = (bodies.inside + CHUNK - 1) // CHUNK
    first = chunks * number // threads * CHUNK
    last = chunks * (number + 1) // threads * CHUNK
    return min(first, bodies.inside), min(last, bodies.inside)
