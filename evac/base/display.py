"""The progress of a run: a bar on a terminal, occasional lines elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

from rich import progress as bars
from rich.console import Console

from evac.base.errors import counted
from evac.base.progress import Progress, shown_by

#: Wall time between two updates of the bar, and between two plain lines of a run and of several [s]; the first
#: line of a loop or run comes as early as those of several runs.
BAR_EVERY = 0.1
LINE_EVERY = 10.0
RUNS_EVERY = 2.0


class Display:
    """Shows people out, simulated time, speed relative to real time and the estimated time left.

    A context manager; call `phase` with a description of each phase before the loop, and the display itself with a
    `Progress` at every tick. It also shows how far loops are that tell it (`evac.base.progress.track`).
    """

    def __init__(self, has_lines: bool = True) -> None:
        self._has_lines = has_lines
        self._console = Console(stderr=True, highlight=False, markup=False, emoji=False)
        # Variables such as FORCE_COLOR make rich treat any file as a terminal.
        self._is_bar = self._console.is_terminal and sys.stderr.isatty() and not self._console.is_dumb_terminal
        self._bar = bars.Progress(
            bars.SpinnerColumn("line" if self._console.options.ascii_only else "dots"),
            bars.TextColumn("{task.description}", markup=False),
            bars.BarColumn(bar_width=30),
            bars.TextColumn("{task.fields[numbers]}", markup=False),
            bars.TimeElapsedColumn(),
            console=self._console,
            transient=True,
            disable=not self._is_bar,
        )
        self._task = self._bar.add_task("starting", total=None, numbers="")
        self._start = self._shown = time.perf_counter()
        self._first: Progress | None = None
        self._is_entered, self._what, self._named = False, "", "working"

    def __enter__(self) -> Self:
        self._bar.start()
        shown_by.append(self.steps)
        self._is_entered = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shown_by.remove(self.steps)
        self._bar.stop()

    def phase(self, what: str) -> None:
        """Show the name of the current phase, also between the loops within it."""
        self._named = what
        self._bar.reset(self._task, total=None, description=what, numbers="")

    def compiling(self, done: int, kernels: int) -> None:
        """Show how many kernels have been compiled; the directions are computed after the last."""
        if self._what != "compiling" and not self._is_bar:
            self._print(f"compiling {counted(kernels, 'kernel')}, kept for later runs")
        self.steps("compiling", done, kernels)

    def steps(self, what: str, done: int, count: int) -> None:
        """Show how many steps of a phase are done, and the estimated time left."""
        now = time.perf_counter()
        if what != self._what:
            self._what = what
            self._begin(now)
        if done == count:
            self._what = ""
            self.phase(self._named)
            if not self._is_entered:
                self._bar.stop()
        elif done and now - self._shown >= (BAR_EVERY if self._is_bar else LINE_EVERY):
            self._shown = now
            numbers = f"{done}/{count}, ETA {_clock((now - self._start) * (count - done) / done)}"
            if self._is_bar:
                self._bar.start()  # of a command that has no display of its own, until the loop ends
                self._bar.update(self._task, description=what, total=count, completed=done, numbers=numbers)
            else:
                self._print(f"{what}: {numbers}")

    def _begin(self, now: float) -> None:
        """Measure speed from now on, and let the first plain line come early."""
        self._start, self._shown = now, now if self._is_bar else now - LINE_EVERY + RUNS_EVERY

    def line(self, text: str) -> None:
        """Print a permanent line above the bar."""
        self._console.print(text, soft_wrap=True)

    def _print(self, line: str) -> None:
        if self._has_lines:
            print(line, file=sys.stderr, flush=True)

    def __call__(self, state: Progress) -> None:
        """Show a tick unless the last update is recent; speed is measured after the first tick, which may load code."""
        now = time.perf_counter()
        if self._first is None:
            self._first = state
            self._begin(now)
            self.phase("running")
            return
        if now - self._shown < (BAR_EVERY if self._is_bar else LINE_EVERY) and not (self._is_bar and state.is_over):
            return
        self._shown = now
        numbers = numbers_of(self._first, state, now - self._start)
        if self._is_bar:
            self._bar.update(self._task, total=state.people, completed=state.out, numbers=numbers)
        else:
            self._print(numbers)

    def runs(self, done: int, runs: int) -> None:
        """Show how many of several runs are done; without a terminal, occasional lines are printed."""
        if self._is_bar:
            self._bar.update(
                self._task, description="running", total=runs, completed=done, numbers=f"{done}/{runs} runs"
            )
        elif done in (1, runs) or time.perf_counter() - self._shown >= RUNS_EVERY:
            self._shown = time.perf_counter()
            self._print(f"{done}/{runs} runs")


@contextmanager
def displayed(progress: Callable[[Progress], None] | bool | None) -> Iterator[Callable[[Progress], None] | None]:
    """Enter the display of a run started from Python, and return the function to call at every tick."""
    if callable(progress):
        yield progress
    elif progress is False:
        yield None
    elif progress is True or (hasattr(sys, "ps1") or sys.stderr.isatty()):
        with Display(has_lines=progress is True) as display:
            yield display
    else:
        yield None


def numbers_of(first: Progress, state: Progress, wall: float) -> str:
    """Return people out, simulated time, speed relative to real time and the estimated time left as a text.

    Speed and time left follow from the progress since `first`, in `wall` [s]; the run may end before its duration.
    """
    counts = f"{state.out}/{state.people} out, t = {state.time:.1f} s"
    if state.is_over:
        return f"{counts}, writing the results"
    speed = (state.time - first.time) / wall if wall > 0 else 0.0
    left = (state.duration - state.time) / speed if speed > 0 else 0.0
    gone = state.out - first.out
    bound = "" if gone else "< "
    if gone:
        left = min(left, (state.people - state.out) * wall / gone)
    return f"{counts}, {speed:.3g} x real time, ETA {bound}{_clock(left)}"


def _clock(seconds: float) -> str:
    """Return a time as minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"
