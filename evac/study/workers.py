"""Local processes that call functions for this one; they do not import its main script, which needs no guard."""

import os
import pickle
import threading
import traceback
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from queue import SimpleQueue
from subprocess import Popen
from typing import IO, Any, TypeVar

from evac.base.errors import EvacError, ProcessWarning, SimulationError, in_one_line
from evac.base.processes import close_pipes, kill_workers, start_worker

Result = TypeVar("Result")


class LocalPool:
    """Local worker processes. Each is started when a task is submitted and no other process is idle.

    A process that dies breaks its task alone, and another one is started for the next.

    Parameters
    ----------
    workers : int
        Greatest number of processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._tasks: SimpleQueue[tuple[Future[Any], bytes] | None] = SimpleQueue()
        self._left: set[Future[Any]] = set()
        self._threads: list[threading.Thread] = []
        self._processes: list[Popen[bytes]] = []
        self._is_open, self._lock = True, threading.Lock()

    def submit(self, function: Callable[..., Result], *arguments: Any) -> "Future[Result]":
        """Submit the call of a function at the level of a module, which must not be the main script.

        Returns
        -------
        Future
            With the exception `BrokenExecutor` if the process dies.

        Raises
        ------
        OSError
            There is no process, and none can be started.
        """
        question = pickle.dumps((function, arguments), protocol=5)
        if len(self._threads) < min(self.workers, len(self._left) + 1):
            self._add_worker()
        future: Future[Result] = Future()
        self._left.add(future)
        future.add_done_callback(self._left.discard)
        self._tasks.put((future, question))
        return future

    def close(self, at_once: bool = False) -> None:
        """End the processes; busy ones finish their tasks, unless `at_once`."""
        with self._lock:
            self._is_open = False
        for future in list(self._left):
            future.cancel()
        for _ in self._threads:
            self._tasks.put(None)
        if at_once:
            kill_workers(self._processes)
        for thread in self._threads:
            thread.join()
        kill_workers(self._processes)
        close_pipes(self._processes)

    def _add_worker(self) -> None:
        """Start a process and the thread that attends to it; if that fails, be content with those that exist."""
        try:
            thread = threading.Thread(target=self._attend, args=(self._started(),), daemon=True)
            thread.start()
        except (OSError, RuntimeError) as error:  # a process, or a thread, cannot be started
            if not self._threads:
                raise OSError(in_one_line(error)) from error
            self.workers = len(self._threads)
        else:
            self._threads.append(thread)

    def _started(self) -> "Popen[bytes]":
        """Start a process whose errors are shown beside those of this one."""
        with self._lock:
            if not self._is_open:
                raise OSError("closed")
            self._processes.append(start_worker(__name__, is_quiet=False))
            return self._processes[-1]

    def _attend(self, process: "Popen[bytes]") -> None:
        """Pass tasks to a process one after another."""
        while (task := self._tasks.get()) is not None:
            future, question = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                answer = _asked(process, question)
            except Exception as error:  # of any kind: what a process writes before it dies may be cut off
                with suppress(OSError):
                    process = self._started()
                future.set_exception(BrokenExecutor(in_one_line(error)))
                continue
            _settle(future, answer)


def died() -> SimulationError:
    """Return the error for worker processes that were killed or could not be started."""
    return SimulationError(
        "worker processes ended unexpectedly, possibly for lack of memory; use fewer (--jobs, from Python workers=1)"
    )


def warn_alone(why: str) -> None:
    """Warn that this process makes all runs."""
    warnings.warn(f"{why}; all runs are made in this process", ProcessWarning, stacklevel=2)


def _settle(future: "Future[Any]", answer: bytes) -> None:
    """Give a future the result or the exception of an answer."""
    try:
        result, failure = pickle.loads(answer)
    except Exception as error:  # a class that this process does not know, for example
        result, failure = None, error
    if failure is None:
        future.set_result(result)
    else:
        future.set_exception(failure)


def _asked(process: "Popen[bytes]", question: bytes) -> bytes:
    """Return the answer of a process."""
    assert process.stdin is not None
    assert process.stdout is not None
    _send(process.stdin, question)
    answer = pickle.load(process.stdout)
    assert isinstance(answer, bytes)
    return answer


def _send(stream: IO[bytes], content: bytes) -> None:
    """Send bytes as a pickle, which contains their number."""
    pickle.dump(content, stream, protocol=5)
    stream.flush()


# Worker process


def serve() -> None:
    """Call the functions that the other process requests, until it ends."""
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # plugins must neither read questions
    os.dup2(2, 1)  # nor write into answers
    todo: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_read, args=(questions, todo), daemon=True).start()
    while True:
        _send(answers, _answer(todo.get()))


def _read(questions: IO[bytes], todo: "SimpleQueue[bytes]") -> None:
    """Read questions; end this process, also in the midst of a task, when the other process has ended."""
    with suppress(Exception):
        while True:
            todo.put(pickle.load(questions))
    os._exit(1)


def _answer(question: bytes) -> bytes:
    """Return the pickle of the result and of the exception of a call, of which one is None."""
    try:
        function, arguments = pickle.loads(question)
        return pickle.dumps((function(*arguments), None), protocol=5)
    except Exception as error:
        if not isinstance(error, EvacError):
            error.add_note(f"in a worker process:\n{''.join(traceback.format_exception(error))}")
        with suppress(Exception):
            return pickle.dumps((None, error), protocol=5)
        return pickle.dumps((None, RuntimeError(in_one_line(error))), protocol=5)
