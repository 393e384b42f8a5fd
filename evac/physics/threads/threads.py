"""The threads of a run: they serve the step loop during a tick, and wait in Python between two."""

import ctypes
import os
import threading
import weakref
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

import numpy as np

from evac.base.errors import ScenarioError
from evac.jit import Entry
from evac.jit.kernels import INTERPRETED
from evac.jit.processor import cores
from evac.physics.allocation import allocate, make_contacts
from evac.physics.contact.model import ContactModel
from evac.physics.state import Events, Lists, State, Team
from evac.physics.threads.team import LEAVE, Member, conduct, serve

#: People for each thread below which further threads take longer, since a phase waits for threads that do not run
#: because other programs use the same cores. docs/evidence/scaling has the times.
PEOPLE_PER_THREAD = 25_000

#: More threads than this are not taken unless they are asked for.
MOST_BY_DEFAULT = 2


def number_of_threads(wanted: int | None, people: int) -> int:
    """Return the number of threads for a run with a number of people, at most `wanted` if it is not None."""
    if wanted is not None and wanted < 1:
        raise ScenarioError(f"threads: {wanted} given; give 1 or more, or nothing to let the size decide")
    if INTERPRETED:
        return 1
    return max(1, min(MOST_BY_DEFAULT if wanted is None else wanted, people // PEOPLE_PER_THREAD, cores()))


def unused_threads(wanted: int | None, people: int) -> tuple[str, ...]:
    """Return a line for a run that has fewer threads than were wanted, otherwise nothing."""
    number = number_of_threads(wanted, people)
    if wanted is None or number == wanted:
        return ()
    return (
        f"threads: {wanted} given, the steps use {number}: more than one for each core and one for each"
        f" {PEOPLE_PER_THREAD:,} of the {people:,} people take longer, with the same results",
    )


class Threads:
    """The threads of a run. The first one is the thread that calls the step loop; it has others beside it if needed."""

    def __init__(self, state: State, number: int, people: int = 0) -> None:
        self._people = people
        state.team = Team(
            threads=number,
            rest=_address_of_rest(),
            turn=np.zeros(8 * number, np.int64),
            found=np.zeros((number, 8), np.int64),
            result=np.zeros(8 * number),
        )
        self._state = state
        self._members: list[Member] = []
        for k in range(1, number):
            contacts, events = make_contacts(len(state.contacts.body)), allocate(Events, len(state.events.row))
            own, listing = state.replace(contacts=contacts, events=events), state.replace(lists=_own_lists(state))
            self._members.append(Member(number=k, main=state, own=own, listing=listing))
        self._threads: list[threading.Thread] = []
        self._calls: list[SimpleQueue[bool]] = []
        self._done: SimpleQueue[bool] = SimpleQueue()
        self._process = 0
        self._is_serving = False

    def entries(self, model: ContactModel) -> list[Entry]:
        """Return the kernels by which threads share the steps of a model: none of a model whose loop is in Python."""
        return [conduct, serve] if self._members and model.law is not None else []

    @contextmanager
    def serving(self, model: ContactModel) -> Generator[None, None, None]:
        """Let the threads serve the step loop of a model, which is called within."""
        if not self._members or model.law is None or self._state.bodies.inside < self._people:
            yield
            return
        if self._is_serving:  # and was interrupted before all had left
            self.end()
        if self._process != os.getpid():  # not begun, or left behind by a fork
            self._begin()
        for member in self._members:
            _align(member, self._state)
        parts = self._state.parts
        alone = parts.phase
        self._is_serving = True
        try:
            parts.phase = conduct.address
            for call in self._calls:
                call.put(True)
            yield
        finally:
            parts.phase = alone
            conduct(self._state, LEAVE)
        for _ in self._threads:
            self._done.get()
        self._is_serving = False

    def end(self) -> None:
        """End the threads; they begin again when they are needed."""
        if self._process == os.getpid():
            conduct(self._state, LEAVE)
            _dismiss(self._calls)
            for thread in self._threads:
                thread.join()
        self._process = 0
        self._is_serving = False

    def _begin(self) -> None:
        """Begin threads that wait to be called."""
        team = self._state.team
        team.turn[:] = 0
        self._calls = [SimpleQueue() for _ in self._members]
        self._done = SimpleQueue()
        run = ctypes.CFUNCTYPE(None, ctypes.c_int64)(serve.address)
        self._threads = [
            threading.Thread(
                target=_attend, args=(run, member, call, self._done), name=f"evac {member.number}", daemon=True
            )
            for member, call in zip(self._members, self._calls, strict=True)
        ]
        weakref.finalize(self, _dismiss, self._calls)  # also where an interrupt comes before all have begun
        for thread in self._threads:
            thread.start()
        self._process = os.getpid()


def _address_of_rest() -> int:
    """Return the address of the system's function that sleeps, on Windows of one that lets other threads run."""
    windows: Any = getattr(ctypes, "windll", None)
    rest = windows.kernel32.SwitchToThread if windows else ctypes.CDLL(None).usleep
    return ctypes.cast(rest, ctypes.c_void_p).value or 0


def _attend(run: Any, member: Member, call: "SimpleQueue[bool]", done: "SimpleQueue[bool]") -> None:
    """Serve whenever called, until dismissed."""
    while call.get():
        run(member.memory_address)
        done.put(True)


def _dismiss(calls: "Sequence[SimpleQueue[bool]]") -> None:
    """Let threads end that are not serving."""
    for call in calls:
        call.put(False)


def _own_lists(state: State) -> Lists:
    """Return the lists of a run with other arrays for pairs and walls."""
    lists = state.lists
    return lists.replace(pair_body=np.zeros_like(lists.pair_body), wall_item=np.zeros_like(lists.wall_item))


def _align(member: Member, state: State) -> None:
    """Let a thread's state have what the run's has now, and as much room."""
    own, listing = member.own, member.listing
    for name, value in state.values().items():
        if name not in ("contacts", "events"):
            setattr(own, name, value)
        if name != "lists":
            setattr(listing, name, value)
    if len(own.contacts.body) != len(state.contacts.body):
        own.contacts = make_contacts(len(state.contacts.body))
    if len(own.events.row) != len(state.events.row):
        own.events = allocate(Events, len(state.events.row))
    lists, kept = state.lists, listing.lists
    room = len(kept.pair_body) == len(lists.pair_body) and len(kept.wall_item) == len(lists.wall_item)
    if not room or kept.pair_start is not lists.pair_start:
        listing.lists = _own_lists(state)
