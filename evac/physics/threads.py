"""The threads of a run: they serve the step loop during a tick, and wait in Python between two."""

import ctypes
import os
import sys
import threading
import weakref
from collections.abc import Generator
from contextlib import contextmanager

import numpy as np

from evac.jit.kernels import INTERPRETED
from evac.physics import pieces
from evac.physics.allocation import allocate, make_contacts
from evac.physics.state import Events, State, Team
from evac.physics.team import Member, conduct, serve

#: The system's function that lets other threads run.
_REST = ctypes.windll.kernel32.SwitchToThread if sys.platform == "win32" else ctypes.CDLL(None).sched_yield


class Threads:
    """Threads beside the one that calls the step loop.

    Parameters
    ----------
    state : State
        Of the run.
    number : int
        Threads in all, the caller's among them.
    """

    def __init__(self, state: State, number: int) -> None:
        self.number = number
        rest = ctypes.cast(_REST, ctypes.c_void_p).value or 0
        state.team = Team(
            threads=number,
            phase=pieces.OPEN,
            rest=rest,
            turn=np.zeros(8 * number, np.int64),
            found=np.zeros((number, 8), np.int64),
            fastest=np.zeros(8 * number),
        )
        self._members = [_member_of(state, k) for k in range(1, number)]
        self._calls = [threading.Semaphore(0) for _ in self._members]
        self._done = threading.Semaphore(0)
        self._process = 0

    @contextmanager
    def serving(self, state: State) -> Generator[None, None, None]:
        """Let the threads serve the step loop, which is called within."""
        for member in self._members:
            _align(member, state)
        if self._process != os.getpid():  # not begun, or left behind by a fork
            self._begin()
        for call in self._calls:
            call.release()
        state.parts.team = conduct.address
        try:
            yield
        finally:
            state.parts.team = 0
            conduct(state, pieces.LEAVE)
            for _ in self._calls:
                self._done.acquire()

    def _begin(self) -> None:
        self._process = os.getpid()
        self._calls = [threading.Semaphore(0) for _ in self._members]
        self._done = threading.Semaphore(0)
        run = ctypes.CFUNCTYPE(None, ctypes.c_int64)(serve.address)
        for member, call in zip(self._members, self._calls, strict=True):
            args = (run, member, call, self._done)
            threading.Thread(target=_attend, args=args, daemon=True, name=f"evac {member.number}").start()
        weakref.finalize(self, _end, self._calls)


def _end(calls: list[threading.Semaphore]) -> None:
    for call in calls:
        call.leave = True
        call.release()


def _attend(run, member, call, done) -> None:
    """Serve whenever called."""
    while True:
        call.acquire()
        if getattr(call, "leave", False):
            return
        run(member.memory_address)
        done.release()


def _member_of(state: State, number: int) -> Member:
    own = state.replace(
        contacts=make_contacts(len(state.contacts.body)), events=allocate(Events, len(state.events.row))
    )
    pairs, walls = np.zeros_like(state.lists.pair_body), np.zeros_like(state.lists.wall_item)
    return Member(number=number, own=own, pair_body=pairs, wall_item=walls, main=state)


def _align(member: Member, state: State) -> None:
    """Let a thread's state have what the run's has now, and as much room."""
    own = member.own
    for name in State.kinds:
        if name not in ("contacts", "events") and getattr(own, name) is not getattr(state, name):
            setattr(own, name, getattr(state, name))
    if len(own.contacts.body) != len(state.contacts.body):
        own.contacts = make_contacts(len(state.contacts.body))
    if len(own.events.row) != len(state.events.row):
        own.events = allocate(Events, len(state.events.row))
    if len(member.pair_body) != len(state.lists.pair_body):
        member.pair_body = np.zeros_like(state.lists.pair_body)
    if len(member.wall_item) != len(state.lists.wall_item):
        member.wall_item = np.zeros_like(state.lists.wall_item)
