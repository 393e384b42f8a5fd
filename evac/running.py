"""From a case to a result folder: run, then write everything that is written; and go on from a checkpoint."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.checkpoints import Checkpoints, find_checkpoint
from evac.display import displayed
from evac.ending import FAILED, INTERRUPTED, Stopped
from evac.errors import EvacError, ResultError, ScenarioError, note
from evac.output.files import (
    CHECKPOINT_NAME,
    EGRESS_NAME,
    EGRESS_PICTURE_NAME,
    PEOPLE_NAME,
    SUMMARY_NAME,
    TRAJECTORY_NAME,
)
from evac.output.recording import check_lengths
from evac.output.resultfolder import ResultFolder
from evac.output.results import Results
from evac.output.trajectory import read_trajectory
from evac.phases import Phases, Progress
from evac.scenario.loading import as_case
from evac.scenario.overrides import parsed
from evac.simulation import Simulation

if TYPE_CHECKING:
    from evac.registry import Registry
    from evac.scenario.case import Case


def run(
    case: "Case | str | Path | Mapping[str, Any]",
    folder: str | Path | None = None,
    *,
    full: bool = False,
    checkpoint: float | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | bool | None = None,
) -> Results:
    """Run a case to its end and return the results.

    Parameters
    ----------
    case : Case, str, Path or mapping
        From `evac.load`, or what `evac.load` takes.
    folder : str or Path, optional
        Result folder: new, empty, or that of an earlier run, which is replaced once this one has ended. None writes
        nothing.
    full : bool
        Do even what the scene does not need; gives the same bits, slower.
    checkpoint : float, optional
        Wall time between two checkpoints [s], from which `resume` goes on after a kill. None keeps none.
    threads : int, optional
        Threads that share the steps, no more than there are cores; None lets the number of people decide. The results
        are the same to the last bit.
    progress : callable or bool, optional
        Called with a `Progress` at every tick. None shows a bar on a terminal and a line in a notebook; True shows
        lines elsewhere too, and False nothing.

    Returns
    -------
    Results

    Raises
    ------
    EvacError
        The case, the building, the people or the plugins do not fit together, a step cannot be made, or the folder
        cannot be written or is being written by another run.

    Examples
    --------
    >>> results = run("classroom", "classroom-result")  # doctest: +SKIP
    """
    case = as_case(case)
    if folder is None:
        if checkpoint is not None:
            raise ScenarioError("checkpoints need a result folder; give one")
        with displayed(progress) as shown:
            return Simulation(case, None, full, threads=threads).run(shown)
    with ResultFolder(folder) as place, displayed(progress) as shown:
        simulation = Simulation(case, place.running, full, threads=threads)
        place.start()
        return run_into(simulation, place, shown, checkpoint=checkpoint)


def resume(
    folder: str | Path,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    *,
    out: str | Path | None = None,
    plugin_files: Iterable[str | Path] = (),
    registry: "Registry | None" = None,
    checkpoint: float | None = None,
    threads: int | None = None,
    allow_differences: bool = False,
    progress: Callable[[Progress], None] | bool | None = None,
) -> Results:
    """Go on with a run that was killed or stopped, from its last checkpoint; to the same bits as if it had not been.

    Parameters
    ----------
    folder : str or Path
        Result folder that the run was given.
    overrides : mapping, or iterable of str
        Keys of the case to change from here on, as for `evac.load`; needs `out`. Of the building only ``closed`` may
        change, and people, seed, step, tick and ``output.every`` may not.
    out : str or Path, optional
        Another result folder. The run there records from the checkpoint on, and `folder` stays as it is.
    plugin_files, registry
        As for `evac.load`: those that the run was given beside those of its case.
    checkpoint : float, optional
        Wall time between two checkpoints [s]; by default as before.
    threads : int, optional
        As for `run`.
    allow_differences : bool
        Go on even where versions, kernels, plugins or the building's file are not as they were; the results then
        may not be those of a run that was never stopped, and the summary says so.
    progress : callable or bool, optional
        As for `run`.

    Returns
    -------
    Results

    Raises
    ------
    ResultError
        There is no checkpoint, it is damaged, or something is not as it was when it was written.
    EvacError
        As `run`.

    Examples
    --------
    >>> results = resume("classroom-result")  # doctest: +SKIP
    >>> results = resume("classroom-result", {"building.closed": ["door"]}, out="closed-result")  # doctest: +SKIP
    """
    with ResultFolder(folder if out is None else out) as place, displayed(progress) as shown:
        simulation, every = resumed(folder, place, overrides, plugin_files, registry, allow_differences, threads)
        return run_into(simulation, place, shown, checkpoint=every if checkpoint is None else checkpoint)


def resumed(
    folder: str | Path,
    place: ResultFolder,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    plugin_files: Iterable[str | Path] = (),
    registry: "Registry | None" = None,
    allow_differences: bool = False,
    threads: int | None = None,
    compiling: Callable[[int, int], None] | None = None,
    tell: Callable[[Path], None] | None = None,
) -> tuple[Simulation, float | None]:
    """Return a simulation at the checkpoint of a folder, ready to go on in `place`, and its time between checkpoints.

    Parameters and errors are those of `resume` and of `Simulation`; `place` is held, and `tell` is called with the path
    of each plugin file of the case before it is run.
    """
    folder, overrides = Path(folder), _listed(overrides)
    is_branch = folder.resolve() != place.path.resolve()
    if overrides and not is_branch:
        raise ScenarioError(
            f"{folder}: a run that goes on in a changed case needs a folder of its own, so that the results of the two "
            "never mix; name one (--out)"
        )
    found = find_checkpoint(folder)
    before = found.case((), plugin_files, registry, tell)
    case = found.case(overrides, plugin_files, before.registry) if overrides else before
    differences = found.differences(before)
    _refuse(found.path, differences, allow_differences)
    simulation = Simulation(case, place.running, bool(found.header["full"]), threads=threads, compiling=compiling)
    differences += found.simulation_differences(simulation)
    _refuse(found.path, differences, allow_differences)
    found.restore(simulation, before if overrides else None)
    simulation.resumed.append(
        {"from": str(folder), "time": found.time, "changes": dict(overrides), "differences": differences}
    )
    if is_branch:
        place.start()
    else:
        place.reopen(found.path.parent, [*found.files, CHECKPOINT_NAME])
        found.restore_recorders(simulation)
    return simulation, found.every


def run_into(
    simulation: Simulation,
    place: ResultFolder,
    progress: Callable[[Progress], None] | None = None,
    *,
    checkpoint: float | None = None,
    writing: Callable[[], None] | None = None,
) -> Results:
    """Run a simulation, write its folder, and put that in its place; a run that fails leaves what it has done.

    Parameters
    ----------
    simulation : Simulation
        Made for ``place.running``.
    place : ResultFolder
        Held, and started or reopened.
    progress : callable, optional
        Called with a `Progress` at every tick. If it raises `Stopped`, the state is kept, to go on from.
    checkpoint : float, optional
        As for `run`.
    writing : callable, optional
        Called when the run is over, before its outputs are written.

    Returns
    -------
    Results
        Their ``folder`` is where they are: RESULT, or for a run that was stopped beside an earlier result
        RESULT.running.

    Raises
    ------
    EvacError
        As for `run`.
    """
    checkpoints = Checkpoints(simulation, place, checkpoint)
    first = simulation.step

    def after_tick(state: Progress) -> None:
        place.check()
        try:
            if progress is not None:
                progress(state)
        except Stopped:
            if not simulation.ended:
                checkpoints.save_last()
            raise
        if not simulation.ended:  # a run goes on from a tick that is not its last
            checkpoints.save_if_due()

    with simulation.phases.enter("output"):
        try:
            results = simulation.run(after_tick, checkpoints.begin)
            results = replace(results, plugin_files=simulation.recording.plugin_files())
            if writing is not None:
                writing()
            results = write_outputs(results, place.running, simulation.phases)
            _look(simulation, place)
        except EvacError as error:
            note(error, simulation.warnings())
            _leave(simulation, place, first, error)
            raise
        if results.ended == INTERRUPTED:
            return replace(results, folder=place.publish_if_new())
        folder = place.publish()
        (folder / CHECKPOINT_NAME).unlink(missing_ok=True)
        return replace(results, folder=folder)


def write_outputs(results: Results, folder: Path, phases: Phases) -> Results:
    """Write everything but trajectory and replay, which the run has written, to its folder.

    Always summary.json; egress.csv and people.csv where ``output.tables`` is true, egress.png where ``output.picture``
    is, the VTK animation where ``output.animation`` is.

    Parameters
    ----------
    results : Results
    folder : Path
        There already.
    phases : Phases
        The clock of the run, in its phase "output".

    Returns
    -------
    Results
        With the wall time of the output among its phases.

    Raises
    ------
    ResultError
        A file cannot be written.
    """
    try:
        if results.case.output.tables:
            results.write_tables(folder)
        if results.case.output.picture:
            from evac.output.pictures import draw_egress

            draw_egress(results, folder / EGRESS_PICTURE_NAME)
        if results.case.output.animation and (folder / TRAJECTORY_NAME).is_file():
            from evac.output.vtk_export import export_vtk

            export_vtk(read_trajectory(folder), folder)
    finally:  # the summary tells how long the other files took, and is there even if one of them fails
        results = replace(results, phases=phases.seconds())
        results.write_summary(folder)
    return results


def _look(simulation: Simulation, place: ResultFolder) -> None:
    """See that all that was written is there."""
    place.check()
    simulation.recording.check_files()
    tables = (EGRESS_NAME, PEOPLE_NAME) if simulation.case.output.tables else ()
    check_lengths(place.running, dict.fromkeys((*tables, SUMMARY_NAME), 1))


def _leave(simulation: Simulation, place: ResultFolder, first: int, error: EvacError) -> None:
    """Write the tables of a run that has failed, or remove its folder if it has not made a step since `first`."""
    with suppress(ResultError, OSError):  # the first failure is the one to tell
        place.check()
        if simulation.step > first:
            simulation.ended = simulation.ended or FAILED
            if not (place.running / SUMMARY_NAME).is_file():
                results = replace(simulation.results(), plugin_files=simulation.recording.plugin_files())
                if results.case.output.tables:
                    results.write_tables(place.running)
                results.write_summary(place.running)
            error.add_note(f"what the run has done until then is in {place.publish_if_new()}")
        elif not first:
            place.discard(simulation.recording.plugin_files())


def _refuse(path: Path, differences: list[str], is_allowed: bool) -> None:
    """Refuse to go on where something is not as it was."""
    if differences and not is_allowed:
        raise ResultError(
            f"{path}: the run cannot go on to the same bits, for not all is as it was at the checkpoint:\n"
            + "\n".join(f"  {line}" for line in differences)
            + "\nput that right, run the case again, or go on all the same (--allow-differences)"
        )


def _listed(overrides: Mapping[str, Any] | Iterable[str]) -> dict[str, Any]:
    """Return overrides as a dictionary."""
    pairs, problems = parsed(overrides)
    if problems:
        raise ScenarioError("; ".join(f"{'.'.join(map(str, problem.key))}: {problem.text}" for problem in problems))
    return dict(pairs)
