"""A study: its points, its rows, and their statistics."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow

from evac.analysis.maps import LevelMaps
from evac.base.arrays import FloatArray
from evac.base.errors import EvacError, ResultError, in_one_line, usable_path
from evac.building.model.building import Building
from evac.case.case import Case
from evac.folder.files import STUDY_NAME
from evac.results.recordedcase import recorded_case
from evac.results.results import Results
from evac.results.verdict import Verdict, rank, verdict_of
from evac.simulation.shared import shared_scene
from evac.study import store
from evac.study.execute import Execution, Order, Row, Task, order_of
from evac.study.maps import maps_over_runs
from evac.study.points import STEP, Point, Seeds
from evac.study.statistics import MEDIAN, Estimate, Statistics, Variation, difference, statistics, variation
from evac.study.stopping import Rule

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study, reported after each row."""

    done: int
    wanted: int  # so far; a study with `until` may request more
    row: Row | None  # None at the start, when `done` rows exist already


class Study:
    """Runs of one or several points, with the same seeds at every point.

    Returned by `evac.repeat` and `evac.sweep`, and by `evac.read_study` for the folder of an earlier study.

    Parameters
    ----------
    points : sequence of Point
    seeds : Seeds
    rule : Rule
    folder : Path
        Folder with the rows. Of an interrupted study, the runs before the first missing one are in the statistics.

    Attributes
    ----------
    points, seeds, rule, folder
        As the parameters.
    """

    def __init__(self, points: Sequence[Point], seeds: Seeds, rule: Rule, folder: Path) -> None:
        self.points = tuple(points)
        self.seeds, self.rule, self.folder = seeds, rule, folder
        self._store = store.RowStore(self.folder, self.points)
        self._orders: list[Order] = []
        self._wanted = [self._extent(point.index) for point in self.points]
        self._there = list(self._wanted)

    @classmethod
    def read(cls, folder: str | Path, plugin_files: Iterable[str | Path] = ()) -> "Study":
        """Open a study from its folder; the short form is `evac.read_study`, which explains it."""
        return read_study(folder, plugin_files)

    @classmethod
    def begun(
        cls,
        points: Sequence[Point],
        seeds: Seeds,
        rule: Rule,
        folder: Path,
        resume: bool = False,
        is_mapped: bool = False,
    ) -> "Study":
        """Return a study to be executed; its folder contains no study, or if it is resumed, the same one."""
        keys = [store.key_of(point.case) for point in points]
        digests = [store.digest_of(point.case, key) for point, key in zip(points, keys, strict=True)]
        identity = store.identity_of(points, seeds, digests)
        if resume:
            store.check_identity(folder, identity)
        store.write_identity(folder, identity, store.definition_of(points, rule))
        study = cls(points, seeds, rule, folder)
        study._store.forget_failed()
        study._orders = [
            order_of(point, seeds, digest, key, is_mapped)
            for point, digest, key in zip(points, digests, keys, strict=True)
        ]
        study._wanted = [rule.first] * len(points)
        study._there = [rule.first - len(study._missing(point.index, range(rule.first))) for point in points]
        return study

    @property
    def stored_runs(self) -> int:
        """Number of runs that are stored, failed ones included."""
        return len(self._store.entries)

    @property
    def dropped_bytes(self) -> int:
        """Number of bytes of incomplete or damaged rows of an interrupted study; their runs are made again."""
        return self._store.dropped_bytes

    def __repr__(self) -> str:
        return f"<Study of {len(self.points)} points, {self.stored_runs} runs in {self.folder}>"

    def _repr_html_(self) -> str:
        """Return the evacuation times of all points as a table, and their picture, for notebooks."""
        from evac.pictures.notebook import figure_html, table_html, verdict_html
        from evac.study.outputs import points_table

        return (
            verdict_html(self.verdict) + table_html(*points_table(self)) + figure_html(self.plot(), "evacuation times")
        )

    def plot(self) -> "Figure":
        """Return a figure of the egress curves over the runs of each point; of many points, of their statistics."""
        from evac.pictures.pictures import designs_figure
        from evac.study.outputs import MOST_CURVES, egress, figure_of

        made = [point for point in self.points if self.statistics[point.index].runs]
        curves = {point.label: egress(self, point.index) for point in made[: MOST_CURVES + 1]}
        if not 1 < len(curves) <= MOST_CURVES:
            return figure_of(self, next(iter(curves.values()), {}))
        people = max(self.people(point.index) for point in made)
        return designs_figure(self.points[0].case.title, people, curves)

    def move(self, folder: Path) -> None:
        """Set the new path of the renamed folder."""
        self.folder = folder
        self._store.move(folder)

    def execute(
        self, workers: int, executor: Executor | None = None, progress: Callable[[StudyProgress], None] | None = None
    ) -> None:
        """Execute and store all missing runs; raise if all runs failed."""
        failed: dict[tuple[int, int], EvacError] = {}
        waiting: deque[Task] = deque()

        def keep(row: Row) -> None:
            self._store.append(row)
            self._there[row.point] += 1
            waiting.extend(self._further(self._orders[row.point]))
            if row.error is not None:
                failed[row.point, row.run] = row.error
            if progress is not None:
                progress(StudyProgress(self.done, sum(self._wanted), row))

        for order in self._orders:
            missing = self._missing(order.point, range(self.rule.first))
            waiting.extend([Task(order, run) for run in missing] or self._further(order))
        with Execution(self.points, workers, executor) as execution, closing(self._store):
            if progress is not None:
                progress(StudyProgress(self.done, sum(self._wanted), None))
            for row in execution.rows(waiting):
                keep(row)
        if failed and all(math.isnan(entry.last_out) for entry in self._store.entries.values()):
            raise failed[min(failed)]
        self._store.complete()
        self._write_buildings()

    def _write_buildings(self) -> None:
        """Write the building of the first point, and with maps those of all."""
        buildings = dict[str, Building]()
        orders = self._orders if self._orders[0].is_mapped else self._orders[:1]
        for order in orders:
            with suppress(EvacError):  # of a point whose runs are refused
                scene = shared_scene(self.points[order.point].case, order.key)
                buildings.setdefault(order.key, scene.building)
        store.write_buildings(self.folder, buildings, [order.key for order in orders])

    @property
    def done(self) -> int:
        """Number of finished runs among those requested so far."""
        return sum(self._there)

    def runs_of(self, point: int) -> int:
        """Return the number of runs in the statistics of a point."""
        return self._wanted[point]

    def times(self, point: int) -> FloatArray:
        """Return the evacuation times (runs,) [s] of a point; infinite if people are left, NaN for failed runs."""
        return self._times(point, self._wanted[point])

    def people(self, point: int) -> int:
        """Return the greatest number of people of the runs of a point; 0 without runs."""
        return max((row["people"] for row in self.rows(point, ["people"])), default=0)

    def populations(self, point: int) -> list[int]:
        """Return the number of the population of each run of a point."""
        return [self.seeds.population(run) for run in range(self._wanted[point])]

    @cached_property
    def statistics(self) -> tuple[Statistics, ...]:
        """The statistics of each point."""
        confidence = self.rule.confidence
        return tuple(
            statistics(self.times(point.index), self.populations(point.index), confidence) for point in self.points
        )

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of runs that have not failed, of blocked and of failed ones, at all points together."""
        runs, blocked, failed = (
            sum(getattr(of, name) for of in self.statistics) for name in ("runs", "blocked", "failed")
        )
        return runs, blocked, failed

    def safety(self, point: int) -> dict[str, Any] | None:
        """Return the compartments of a point, as in summary.json of a run, with percentiles of the required times."""
        from evac.study.outputs import safety_of

        return safety_of(self, point)

    def verdict_at(self, point: int) -> Verdict:
        """Return whether people leave in time at a point, as `Results.verdict`."""
        return verdict_of(self.safety(point))

    @property
    def verdict(self) -> Verdict:
        """Whether people leave in time, as `Results.verdict`; of several points, that of the worst one."""
        verdicts = [self.verdict_at(point.index) for point in self.points]
        worst = min(range(len(verdicts)), key=lambda k: rank(verdicts[k]))
        label = self.points[worst].label
        return {**verdicts[worst], "text": f"{label}: {verdicts[worst]['text']}"} if label else verdicts[worst]

    def maps(self, point: int = 0) -> Mapping[str, LevelMaps]:
        """Return the means over the runs of a point of the maps of each level; empty if none were made."""
        return {name: own.maps for name, own in maps_over_runs(self, point).items()}

    def building(self, point: int = 0) -> Building | None:
        """Return the building of a point as it is at the start; None without maps, but for the first point."""
        return self._buildings[point]

    @cached_property
    def _buildings(self) -> list[Building | None]:
        return store.read_buildings(self.folder, len(self.points))

    @property
    def central(self) -> str:
        """Name of the statistic that describes all points: the mean, or the median if the mean lacks intervals."""
        means, medians = ([estimates[name].has_interval for estimates in self.statistics] for name in ("mean", MEDIAN))
        return "mean" if sum(means) >= sum(medians) else MEDIAN

    def difference(self, point: int, other: int) -> Estimate:
        """Return the mean difference of evacuation times, ``other - point``, of the runs with the same seeds."""
        runs = min(self._wanted[point], self._wanted[other])
        before, after = self._times(point, runs), self._times(other, runs)
        return difference(before, after, self.populations(point)[:runs], self.rule.confidence)

    @property
    def step_change(self) -> Estimate | None:
        """The effect of half the time step, if the points of the study differ in it."""
        if [tuple(point.parameters) for point in self.points] != [(STEP,), (STEP,)]:
            return None
        step, other = (point.parameters[STEP] for point in self.points)
        return self.difference(0, 1) if other == 0.5 * step else None

    def deciding(self, point: int) -> Estimate:
        """Return the statistic on which the stopping rule is based, at one point."""
        return self.rule.estimate(self.times(point), self.populations(point))

    def variation(self, point: int) -> Variation:
        """Return the variation between populations and repetitions, as the procedure of the IMO requires."""
        return variation(self.times(point), self.populations(point))

    def rows(
        self, point: int | None = None, columns: Sequence[str] = (), *, failed: bool = False
    ) -> Iterable[dict[str, Any]]:
        """Yield the rows in the statistics of one point or all points, read one after the other.

        Parameters
        ----------
        point : int, optional
        columns : sequence of str
            Names of columns of `table`; by default all.
        failed : bool
            Include the rows of failed runs, which are in no statistic.
        """
        points = range(len(self.points)) if point is None else (point,)
        wanted = [(index, run) for index in points for run in range(self._wanted[index])]
        if not failed:
            wanted = [key for key in wanted if not math.isnan(self._store.entries[key].last_out)]
        yield from self._store.rows(wanted, columns)  # a frame of this study keeps its temporary folder

    def table(self) -> pyarrow.Table:
        """Return all rows, also of failed runs, as an Arrow table, with the exit times of all people in memory."""
        return self._store.table()

    def to_pandas(self) -> "pandas.DataFrame":
        """Return `table` as a pandas data frame."""
        return self.table().to_pandas()

    def run_again(self, point: int, run: int, folder: str | Path | None = None) -> Results:
        """Repeat one run with all outputs of `evac.run`.

        Parameters
        ----------
        point, run : int
        folder : str or Path, optional
            Result folder.
        """
        from evac.simulation.running import run as run_case

        return run_case(self.case_of(point, run), folder)

    def case_of(self, point: int, run: int) -> Case:
        """Return the case of one run, with its seeds."""
        return self.points[point].case.change(self.seeds.changes(run))

    def _times(self, point: int, runs: int) -> FloatArray:
        return np.array([self._store.entries[point, run].last_out for run in range(runs)])

    def _missing(self, point: int, runs: Iterable[int]) -> list[int]:
        return [run for run in runs if (point, run) not in self._store.entries]

    def _extent(self, point: int) -> int:
        """Return the number of runs that the stopping rule wants, or of those before the first missing one."""
        runs, before = self.rule.first, 0
        while runs > before and not (missing := self._missing(point, range(before, runs))):
            populations = [self.seeds.population(run) for run in range(runs)]
            before, runs = runs, self.rule.wanted(self._times(point, runs), populations)
        return runs if runs == before else missing[0] - missing[0] % self.seeds.repetitions

    def _further(self, order: Order) -> list[Task]:
        """Apply the stopping rule to a point until it requests runs that are missing; return their tasks."""
        point = order.point
        while self._there[point] == self._wanted[point]:
            before = self._wanted[point]
            self._wanted[point] = self.rule.wanted(self.times(point), self.populations(point))
            if self._wanted[point] == before:
                break
            missing = self._missing(point, range(before, self._wanted[point]))
            self._there[point] = self._wanted[point] - len(missing)
            if missing:
                return [Task(order, run) for run in missing]
        return []


def read_study(folder: str | Path, plugin_files: Iterable[str | Path] = ()) -> Study:
    """Open a study from its folder: a result of `evac.repeat` or `evac.sweep`, also of an interrupted or running one.

    Nothing is changed in the folder, and no code that it names is executed. The case is read only when it is needed,
    for `Study.case_of` and `Study.run_again`, from what the folder contains and the file of the building.

    Parameters
    ----------
    folder : str or Path
        Result folder, or the folder ``RESULT.running`` of a study that is not complete.
    plugin_files : iterable of path
        Plugin files of the case. They are executed when the case is needed; none is necessary to read the results.

    Returns
    -------
    Study

    Raises
    ------
    ResultError
        The folder contains no study, or a file is damaged.

    Examples
    --------
    >>> study = read_study("classroom-runs")  # doctest: +SKIP
    >>> study.statistics[0].mean  # doctest: +SKIP
    """
    place = usable_path(folder, ResultError)
    identity, definition = store.read_identity(place)
    store.check_rows(place)
    files = tuple(Path(path).resolve() for path in plugin_files)
    try:
        bases = [
            cache(partial(recorded_case, place, table["table"], table["source"], table["plugin_files"], files))
            for table in definition["cases"]
        ]
        places = zip(definition["case_of_point"], identity["parameters"], strict=True)
        points = [Point(k, bases[number], parameters) for k, (number, parameters) in enumerate(places)]
        seeds = Seeds(identity["first_seed"], identity["repetitions"])
        return Study(points, seeds, Rule(**definition["rule"]), place)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ResultError(f"{place / STUDY_NAME}: not that of a study: {in_one_line(error)}") from error
