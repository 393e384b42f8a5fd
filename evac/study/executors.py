"""Local processes, and other executors."""

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from os import cpu_count
from typing import TYPE_CHECKING, Any, TypeVar

from evac.errors import EvacError, SimulationError

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Windows can wait for at most this many processes.
MOST_WORKERS = 61

#: Number of times that Dask repeats a task whose worker has died, in addition to its own attempts.
DASK_RETRIES = 3

#: Approximate length of a task for a given executor [s]: Dask has an overhead of some milliseconds per task.
TASK_SECONDS = 0.5

#: Number of submitted tasks if the executor does not report its number of workers.
UNKNOWN_IN_FLIGHT = 64


class LocalPool:
    """Local worker processes. Each is started when a task is submitted and no other process is idle.

    Parameters
    ----------
    workers : int
        Greatest number of processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = min(workers, MOST_WORKERS)
        self._before: set[BaseProcess] = set(active_children())
        self._pool: ProcessPoolExecutor | None = None

    @property
    def executor(self) -> ProcessPoolExecutor:
        """The pool, created when first needed."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self.workers,
                mp_context=get_context("spawn"),
                initializer=_begin_worker,
            )
        return self._pool

    def renew(self) -> None:
        """Discard a pool whose processes have died."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None

    def close(self, at_once: bool = False) -> None:
        """End the processes; busy ones finish their tasks, unless `at_once`."""
        if self._pool is None:
            return
        if at_once:
            for process in active_children():
                if process not in self._before:
                    process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None


def _begin_worker() -> None:
    """Ignore Ctrl-C, which the process that started this one handles; end with that process, for whatever reason."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def workers_of(executor: Executor) -> int | None:
    """Return the current number of workers of an executor, or None if it does not report it."""
    client = getattr(executor, "_client", None)
    if client is not None and hasattr(client, "nthreads"):
        return sum(map(int, client.nthreads().values()))
    workers = getattr(executor, "_max_workers", None)
    return workers if isinstance(workers, int) else None


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler and yield an executor.

    Parameters
    ----------
    address : str
        Address such as ``"tcp://10.0.0.1:8786"``, or the path of a scheduler file.

    Raises
    ------
    EvacError
        dask.distributed is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise EvacError('dask.distributed is not installed: pip install "evac[dask]"') from error
    where: dict[str, Any] = {"address": address} if ":" in address else {"scheduler_file": address}
    try:
        client = Client(**where, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EvacError(f"no Dask scheduler answers at {address}: {error}; start one, or check the address") from error
    try:
        yield client.get_executor(pure=False, retries=DASK_RETRIES)
    finally:
        client.close(timeout=10)


def in_processes(function: Callable[[Item], Result], items: Iterable[Item], workers: int) -> Iterator[Result]:
    """Yield ``function(item) for item in items``, computed in processes; the order is that of the items.

    Parameters
    ----------
    function : callable
        Function at module level, whose result depends only on the item.
    items : iterable
        Picklable items, each with at least about a second of work: there is one call per item.
    workers : int
        Number of processes; 1 computes in this process.

    Yields
    ------
    The results of the function.

    Raises
    ------
    SimulationError
        A process was killed or could not be started.
    """
    if workers == 1:
        yield from map(function, items)
        return
    pool = LocalPool(min(workers, cpu_count() or 1))
    at_once = True
    try:
        futures = [pool.executor.submit(function, item) for item in items]
        for future in futures:
            yield future.result()
        at_once = False
    except BrokenExecutor as error:
        raise died() from error
    except Exception:  # wait for tasks that have begun
        at_once = False
        raise
    finally:
        pool.close(at_once)


def died() -> SimulationError:
    """Return the error for worker processes that were killed or could not be started."""
    return SimulationError(
        "a worker process ended unexpectedly, possibly for lack of memory; use fewer processes. In a script, put the "
        "commands under: if __name__ == '__main__':"
    )
