"""What exporters have to hold to: they write where they are told to, the same bytes again, and change nothing."""

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
    """Run a case for some ticks and give its trajectory, of three frames or more."""
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
    """It writes at its place only, says what it wrote, writes over it, and writes the same again."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, f"export{exporter.suffix}")
        before = hashlib.sha256(trajectory.path.read_bytes()).digest()
        digests = []
        for _ in range(2):
            named = export(trajectory, exporter, place)
            if not named:
                raise PluginError(f"{SCENE}: write() names no file; return the paths that a user opens")
            for path in named:
                if not path.is_file():
                    raise PluginError(
                        f"{SCENE}: write() returns {path}, which is no file; return the files that are written"
                    )
            files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
            strays = [path for path in files if path != place and place not in path.parents]
            if strays:
                raise PluginError(f"{SCENE}: writes {strays[0].name} beside its place; write to `path` only")
            digests.append({path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files})
        if digests[0] != digests[1]:
            raise PluginError(f"{SCENE}: the same run is written differently again; write no time and no chance")
        if hashlib.sha256(trajectory.path.read_bytes()).digest() != before:
            raise PluginError(f"{SCENE}: changes the trajectory file; an exporter looks only")


def check_data_untouched(exporter: Exporter, trajectory: Trajectory) -> None:
    """The trajectory in memory is as it was."""
    before = trajectory.position.copy(), trajectory.velocity.copy(), trajectory.radius.copy()
    with tempfile.TemporaryDirectory() as folder:
        export(trajectory, exporter, Path(folder, f"export{exporter.suffix}"))
    after = trajectory.position, trajectory.velocity, trajectory.radius
    if not all(np.array_equal(one, other, equal_nan=True) for one, other in zip(before, after, strict=True)):
        raise PluginError(f"{SCENE}: changes the arrays of the trajectory; an exporter looks only")


def check_without_frames(exporter: Exporter, trajectory: Trajectory) -> None:
    """A run without a frame is written, or refused with ResultError."""
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
