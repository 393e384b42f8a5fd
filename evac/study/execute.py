"""Execution of the runs of a study: in this process, in a pool of local processes, or by a given executor."""

import logging
import math
import os
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError, ProcessWarning, SimulationError, in_one_line
from evac.base.processes import Pool
from evac.base.progress import Progress
from evac.case.case import Case
from evac.case.loading import case_from
from evac.contract.registry import Registry
from evac.results.ending import EVERYBODY_OUT, EVERYBODY_SAFE, FAILED, INTERRUPTED, Stopped
from evac.results.results import Results
from evac.results.tables import numbers_of
from evac.simulation.shared import SharedSceneFile, shared_scene, simulation_of, write_shared_scene
from evac.study.maps import maps_of
from evac.study.points import SEEDS, Point, Seeds

#: Estimated wall time of the remaining tasks from which a pool makes them: its processes take half of it to start [s].
JOINING = 3.0

IN_FLIGHT = 1000  #: Number of tasks that a given executor has at a time.
DASK_RETRIES = 3  #: Number of times that Dask repeats a task whose worker has died, in addition to its own attempts.


@dataclass(frozen=True)
class Order:
    """The data that a process needs to execute runs of a point; picklable."""

    point: int
    where: str  # words that name the point in messages; empty if it is the only one
    digest: str  # of the case, which is loaded only once in each process
    table: Mapping[str, Any]  # the case, see `evac.case.loading.case_from`
    source: Path
    plugin_files: tuple[Path, ...]
    seeds: Seeds
    key: str  # of the shared scene
    shared_scene: SharedSceneFile | None = None  # if it has been written
    is_mapped: bool = False  # whether maps are made


@dataclass(frozen=True)
class Row:
    """The stored results of a run."""

    point: int
    run: int
    seed: int
    population_seed: int | None  # seed of the properties of people, if it differs from `seed`
    ended: str  # as in `Results`; "failed" for a run without results, because of an error
    time: float = math.nan  # simulated time [s]; NaN for a failed run
    # time at which the last person left [s]; infinite if people are left inside, NaN for a failed run
    last_out: float = math.nan
    # for each exit: name, number of people who left by it, time at which the last of them left [s] or None
    exits: tuple[tuple[str, int, float | None], ...] = ()
    # (people,) float64 [s]: NaN for people still inside
    exit_time: FloatArray = field(default_factory=lambda: np.empty(0))
    # (people,) int16: index in `exits`; -1 for people still inside
    exit_used: NDArray[np.int16] = field(default_factory=lambda: np.empty(0, np.int16))
    quality_warnings: tuple[str, ...] = ()
    told: Mapping[str, Any] = field(default_factory=dict)  # the columns `TOLD` of the store
    maps: Sequence[Mapping[str, Any]] = ()  # see `evac.study.maps.maps_of`
    error: EvacError | None = None  # why the run failed, with its seed in a note

    @property
    def is_blocked(self) -> bool:
        """Whether people are left inside at the end of a run that did not fail."""
        return self.ended not in (EVERYBODY_OUT, EVERYBODY_SAFE, FAILED)


@dataclass(frozen=True)
class Task:
    """A run of a point."""

    order: Order
    run: int


