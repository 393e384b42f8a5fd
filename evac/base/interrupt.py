"""Stop a run by a signal at the end of a tick, with results."""

import signal
import threading
from collections.abc import Callable, Iterable
from types import FrameType, TracebackType
from typing import Any, Self


def never() -> bool:
    """Return False."""
    return False


class Interrupt:
    """Counts signals: after the first one, the run stops at the end of its tick, and after the next, its outputs stop.

    A third one raises KeyboardInterrupt anywhere, as does a second one if `may_break`, while recorders finish. `wanted`
    is the number of the last one. Signals that were ignored before, such as SIGHUP under nohup, remain ignored. Outside
    the main thread, which is the only one that receives signals, no handler is installed.
    """

    def __init__(self, names: Iterable[str] = ("SIGINT",), announce: Callable[[int], None] | None = None) -> None:
        self.wanted = self.count = 0
        self.may_break: Callable[[], bool] = never
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
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.wanted, self.count = number, self.count + 1
        if self.count > 2 or (self.count == 2 and self.may_break()):
            raise KeyboardInterrupt
        if self._announce is not None and self.count == 1:
            self._announce(number)
