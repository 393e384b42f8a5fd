"""The progress display of a run: a bar on a terminal, a line now and then elsewhere; on standard error."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich import progress as bars
from rich.console import Console

if TYPE_CHECKING:
    from evac.simulation import Progress

#: Wall time between two updates of the bar, and between two plain lines [s].
BAR_EVERY = 0.1
LINE_EVERY = 10.0


class Display:
    """Shows people out, simulated time, speed against real time and the time that is left.

    A context manager; call `phase` with what is going on before the loop, and the display itself with a
    `Progress` at every tick.
    """

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False, markup=False, emoji=False)
        self._is_bar = self._console.is_terminal
        self._bar = bars.Progress(
            bars.SpinnerColumn(),
            bars.TextColumn("{task.description}", markup=False),
            bars.BarColumn(bar_width=30),
            bars.TextColumn("{task.fields[numbers]}", markup=False),
            console=self._console,
            transient=True,
            disable=not self._is_bar,
        )
        self._task = self._bar.add_task("starting", total=None, numbers="")
        self._start = self._shown = time.perf_counter()

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def phase(self, what: str) -> None:
        """Say what is going on, and count the speed from here."""
        self._start = time.perf_counter()
        self._bar.update(self._task, description=what)

    def __call__(self, state: "Progress") -> None:
        """Show a tick, unless one was shown just now."""
        now = time.perf_counter()
        if now - self._shown < (BAR_EVERY if self._is_bar else LINE_EVERY):
            return
        self._shown = now
        numbers = numbers_of(state, now - self._start)
        if self._is_bar:
            self._bar.update(
                self._task, description="running", total=state.people, completed=state.out, numbers=numbers
            )
        else:
            print(numbers, file=sys.stderr, flush=True)


def numbers_of(state: "Progress", wall: float) -> str:
    """Return people out, simulated time, speed against real time and the time left, in words.

    The time left is that to the end of ``simulation.duration``, or less where people leave fast enough.
    """
    speed = state.time / wall if wall > 0 else 0.0
    left = (state.duration - state.time) / speed if speed > 0 else 0.0
    bound = "" if state.out else "< "
    if state.out:
        left = min(left, (state.people - state.out) * wall / state.out)
    minutes, seconds = divmod(round(left), 60)
    counts = f"{state.out}/{state.people} out, t = {state.time:.1f} s"
    return f"{counts}, {speed:.3g} x real time, ETA {bound}{minutes}:{seconds:02d}"
