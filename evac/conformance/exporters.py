"""Checks of exporters: they write only to their path, reproducibly, and do not change the trajectory."""

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from evac.base.errors import PluginError, ResultError, RunWarning, text_of
from evac.case.case import Case
from evac.conformance.failures import CheckError, scene
from evac.export.exporter import Exporter, export
from evac.simulation.running import run
from evac.trajectory.trajectory import Trajectory, read_trajectory


def check_case(case: Case, ticks: int, folder: Path) -> Trajectory:
    """Check that a case can be run for some ticks; return its trajectory, with at least three frames."""
    changes = {
        "simulation.duration": ticks * case.simulation.tick,
        "output.every": max(1, ticks // 4) * case.simulation.tick,
        "output.animation": False,
        "output.picture": False,
    }
    with scene(case.title), warnings.catch_warnings():
        warnings.simplefilter("ignore", RunWarning)  # of a case, not of the exporter
        run(case.change(changes), folder / "result")
        return read_trajectory(folder / "result")


def check_files(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that an exporter writes only to its path, returns the files, can overwrite them, and is reproducible."""
    before = trajectory.path.read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, f"export{exporter.suffix}")
        with scene("a run of some ticks"):
            first = _exported(exporter, trajectory, place)
        with scene("a run of some ticks, exported again to the same place"):
            if _exported(exporter, trajectory, place) != first:
                raise CheckError("the two exports differ", "do not write the current time or random numbers")
            if trajectory.path.read_bytes() != before:
                raise CheckError("the trajectory file has changed", "only read it")


def _exported(exporter: Exporter, trajectory: Trajectory, place: Path) -> dict[Path, bytes]:
    """Return the files that an exporter writes, with their content; refuse files outside of `place`."""
    export(trajectory, exporter, place)
    files = sorted(path for path in place.parent.rglob("*") if path.is_file())
    strays = [path for path in files if path != place and place not in path.parents]
    if strays:
        raise CheckError(f"writes {strays[0].name} outside `path`", "write to `path` only")
    return {path: path.read_bytes() for path in files}


def check_without_frames(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that a run without frames is written, or refused with `ResultError`."""
    empty = replace(trajectory, time=trajectory.time[:0], rows=())
    with tempfile.TemporaryDirectory() as folder, scene("a run without frames"):
        try:
            export(empty, exporter, Path(folder, f"export{exporter.suffix}"))
        except ResultError:
            return
        except PluginError as error:
            wrong, _, _ = text_of(error).rpartition("; ")
            raise CheckError(wrong, "write a file without rows, or raise ResultError") from error.__cause__


EXPORTER_CHECKS: tuple[Callable[[Exporter, Trajectory], None], ...] = (
    check_files,
    check_without_frames,
)
