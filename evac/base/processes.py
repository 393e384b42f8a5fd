"""A pool of worker processes that do not import the main script and end with the process that started them."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import wait
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess, parent_process
from types import ModuleType
from typing import Any


class Pool(ProcessPoolExecutor):
    """A pool of processes, each of which makes a first call; used as a context, it ends them at once.

    A process that dies breaks the pool: all its unfinished tasks raise `concurrent.futures.BrokenExecutor`.
    """

    def __init__(
        self,
        workers: int,
        first: Callable[..., object] | None = None,
        arguments: tuple[Any, ...] = (),
        *,
        is_quiet: bool = False,
    ) -> None:
        super().__init__(workers, _Context(), _begin, (is_quiet, first, arguments))

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        """End the processes at once, also in the midst of a result, at the end of which nobody waits then."""
        if self._result_queue is not None:  # type: ignore[attr-defined]
            self._result_queue._writer.close()  # type: ignore[attr-defined]
        for process in list((self._processes or {}).values()):
            process.kill()
        self.shutdown(cancel_futures=True)


class _Process(SpawnProcess):
    """A process that is started without the main script, and with Ctrl-C blocked, which the starting one handles."""

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:  # noqa: N802
        main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        has_masks = hasattr(signal, "pthread_sigmask")  # Windows has none
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,)) if has_masks else ()
        try:
            return SpawnProcess._Popen(process_obj)  # type: ignore[attr-defined]
        finally:
            if has_masks:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            sys.modules["__main__"] = main


class _Context(SpawnContext):
    """What starts processes of the class above."""

    Process = _Process  # type: ignore[assignment]


# Worker process


def _begin(is_quiet: bool, first: Callable[..., object] | None, arguments: tuple[Any, ...]) -> None:
    """Prepare a worker: it ends with the process that started it, also in the midst of a task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if is_quiet:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
    if first is not None:
        first(*arguments)


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
