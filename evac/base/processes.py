"""Worker processes that call functions for this one; they do not import its main script, which needs no guard."""

import json
import os
import pickle
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from queue import SimpleQueue
from typing import IO, Any, Self, TypeVar

from evac.base.errors import EvacError, in_one_line

Result = TypeVar("Result")

#: An object as bytes: a pickle without its arrays, and their content.
Packed = tuple[bytes, Sequence[memoryview | bytearray]]

# Ctrl-C reaches all processes; the one that started the others handles it.
_BOOTSTRAP = (
    "import json, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN);"
    " sys.path[:] = json.loads(sys.argv[1]); from evac.base.processes import serve; serve()"
)


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Pool:
    """Local worker processes. Each is started when a task is submitted and no other process is idle.

    A process that dies breaks its task alone, and another one takes its place. The processes end with this one, for
    whatever reason it ends.
    """

    def __init__(
        self,
        workers: int,
        first: tuple[Callable[..., object], tuple[Any, ...]] | None = None,
        *,
        is_quiet: bool = False,
    ) -> None:
        self.workers = workers
        self._first = first
        self._is_quiet = is_quiet
        self._tasks: SimpleQueue[tuple[Future[Any], Any] | None] = SimpleQueue()
        self._left: set[Future[Any]] = set()
        self._threads: list[threading.Thread] = []
        self._processes: list[subprocess.Popen[bytes]] = []
        self._is_open, self._lock = True, threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close(at_once=True)

    def submit(self, function: Callable[..., Result], *arguments: Any) -> "Future[Result]":
        """Submit the call of a function at the level of a module, which must not be the main script.

        Function and arguments are pickled when a process is free, without copies of arrays.
        """
        if len(self._threads) < min(self.workers, len(self._left) + 1):
            self._add_worker()
        future: Future[Result] = Future()
        self._left.add(future)
        future.add_done_callback(self._left.discard)
        self._tasks.put((future, (function, arguments)))
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
            self._kill()
        for thread in self._threads:
            thread.join()
        self._kill()
        for process in self._processes:
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    pipe.close()  # type: ignore[union-attr]

    def _kill(self) -> None:
        """End the processes at once; threads that read from them find the end of the stream."""
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.wait()

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

    def _started(self) -> "subprocess.Popen[bytes]":
        with self._lock:
            if not self._is_open:
                raise OSError("closed")
            self._processes.append(start_worker(self._is_quiet))
            return self._processes[-1]

    def _attend(self, process: "subprocess.Popen[bytes]") -> None:
        """Pass tasks to a process one after another."""
        is_new = True
        while (task := self._tasks.get()) is not None:
            future, call = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                question = packed(call)
            except Exception as error:  # of any kind: what cannot be pickled
                future.set_exception(error)
                continue
            try:
                if is_new and self._first is not None:
                    asked(process, packed(self._first))
                is_new = False
                answer = asked(process, question)
            except Exception as error:  # of any kind: what a process writes before it dies may be cut off
                future.set_exception(BrokenExecutor(in_one_line(error)))
                with suppress(OSError):
                    process, is_new = self._started(), True
                continue
            _settle(future, answer)


def start_worker(is_quiet: bool) -> "subprocess.Popen[bytes]":
    """Start a process that answers questions from its standard input on its standard output."""
    if not sys.executable or getattr(sys, "frozen", False):
        raise OSError("this program is not started by an interpreter of Python")
    folders = json.dumps([os.path.abspath(folder) for folder in sys.path])
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _BOOTSTRAP, folders],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if is_quiet or not _is_open(2) else None,
    )


def _is_open(descriptor: int) -> bool:
    """Return whether a file descriptor is open."""
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def packed(item: object) -> Packed:
    """Return an object as a pickle without its arrays, and their content, which is not copied."""
    buffers: list[pickle.PickleBuffer] = []
    return pickle.dumps(item, protocol=5, buffer_callback=buffers.append), [array.raw() for array in buffers]


def asked(process: "subprocess.Popen[bytes]", question: Packed) -> Packed:
    """Return the answer of a process."""
    assert process.stdin is not None
    assert process.stdout is not None
    _send(process.stdin, question)
    return _received(process.stdout)


def _settle(future: "Future[Any]", answer: Packed) -> None:
    """Give a future the result or the exception of an answer."""
    try:
        result, failure = pickle.loads(answer[0], buffers=answer[1])
    except Exception as error:  # a class that this process does not know, for example
        result, failure = None, error
    if failure is None:
        future.set_result(result)
    else:
        future.set_exception(failure)


def _send(stream: IO[bytes], content: Packed) -> None:
    """Send an object: the pickle and the lengths of the arrays, then the arrays."""
    pickle.dump((content[0], [len(array) for array in content[1]]), stream, protocol=5)
    for array in content[1]:
        stream.write(array)
    stream.flush()


def _received(stream: IO[bytes]) -> Packed:
    """Return what `_send` has sent."""
    content, lengths = pickle.load(stream)
    arrays = [bytearray(length) for length in lengths]
    for array in arrays:
        if stream.readinto(array) != len(array):  # type: ignore[attr-defined]
            raise EOFError
    return content, arrays


# Worker process


def serve() -> None:
    """Call the functions that the other process requests, until it ends."""
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # plugins must neither read questions
    os.dup2(2, 1)  # nor write into answers
    todo: SimpleQueue[Packed] = SimpleQueue()
    threading.Thread(target=_read, args=(questions, todo), daemon=True).start()
    while True:
        _send(answers, _answer(*todo.get()))


def _read(questions: IO[bytes], todo: "SimpleQueue[Packed]") -> None:
    """Read questions; end this process, also in the midst of a task, when the other process has ended."""
    with suppress(Exception):
        while True:
            todo.put(_received(questions))
    os._exit(1)


def _answer(content: bytes, arrays: Sequence[memoryview | bytearray]) -> Packed:
    """Return the result and the exception of a call, of which one is None."""
    try:
        function, arguments = pickle.loads(content, buffers=arrays)
        return packed((function(*arguments), None))
    except Exception as error:
        if not isinstance(error, EvacError):
            error.add_note(f"in a worker process:\n{''.join(traceback.format_exception(error))}")
        with suppress(Exception):
            return packed((None, error))
        return packed((None, RuntimeError(in_one_line(error))))
