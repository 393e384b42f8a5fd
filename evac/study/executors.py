"""Processes of this machine, and executors of others."""

import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from os import cpu_count
from typing import TYPE_CHECKING, Any, TypeVar

from evac.errors import EvacError, SimulationError

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Windows waits for no more processes than these.
MOST_WORKERS = 61

#: How often Dask makes a task again whose worker has died, beside what it does by itself.
DASK_RETRIES = 3

#: Runs are handed to executors of others in tasks of about so long [s]: Dask takes some milliseconds for each.
TASK_SECONDS = 0.5

#: Tasks that an executor has at once if it does not say how many workers it has.
UNKNOWN_IN_FLIGHT = 64


class LocalPool:
    """Worker processes of this machine. Each starts when a task is submitted that no other one is free for.

    Parameters
    ----------
    workers : int
        The most processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = min(workers, MOST_WORKERS)
        self._before: set[BaseProcess] = set(active_children())
        self._pool: ProcessPoolExecutor | None = None

    @property
    def executor(self) -> ProcessPoolExecutor:
        """The pool, made when it is first needed."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self.workers,
                mp_context=get_context("spawn"),
                initializer=signal.signal,  # Ctrl-C reaches all processes; this one alone decides what it means
                initargs=(signal.SIGINT, signal.SIG_IGN),
            )
        return self._pool

    def renew(self) -> None:
        """Forget a pool whose processes have died."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None

    def close(self, at_once: bool = False) -> None:
        """End the processes; those that are busy finish what they do, unless `at_once`."""
        if self._pool is None:
            return
        if at_once:
            for process in active_children():
                if process not in self._before:
                    process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None


def workers_of(executor: Executor) -> int | None:
    """Return how many workers an executor says that it has now, or None."""
    client = getattr(executor, "_client", None)
    if client is not None and hasattr(client, "nthreads"):
        return sum(map(int, client.nthreads().values()))
    workers = getattr(executor, "_max_workers", None)
    return workers if isinstance(workers, int) else None


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler, and return it as an executor.

    Parameters
    ----------
    address : str
        Such as ``"tcp://10.0.0.1:8786"``, or the path of a scheduler file.

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
        At module level. What it returns depends on the item alone.
    items : iterable
        Picklable. Make each worth a second or more: one call per item.
    workers : int
        Processes; 1 computes in this one.

    Yields
    ------
    What the function returns.

    Raises
    ------
    SimulationError
        A process was killed, or could not start.
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
    except Exception:  # what has begun is waited for
        at_once = False
        raise
    finally:
        pool.close(at_once)


def died() -> SimulationError:
    """Return the error of processes that do not live."""
    return SimulationError(
        "a process ended before its time: too little memory? use fewer of them. A script that starts processes has "
        "its commands under: if __name__ == '__main__':"
    )
