"""Phases of a step on several threads, to the bits of one: each thread has a piece of the bodies.

A thread writes what belongs to the bodies of its piece, and lists, contacts and events to arrays of its own; these are
joined in the order of pieces, which is the order of bodies. What a thread needs to do before another one goes on is a
phase of its own: the first thread says which it is, does its piece and waits for the others. Loaded only where a run
has several threads.
"""

from evac.jit import AddressCall, Ints, Struct, acquire, claim, inner, kernel, pause, release
from evac.physics.contact.blocks import call_block
from evac.physics.contact.contacts import find_contacts, set_reach, take_velocities
from evac.physics.contact.neighbours import list_pairs, list_walls, sort_into_cells
from evac.physics.drive import call_drive, set_desired
from evac.physics.motion import move, remember
from evac.physics.state import Problem, State
from evac.physics.status import CONTACTS_FULL, EVENTS_FULL, OK, PAIRS_FULL, WALLS_FULL
from evac.physics.threads import pieces
from evac.physics.threads.pieces import piece_of

#: A thread that waits looks so often before it sleeps, and so long [us]. Where others want its core, to let them run
#: without sleeping costs it a whole slice of their time.
LOOKS, NAP = 10000, 50

#: Sleep for so many microseconds.
call_rest = AddressCall([int], (int,))


class Member(Struct):
    """A thread beside the first."""

    number: int
    own: State  # the run's, but for contacts and events
    pair_body: Ints
    wall_item: Ints
    main: State


@inner
def _wait(team, words, place, word):
    """Wait until another thread has raised a word of `words` to a value, or beyond."""
    looks = 0
    while acquire(words, place) < word:
        pause()
        looks += 1
        if looks == LOOKS:
            call_rest(team.rest, NAP)
            looks = 0


@kernel
def serve(member: Member) -> None:
    """Do this thread's piece of each phase until the threads are to leave."""
    team, number = member.main.team, member.number
    last = acquire(team.turn, 8 * number)
    while True:
        _wait(team, team.turn, 0, last + 1)
        last = acquire(team.turn, 0)
        phase = last % pieces.PHASES
        if phase == pieces.LEAVE:
            break
        if phase >= pieces.SOLVE:
            _make_blocks(member.main.problem, last, number)
        else:
            _do(member.own, member.main, member.pair_body, member.wall_item, phase, number)
        release(team.turn, 8 * number, last)
    release(team.turn, 8 * number, last)


@kernel
def conduct(state: State, phase: int) -> float:
    """Make a phase with all threads; return the greatest speed [m/s], or a status."""
    team = state.team
    if phase == pieces.LIST:
        sort_into_cells(state.bodies, state.lists)
    _together(state, phase)
    if phase == pieces.DRIVE:
        fastest = 0.0
        for number in range(team.threads):
            fastest = max(fastest, team.fastest[8 * number])
        return fastest
    status = OK
    if phase == pieces.LIST:
        status = _join_lists(state)
    elif phase == pieces.FIND:
        status = _join_contacts(state)
    elif phase == pieces.MOVE:
        status = _join_events(state)
    return float(status)


@kernel
def conduct_blocks(rows: Problem, phase: int) -> int:
    """Make a phase of the solver with all threads; a thread that is late finds that others have done its blocks."""
    team = rows.team
    word = _begin(team, pieces.SOLVE + phase, rows.blocks)
    _make_blocks(rows, word, 0)
    for block in range(rows.blocks):
        _wait(team, team.made, 8 * block, word)
    return 0


@inner
def _make_blocks(rows, word, number):
    """Make a phase of the solver on the blocks that no thread has begun, a thread's own share first.

    A thread may come when the phase is over and the problem is another one. Then all blocks of the phase have begun.
    """
    team, phase, blocks = rows.team, word % pieces.PHASES, word // pieces.PHASES % pieces.MOST_BLOCKS
    first = blocks * number // team.threads
    for k in range(blocks):
        block = (first + k) % blocks
        if claim(team.begun, 8 * block, word):
            call_block(rows.make_phase, rows, phase - pieces.SOLVE, block)
            release(team.made, 8 * block, word)


@inner
def _together(state, phase):
    """Let every thread do its piece of a phase, and wait for all."""
    team = state.team
    word = _begin(team, phase, 0)
    if phase == pieces.LEAVE:
        return
    _do(state, state, state.lists.pair_body, state.lists.wall_item, phase, 0)
    for number in range(1, team.threads):
        _wait(team, team.turn, 8 * number, word)


@inner
def _begin(team, phase, blocks):
    """Let the other threads begin a phase; return its word, see `evac.physics.threads.pieces.PHASES`."""
    number = acquire(team.turn, 0) // (pieces.PHASES * pieces.MOST_BLOCKS) + 1
    word = (number * pieces.MOST_BLOCKS + blocks) * pieces.PHASES + phase
    release(team.turn, 0, word)
    return word


