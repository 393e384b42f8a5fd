"""Phases of a step with several threads, with the same results as with one: each thread has a piece of the bodies.

A thread writes only what belongs to the bodies of its piece, which begin and end where chunks do, and lists, contacts
and events to arrays of its own. These are joined in the order of pieces, which is the order of bodies. The first thread
announces a phase, does its piece, and waits for the others. These kernels are loaded only if a run has several threads.
"""

from typing import Any

from evac.jit import AddressCall, Intrinsic, Struct, inner, kernel
from evac.physics.contact.contacts import copy_contact
from evac.physics.phases import make_phase
from evac.physics.state import CHUNK, DRIVE, FIND, LIST, MOVE, State
from evac.physics.status import CONTACTS_FULL, EVENTS_FULL, OK, PAIRS_FULL, WALLS_FULL

#: Phases of the team behind those of `evac.physics.phases`.
JOIN_LISTS, JOIN_CONTACTS, JOIN_EVENTS, LEAVE = range(8, 12)

#: The word of a phase is number PHASES + phase, with the number of phases before, so that threads read both at once.
PHASES = 64

#: Columns of `Team.found`: numbers of pairs, walls, contacts and events, room for pairs, body that failed.
PAIRS, WALLS, CONTACTS, EVENTS, ROOM, FAILED = range(6)

#: A waiting thread looks this often at the word before it sleeps, and sleeps this long [us]. Letting other threads run
#: without sleeping would cost it a whole time slice if they want its core.
LOOKS, NAP = 10000, 50

#: Sleep for a number of microseconds.
call_rest = AddressCall([int], (int,))


def _compile_release(builder: Any, place: Any, value: Any) -> Any:
    builder.store_atomic(value, place, "release", 8)
    return value


def _compile_pause(builder: Any) -> Any:
    from llvmlite import ir

    number, triple = ir.IntType(32), builder.module.triple
    if triple.startswith(("x86", "i686")):
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), kind), [])
    elif triple.startswith(("aarch64", "arm64")):
        kind = ir.FunctionType(ir.VoidType(), [number])
        builder.call(builder.module.declare_intrinsic("llvm.aarch64.hint", (), kind), [number(1)])
    return ir.IntType(64)(0)


#: Read and write number k of an array that another thread writes and reads: what it wrote before is seen after.
acquire = Intrinsic(
    "acquire", lambda array, k: array[k], lambda builder, place: builder.load_atomic(place, "acquire", 8)
)
release = Intrinsic("release", lambda array, k, value: array.__setitem__(k, value), _compile_release)

#: Let the processor rest for a moment in a loop that waits for another thread.
pause = Intrinsic("pause", lambda: 0, _compile_pause)


class Member(Struct):
    """A thread beside the first."""

    number: int
    main: State  # of the run
    own: State  # the same, but for contacts and events
    listing: State  # the same, but for the arrays of neighbour lists


@inner
def _wait(team, number, word):
    """Wait until a thread has raised its word to a value, or beyond."""
    looks = 0
    while acquire(team.turn, 8 * number) < word:
        pause()
        looks += 1
        if looks == LOOKS:
            call_rest(team.rest, NAP)
            looks = 0


@kernel
def serve(member: Member) -> None:
    """Do this thread's piece of each phase until the threads are to leave."""
    main, number = member.main, member.number
    team = main.team
    last = acquire(team.turn, 8 * number)
    while True:
        _wait(team, 0, last + 1)
        last = acquire(team.turn, 0)
        phase = last % PHASES
        if phase == LEAVE:
            break
        if phase >= JOIN_LISTS:
            _hand_over(member, phase)
        else:
            if phase == LIST:
                own, lists = member.listing.lists, main.lists
                own.pair_reach, own.wall_reach, own.greatest = lists.pair_reach, lists.wall_reach, lists.greatest
            member.own.events.number = 0
            _do(member.listing if phase == LIST else member.own, team, phase, number)
        release(team.turn, 8 * number, last)
    release(team.turn, 8 * number, last)


@kernel
def conduct(state: State, phase: int) -> float:
    """Make a phase on all bodies with all threads; return as `make_phase`."""
    team = state.team
    word = _begin(team, phase)
    if phase == LEAVE:
        return 0.0
    _do(state, team, phase, 0)
    _wait_for_all(team, word)
    if phase == DRIVE:
        fastest = 0.0
        for number in range(team.threads):
            fastest = max(fastest, team.result[8 * number])
        return fastest
    status = OK
    if phase == LIST:
        status = _join_lists(state)
    elif phase == FIND:
        status = _join_contacts(state)
    elif phase == MOVE:
        status = _join_events(state)
    return float(status)