class Execution:
    """Executes tasks: in this process while that is faster, then in a pool of processes; or all by a given executor."""

    def __init__(self, points: Sequence[Point], workers: int, executor: Executor | None = None) -> None:
        self._points, self._workers, self._executor = points, workers, executor
        self._pool: Pool | None = None
        self._files: dict[str, SharedSceneFile | None] = {}
        self._folder = TemporaryDirectory(prefix="evac-study-", ignore_cleanup_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._renew()
        self._folder.cleanup()

    def rows(self, waiting: deque[Task]) -> Iterator[Row]:
        """Yield the row of each task as soon as it has ended; tasks may be added meanwhile."""
        if self._executor is None and self._pool is None:
            yield from self._rows_made_here(waiting)
        try:
            yield from self._rows_made_elsewhere(waiting)
        except OSError as error:
            warn_alone(f"no other process can be started: {error}")
            self._renew()
            self._workers = 1
            yield from self._rows_made_here(waiting)

    def _rows_made_here(self, waiting: deque[Task]) -> Iterator[Row]:
        """Yield the rows of tasks until a pool is faster; a run that takes too long is given up for that."""
        spent, made = 0.0, 0
        while waiting and not self._pays(spent / max(made, 1), len(waiting)):
            task, begin = waiting.popleft(), time.perf_counter()
            tick = partial(self._tick, begin, waiting) if self._workers > 1 else None
            row = make_row(task, self._points[task.order.point].case, tick)
            spent, made = spent + time.perf_counter() - begin, made + 1
            if row.ended == INTERRUPTED:
                waiting.appendleft(task)
            else:
                yield row

    def _tick(self, begin: float, waiting: Sized, progress: Progress) -> None:
        if self._pays(time.perf_counter() - begin, len(waiting) + 1):
            raise Stopped

    def _pays(self, seconds: float, tasks: int) -> bool:
        """Return whether a pool is faster for so many tasks, each of which takes some seconds here."""
        return self._workers > 1 and tasks > 1 and seconds * tasks >= JOINING

    def _rows_made_elsewhere(self, waiting: deque[Task]) -> Iterator[Row]:
        """Yield the rows of tasks of the pool or the executor."""
        running: dict[Future[Row], Task] = {}
        most = self._workers if self._executor is None else IN_FLIGHT
        try:
            while waiting or running:
                while waiting and len(running) < most:
                    running[self._submitted(waiting[0])] = waiting[0]
                    waiting.popleft()
                done = wait(running, return_when=FIRST_COMPLETED).done
                broken = {future for future in done if self._pool and isinstance(future.exception(), BrokenExecutor)}
                for future in done - broken:
                    yield _row_of(future, running.pop(future))
                if broken:
                    unfinished = list(running.values())
                    running.clear()
                    yield from self._rows_made_singly(unfinished)
        finally:
            for future in running:
                future.cancel()
            waiting.extendleft(running.values())

    def _rows_made_singly(self, tasks: Sequence[Task]) -> Iterator[Row]:
        """Yield the rows of tasks of a broken pool, each executed alone: if its process dies again, its run failed."""
        self._renew()
        for task in tasks:
            try:
                row = self._submitted(task).result()
            except BrokenExecutor:
                self._renew()
                error = SimulationError(
                    "the process that made this run ended unexpectedly, twice, possibly for lack of memory; use fewer"
                    " processes (--jobs, from Python workers=1)"
                )
                row = _failed_row(task, error)
            yield row

    def _renew(self) -> None:
        """End the processes of the pool; the next task starts others."""
        if self._pool is not None:
            self._pool.kill()
        self._pool = None

    def _submitted(self, task: Task) -> "Future[Row]":
        """Submit a task to the pool or the executor, with the file of its shared scene."""
        task = replace(task, order=replace(task.order, shared_scene=self._shared(task.order)))
        if self._executor is None and self._pool is None:
            self._pool = Pool(self._workers)
        try:
            return (self._executor or self._pool).submit(make_row, task)  # type: ignore[union-attr]
        except BrokenExecutor as error:
            future: Future[Row] = Future()
            future.set_exception(error)
            return future
        except (OSError, RuntimeError) as error:
            if self._executor is None:
                raise OSError(in_one_line(error)) from error
            raise SimulationError(
                f"the executor accepts no task: {in_one_line(error)}; continue with --resume or resume=True"
            ) from error

    def _shared(self, order: Order) -> SharedSceneFile | None:
        """Return the file of a shared scene, written when it is first needed; None if the scene cannot be made."""
        if order.key not in self._files:
            self._files[order.key] = None
            with suppress(EvacError):  # the worker tells why
                scene = shared_scene(self._points[order.point].case, order.key)
                self._files[order.key] = write_shared_scene(scene, Path(self._folder.name))
        return self._files[order.key]


def _row_of(future: "Future[Row]", task: Task) -> Row:
    """Return the row of a task that has ended, or raise why it was not executed."""
    error = None if future.cancelled() else future.exception()
    if isinstance(error, EvacError):
        raise error
    if error is not None or future.cancelled():
        why = "its task was given up, as when the scheduler has ended" if error is None else in_one_line(error)
        raise SimulationError(
            f"the worker did not make {_named(task)}: {why}; see its log, then continue with --resume or resume=True"
        ) from error
    return future.result()


def make_row(task: Task, case: Case | None = None, tick: Callable[[Progress], None] | None = None) -> Row:
    """Execute a task in this process; an error of the run makes a row with that error."""
    order, base = task.order, case if case is not None else _case_of(task.order)
    try:
        recorded = {"output.trajectory": True} if order.is_mapped else {}
        case = base.change(order.seeds.changes(task.run) | recorded)
        simulation = simulation_of(case, order.key, order.shared_scene, in_memory=True)
        results = simulation.run(tick)
        simulation.release()
        maps, numbers = maps_of(results) if order.is_mapped else ([], [])  # finds the queues as well
        row = _row(task, results)
        return replace(row, maps=maps, told={**row.told, "tables": [*row.told["tables"], *numbers]})
    except EvacError as error:
        return _failed_row(task, error)


def _row(task: Task, results: Results) -> Row:
    """Return the row of a run."""
    crowd, population_seed = results.crowd, results.settings["simulation"].get("population_seed")
    return Row(
        task.order.point,
        task.run,
        results.seed,
        population_seed,
        results.ended,
        time=results.time,
        last_out=results.last_out if results.is_complete and results.last_out is not None else math.inf,
        exits=tuple((name, use["people"], use["last_out"]) for name, use in results.exits.items()),
        exit_time=crowd.exit_time[results.leaving],
        exit_used=crowd.exit_used[results.leaving].astype(np.int16),
        quality_warnings=tuple(results.quality_warnings),
        told=_told(results),
    )


def _told(results: Results) -> dict[str, Any]:
    """Return what a run tells besides its times: number of people, the numbers of its tables, and compartments."""
    return {
        "people": len({*results.leaving.tolist(), *(row for place in results.places for row in place.people)}),
        "tables": list(numbers_of(results)),
        "compartments": [] if results.safety is None else results.safety["compartments"],
    }


def _failed_row(task: Task, error: EvacError) -> Row:
    """Return the row of a run that failed; its seed and, in a study of several points, its point are noted."""
    changes = task.order.seeds.changes(task.run)
    copy = type(error)(*error.args)  # without the simulation to which the traceback of the error refers
    copy.__cause__ = error.__cause__
    for note in getattr(error, "__notes__", ()):
        copy.add_note(note)
    copy.add_note(f"in {_named(task)}")
    return Row(task.order.point, task.run, changes[SEEDS[0]], changes.get(SEEDS[1]), FAILED, error=copy)


def _named(task: Task) -> str:
    """Return the words that name the run of a task in messages."""
    seeds = ", ".join(f"{key} = {seed}" for key, seed in task.order.seeds.changes(task.run).items())
    return f"the run with {seeds}{task.order.where}"


def order_of(point: Point, seeds: Seeds, digest: str, key: str, is_mapped: bool) -> Order:
    """Return the order for the runs of a point."""
    case = point.case
    where = f" at the point {point.label}" if point.parameters else ""
    files = case.registry.files()
    return Order(point.index, where, digest, case.table, case.source, files, seeds, key, is_mapped=is_mapped)


_cases: dict[str, Case] = {}


@lru_cache(maxsize=8)
def _registry(plugin_files: tuple[Path, ...]) -> Registry:
    """Return the registry of a study, created once in each process."""
    return Registry(plugin_files)


def _case_of(order: Order) -> Case:
    """Return the checked case of an order; only that of the last point is cached."""
    if order.digest not in _cases:
        registry = _registry(order.plugin_files)
        case = case_from(order.table, order.source, plugin_files=order.plugin_files, registry=registry)
        _cases.clear()
        _cases[order.digest] = case
    return _cases[order.digest]


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler and yield an executor."""
    try:
        from distributed import Client
    except ImportError as error:
        raise EvacError('dask.distributed is not installed: pip install "evac[dask]"') from error
    where = {"scheduler_file": address} if os.path.exists(address) else {"address": address}
    # What Dask logs of a lost connection, with tracebacks, also later, is told by an error of the study.
    before = logging.root.manager.disable
    logging.disable()
    try:
        client = Client(**where, timeout=10, set_as_default=False)
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise EvacError(
            f"no Dask scheduler answers at {address}: {in_one_line(error)}; start one, and give its address, such as "
            "tcp://10.0.0.1:8786, or the file that dask scheduler --scheduler-file has written"
        ) from error
    try:
        yield client.get_executor(pure=False, retries=DASK_RETRIES)
    finally:
        with suppress(Exception):  # of a scheduler that has ended
            client.close(timeout=10)
    logging.disable(before)


def warn_alone(why: str) -> None:
    """Warn that this process makes all runs."""
    warnings.warn(f"{why}; all runs are made in this process", ProcessWarning, stacklevel=2)
