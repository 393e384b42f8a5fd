"""Functions that run studies: `evac.repeat`, `evac.sweep`; and the folder of a study."""

import shutil
import weakref
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from numbers import Integral
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, TypedDict, Unpack

from evac.base.errors import EvacError, PluginError, ResultError, ScenarioError, counted, warn
from evac.base.parameters import PATH, check_types, did_you_mean
from evac.case.case import Case
from evac.case.loading import as_case, run_plugin_files
from evac.folder.files import RUNS_STREAM_NAME, STUDY_NAME
from evac.folder.resultfolder import ResultFolder, remove_written
from evac.jit.loading import cores
from evac.simulation.shared import simulation_of
from evac.study import points
from evac.study.execute import warn_alone
from evac.study.outputs import quality_of, remarks_of, write_outputs, write_replays
from evac.study.points import Point, Seeds
from evac.study.stopping import MOST_OF_STUDY, Rule, rule_of
from evac.study.study import Study, StudyProgress

OF_RULE = ("until", "statistic", "least", "most", "repetitions")  #: Options that are arguments of `rule_of`.


class StudyOptions(TypedDict, total=False):
    """The options of `repeat`, which explains them, and of `sweep`."""

    until: float | None
    statistic: str
    least: int | None
    most: int | None
    repetitions: int
    folder: str | Path | None
    workers: int | None
    executor: Executor | None
    resume: bool
    maps: bool
    progress: Callable[[StudyProgress], None] | None


def repeat(
    case: Case | str | Path | Mapping[str, Any],
    runs: int | None = None,
    *,
    check_step: bool = False,
    **options: Unpack[StudyOptions],
) -> Study:
    """Run a case with many seeds: ``simulation.seed`` and the following ones.

    Parameters
    ----------
    case : Case, str, Path or mapping
        A case from `evac.load`, or an argument of `evac.load`.
    runs : int, optional
        Number of runs; 20 by default. Not allowed with `until`.
    check_step : bool
        Make all runs with half the time step as well, as a second point; `Study.step_change` compares them.
    folder : str or Path, optional
        Result folder: new, empty, or an earlier result, which is overwritten. By default the rows are in a temporary
        folder that exists as long as the returned object.
    until : float, optional
        Run until half the width of the confidence interval of the `statistic` of the evacuation time is at most this
        share of its value.
    statistic : str
        ``"mean"`` of the complete runs, the default, or ``"percentile 95"`` for example.
    least, most : int, optional
        Bounds of the number of runs with `until`; 20 (80 for the 95th percentile) and 1000 by default.
    repetitions : int
        Number of consecutive runs with the same people, see `evac.study.points.Seeds`; `runs` counts all of them.
        100 populations with 5 repetitions, ``repeat(case, 500, repetitions=5)``, are the scheme of IMO MSC.1/Circ.1533.
        By default 1.
    workers : int, optional
        Number of processes; by default the number of cores. Results do not depend on it. The processes do not import
        the main script, which needs no ``if __name__ == "__main__":``.
    executor : Executor, optional
        Executes all runs instead of local processes: any object with the interface of `concurrent.futures.Executor`.
        A `ProcessPoolExecutor` may import the main script in each process, which then needs that line.
    resume : bool
        Continue the study in the folder; existing runs are not repeated.
    maps : bool
        Make the maps and find the congestion of each run, for maps over runs: `Study.maps`, reports, comparisons.
    progress : callable, optional
        Called with an `evac.study.study.StudyProgress` after each row has been written.

    Returns
    -------
    Study
        With the rows of failed runs, which are in no statistic.

    Raises
    ------
    EvacError
        If all runs fail, the error of the first one, with its seed in a note; or a number is out of range, or the
        folder cannot be used or contains another study.

    Warns
    -----
    RunWarning
        The warnings of the command: about building and people of the first run; failed runs, people who are left
        inside, intervals that are wider than required, an effect of the time step, quality warnings.
    ProcessWarning
        All runs are made in this process, although others were requested.

    Examples
    --------
    >>> study = repeat(load("classroom"), until=0.02, folder="study")  # doctest: +SKIP
    >>> study.statistics[0].mean  # doctest: +SKIP
    """
    case = run_plugin_files(as_case(case))
    return _warned(points.halved_steps(case) if check_step else points.single(case), runs, options)


