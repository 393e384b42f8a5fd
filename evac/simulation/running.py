"""Run a case, or resume a run, and write its result folder."""

import math
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from numbers import Real
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self

from evac.base.display import displayed
from evac.base.errors import EvacError, FolderWarning, ResultError, ScenarioError, in_one_line, warn
from evac.base.parameters import PATH, check_types
from evac.base.progress import Progress
from evac.case.case import Case
from evac.case.loading import as_case
from evac.contract.registry import Registry
from evac.folder.files import ANIMATION_NAME, CHECKPOINT_NAME, EGRESS_PICTURE_NAME, REPLAY_NAME
from evac.folder.resultfolder import ResultFolder, remove_written
from evac.results.ending import FAILED, INTERRUPTED
from evac.results.results import Results
from evac.simulation.checkpoints import Checkpoints, differences_of, find_checkpoint, inputs_of, made_of
from evac.simulation.loop import Operation
from evac.simulation.simulation import Simulation


def run(
    case: Case | str | Path | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    full: bool = False,
    checkpoint: float | None = None,
    progress: Callable[[Progress], None] | bool | None = None,
) -> Results:
    """Run a case to its end and return the results.

    Parameters
    ----------
    case : Case, str, Path or mapping
        A case from `evac.load`, or an argument of `evac.load`.
    folder : str or Path, optional
        Result folder: new, empty, or that of an earlier run, which is replaced when this run has ended. None writes
        no files.
    full : bool
        Include the parts that the scene does not need: identical results, slower.
    checkpoint : float, optional
        Wall time between two checkpoints [s], from which `resume` continues if the run is killed. None saves none.
    progress : callable or bool, optional
        Function that is called with a `Progress` at every tick. None shows a bar on a terminal and a line in a
        notebook, True also prints lines elsewhere, False shows nothing.

    Returns
    -------
    Results

    Raises
    ------
    EvacError
        The case, the building or a plugin is not valid, a step fails, or the folder cannot be written or is in use
        by another run.
    KeyboardInterrupt
        Ctrl-C was pressed. The run stops at the end of the tick, and tables and state are in the folder, from which
        `resume` continues. A second Ctrl-C, or one while the outputs of an ended run are written, leaves out the
        remaining outputs, which a note of the error names. A third one stops at once.

    Warns
    -----
    RunWarning
        The warnings of the command, which the results contain, too: about building and people, before the run;
        outcomes of events; people who are left inside or stuck; quality warnings.

    Examples
    --------
    >>> results = evac.run("classroom", "classroom-result")  # doctest: +SKIP
    """
    check_types(folder=(folder, PATH | None), full=(full, bool), progress=(progress, Callable | bool | None))
    case = as_case(case)
    _check_interval(checkpoint)
    if folder is None and checkpoint is not None:
        raise ScenarioError("checkpoint: needs a result folder; give `folder`")
    with nullcontext() if folder is None else ResultFolder(folder) as place, displayed(progress) as shown:
        simulation = Simulation(case, None if place is None else place.running, full, in_memory=True, workers=None)
        before = simulation.warnings()
        warn(before)
        if place is None:
            results = simulation.run(shown)
        else:
            place.start()
            results = _run_interruptible(simulation, place, shown, checkpoint)
    later = (line for line in results.warnings if line not in before)
    warn((*later, *results.remarks, *results.quality_warnings))
    return results


def resume(
    folder: str | Path,
    *,
    plugin_files: Iterable[str | Path] = (),
    registry: Registry | None = None,
    checkpoint: float | None = None,
    allow_differences: bool = False,
    case_file: str | Path | None = None,
    progress: Callable[[Progress], None] | bool | None = None,
) -> Results:
    """Continue a killed or stopped run from its last checkpoint, with the results of an uninterrupted run.

    Parameters
    ----------
    folder : str or Path
        Result folder of the interrupted run.
    plugin_files, registry
        As for `evac.load`: those that the run was given in addition to those of its case.
    checkpoint : float, optional
        Wall time between two checkpoints [s]; by default that of the interrupted run.
    allow_differences : bool
        Resume even if versions, kernels, plugins or the building's file have changed; the results may then differ
        from those of a run without interruption, and the summary lists the differences.
    case_file : str or Path, optional
        The file of the case, or its folder. Needed if the case names plugin files, which are executed, and lies neither
        in the parent folder of the result folder nor in a folder beside it.
    progress : callable or bool, optional
        As for `run`.

    Returns
    -------
    Results

    Raises
    ------
    ResultError
        There is no checkpoint, it is damaged, or something has changed since it was written.
    EvacError
        As `run`.

    Warns
    -----
    RunWarning
        As `run`, all of them after the run.

    Examples
    --------
    >>> results = evac.resume("classroom-result")  # doctest: +SKIP
    """
    check_types(folder=(folder, PATH), case_file=(case_file, PATH | None), plugin_files=(plugin_files, Iterable))
    check_types(allow_differences=(allow_differences, bool), progress=(progress, Callable | bool | None))
    _check_interval(checkpoint)
    with ResultFolder(folder) as place, displayed(progress) as shown:
        simulation, every = resumed(place, plugin_files, registry, allow_differences, case_file)
        results = _run_interruptible(simulation, place, shown, every if checkpoint is None else checkpoint)
    warn((*results.warnings, *results.remarks, *results.quality_warnings))
    return results


