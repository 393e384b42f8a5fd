"""Progress of a run and of long loops, and the wall time of a run by phase."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")

#: What shows how far loops are, see `track`; the last is called with a description, the steps done, and their number.
shown_by: list[Callable[[str, int, int], None]] = []

#: Phases in the order in which they begin. "preparation" is the time before the run that belongs to no other phase,
#: "kernels" the time for loading and compiling code, "output" the time for everything that is shown or written.
PHASES = ("preparation", "building", "directions", "people", "kernels", "behaviours", "physics", "recording", "output")


@dataclass(frozen=True)
class Progress:
    """The state of a run that a progress display gets at every tick."""

    time: float  # simulated [s]
    duration: float  # [s]
    people: int
    out: int

    @property
    def is_over(self) -> bool:
        """Whether everybody is out or the duration is over, so that the results are being written."""
        return self.out == self.people or self.time >= self.duration


def track(what: str, items: Iterable[T], count: int) -> Iterator[T]:
    """Yield `count` items, and report how many of them are done to the display, if there is one."""
    for done, item in enumerate(items):
        show_steps(what, done, count)
        yield item
    show_steps(what, count, count)


def show_steps(what: str, done: int, count: int) -> None:
    """Have it shown, if a command does so, how many of some steps are done."""
    if shown_by:
        shown_by[-1](what, done, count)


def reading(stages: int) -> None:
    """Have it shown how many of the stages in which a building is made are done: surface, cleaning, levels."""
    show_steps("reading the building", stages, 3)


class Phases:
    """A clock that assigns wall time to phases: always to the innermost phase that has been entered."""

    def __init__(self) -> None:
        self._seconds = dict.fromkeys(PHASES, 0.0)
        self._entered: list[str] = []
        self._charged = 0.0  # time up to which everything is assigned [s]

    @contextmanager
    def enter(self, name: str) -> Iterator[None]:
        """Assign the time within the context to the phase `name` of `PHASES`, except that of phases entered within."""
        self._charge()
        self._entered.append(name)
        try:
            yield
        finally:
            self._charge()
            self._entered.pop()

    def turn_to(self, name: str) -> None:
        """Assign the time from now on to another phase than that entered last, instead of it."""
        self._charge()
        self._entered[-1] = name

    def seconds(self) -> dict[str, float]:
        """Return the wall time of each phase so far [s], in the order of `PHASES`."""
        self._charge()
        return dict(self._seconds)

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add the wall time [s] that the phases of this run took in an earlier process."""
        for name, more in seconds.items():
            self._seconds[name] += more

    def _charge(self) -> None:
        now = time.perf_counter()
        if self._entered:
            self._seconds[self._entered[-1]] += now - self._charged
        self._charged = now