def sweep(
    case: Case | str | Path | Mapping[str, Any],
    parameters: Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]],
    runs: int | None = None,
    **options: Unpack[StudyOptions],
) -> Study:
    """Run a case with many seeds at several points in parameter space, with the same seeds (common random numbers).

    Parameters
    ----------
    case : Case, str, Path or mapping
        A case from `evac.load`, or an argument of `evac.load`.
    parameters : mapping of str to sequence, or sequence of mapping
        A mapping of dotted keys to lists of values gives one point per combination; a sequence of mappings of dotted
        keys to values gives one point per mapping.
    runs : int, optional
        Number of runs at each point; 20 by default.
    **options
        As for `repeat`, at each point.

    Returns
    -------
    Study

    Raises
    ------
    EvacError
        As for `repeat`; or the case is not valid at one of the points.

    Warns
    -----
    RunWarning, ProcessWarning
        As for `repeat`.

    Examples
    --------
    >>> changes = {"people.people.number": [20, 40], "people.people.speed": [1.0, 1.4]}
    >>> study = sweep(load("square_room"), changes, runs=20)  # doctest: +SKIP
    >>> study.to_pandas().groupby("people.people.number").last_out.mean()  # doctest: +SKIP
    """
    check_types(parameters=(parameters, Mapping | Sequence))
    case = run_plugin_files(as_case(case))
    if isinstance(parameters, Mapping):
        chosen = points.grid(case, parameters)
    else:
        chosen = points.from_rows(case, parameters, Path.cwd(), case.registry)
    return _warned(chosen, runs, options)


def execute_study(
    chosen: Sequence[Point],
    rule: Rule,
    *,
    folder: str | Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    maps: bool = False,
    progress: Callable[[StudyProgress], None] | None = None,
    replay: bool = False,
) -> Study:
    """Run the study of some points, and write its outputs if it has a folder; other arguments as for `repeat`."""
    check_types(folder=(folder, PATH | None), workers=(workers, Integral | None), progress=(progress, Callable | None))
    check_types(executor=(executor, Executor | None), resume=(resume, bool), maps=(maps, bool))
    if workers is not None and workers < 1:
        raise ScenarioError(f"workers must be at least 1, not {workers}")
    if len(chosen) * rule.first > MOST_OF_STUDY:
        number = f"{rule.first} runs at each of {len(chosen)} points"
        raise ScenarioError(f"{number} are more than {MOST_OF_STUDY}; reduce the number of runs or points")
    workers = _number_of_workers(chosen, workers or cores(), executor)
    seeds = Seeds(chosen[0].case.simulation.seed, rule.repetitions)
    if folder is None:
        temporary = Path(mkdtemp(prefix="evac-study-"))
        study = Study.begun(chosen, seeds, rule, temporary, is_mapped=maps)
        weakref.finalize(study, shutil.rmtree, temporary, ignore_errors=True)
        study.execute(workers, executor, progress)
        return study
    with ResultFolder(Path(folder)) as place:
        _open_folder(place, resume)
        study = Study.begun(chosen, seeds, rule, place.running, resume, maps)
        try:
            study.execute(workers, executor, progress)
        except KeyboardInterrupt as error:
            kept = f"{place.running} has {counted(study.stored_runs, 'run')}"
            error.add_note(f"{kept}; --resume, or resume=True, continues the study")
            raise
        write_outputs(study)
        if replay:
            write_replays(study)
        study.move(place.publish())
    return study


def _warned(chosen: Sequence[Point], runs: int | None, options: StudyOptions) -> Study:
    """Run the study of some points, and warn of building and people of its first run, and of what came out."""
    for name in options.keys() - StudyOptions.__annotations__.keys():
        raise ScenarioError(f"{name}: no such argument; {did_you_mean(name, [*StudyOptions.__annotations__])}")
    given: dict[str, Any] = dict(options)
    rule = rule_of(runs, **{name: given.pop(name) for name in OF_RULE if name in given})
    with suppress(EvacError):  # the study tells why the run is refused
        warn(simulation_of(chosen[0].case, will_run=False).warnings(), 4)
    study = execute_study(chosen, rule, **given)
    warn((*remarks_of(study), *quality_of(study)), 4)
    return study


def _number_of_workers(chosen: Sequence[Point], workers: int, executor: Executor | None) -> int:
    """Return the number of processes: one if a plugin is a class, which other processes may not have."""
    names = dict.fromkeys(name for point in chosen for name in point.case.registry.names_of_classes())
    why = f"{', '.join(names)}: a class that other processes do not have; put it in a file for plugin_files"
    if names and executor is not None:
        raise PluginError(why)
    if names and workers > 1:
        warn_alone(why)
    return 1 if names else workers


def _open_folder(place: ResultFolder, resume: bool) -> None:
    """Prepare the folder of a study for writing; if it is resumed, with its existing rows."""
    if not resume:
        place.start()
        return
    source = place.running if (place.running / STUDY_NAME).is_file() else place.path
    if not (source / STUDY_NAME).is_file():
        raise ResultError(f"{place.path}: contains no study to resume; start one without resume")
    place.reopen(source)
    remove_written(place.running, (STUDY_NAME, RUNS_STREAM_NAME))
