"""Checks of plugins in a running case: reproducibility, read-only recorders."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import PluginError, ResultError, counted, text_of
from evac.case.case import Case
from evac.conformance.failures import CheckError, require, scene
from evac.simulation.checkpoints import without_state
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac.trajectory.recording import reading

State = dict[str, NDArray[Any]]


def check_same_bits(case: Case, ticks: int = 20) -> None:
    """Check that results are bitwise equal: when repeated, resumed, and with all optional parts included."""
    title = f"{counted(ticks, 'tick')} of {case.title}"
    with scene(title):
        simulation = Simulation(case)
        _advance(simulation, ticks // 2)
        middle = simulation.state()
        whole = _advance(simulation, ticks - ticks // 2)
    with scene(f"{title}, repeated"):
        different = _difference(whole, _advance(Simulation(case), ticks))
        require(not different, f"two runs differ in {different}", "use only the generator scene.generator")
    with scene(f"{title}, resumed in the middle"):
        resumed = Simulation(case)
        resumed.restore(middle)
        while resumed.step < whole["simulation.clock"][0]:
            resumed.advance_tick()
        different = _difference(whole, resumed.state())
        require(not different, f"a resumed run differs in {different}", "state() must return all private arrays")
        _check_state(resumed)
    with scene(f"{title}, with all optional parts"):
        full = _advance(Simulation(case, full=True), ticks)
        crowd = {key: value for key, value in whole.items() if key.startswith("population.")}
        del crowd["population.route"]
        different = _difference(crowd, full)
        require(not different, f"omitting parts that are not needed changes {different}", "correct is_needed()")


def check_recorder(recorder: Recorder, case: Case, ticks: int = 10) -> None:
    """Check that a recorder changes nothing, also without a result folder, and that its files survive a resumed run.

    It can finish without a start. Its files are identical if a run is stopped and resumed.
    """
    title, plain = f"{counted(2 * ticks, 'tick')} of {case.title}", Simulation(case)
    plain.recording.recorders = []
    state = _advance(plain, 2 * ticks)
    with tempfile.TemporaryDirectory() as whole, tempfile.TemporaryDirectory() as halved:
        for folder, what in ((None, "without a result folder"), (Path(whole), "with a result folder")):
            with scene(f"{title}, {what}, finished before its start"):
                simulation, made = _recorded(case, folder, recorder)
                made.finish(simulation, None)
            with scene(f"{title}, {what}"), _files_exist():
                simulation, made = _recorded(case, folder, recorder)
                different = _difference(state, _advance(simulation, 2 * ticks))
                require(not different, f"changes {different}", "only read the simulation, and copy arrays")
                with reading(simulation, "finish()", recorder):
                    made.finish(simulation, simulation.results())
        with scene(f"{title}, resumed in the middle"), _files_exist():
            simulation, made = _recorded(case, Path(halved), recorder)
            middle = _advance(simulation, ticks)
            kept, files = simulation.recording.state(), simulation.recording.files()
            _check_state(simulation)
            _advance(simulation, ticks)  # data written after the checkpoint must be truncated on resume
            made.finish(simulation, None)
            simulation, made = _recorded(case, Path(halved), recorder)
            simulation.restore(middle)
            simulation.recording.restore(simulation, kept, files)
            _advance(simulation, ticks)
            made.finish(simulation, simulation.results())
            for path in sorted(path for path in Path(whole).rglob("*") if path.is_file()):
                other = Path(halved) / path.relative_to(whole)
                is_same = other.is_file() and path.read_bytes() == other.read_bytes()
                remedy = "state() must return all that it keeps, and files() the lengths of files that it appends to"
                require(is_same, f"{path.name} differs in a run resumed from a checkpoint", remedy)


@contextmanager
def _files_exist() -> Iterator[None]:
    """Name the remedy if the files that the recorder names do not exist."""
    try:
        yield
    except ResultError as error:
        wrong, _, _ = text_of(error).rpartition("; ")
        remedy = "files() must return existing files of the folder, with the numbers of bytes written so far"
        raise CheckError(wrong, remedy) from error


def _check_state(simulation: Simulation) -> None:
    if missing := without_state(simulation):
        raise PluginError(missing[0])


def _recorded(case: Case, folder: Path | None, recorder: Recorder) -> tuple[Simulation, Recorder]:
    """Return a simulation with one recorder, a new one of the same kind."""
    simulation, made = Simulation(case, folder), type(recorder)(**recorder.values())
    simulation.recording.recorders = [made]
    return simulation, made


def _advance(simulation: Simulation, ticks: int) -> State:
    """Make a number of ticks, unless the run ends before, and return the state."""
    for _ in range(ticks):
        if not simulation.ended:
            simulation.advance_tick()
    return simulation.state()


def _difference(first: State, second: State) -> str:
    """Return the name of the first array that differs; empty if there is none."""
    for key, value in first.items():
        if key not in second or not np.array_equal(value, second[key], equal_nan=value.dtype.kind == "f"):
            return key
    return ""
