"""One run of a study: what is told to whoever makes it, and what is kept of it."""

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
    """What a process needs for the runs of a point: plain data.

    Attributes
    ----------
    point : int
    digest : str
        Of the case: it is checked once in each process.
    table, source, plugin_files
        The case, see `evac.scenario.loading.case_from`.
    seeds : Seeds
    key : str
        Of the ground.
    ground : GroundFile or None
        Where it can be read, if it has been written.
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
    """What is kept of a run.

    Attributes
    ----------
    point, run, seed : int
    population_seed : int or None
        Seed of what people are like, where it is not `seed`.
    ended : str
        As in `Results`.
    time : float
        Simulated time [s].
    last_out : float
        When the last person left [s]; infinite where people are left.
    exits : tuple of (str, int, float)
        Of each exit: name, people who left by it, when the last of them did [s] or NaN.
    exit_time : (people,) float64 [s]
        NaN of who is still inside.
    exit_used : (people,) int16
        Index in `exits`; -1 of who is still inside.
    quality_warnings : tuple of str
    wall_time : float
        What the run took, building and directions apart [s]; not part of the tables.
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
        """Whether people are left."""
        return self.ended != EVERYBODY_OUT


def make_runs(
    order: Order, runs: tuple[int, ...], case: "Case | None" = None, tick: Callable[[Progress], None] | None = None
) -> list[Row]:
    """Make some runs of a point, in this process.

    Parameters
    ----------
    order : Order
    runs : tuple of int
    case : Case, optional
        The case of the order, where this process has it.
    tick : callable, optional
        Called at every tick of each run.

    Raises
    ------
    EvacError
        As `evac.run`, from the first run that fails; a note tells its seed.
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
    """Return what is kept of a run."""
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
    """Return what is told of a point."""
    case = point.case
    return Order(point.index, digest, case.table, case.source, case.loaded_files, seeds, key)


_cases: dict[str, "Case"] = {}


@lru_cache(maxsize=8)
def _registry(plugin_files: tuple[Path, ...]) -> "Registry":
    """Return the plugins of a study, loaded once in each process."""
    from evac.registry import Registry

    return Registry(plugin_files)


def _case_of(order: Order) -> "Case":
    """Return the checked case of an order; only that of the last point is kept."""
    from evac.scenario.loading import case_from

    if order.digest not in _cases:
        case = case_from(
            order.table, order.source, plugin_files=order.plugin_files, registry=_registry(order.plugin_files)
        )
        _cases.clear()
        _cases[order.digest] = case
    return _cases[order.digest]
