"""The runs of a study: the order for the process that executes them, and the row with the results of one."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError
from evac.base.phases import Progress
from evac.results.ending import EVERYBODY_OUT, EVERYBODY_SAFE, FAILED
from evac.simulation.assembly import make_behaviours, make_contact_model, make_population
from evac.simulation.shared import GroundFile, shared_ground, simulation_of
from evac.study.points import SEEDS, Point, Seeds

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.contract.registry import Registry


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
    key: str  # of the ground
    ground: GroundFile | None = None  # if it has been written


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
    # tuple of (str, int, float): for each exit: name, number of people who left by it, time at which the last of them
    # left [s] or NaN
    exits: tuple[tuple[str, int, float], ...] = ()
    # (people,) float64 [s]: NaN for people still inside
    exit_time: FloatArray = field(default_factory=lambda: np.empty(0))
    # (people,) int16: index in `exits`; -1 for people still inside
    exit_used: NDArray[np.int16] = field(default_factory=lambda: np.empty(0, np.int16))
    quality_warnings: tuple[str, ...] = ()
    wall_time: float = 0.0  # wall time of the run without building and directions [s]; not part of the tables
    error: EvacError | None = None  # why the run failed, with its seed in a note

    @property
    def is_blocked(self) -> bool:
        """Whether people are left inside at the end of a run that did not fail."""
        return self.ended not in (EVERYBODY_OUT, EVERYBODY_SAFE, FAILED)


@dataclass(frozen=True)
class Task:
    """Some runs of a point, for one process; or, with `only_check`, whether these runs are refused.

    They are refused if their people cannot be placed, have no ways, or are not accepted by the contact model.
    """

    order: Order
    runs: tuple[int, ...]
    only_check: bool = False


def make_rows(task: Task, case: "Case | None" = None, tick: Callable[[Progress], None] | None = None) -> list[Row]:
    """Execute a task in this process; an error of `evac.run` makes a row with that error."""
    base = case if case is not None else _case_of(task.order)
    if task.only_check:
        return _refused(task, base)
    return [_make_run(task.order, base, run, tick) for run in task.runs]


def _refused(task: Task, base: "Case") -> list[Row]:
    order, rows = task.order, []
    try:
        ground = shared_ground(base, order.key, order.ground)
    except EvacError as error:
        return [_failed_row(order, run, error) for run in task.runs]
    for run in task.runs:
        try:
            case = base.change(order.seeds.changes(run))
            case.registry.call_all("evac_configure", case=case, registry=case.registry)
            make_population(case, ground, make_contact_model(case), make_behaviours(case))
        except EvacError as error:
            rows.append(_failed_row(order, run, error))
    return rows


def _make_run(order: Order, base: "Case", run: int, tick: Callable[[Progress], None] | None) -> Row:
    start = time.perf_counter()
    try:
        case = base.change(order.seeds.changes(run))
        simulation = simulation_of(case, order.key, order.ground)
        made = sum(simulation.phases.seconds()[phase] for phase in ("building", "directions", "kernels"))
        results = simulation.run(tick)
    except EvacError as error:
        return _failed_row(order, run, error, time.perf_counter() - start)
    crowd = results.crowd
    exits = []
    for exit_ in results.building.exits:
        times = crowd.exit_time[crowd.exit_used == exit_.index]
        exits.append((exit_.name, len(times), float(times.max()) if len(times) else math.nan))
    return Row(
        order.point,
        run,
        results.seed,
        case.simulation.population_seed,
        results.ended,
        time=results.time,
        last_out=results.last_out if results.is_complete and results.last_out is not None else math.inf,
        exits=tuple(exits),
        exit_time=crowd.exit_time[results.leaving],
        exit_used=crowd.exit_used[results.leaving].astype(np.int16),
        quality_warnings=tuple(results.quality_warnings),
        wall_time=time.perf_counter() - start - made,
    )


def _failed_row(order: Order, run: int, error: EvacError, wall_time: float = 0.0) -> Row:
    """Return the row of a run that failed; its seed and, in a study of several points, its point are noted."""
    changes = order.seeds.changes(run)
    told = type(error)(*error.args)  # without the simulation to which the traceback of the error refers
    told.__cause__ = error.__cause__
    for note in getattr(error, "__notes__", ()):
        told.add_note(note)
    told.add_note(f"in the run with {', '.join(f'{key} = {seed}' for key, seed in changes.items())}{order.where}")
    seeds = changes[SEEDS[0]], changes.get(SEEDS[1])
    return Row(order.point, run, *seeds, FAILED, wall_time=wall_time, error=told)


def order_of(point: Point, seeds: Seeds, digest: str, key: str) -> Order:
    """Return the order for the runs of a point."""
    case = point.case
    where = f" at the point {point.label}" if point.parameters else ""
    return Order(point.index, where, digest, case.table, case.source, case.registry.files(), seeds, key)


_cases: dict[str, "Case"] = {}


@lru_cache(maxsize=8)
def _registry(plugin_files: tuple[Path, ...]) -> "Registry":
    """Return the registry of a study, created once in each process."""
    from evac.contract.registry import Registry

    return Registry(plugin_files)


def _case_of(order: Order) -> "Case":
    """Return the checked case of an order; only that of the last point is cached."""
    from evac.case.loading import case_from

    if order.digest not in _cases:
        case = case_from(
            order.table, order.source, plugin_files=order.plugin_files, registry=_registry(order.plugin_files)
        )
        _cases.clear()
        _cases[order.digest] = case
    return _cases[order.digest]
