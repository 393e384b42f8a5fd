"""Broken dispatchers of lifts."""

from evac.people.dispatcher import Dispatcher
from tests.conformance.broken import Broken, odd, raising

STATE = iter(range(10**9))

BROKEN = [
    Broken(odd(Dispatcher, next_stop=lambda self, car, calls, time: 99), "check_stops", "its", "the stop of a call"),
    Broken(
        odd(Dispatcher, next_stop=lambda self, car, calls, time: calls[next(STATE) % len(calls)].stop),
        "check_stops",
        "its",
        "asked again",
    ),
    Broken(odd(Dispatcher, next_stop=raising), "check_stops", "its", "KeyError", KeyError),
]
