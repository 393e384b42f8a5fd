"""Several marches at the same time, in worker processes.

scikit-fmm holds the lock of the interpreter, so that threads would march one after another. A worker is sent the grids
once, and then a metric and exits for each march; it answers with the costs.
"""

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack, suppress
from functools import partial
from typing import NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.phases import tell
from evac.building.model.building import Area, Exit
from evac.directions.march.marching import Metric, march
from evac.directions.raster.grids import BuildingGrids
from evac.jit.loading import cores

#: What takes this time, in words.
DIRECTIONS = "computing directions"

#: A worker pays from so many nodes on, counted once for each march: it takes a quarter of a second to start.
NODES_PER_WORKER = 2_500_000

#: Memory of a worker [bytes]: of the process, per node of all grids, and per node of the largest grid for its march.
WORKER_BYTES, WORKER_NODE_BYTES, MARCH_BYTES = 6e7, 40.0, 100.0


class March(NamedTuple):
    """The arguments of a march that differ between the fields of a building; see `march`."""

    metric: Metric
    exits: list[Exit | Area]
    barred: frozenset[tuple[int, int]] = frozenset()
    lifts: bool = False


def number_of_workers(grids: BuildingGrids, marches: int, memory: float, wanted: int | None) -> int:
    """Return how many processes march at the same time; 1 means that this process does.

    All workers may take `memory` [bytes]; at most `wanted` are started, None means one for each core.
    """
    each = WORKER_BYTES + WORKER_NODE_BYTES * grids.size + MARCH_BYTES * max(grid.sheet.size for grid in grids.levels)
    most = (wanted or cores(), cores(), marches, grids.size * marches // NODES_PER_WORKER, int(memory // each))
    return max(1, min(most))


def march_all(
    grids: BuildingGrids, marches: Sequence[March], order: int, workers: int
) -> Generator[FloatArray, None, None]:
    """Yield the costs (nodes,) of marches in their order, with the same bits for any number of workers.

    What the workers do not answer, because one could not be started or was killed, is marched in this process.
    """
    futures: deque[Future[FloatArray]] = deque()
    with ExitStack() as stack:
        if workers > 1:
            from evac.base.processes import Pool

            with suppress(OSError, BrokenExecutor):
                pool = stack.enter_context(Pool(workers, _take, (grids, order), is_quiet=True))
                for metric, exits, barred, lifts in marches:
                    factor = metric.factor[:1] if metric.factor.strides == (0,) else metric.factor  # one number
                    futures.append(pool.submit(_march, metric.slowness, factor, metric.is_plain, exits, barred, lifts))
        levels, count = len(grids.levels), len(marches) * len(grids.levels)
        for number, (metric, exits, barred, lifts) in enumerate(marches):
            done = number * levels
            tell(DIRECTIONS, done, count)
            cost = _answer(futures.popleft()) if futures else None
            if cost is None:
                told = partial(lambda before, reached: tell(DIRECTIONS, before + reached, count), done)
                cost = march(grids, metric, exits, order, barred, lifts, told)
            yield cost
        tell(DIRECTIONS, count, count)


def _answer(future: "Future[FloatArray]") -> FloatArray | None:
    """Return the answer of a worker; None if it died, or could not march for lack of memory, for example."""
    try:
        return future.result()
    except Exception:
        return None


# Worker process

_given: list[tuple[BuildingGrids, int]] = []


def _take(grids: BuildingGrids, order: int) -> None:
    """Keep what all marches need."""
    _given.append((grids, order))


def _march(
    slowness: FloatArray,
    factor: FloatArray,
    is_plain: bool,
    exits: list[Exit | Area],
    barred: frozenset[tuple[int, int]],
    lifts: bool,
) -> FloatArray:
    """Return the costs of a march."""
    ((grids, order),) = _given
    return march(grids, Metric(slowness, np.broadcast_to(factor, grids.size), is_plain), exits, order, barred, lifts)