def resumed(
    place: ResultFolder,
    plugin_files: Iterable[str | Path] = (),
    registry: Registry | None = None,
    allow_differences: bool = False,
    case_file: str | Path | None = None,
    compiling: Callable[[int, int], None] | None = None,
    announce: Callable[[Path], None] | None = None,
) -> tuple[Simulation, float | None]:
    """Return a simulation restored from the checkpoint of a locked folder, and its wall time between checkpoints [s].

    Parameters and errors are those of `resume` and of `Simulation`; `announce` is called with
    the path of each plugin file of the case before it is executed.
    """
    checkpoint = find_checkpoint(place.path)
    case = checkpoint.case(plugin_files, registry, case_file, announce)
    differences = differences_of(checkpoint.header.made_with, inputs_of(case))
    _check_differences(checkpoint.path, differences, allow_differences)
    simulation = Simulation(case, place.running, checkpoint.header.full, workers=None, compiling=compiling)
    differences += differences_of(checkpoint.header.made_with, made_of(simulation))
    _check_differences(checkpoint.path, differences, allow_differences)
    checkpoint.restore(simulation)
    checkpoint.check_recorders(simulation)
    simulation.resumed.append({"time": checkpoint.header.time, "differences": differences})
    place.reopen(checkpoint.path.parent)
    try:
        checkpoint.restore_recorders(simulation)
    except BaseException:
        place.put_back(checkpoint.path.parent)
        raise
    remove_written(place.running, [*checkpoint.files, CHECKPOINT_NAME])
    return simulation, checkpoint.header.every


class Interrupt:
    """Counts signals: after the first one, the run stops at the end of its tick, and after the next, its outputs stop.

    A third one raises KeyboardInterrupt anywhere, as does a second one if `may_break`, while recorders finish. `wanted`
    is the number of the last one. Signals that were ignored before, such as SIGHUP under nohup, remain ignored. Outside
    the main thread, which is the only one that receives signals, no handler is installed. With `announce`, which is
    called at the first signal, the process ends after an interrupt: signals while it tells what is missing are ignored.
    """

    def __init__(self, names: Iterable[str] = ("SIGINT",), announce: Callable[[int], None] | None = None) -> None:
        self.wanted = self.count = 0
        self.may_break = False
        self._numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
        self._announce = announce
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in self._numbers:
                if signal.getsignal(number) not in (signal.SIG_IGN, None):  # None: not set from Python
                    self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        is_last = self._announce is not None and isinstance(error, KeyboardInterrupt)
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if is_last else handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.wanted, self.count = number, self.count + 1
        if self.count > 2 or (self.count == 2 and self.may_break):
            raise KeyboardInterrupt
        if self._announce is not None and self.count == 1:
            self._announce(number)


def _run_interruptible(
    simulation: Simulation, place: ResultFolder, progress: Callable[[Progress], None] | None, checkpoint: float | None
) -> Results:
    """Run a simulation as `run_into` does; the first Ctrl-C ends it at the end of its tick."""
    with Interrupt() as interrupt:
        results = run_into(simulation, place, progress, interrupt, checkpoint)
    if interrupt.wanted and results.ended == INTERRUPTED:
        raise KeyboardInterrupt(
            f"stopped at {results.time:.2f} s; tables and state are in {results.folder}, evac.resume goes on from them"
        )
    return results


