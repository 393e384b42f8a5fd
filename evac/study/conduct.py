"""Execution of the runs of a study: in this process, in further local processes, or by a given executor."""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from evac.base.errors import EvacError, SimulationError, in_one_line
from evac.base.phases import Progress
from evac.base.processes import Pool
from evac.results.ending import Stopped
from evac.simulation.shared import GroundFile, shared_ground, write_ground
from evac.study.executors import TASK_SECONDS, UNKNOWN_IN_FLIGHT, died, warn_alone, workers_of
from evac.study.points import Point
from evac.study.runs import Order, Row, Task, make_rows

#: Start-up cost of a further process: it is started only if there is at least this much work for it [s].
JOINING = 1.5

#: Number of consecutive failures of processes after which the study fails.
MOST_DEATHS = 3

#: Time for which the number of workers of a given executor is cached [s].
WORKERS_FOR = 5.0

#: Number of runs that are checked together.
CHECKED_TOGETHER = 10


class Conductor:
    """Executes or checks the requested runs, and passes on each row as soon as its run has ended."""

    def __init__(
        self, points: Sequence[Point], on_row: Callable[[Row], None], workers: int, executor: Executor | None = None
    ) -> None:
        self._points = points
        self._on_row = on_row
        self._executor = executor
        self._pool = Pool(workers - 1) if executor is None and workers > 1 else None
        self._waiting: deque[Task] = deque()
        self._running: dict[Future[list[Row]], Task] = {}
        self._deaths = 0
        self._spent, self._made = 0.0, 0
        self._begun: float | None = None  # time at which the current run of this process began
        self._failure: EvacError | None = None
        self._workers: tuple[float, int | None] = (-math.inf, None)
        self._folder = Path()
        self._files: dict[str, GroundFile | None] = {}

    def ask(self, order: Order, runs: Iterable[int]) -> None:
        """Request runs of a point."""
        self._waiting.extend(Task(order, (run,)) for run in runs)

    def ask_check(self, order: Order, runs: Sequence[int]) -> None:
        """Request that runs of a point are checked; there will be rows of those that are refused."""
        for k in range(0, len(runs), CHECKED_TOGETHER):
            self._waiting.append(Task(order, tuple(runs[k : k + CHECKED_TOGETHER]), only_check=True))

    def conduct(self) -> None:
        """Execute all requested tasks, including those that are requested meanwhile."""
        at_once = True
        self._spent, self._made, self._files = 0.0, 0, {}
        with TemporaryDirectory(prefix="evac-study-", ignore_cleanup_errors=True) as folder:
            self._folder = Path(folder)
            try:
                while self._waiting or self._running:
                    self._look_after_others()
                    if self._waiting and self._executor is None:
                        self._make_here()
                    elif self._running:
                        wait(self._running, return_when=FIRST_COMPLETED)
                at_once = False
            finally:
                for future in self._running:
                    future.cancel()
                if self._pool is not None:
                    self._pool.close(at_once)

    def _look_after_others(self) -> None:
        self._collect()
        self._submit()

    def _make_here(self) -> None:
        """Execute one task in this process, and collect the rows of other processes at each of its ticks."""
        task = self._waiting.popleft()
        self._begun = time.perf_counter()
        rows = make_rows(task, self._points[task.order.point].case, self._tick)
        if task.only_check:
            self._spent += time.perf_counter() - self._begun
            self._made += 1
        self._begun = None
        if self._failure is not None:
            raise self._failure
        self._note(task, rows)

    def _tick(self, progress: Progress) -> None:
        try:
            self._look_after_others()
        except EvacError as error:  # from another run, not from the one in this process
            self._failure = error
            raise Stopped from error

    def _note(self, task: Task, rows: Sequence[Row]) -> None:
        if not task.only_check:
            self._spent += sum(row.wall_time for row in rows)
            self._made += len(rows)
        for row in rows:
            self._on_row(row)

    def _seconds(self) -> float:
        """Return the estimated wall time of a run, or of a task that checks some [s]."""
        known = self._spent / self._made if self._made else 0.0
        return max(known, time.perf_counter() - self._begun) if self._begun is not None else known

    def _submit(self) -> None:
        """Submit as many tasks as can be executed soon."""
        if self._executor is not None:
            workers = self._workers_there()
            room = UNKNOWN_IN_FLIGHT if workers is None else max(UNKNOWN_IN_FLIGHT, 4 * workers)
        elif self._pool is not None and self._waiting:
            joining = min(self._pool.workers, int(self._seconds() * len(self._waiting) / JOINING))
            joining = max(joining, min(self._pool.workers, len(self._running)))  # processes in use stay in use
            room = 2 * joining if joining == self._pool.workers else joining
        else:
            return
        executor = self._executor or self._pool
        assert executor is not None
        while self._waiting and len(self._running) < room:
            task = self._next_task()
            try:
                self._running[executor.submit(make_rows, task)] = task
            except (OSError, RuntimeError) as error:
                self._waiting.appendleft(task)
                if self._executor is not None:
                    raise SimulationError(
                        f"the executor accepts no task: {in_one_line(error)}; continue with --resume"
                    ) from error
                self._pool = None
                warn_alone(f"no other process can be started: {error}")
                return

    def _next_task(self) -> Task:
        """Remove and return the next task: a run of one point, or for a given executor several short runs."""
        task = self._waiting.popleft()
        order, runs = task.order, task.runs
        if self._executor is not None and self._made:
            share = math.ceil((len(self._waiting) + 1) / (2 * (self._workers_there() or 1)))
            wanted = min(share, math.ceil(TASK_SECONDS / max(self._seconds(), 1e-3)))
            while len(runs) < wanted and self._waiting and self._waiting[0].order == order:
                runs += self._waiting.popleft().runs
        return replace(task, order=replace(order, ground=self._shared(order)), runs=runs)

    def _workers_there(self) -> int | None:
        """Return the number of workers of the executor, cached because asking takes a network round trip."""
        assert self._executor is not None
        now = time.monotonic()
        if now - self._workers[0] > WORKERS_FOR:
            try:
                self._workers = now, workers_of(self._executor)
            except Exception as error:  # of a scheduler that has ended
                raise SimulationError(
                    f"the executor does not answer: {in_one_line(error)}; continue with --resume"
                ) from error
        return self._workers[1]

    def _shared(self, order: Order) -> GroundFile | None:
        """Return the file of a ground, which this process writes when it is first needed.

        It is None if the ground cannot be made: the worker then reports why.
        """
        if order.key not in self._files:
            self._files[order.key] = None
            with suppress(EvacError):
                ground = shared_ground(self._points[order.point].case, order.key)
                self._files[order.key] = write_ground(ground, self._folder)
        return self._files[order.key]

    def _collect(self) -> None:
        """Collect the rows of tasks that have ended; tasks of a killed process are executed again."""
        for future in [future for future in self._running if future.done()]:
            task = self._running.pop(future)
            error = None if future.cancelled() else future.exception()
            if isinstance(error, EvacError):
                raise error
            if self._pool is not None and isinstance(error, BrokenExecutor):
                self._waiting.appendleft(task)
                self._deaths += 1
                if self._deaths > MOST_DEATHS:
                    raise died()
            elif error is not None or future.cancelled():
                runs = task.runs
                raise SimulationError(
                    f"runs {runs[0]} to {runs[-1]}: the task failed on its worker: {error!r}; see its log, then "
                    "continue with --resume"
                ) from error
            else:
                self._deaths = 0
                self._note(task, future.result())
