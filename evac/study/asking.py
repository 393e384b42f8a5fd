"""How a study is asked for: `evac.repeat`, `evac.sweep`, and the folder that it is written to."""

import math
import shutil
import weakref
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from evac.errors import ResultError, ScenarioError
from evac.output.files import RUNS_PARQUET_NAME, RUNS_STREAM_NAME, STUDY_NAME
from evac.output.resultfolder import ResultFolder
from evac.scenario.loading import as_case
from evac.scenario.trust import run_plugin_files
from evac.study import points
from evac.study.points import Point, Seeds
from evac.study.stopping import LEAST_RUNS, Rule, fixed, until_known
from evac.study.study import Progress, Study

if TYPE_CHECKING:
    from evac.scenario.case import Case


def repeat(
    case: "Case | str | Path | Mapping[str, Any]",
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
    case : Case, str, Path or mapping
        From `evac.load`, or what `evac.load` takes.
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
        points.single(run_plugin_files(as_case(case))), rule, place, repetitions, workers, executor, resume, progress
    )


def sweep(
    case: "Case | str | Path | Mapping[str, Any]",
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
    case : Case, str, Path or mapping
        From `evac.load`, or what `evac.load` takes.
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
    case = run_plugin_files(as_case(case))
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