@inner
def _do(state, team, phase, number):
    """Do a thread's piece of a phase, and note what it has found."""
    first, last = piece_of(state.bodies, number, team.threads)
    team.result[8 * number] = make_phase(state, phase, first, last)
    found, lists = team.found, state.lists
    found[number, PAIRS], found[number, WALLS], found[number, ROOM] = lists.pairs, lists.walls, lists.room
    found[number, CONTACTS] = state.contacts.number
    found[number, EVENTS], found[number, FAILED] = state.events.number, state.events.failed


@inner
def piece_of(bodies, number, threads):
    """Return the first body of a thread's piece, and one past the last."""
    chunks = (bodies.inside + CHUNK - 1) // CHUNK
    first = chunks * number // threads * CHUNK
    last = chunks * (number + 1) // threads * CHUNK
    return min(first, bodies.inside), min(last, bodies.inside)


@inner
def _begin(team, phase):
    """Let the other threads begin a phase; return its word, see `PHASES`."""
    word = (acquire(team.turn, 0) // PHASES + 1) * PHASES + phase
    release(team.turn, 0, word)
    return word


@inner
def _wait_for_all(team, word):
    for number in range(1, team.threads):
        _wait(team, number, word)


@inner
def _before(team, number, what):
    """Return how many of what the threads before a thread have found."""
    total = 0
    for other in range(number):
        total += team.found[other, what]
    return total


@inner
def _hand_over(member, phase):
    """Copy what a thread has found behind what those before it have."""
    main, number = member.main, member.number
    team = main.team
    if phase == JOIN_LISTS:
        lists, own = main.lists, member.listing.lists
        first, last = piece_of(main.bodies, number, team.threads)
        pairs, walls = _before(team, number, PAIRS), _before(team, number, WALLS)
        for i in range(first, last):
            lists.pair_start[i + 1] += pairs
            lists.wall_start[i + 1] += walls
        for k in range(own.pairs):
            lists.pair_body[pairs + k] = own.pair_body[k]
        for k in range(own.walls):
            lists.wall_item[walls + k] = own.wall_item[k]
    elif phase == JOIN_CONTACTS:
        before = _before(team, number, CONTACTS)
        for k in range(member.own.contacts.number):
            copy_contact(member.own.contacts, k, main.contacts, before + k)
    else:
        before, events, own_events = _before(team, number, EVENTS), main.events, member.own.events
        for k in range(own_events.number):
            events.row[before + k] = own_events.row[k]
            events.kind[before + k] = own_events.kind[k]
            events.link[before + k] = own_events.link[k]
            events.time[before + k] = own_events.time[k]


@inner
def _join(team, phase):
    """Let the other threads hand over what they have found."""
    _wait_for_all(team, _begin(team, phase))


@inner
def _join_lists(state):
    """Join the lists; return a status."""
    team, lists = state.team, state.lists
    for number in range(team.threads):
        room = _before(team, number, PAIRS) + team.found[number, ROOM]
        if team.result[8 * number] == PAIRS_FULL or room > lists.pair_body.shape[0]:
            return PAIRS_FULL
    for number in range(team.threads):
        if team.result[8 * number] == WALLS_FULL or _before(team, number + 1, WALLS) > lists.wall_item.shape[0]:
            return WALLS_FULL
    _join(team, JOIN_LISTS)
    return OK


@inner
def _join_contacts(state):
    """Join the contacts; return a status, the first thread's that is not OK."""
    team, contacts = state.team, state.contacts
    before = 0
    for number in range(team.threads):
        if team.result[8 * number] != OK:
            return int(team.result[8 * number])
        before += team.found[number, CONTACTS]
        if before > contacts.body.shape[0]:
            return CONTACTS_FULL
    if before > contacts.number:
        _join(team, JOIN_CONTACTS)
    contacts.number = before
    return OK


@inner
def _join_events(state):
    """Join the events; return a status, the first thread's that is not OK, and note the body with which it failed."""
    team, events = state.team, state.events
    before = 0
    for number in range(team.threads):
        before += team.found[number, EVENTS]
        if before > events.row.shape[0]:
            return EVENTS_FULL
        if team.result[8 * number] != OK:
            state.bodies.failed = team.found[number, FAILED]
            return int(team.result[8 * number])
    if before > events.number:
        _join(team, JOIN_EVENTS)
    events.number = before
    return OK
