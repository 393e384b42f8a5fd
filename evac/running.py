"""From a case to a result folder: run, then write everything that is written."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from evac.ending import FAILED
from evac.errors import EvacError, ResultError, note
from evac.output.files import EGRESS_PICTURE_NAME, STUDY_NAME, SUMMARY_NAME, TRAJECTORY_NAME, WRITTEN, writing
from evac.output.results import Results
from evac.output.trajectory import MAGIC, read_trajectory
from evac.phases import Phases, Progress
from evac.simulation import Simulation

if TYPE_CHECKING:
    from evac.scenario.case import Case


def run(
    case: "Case",
    folder: str | Path | None = None,
    *,
    full: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Results:
    """Run a case to its end and return the results.

    Parameters
    ----------
    case : Case
        From `evac.load`.
    folder : str or Path, optional
        Result folder: new, empty, or that of an earlier run, which is overwritten. None writes nothing.
    full : bool
        Do even what the scene does not need; gives the same bits, slower.
    progress : callable, optional
        Called with a `Progress` at every tick.

    Returns
    -------
    Results

    Raises
    ------
    EvacError
        The building, the people or the plugins do not fit together, a step cannot be made, or the folder
        cannot be written.

    Examples
    --------
    >>> results = run(load("classroom"), "classroom-result")  # doctest: +SKIP
    """
    if folder is None:
        return Simulation(case, None, full).run(progress)
    place = Path(folder)
    check_folder(place)
    return run_into(Simulation(case, place, full), place, progress)


def run_into(
    simulation: Simulation,
    folder: Path,
    progress: Callable[[Progress], None] | None = None,
    writing: Callable[[], None] | None = None,
) -> Results:
    """Run a simulation and write its folder; a run that fails leaves the tables of what it has done.

    Parameters
    ----------
    simulation : Simulation
        Made for this folder.
    folder : Path
        As for `run`.
    progress : callable, optional
        Called with a `Progress` at every tick.
    writing : callable, optional
        Called when the run is over, before its outputs are written.

    Returns
    -------
    Results

    Raises
    ------
    EvacError
        As for `run`.
    """
    with simulation.phases.enter("output"):
        clear_folder(folder)
        try:
            results = simulation.run(progress)
        except EvacError as error:
            note(error, simulation.warnings())
            if simulation.step:
                simulation.ended = simulation.ended or FAILED
                with suppress(ResultError):  # the first failure is the one to tell
                    simulation.results().write(folder)
            raise
        if writing is not None:
            writing()
        return write_outputs(results, folder, simulation.phases)


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds files and is no result folder of evac.

    Raises
    ------
    ResultError
        Naming the folder and the way out.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ResultError(f"{folder}: not a folder; choose another one for the results (--out)")
    if not _is_result(folder) and any(folder.iterdir()):
        raise ResultError(
            f"{folder}: holds files and is no result folder of evac (neither its {SUMMARY_NAME} nor its "
            f"{TRAJECTORY_NAME} is there); choose a new or empty folder for the results (--out)"
        )


def _is_result(folder: Path) -> bool:
    """Say whether a folder holds a trajectory or a summary that evac has written."""
    try:
        with (folder / TRAJECTORY_NAME).open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                return True
    except OSError:
        pass
    return any(_is_written_by_evac(folder / name) for name in (SUMMARY_NAME, STUDY_NAME))


def _is_written_by_evac(path: Path) -> bool:
    """Say whether a file is one of evac's that name its version."""
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    versions = summary.get("versions") if isinstance(summary, dict) else None
    return isinstance(versions, dict) and "evac" in versions


def make_folder(folder: Path) -> None:
    """Make a folder for results where there is none, or see that it may be used.

    Raises
    ------
    ResultError
        It is somebody else's, or cannot be made.
    """
    check_folder(folder)
    with writing("the results", folder):
        folder.mkdir(parents=True, exist_ok=True)


def clear_folder(folder: Path) -> None:
    """Make a folder, and remove from it what an earlier run wrote, so that two runs never mix.

    Raises
    ------
    ResultError
        The folder cannot be made or written.
    """
    make_folder(folder)
    with writing("the results", folder):
        for pattern in WRITTEN:
            for path in folder.glob(pattern):
                path.unlink()


def write_outputs(results: Results, folder: Path, phases: Phases) -> Results:
    """Write everything but the trajectory, which the run has written, to its folder.

    Always egress.csv, people.csv and summary.json; egress.png where ``output.picture`` is true, the VTK
    animation where ``output.animation`` is.

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
