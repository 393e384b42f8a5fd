"""Stop a run by a signal at the end of a tick, with results."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, Self


class Interrupt:
    """Notes the first signal, after which the run stops at the end of its tick; a second Ctrl-C stops it at once.

    Signals that were ignored before, such as SIGHUP under nohup, remain ignored. Outside the main thread, which is the
    only one that receives signals, no handler is installed.

    Attributes
    ----------
    wanted : int
        Number of the signal received; 0 if there was none.
    """

    def __init__(self, names: Iterable[str] = ("SIGINT",), announce: Callable[[int], None] | None = None) -> None:
        self.wanted = 0
        self._numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
        self._announce = announce
        self._before: dict[int, Any] = {}

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
        """Restore the previous handler of a signal."""
        if number in self._before:
            signal.signal(number, self._before.pop(number))

    @contextmanager
    def ignored(self) -> Iterator[None]:
        """Ignore Ctrl-C while the results are saved after it."""
        before = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is not threading.main_thread() or before is None:
            yield
            return
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.wanted = number
        self.release(signal.SIGINT)  # before it is announced, so that a second one stops the run from then on
        if self._announce is not None:
            self._announce(number)
