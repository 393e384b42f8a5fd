"""A study: its points, its rows, and what they say."""

import math
import shutil
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from os import cpu_count
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.arrays import FloatArray
from evac.errors import EvacError, ResultError, ScenarioError
from evac.output.files import RUNS_PARQUET_NAME, RUNS_STREAM_NAME, STUDY_NAME
from evac.output.resultfolder import ResultFolder
from evac.scenario.trust import run_plugin_files
from evac.study import imo, points
from evac.study.conduct import Conductor
from evac.study.identity import check_identity, digest_of, identity_of, key_of, write_identity
from evac.study.points import Point, Seeds
from evac.study.runs import Order, Row, order_of
from evac.study.statistics import Estimate, Statistics, statistics
from evac.study.stopping import LEAST_RUNS, Rule, fixed, until_known
from evac.study.store import Store

if TYPE_CHECKING:
    import pandas
    import pyarrow

    from evac.output.results import Results
    from evac.scenario.case import Case


@dataclass(frozen=True)
class Progress:
    """How far a study is, once a row."""

    done: int
    wanted: int  # so far: a study that stops when it knows enough may want more
    row: Row | None  # None at the start, where `done` rows were there already


class Study:
    """Runs of a case, or of several under parameters of a sweep, with the same seeds at every point.

    Made by `evac.repeat` and `evac.sweep`.

    Attributes
    ----------
    points : tuple of Point
    seeds : Seeds
    rule : Rule
    folder : Path
        Where the rows are.
    """

    def __init__(self, points: Sequence[Point], seeds: Seeds, rule: Rule, folder: Path, resume: bool = False) -> None:
        self.points = tuple(points)
        self.seeds, self.rule, self.folder = seeds, rule, folder
        keys = [key_of(point.case) for point in self.points]
        digests = [digest_of(point.case, key) for point, key in zip(self.points, keys, strict=True)]
        self._orders = [order_of(*of) for of in zip(self.points, [seeds] * len(keys), digests, keys, strict=True)]
        identity = identity_of(self.points, seeds, digests)
        if resume:
            check_identity(self.folder, identity)
        else:
            write_identity(self.folder, identity)
        self._store = Store(self.folder, self.points)
        self._wanted = [rule.first] * len(self.points)
        self._there = [rule.first - len(self._missing(order, range(rule.first))) for order in self._orders]

    def __repr__(self) -> str:
        return f"<Study of {len(self.points)} points, {len(self._store.entries)} runs in {self.folder}>"

    def move(self, folder: Path) -> None:
        """Note that the folder has been renamed."""
        self.folder = folder
        self._store.move(folder)

    def conduct(
        self,
        workers: int | None = None,
        executor: Executor | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> None:
        """Make all runs that are missing, and put the rows in order."""
        conductor: Conductor

        def on_row(row: Row) -> None:
            self._store.append(row)
            self._there[row.point] += 1
            order = self._orders[row.point]
            conductor.ask(order, self._advanced(order))
            if progress is not None:
                progress(Progress(self.done, sum(self._wanted), row))

        conductor = Conductor(self.points, on_row, workers or cpu_count() or 1, executor)
        for order in self._orders:
            missing = self._missing(order, range(self.rule.first)) or self._advanced(order)
            conductor.ask(order, missing)
        if progress is not None:
            progress(Progress(self.done, sum(self._wanted), None))
        try:
            conductor.conduct()
        finally:
            self._store.close()
        self._store.compact(sorted(self._store.entries))

    @property
    def done(self) -> int:
        """Number of runs that are made, of those that are wanted so far."""
        return sum(self._there)

    def runs_of(self, point: int) -> int:
        """Return the number of runs of a point that its statistics are over."""
        return self._wanted[point]

    def times(self, point: int) -> FloatArray:
        """Return the evacuation times (runs,) [s] of a point by run; infinite where people are left."""
        return np.array([self._store.entries[point, run].last_out for run in range(self._wanted[point])])

    def populations(self, point: int) -> list[int]:
        """Return which population each run of a point is of."""
        return [self.seeds.population(run) for run in range(self._wanted[point])]

    @cached_property
    def statistics(self) -> tuple[Statistics, ...]:
        """The statistics of each point."""
        confidence = self.rule.confidence
        return tuple(
            statistics(self.times(point.index), self.populations(point.index), confidence) for point in self.points
        )

    def deciding(self, point: int) -> Estimate:
        """Return the statistic that the study stops by, at one point."""
        return self.rule.estimate(self.times(point), self.populations(point))

    def variation(self, point: int) -> imo.Variation:
        """Return what the IMO's scheme asks of the runs of a point."""
        return imo.variation(self.times(point), self.populations(point))

    def rows(self, point: int | None = None, columns: Sequence[str] = ()) -> Iterable[dict[str, Any]]:
        """Yield the rows that the statistics are over, of one point or all, read one after the other.

        Parameters
        ----------
        point : int, optional
        columns : sequence of str
            Names as in `table`; by default all.
        """
        chosen = self.points if point is None else (self.points[point],)
        wanted = [(one.index, run) for one in chosen for run in range(self._wanted[one.index])]
        return self._store.rows(wanted, columns)

    def table(self) -> "pyarrow.Table":
        """Return all rows as an Arrow table: it takes the memory of all exit times."""
        return self._store.table()

    def to_pandas(self) -> "pandas.DataFrame":
        """Return all rows as a data frame of pandas.

        Raises
        ------
        EvacError
            pandas is not installed.
        """
        try:
            import pandas  # noqa: F401
        except ImportError as error:
            raise EvacError('pandas is not installed: pip install "evac[frames]", or use table()') from error
        return self.table().to_pandas()

    def run_again(self, point: int, run: int, folder: str | Path | None = None) -> "Results":
        """Make one run again, with all outputs of `evac.run`.

        Parameters
        ----------
        point, run : int
        folder : str or Path, optional
            Result folder.
        """
        from evac.running import run as run_case

        return run_case(self.case_of(point, run), folder)

    def case_of(self, point: int, run: int) -> "Case":
        """Return the case of one run, with its seeds."""
        return self.points[point].case.change(self.seeds.changes(run))

    def _missing(self, order: Order, runs: Iterable[int]) -> list[int]:
        return [run for run in runs if (order.point, run) not in self._store.entries]

    def _advanced(self, order: Order) -> list[int]:
        """Look at a point whose wanted runs are all there, again and again; return what it wants then."""
        point = order.point
        while self._there[point] == self._wanted[point]:
            before = self._wanted[point]
            self._wanted[point] = self.rule.wanted(self.times(point), self.populations(point))
            if self._wanted[point] == before:
                break
            missing = self._missing(order, range(before, self._wanted[point]))
            self._there[point] = self._wanted[point] - len(missing)
            if missing:
                return missing
        return []


def repeat(
    case: "Case",
    runs: int | None = None,
    *,
    folder: str | Path | None = None,
    until: float | None = None,
    statistic: str = "mean",
    least: int | None = None,
    most: int | None = None,
    repetitions: int = 1,
    workers: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Study:
    """Run a case with many seeds, from ``simulation.seed`` on.

    Parameters
    ----------
    case : Case
        From `evac.load`.
    runs : int, optional
        Number of runs; 20 by default, and not given where `until` is.
    folder : str or Path, optional
        New, empty, or a result folder that is overwritten. Without one the rows are in a temporary folder that lives
        as long as what is returned.
    until : float, optional
        Run until half the interval of the `statistic` of the evacuation time is at most this share of it.
    statistic : str
        ``"mean"`` of the complete runs, or ``"percentile 95"`` for example.
    least, most : int, optional
        Bounds of the number of runs with `until`; 20 (80 for the 95th percentile) and 1000 by default.
    repetitions : int
        So many runs in a row have people who are alike, see `evac.study.points.Seeds`; `runs` counts all of them.
        With 100 populations of 5 repetitions, ``repeat(case, 500, repetitions=5)``, it is the scheme of IMO
        MSC.1/Circ.1533.
    workers : int, optional
        Processes; as many as there are cores by default. Results do not depend on it. With more than one, a script has
        its commands under ``if __name__ == "__main__":``, for each process reads it.
    executor : Executor, optional
        Makes all runs instead of processes of this machine: anything with the interface of `concurrent.futures`.
    resume : bool
        Go on with the study in the folder, and repeat no run that is there.
    progress : callable, optional
        Called with a `Progress` whenever a row has been written.

    Returns
    -------
    Study

    Raises
    ------
    EvacError
        As `evac.run`, from the first run that fails; a note tells its seed. Or a number is out of range, the folder
        cannot be used, or holds another study.

    Examples
    --------
    >>> study = repeat(load("classroom"), until=0.02, folder="study")  # doctest: +SKIP
    >>> study.statistics[0].mean  # doctest: +SKIP
    """
    rule = rule_of(runs, until, statistic, least, most, repetitions)
    place = Path(folder) if folder is not None else None
    return conducted(
        points.single(run_plugin_files(case)), rule, place, repetitions, workers, executor, resume, progress
    )


def sweep(
    case: "Case",
    parameters: Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]],
    runs: int | None = None,
    *,
    folder: str | Path | None = None,
    until: float | None = None,
    statistic: str = "mean",
    least: int | None = None,
    most: int | None = None,
    repetitions: int = 1,
    workers: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Study:
    """Run a case with many seeds under many parameters; the seeds are the same for all (common random numbers).

    Parameters
    ----------
    case : Case
        From `evac.load`.
    parameters : mapping of str to sequence, or sequence of mapping
        Dotted keys with a list of values for each: a point for each combination. Or a point for each mapping of a list.
    runs, folder, until, statistic, least, most, repetitions, workers, executor, resume, progress
        As for `repeat`, at each point.

    Returns
    -------
    Study

    Raises
    ------
    EvacError
        As for `repeat`; or the case is not valid at a point.

    Examples
    --------
    >>> changes = {"people.people.number": [20, 40], "contact.model": ["dem", "nsm2"]}
    >>> study = sweep(load("square_room"), changes, runs=20)  # doctest: +SKIP
    >>> study.to_pandas().groupby("contact.model").last_out.mean()  # doctest: +SKIP
    """
    rule = rule_of(runs, until, statistic, least, most, repetitions)
    case = run_plugin_files(case)
    if isinstance(parameters, Mapping):
        found = points.grid(case, parameters)
    else:
        found = points.from_rows(case, parameters, Path.cwd(), case.registry)
    place = Path(folder) if folder is not None else None
    return conducted(found, rule, place, repetitions, workers, executor, resume, progress)


def rule_of(
    runs: int | None, until: float | None, statistic: str, least: int | None, most: int | None, repetitions: int
) -> Rule:
    """Return the rule that these arguments ask for.

    Raises
    ------
    ScenarioError
        They contradict one another, or one is out of range.
    """
    if until is None:
        if least is not None or most is not None:
            raise ScenarioError("least and most go with until; without it give the number of runs")
        runs = LEAST_RUNS if runs is None else runs
        if runs % max(repetitions, 1):
            whole = math.ceil(runs / repetitions) * repetitions
            raise ScenarioError(f"{runs} runs are no whole number of populations of {repetitions}; use {whole}")
        return fixed(runs, repetitions)
    if runs is not None:
        raise ScenarioError("runs and until contradict one another; with until, least and most bound their number")
    return until_known(until, statistic, least, most, repetitions)


def conducted(
    found: Sequence[Point],
    rule: Rule,
    folder: Path | None,
    repetitions: int = 1,
    workers: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    progress: Callable[[Progress], None] | None = None,
    replay: bool = False,
) -> Study:
    """Make the study of some points, and write its outputs where it has a folder, as `repeat` does."""
    if workers is not None and workers < 1:
        raise ScenarioError(f"workers must be at least 1, not {workers}")
    seeds = Seeds(found[0].case.simulation.seed, repetitions)
    if folder is None:
        temporary = Path(mkdtemp(prefix="evac-study-"))
        study = Study(found, seeds, rule, temporary)
        weakref.finalize(study, shutil.rmtree, temporary, ignore_errors=True)
        study.conduct(workers, executor, progress)
        return study
    from evac.study.outputs import write_outputs, write_replays

    with ResultFolder(folder) as place:
        open_folder(place, resume)
        study = Study(found, seeds, rule, place.running, resume)
        study.conduct(workers, executor, progress)
        write_outputs(study)
        if replay:
            write_replays(study)
        study.move(place.publish())
    return study


def open_folder(place: ResultFolder, resume: bool) -> None:
    """Make the folder of a study ready to be written, with what is there of it if it goes on.

    Raises
    ------
    ResultError
        It holds the rows of a study that was stopped and is not to go on, or cannot be written.
    """
    if resume:
        source = place.running if (place.running / STUDY_NAME).is_file() else place.path
        if not (source / STUDY_NAME).is_file():
            raise ResultError(f"{place.path}: no study to go on with; leave out --resume to begin one")
        place.reopen(source, (STUDY_NAME, RUNS_STREAM_NAME, RUNS_PARQUET_NAME))
    elif any((place.running / name).is_file() for name in (RUNS_STREAM_NAME, RUNS_PARQUET_NAME)):
        raise ResultError(
            f"{place.running}: holds the runs of a study that was stopped; go on with it (--resume), choose another "
            "folder (--out), or remove that one"
        )
    else:
        place.start()
