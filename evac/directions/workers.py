"""Several marches at the same time, in worker processes.

scikit-fmm holds the lock of the interpreter, so that threads would march one after another. A worker is sent the grids
once, and then a metric and exits for each march; it answers with the costs.
"""

import pickle
import subprocess
import sys
import threading
from collections.abc import Generator, Sequence
from contextlib import suppress
from queue import SimpleQueue
from typing import NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.processes import close_pipes, kill_workers, start_worker
from evac.building.model.building import Exit
from evac.directions.grids import BuildingGrids
from evac.directions.marching import Metric, march
from evac.jit.workers import cores

#: A worker pays from so many nodes on, counted once for each march: it takes a quarter of a second to start.
NODES_PER_WORKER = 2_500_000

#: Memory of a worker [bytes]: of the process, per node of all grids, and per node of the largest grid for its march.
WORKER_BYTES, WORKER_NODE_BYTES, MARCH_BYTES = 6e7, 40.0, 100.0


class March(NamedTuple):
    """The arguments of a march that differ between the fields of a building; see `march`."""

    metric: Metric
    exits: list[Exit]


def number_of_workers(grids: BuildingGrids, marches: int, memory: float, wanted: int | None) -> int:
    """Return how many processes march at the same time; 1 means that this process does.

    Parameters
    ----------
    grids : BuildingGrids
    marches : int
    memory : float
        What all workers may take [bytes].
    wanted : int or None
        Greatest number; None means one for each core.
    """
    each = WORKER_BYTES + WORKER_NODE_BYTES * grids.size + MARCH_BYTES * max(grid.sheet.size for grid in grids.levels)
    most = (wanted or cores(), cores(), marches, grids.size * marches // NODES_PER_WORKER, int(memory // each))
    return max(1, min(most))


def march_all(
    grids: BuildingGrids, marches: Sequence[March], order: int, workers: int
) -> Generator[FloatArray, None, None]:
    """Yield the costs (nodes,) of marches in their order, with the same bits for any number of workers.

    What a worker does not answer, because it could not be started or was killed, is marched in this process.

    Parameters
    ----------
    grids : BuildingGrids
    marches : sequence of March
    order : {1, 2}
        Order of the marching stencil.
    workers : int
        Number of processes that march at the same time; 1 means that this process does.
    """
    processes: list[subprocess.Popen[bytes]] = []
    threads: list[threading.Thread] = []
    todo: SimpleQueue[int] = SimpleQueue()
    done: SimpleQueue[tuple[int, FloatArray] | None] = SimpleQueue()
    for index in range(len(marches)):
        todo.put(index)

    def attend(worker: subprocess.Popen[bytes]) -> None:
        """Ask a worker until nothing is left to do (`queue.Empty`) or it has died."""
        with suppress(Exception):  # of any kind: what a worker writes may be cut off, or not be an answer at all
            _send(worker, (grids, order))
            while True:
                index = todo.get_nowait()
                done.put((index, _asked(worker, marches[index])))
        done.put(None)

    found: dict[int, FloatArray] = {}
    try:
        for _ in range(workers if workers > 1 else 0):
            with suppress(OSError):
                processes.append(start_worker(__name__))
                threads.append(threading.Thread(target=attend, args=(processes[-1],), daemon=True))
                threads[-1].start()
        attended = len(threads)
        for index, (metric, exits) in enumerate(marches):
            while index not in found and attended:
                attended -= _take(done, found)
            yield found.pop(index) if index in found else march(grids, metric, exits, order)
    finally:
        kill_workers(processes)
        for thread in threads:
            thread.join()
        close_pipes(processes)


def _take(done: "SimpleQueue[tuple[int, FloatArray] | None]", found: dict[int, FloatArray]) -> bool:
    """Wait for an answer and add it to those found; True if instead a worker answers no more."""
    answer = done.get()
    if answer is not None:
        found[answer[0]] = answer[1]
    return answer is None


def _asked(worker: subprocess.Popen[bytes], task: March) -> FloatArray:
    """Return the answer of a worker."""
    factor = task.metric.factor
    if factor.strides == (0,):  # one number, repeated
        factor = factor[:1]
    _send(worker, (task.metric.slowness, factor, task.metric.is_plain, task.exits))
    assert worker.stdout is not None
    cost: FloatArray = pickle.load(worker.stdout)
    return cost


def _send(worker: subprocess.Popen[bytes], question: object) -> None:
    assert worker.stdin is not None
    pickle.dump(question, worker.stdin, protocol=5)
    worker.stdin.flush()


def serve() -> None:
    """March what the other process asks for, until it closes the pipe."""
    questions, answers = sys.stdin.buffer, sys.stdout.buffer
    with suppress(EOFError):
        grids, order = pickle.load(questions)
        while True:
            slowness, factor, is_plain, exits = pickle.load(questions)
            metric = Metric(slowness, np.broadcast_to(factor, grids.size), is_plain)
            pickle.dump(march(grids, metric, exits, order), answers, protocol=5)
            answers.flush()
