"""Signals that end a run at the end of its tick, with its results."""

import signal
import threading
from collections.abc import Callable, Iterable
from types import FrameType, TracebackType
from typing import Any, Self

from evac.ending import Stopped
from evac.phases import Progress


class Interrupt:
    """The progress of a run that takes the first signal as a wish to stop at the end of the tick.

    A second Ctrl-C stops at once, without results. A signal that was ignored before, as SIGHUP under nohup, stays so.
    Outside of the main thread, which alone gets signals, nothing is changed.

    Parameters
    ----------
    progress : callable, optional
        Called with a `Progress` at every tick.
    names : iterable of str
        Names of the signals; those that the system does not have are left out.
    tell : callable, optional
        Called with the number of the first signal. It is called by the handler, and must not fail.

    Attributes
    ----------
    wanted : int
        Number of the signal, 0 while there was none.
    """

    def __init__(
        self,
        progress: Callable[[Progress], None] | None = None,
        names: Iterable[str] = ("SIGINT",),
        tell: Callable[[int], None] | None = None,
    ) -> None:
        self.progress = progress
        self.wanted = 0
        self._numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
        self._tell = tell
        self._before: dict[int, Any] = {}

    def __call__(self, state: Progress) -> None:
        """Show the state of the run, or stop it."""
        if self.progress is not None:
            self.progress(state)
        if self.wanted:
            raise Stopped

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in self._numbers:
                if signal.getsignal(number) not in (signal.SIG_IGN, None):  # None: not set from Python
                    self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number in list(self._before):
            self.release(number)

    def release(self, number: int) -> None:
        """Let a signal mean again what it meant before."""
        if number in self._before:
            signal.signal(number, self._before.pop(number))

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.wanted = number
        if self._tell is not None:
            self._tell(number)
        self.release(signal.SIGINT)
