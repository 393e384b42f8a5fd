"""The runs of a study: the order for the process that executes them, and the row with the results of one."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray
from evac.ending import EVERYBODY_OUT
from evac.errors import EvacError
from evac.output.results import Results
from evac.phases import Progress
from evac.study.points import Point, Seeds
from evac.study.shared import GroundFile, simulation_of

if TYPE_CHECKING:
    from evac.registry import Registry
    from evac.scenario.case import Case


@dataclass(frozen=True)
class Order:
    """The data that a process needs to execute runs of a point; picklable.

    Attributes
    ----------
    point : int
    digest : str
        Digest of the case, which is loaded only once in each process.
    table, source, plugin_files
        The case, see `evac.scenario.loading.case_from`.
    seeds : Seeds
    key : str
        Key of the ground.
    ground : GroundFile or None
        File of the ground, if it has been written.
    """

    point: int
    digest: str
    table: Mapping[str, Any]
    source: Path
    plugin_files: tuple[Path, ...]
    seeds: Seeds
    key: str
    ground: GroundFile | None = None


@dataclass(frozen=True)
class Row:
    """The stored results of a run.

    Attributes
    ----------
    point, run, seed : int
    population_seed : int or None
        Seed of the properties of people, if it differs from `seed`.
    ended : str
        As in `Results`.
    time : float
        Simulated time [s].
    last_out : float
        Time at which the last person left [s]; infinite if people are left inside.
    exits : tuple of (str, int, float)
        For each exit: name, number of people who left by it, time at which the last of them left [s] or NaN.
    exit_time : (people,) float64 [s]
        NaN for people still inside.
    exit_used : (people,) int16
        Index in `exits`; -1 for people still inside.
    quality_warnings : tuple of str
    wall_time : float
        Wall time of the run without building and directions [s]; not part of the tables.
    """

    point: int
    run: int
    seed: int
    population_seed: int | None
    ended: str
    time: float
    last_out: float
    exits: tuple[tuple[str, int, float], ...]
    exit_time: FloatArray
    exit_used: NDArray[np.int16]
    quality_warnings: tuple[str, ...]
    wall_time: float

    @property
    def is_blocked(self) -> bool:
        """Whether people are left inside."""
        return self.ended != EVERYBODY_OUT


def make_runs(
    order: Order, runs: tuple[int, ...], case: "Case | None" = None, tick: Callable[[Progress], None] | None = None
) -> list[Row]:
    """Execute some runs of a point in this process.

    Parameters
    ----------
    order : Order
    runs : tuple of int
    case : Case, optional
        The case of the order, if it is already loaded.
    tick : callable, optional
        Called at every tick of each run.

    Raises
    ------
    EvacError
        An error of `evac.run` in the first run that fails, with its seed in a note.
    """
    base = case if case is not None else _case_of(order)
    return [_make_run(order, base, run, tick) for run in runs]


def _make_run(order: Order, base: "Case", run: int, tick: Callable[[Progress], None] | None) -> Row:
    changes = order.seeds.changes(run)
    try:
        case = base.change(changes)
        start = time.perf_counter()
        simulation = simulation_of(case, order.key, order.ground)
        made = sum(simulation.phases.seconds()[phase] for phase in ("building", "directions", "kernels"))
        results = simulation.run(tick)
    except EvacError as error:
        error.add_note(f"in the run with {', '.join(f'{key} = {seed}' for key, seed in changes.items())}")
        raise
    wall_time = time.perf_counter() - start - made
    return row_of(results, order.point, run, case.simulation.population_seed, wall_time)


def row_of(results: Results, point: int, run: int, population_seed: int | None, wall_time: float) -> Row:
    """Return the row of a run."""
    crowd = results.crowd
    exits = []
    for exit_ in results.building.exits:
        times = crowd.exit_time[crowd.exit_used == exit_.index]
        exits.append((exit_.name, len(times), float(times.max()) if len(times) else math.nan))
    return Row(
        point=point,
        run=run,
        seed=results.seed,
        population_seed=population_seed,
        ended=results.ended,
        time=results.time,
        last_out=float(crowd.exit_time.max()) if results.ended == EVERYBODY_OUT else math.inf,
        exits=tuple(exits),
        exit_time=crowd.exit_time,
        exit_used=crowd.exit_used.astype(np.int16),
        quality_warnings=tuple(results.quality_warnings),
        wall_time=wall_time,
    )


def order_of(point: Point, seeds: Seeds, digest: str, key: str) -> Order:
    """Return the order for the runs of a point."""
    case = point.case
    return Order(point.index, digest, case.table, case.source, case.registry.files(), seeds, key)


_cases: dict[str, "Case"] = {}


@lru_cache(maxsize=8)
def _registry(plugin_files: tuple[Path, ...]) -> "Registry":
    """Return the registry of a study, created once in each process."""
    from evac.registry import Registry

    return Registry(plugin_files)


def _case_of(order: Order) -> "Case":
    """Return the checked case of an order; only that of the last point is cached."""
    from evac.scenario.loading import case_from

    if order.digest not in _cases:
        case = case_from(
            order.table, order.source, plugin_files=order.plugin_files, registry=_registry(order.plugin_files)
        )
        _cases.clear()
        _cases[order.digest] = case
    return _cases[order.digest]
