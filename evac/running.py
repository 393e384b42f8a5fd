"""From a case to a result folder: run, then write everything that is written."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from evac.errors import ResultError
from evac.output import FILM_NAME, PICTURE_NAME
from evac.output.results import Results
from evac.output.trajectory import FILE_NAME, read_trajectory
from evac.simulation import Progress, Simulation

if TYPE_CHECKING:
    from evac.scenario.schema import Case

#: What a run writes to its folder; nothing else there is ever touched.
SUMMARY_NAME = "summary.json"
EGRESS_PICTURE_NAME = "egress.png"
ANIMATION_NAME = "animation.pvd"
WRITTEN = (
    SUMMARY_NAME,
    FILE_NAME,
    "egress.csv",
    "people.csv",
    EGRESS_PICTURE_NAME,
    ANIMATION_NAME,
    "building.vtp",
    "frames/frame_*.vtp",
    PICTURE_NAME,
    FILM_NAME,
)


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

    Raises
    ------
    EvacError
        The building, the people or the plugins do not fit together, a step cannot be made, or the folder
        cannot be written.

    Examples
    --------
    >>> results = run(load("classroom"), "classroom-result")  # doctest: +SKIP
    """
    place = None if folder is None else Path(folder)
    if place is not None:
        check_folder(place)
    simulation = Simulation(case, place, full)
    if place is not None:
        clear_folder(place)
    results = simulation.run(progress)
    return results if place is None else write_outputs(results, place)


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
    is_result = (folder / SUMMARY_NAME).is_file() or (folder / FILE_NAME).is_file()
    if not is_result and any(folder.iterdir()):
        raise ResultError(
            f"{folder}: holds files and is no result folder of evac (neither {SUMMARY_NAME} nor {FILE_NAME} is there); "
            "choose a new or empty folder for the results (--out)"
        )


def clear_folder(folder: Path) -> None:
    """Make a folder, and remove from it what an earlier run wrote, so that two runs never mix.

    Raises
    ------
    ResultError
        The folder cannot be made or written.
    """
    check_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for pattern in WRITTEN:
            for path in folder.glob(pattern):
                path.unlink()
    except OSError as error:
        raise ResultError(f"{folder}: cannot write results there: {error.strerror}; choose another folder") from error


def write_outputs(results: Results, folder: Path) -> Results:
    """Write everything but the trajectory, which the run has written, to its folder.

    Always summary.json, egress.csv and people.csv; egress.png where ``output.picture`` is true, the VTK
    animation where ``output.animation`` is.

    Returns
    -------
    Results
        With the wall time of the output among its phases.

    Raises
    ------
    ResultError
        A file cannot be written.
    """
    start = time.perf_counter()
    if results.case.output.picture:
        from evac.output.pictures import draw_egress

        draw_egress(results, folder / EGRESS_PICTURE_NAME)
    if results.case.output.animation and (folder / FILE_NAME).is_file():
        from evac.output.vtk_export import export_vtk

        export_vtk(read_trajectory(folder), folder)
    results = replace(results, phases={**results.phases, "output": time.perf_counter() - start})
    results.write(folder)
    return results
