"""Execution of functions in processes: local ones, and those of other executors."""

import json
import logging
import os
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from pathlib import Path

from evac.base.errors import EvacError, ProcessWarning, SimulationError, in_one_line

#: Number of times that Dask repeats a task whose worker has died, in addition to its own attempts.
DASK_RETRIES = 3

#: Approximate length of a task for a given executor [s]: Dask has an overhead of some milliseconds per task.
TASK_SECONDS = 0.5

#: Number of submitted tasks if the executor does not report its number of workers.
UNKNOWN_IN_FLIGHT = 64


def workers_of(executor: Executor) -> int | None:
    """Return the current number of workers of an executor, or None if it does not report it."""
    client = getattr(executor, "_client", None)
    if client is not None and hasattr(client, "nthreads"):
        return sum(map(int, client.nthreads().values()))
    workers = getattr(executor, "_max_workers", None)
    return workers if isinstance(workers, int) else None


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler and yield an executor."""
    try:
        from distributed import Client
    except ImportError as error:
        raise EvacError('dask.distributed is not installed: pip install "evac[dask]"') from error
    is_address = ":" in address and not os.path.exists(address)
    where = address if is_address else _address_in(address)
    # What Dask logs of a lost connection, with tracebacks, also later, is told by an error of the study.
    before = logging.root.manager.disable
    logging.disable()
    try:
        client = Client(where, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EvacError(
            f"no Dask scheduler answers at {address}: {in_one_line(error)}; start one, or check the address"
        ) from error
    try:
        yield client.get_executor(pure=False, retries=DASK_RETRIES)
    finally:
        with suppress(Exception):  # of a scheduler that has ended
            client.close(timeout=10)
    logging.disable(before)


def _address_in(path: str) -> str:
    """Return the address in a scheduler file."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
        address = found["address"]
        if not isinstance(address, str):
            raise TypeError("its address is not text")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise EvacError(
            f"{path}: not a scheduler file of Dask: {in_one_line(error)}; give the file that dask scheduler "
            "--scheduler-file has written, or an address such as tcp://10.0.0.1:8786"
        ) from error
    return address


def died() -> SimulationError:
    """Return the error for worker processes that were killed or could not be started."""
    return SimulationError(
        "worker processes ended unexpectedly, possibly for lack of memory; use fewer (--jobs, from Python workers=1)"
    )


def warn_alone(why: str) -> None:
    """Warn that this process makes all runs."""
    warnings.warn(f"{why}; all runs are made in this process", ProcessWarning, stacklevel=2)