@inner
def _do(own, main, pair_body, wall_item, phase, number):
    """Do a thread's piece of a phase."""
    team, world, bodies, clock = main.team, main.world, main.bodies, main.clock
    first, last = piece_of(bodies, number, team.threads)
    if phase == pieces.OPEN:
        remember(bodies, first, last)
    elif phase == pieces.LOOK:
        set_desired(world, bodies, first, last)
    elif phase == pieces.DRIVE:
        team.fastest[8 * number] = call_drive(main.parts.drive, main, first, last)
    elif phase == pieces.REACH:
        set_reach(bodies, first, last, clock.h, main.traits.reach_share)
    elif phase == pieces.TAKE:
        take_velocities(bodies, first, last)
    elif phase == pieces.LIST:
        used, room = list_pairs(world, bodies, main.lists, pair_body, first, last)
        team.found[number, pieces.PAIRS] = used
        team.found[number, pieces.ROOM] = room
        team.found[number, pieces.WALLS] = list_walls(world, bodies, main.lists, wall_item, first, last)
    elif phase == pieces.FIND:
        team.found[number, pieces.STATUS] = find_contacts(own, first, last)
        team.found[number, pieces.CONTACTS] = own.contacts.number
    elif phase == pieces.MOVE:
        if number > 0:
            own.events.number = 0
        status = move(own, first, last, clock.time, clock.h, main.traits.old_share, True)
        team.found[number, pieces.STATUS] = status
        team.found[number, pieces.EVENTS] = own.events.number
        team.found[number, pieces.FAILED] = own.events.failed
    elif number > 0:
        _hand_over(own, main, pair_body, wall_item, phase, number)


@inner
def _before(team, number, what):
    """Return how many of what the threads before a thread have found."""
    total = 0
    for other in range(number):
        total += team.found[other, what]
    return total


@inner
def _hand_over(own, main, pair_body, wall_item, phase, number):
    """Copy what a thread has found behind what those before it have."""
    team = main.team
    if phase == pieces.JOIN_LISTS:
        lists = main.lists
        first, last = piece_of(main.bodies, number, team.threads)
        pairs, walls = _before(team, number, pieces.PAIRS), _before(team, number, pieces.WALLS)
        for i in range(first, last):
            lists.pair_start[i + 1] += pairs
            lists.wall_start[i + 1] += walls
        for k in range(team.found[number, pieces.PAIRS]):
            lists.pair_body[pairs + k] = pair_body[k]
        for k in range(team.found[number, pieces.WALLS]):
            lists.wall_item[walls + k] = wall_item[k]
    elif phase == pieces.JOIN_CONTACTS:
        given, kept = own.contacts, main.contacts
        before = _before(team, number, pieces.CONTACTS)
        for k in range(given.number):
            c = before + k
            kept.body[c] = given.body[k]
            kept.other[c] = given.other[k]
            kept.key[c] = given.key[k]
            kept.normal[c, 0] = given.normal[k, 0]
            kept.normal[c, 1] = given.normal[k, 1]
            kept.gap[c] = given.gap[k]
            kept.omega[c] = given.omega[k]
            kept.velocity_before[c] = given.velocity_before[k]
            kept.percussion[c] = given.percussion[k]
            kept.bias[c] = 0.0
            kept.friction[c] = 0.0
            kept.sticky[c] = 0
    elif phase == pieces.JOIN_EVENTS:
        before = _before(team, number, pieces.EVENTS)
        for k in range(own.events.number):
            main.events.row[before + k] = own.events.row[k]
            main.events.kind[before + k] = own.events.kind[k]
            main.events.link[before + k] = own.events.link[k]
            main.events.time[before + k] = own.events.time[k]


@inner
def _join_lists(state):
    """Join the lists; return a status."""
    team, lists = state.team, state.lists
    before = 0
    for number in range(team.threads):
        used = team.found[number, pieces.PAIRS]
        if used < 0 or before + team.found[number, pieces.ROOM] > lists.pair_body.shape[0]:
            return PAIRS_FULL
        before += used
    before = 0
    for number in range(team.threads):
        used = team.found[number, pieces.WALLS]
        if used < 0 or before + used > lists.wall_item.shape[0]:
            return WALLS_FULL
        before += used
    _together(state, pieces.JOIN_LISTS)
    lists.stale = 0
    return OK


@inner
def _join_contacts(state):
    """Join the contacts; return a status, the first thread's that is not OK."""
    team, contacts = state.team, state.contacts
    before = 0
    for number in range(team.threads):
        if team.found[number, pieces.STATUS] != OK:
            return team.found[number, pieces.STATUS]
        before += team.found[number, pieces.CONTACTS]
        if before > contacts.body.shape[0]:
            return CONTACTS_FULL
    if before > contacts.number:
        _together(state, pieces.JOIN_CONTACTS)
    contacts.number = before
    return OK


@inner
def _join_events(state):
    """Join the events; return a status, the first thread's that is not OK, and note the body with which it failed."""
    team, events = state.team, state.events
    before = 0
    for number in range(team.threads):
        before += team.found[number, pieces.EVENTS]
        if before > events.row.shape[0]:
            return EVENTS_FULL
        if team.found[number, pieces.STATUS] != OK:
            state.bodies.failed = team.found[number, pieces.FAILED]
            return team.found[number, pieces.STATUS]
    if before > events.number:
        _together(state, pieces.JOIN_EVENTS)
    events.number = before
    return OK