def run_into(
    simulation: Simulation,
    place: ResultFolder,
    progress: Callable[[Progress], None] | None,
    interrupt: Interrupt,
    checkpoint: float | None,
    writing: Callable[[], None] = lambda: None,
) -> Results:
    """Run a simulation, write its folder, and publish it; if the run fails, the tables until then are written."""
    first = simulation.step
    failure: EvacError | KeyboardInterrupt | None = None

    def let_break() -> None:
        interrupt.may_break = True

    simulation.loop.operations += [
        Operation("result folder", "output", place.check),
        Operation("interrupts", "output", simulation.stop, lambda: interrupt.count > 0),
        Checkpoints(simulation, place, checkpoint).operation(),
        Operation("end of the ticks", "output", let_break, lambda: bool(simulation.ended)),
    ]
    with simulation.phases.enter("output"):
        try:
            results = simulation.run(progress)
        except (EvacError, KeyboardInterrupt) as error:
            if simulation.step == first or not (simulation.ended or isinstance(error, EvacError)):
                if not simulation.step:
                    with suppress(ResultError, OSError):
                        place.check()
                        place.discard()
                raise
            simulation.ended, failure = simulation.ended or FAILED, error
            results = simulation.results()
        interrupt.may_break = False
        most = 1 if results.ended == INTERRUPTED else 0  # the signal that has ended the run does not stop its outputs
        is_whole = results.ended not in (FAILED, INTERRUPTED) and not isinstance(failure, ResultError)
        try:
            results = _published(simulation, place, results, is_whole)
            if failure is None:
                writing()
            left_out = draw_pictures(results, lambda: failure is not None or interrupt.count > most)
            if left_out and failure is None and interrupt.count > most:
                failure = KeyboardInterrupt()
            if failure is not None:
                without = f", without {', '.join(left_out)}" if left_out else ""
                failure.add_note(f"the results {'' if is_whole else 'until then '}are in {results.folder}{without}")
        except (ResultError, OSError):
            if failure is None:
                raise
        if failure is not None:
            raise failure
        return results


def _published(simulation: Simulation, place: ResultFolder, results: Results, is_whole: bool) -> Results:
    """Write the tables and the summary of a run that has ended or failed, and publish its folder."""
    place.check()
    if results.case.output.tables:
        results.write_tables(place.running)
    written, phases = simulation.recording.plugin_files(), simulation.phases.seconds()
    results = results.with_values(plugin_files=written, phases=phases)
    results.write_summary(place.running)
    folder = place.publish() if is_whole else place.publish_if_new()
    if is_whole:
        (folder / CHECKPOINT_NAME).unlink(missing_ok=True)
    return results.with_values(folder=folder)


def draw_pictures(results: Results, is_stopped: Callable[[], bool]) -> list[str]:
    """Write egress.png and the VTK animation if the case asks for them, until stopped; return the outputs that lack.

    The results are complete without them: one that cannot be made is a warning.
    """
    output = results.case.output
    folder = results.folder
    assert folder is not None
    if output.picture and not is_stopped():
        with _optional(folder / EGRESS_PICTURE_NAME):
            from evac.pictures.pictures import egress_figure
            from evac.pictures.writing import as_shipped, save

            with as_shipped():
                save(egress_figure(results), folder / EGRESS_PICTURE_NAME)
    if output.animation and not is_stopped():
        with _optional(folder / ANIMATION_NAME):
            from evac.export.vtk import export_vtk

            if results.trajectory is not None:
                export_vtk(results.trajectory, folder)
    is_replayed = output.replay and output.trajectory
    names = {REPLAY_NAME: is_replayed, EGRESS_PICTURE_NAME: output.picture, ANIMATION_NAME: output.animation}
    return [name for name, is_wanted in names.items() if is_wanted and not (folder / name).is_file()]


@contextmanager
def _optional(path: Path) -> Iterator[None]:
    """Warn of a file that cannot be written."""
    try:
        yield
    except Exception as error:
        why = str(error) if isinstance(error, EvacError) else f"{path}: {in_one_line(error)}"
        warnings.warn(f"{why}; the tables of the run are complete", FolderWarning, stacklevel=3)


def _check_interval(checkpoint: float | None) -> None:
    """Raise an error unless a wall time between two checkpoints [s] is finite and not negative, or None."""
    check_types(checkpoint=(checkpoint, Real | None))
    if checkpoint is not None and not 0.0 <= checkpoint < math.inf:
        raise ScenarioError(f"checkpoint: {checkpoint!r} given; give a wall time of 0 s or more, or None")


def _check_differences(path: Path, differences: list[str], is_allowed: bool) -> None:
    """Raise an error that lists the differences, if there are any and they are not allowed."""
    if differences and not is_allowed:
        raise ResultError(
            f"{path}: the run cannot be resumed with the same results, because of changes since the checkpoint:\n"
            + "\n".join(f"  {line}" for line in differences)
            + "\nundo the changes, run the case again, or accept them (allow_differences=True, or --allow-differences)"
        )
