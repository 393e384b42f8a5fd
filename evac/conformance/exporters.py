"""Checks of exporters: they write only to their path, reproducibly, and do not change the trajectory."""

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from evac.errors import PluginError, ResultError
from evac.output.exporter import Exporter, export
from evac.output.trajectory import Trajectory, read_trajectory
from evac.running import run
from evac.scenario.case import Case

#: What an exporter is tried on, as messages name it.
SCENE = "a run of some ticks"


@contextmanager
def recorded(case: Case, ticks: int) -> Iterator[Trajectory]:
    """Run a case for some ticks and yield its trajectory, with at least three frames."""
    changes = {
        "simulation.duration": ticks * case.simulation.tick,
        "output.every": max(1, ticks // 4) * case.simulation.tick,
        "output.animation": False,
        "output.picture": False,
    }
    with tempfile.TemporaryDirectory() as place:
        run(case.change(changes), Path(place, "result"))
        yield read_trajectory(Path(place, "result"))


def check_files(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that an exporter writes only to its path, returns the files, can overwrite them, and is reproducible."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, f"export{exporter.suffix}")
        before = hashlib.sha256(trajectory.path.read_bytes()).digest()
        digests = []
        for _ in range(2):
            named = export(trajectory, exporter, place)
            if not named:
                raise PluginError(f"{SCENE}: write() returns no file; return the paths that a user opens")
            for path in named:
                if not path.is_file():
                    raise PluginError(
                        f"{SCENE}: write() returns {path}, which is not an existing file; return the written files"
                    )
            files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
            strays = [path for path in files if path != place and place not in path.parents]
            if strays:
                raise PluginError(f"{SCENE}: writes {strays[0].name} outside `path`; write to `path` only")
            digests.append({path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files})
        if digests[0] != digests[1]:
            raise PluginError(
                f"{SCENE}: two exports of one run differ; do not write the current time or random numbers"
            )
        if hashlib.sha256(trajectory.path.read_bytes()).digest() != before:
            raise PluginError(f"{SCENE}: changes the trajectory file; an exporter must only read it")


def check_data_untouched(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that an exporter does not change the trajectory in memory."""
    before = trajectory.position.copy(), trajectory.velocity.copy(), trajectory.radius.copy()
    with tempfile.TemporaryDirectory() as folder:
        export(trajectory, exporter, Path(folder, f"export{exporter.suffix}"))
    after = trajectory.position, trajectory.velocity, trajectory.radius
    if not all(np.array_equal(one, other, equal_nan=True) for one, other in zip(before, after, strict=True)):
        raise PluginError(f"{SCENE}: changes the arrays of the trajectory; an exporter must only read them")


def check_without_frames(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that a run without frames is written, or refused with `ResultError`."""
    empty = replace(trajectory, time=trajectory.time[:0], records=())
    with tempfile.TemporaryDirectory() as folder:
        try:
            export(empty, exporter, Path(folder, f"export{exporter.suffix}"))
        except ResultError:
            return
        except PluginError as error:
            raise PluginError(f"a run without frames: {error}; raise ResultError") from error


EXPORTER_CHECKS: tuple[Callable[[Exporter, Trajectory], None], ...] = (
    check_files,
    check_data_untouched,
    check_without_frames,
)
