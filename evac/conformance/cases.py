"""Checks of plugins in a running case: reproducibility, read-only recorders."""

import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import PluginError, ResultError, counted, text_of
from evac.case.case import Case
from evac.conformance.failures import CheckError, scene
from evac.simulation.checkpoints import without_state
from evac.simulation.simulation import Simulation
from evac.trajectory.recorder import Recorder
from evac.trajectory.recording import reading

State = dict[str, NDArray[Any]]


def check_same_bits(case: Case, ticks: int = 20) -> None:
    """Check that results are bitwise equal: when repeated, resumed, and with all optional parts included."""
    with _scene(case, ticks):
        whole, middle = _run(case, ticks)
    with _scene(case, ticks, "repeated"):
        if different := _difference(whole, _run(case, ticks)[0]):
            raise CheckError(f"two runs differ in {different}", "use only the generator scene.generator")
    with _scene(case, ticks, "resumed in the middle"):
        resumed = Simulation(case)
        resumed.restore(middle)
        while resumed.step < whole["simulation.clock"][0]:
            resumed.advance_tick()
        if different := _difference(whole, resumed.state()):
            raise CheckError(f"a resumed run differs in {different}", "state() must return all private arrays")
        _check_state(resumed)
    with _scene(case, ticks, "with all optional parts"):
        full, _ = _run(case, ticks, full=True)
        crowd = {key: value for key, value in whole.items() if key.startswith("population.")}
        del crowd["population.route"]
        if different := _difference(crowd, full):
            raise CheckError(f"omitting parts that are not needed changes {different}", "correct is_needed()")


def check_read_only(recorder: Recorder, case: Case, ticks: int = 5) -> None:
    """Check that a recorder does not change a run, works without a result folder, and can finish without a start."""
    with tempfile.TemporaryDirectory() as place:
        for folder, what in ((None, "without a result folder"), (Path(place), "with a result folder")):
            with _scene(case, ticks, what):
                simulation = Simulation(case, folder)
                simulation.recording.recorders = []
                with _scene(case, 0, "finished before its start"):
                    type(recorder)(**recorder.values()).finish(simulation, None)
                with reading(simulation, "start()", recorder):
                    recorder.start(simulation)
                for _ in range(ticks):
                    before = simulation.state()
                    with reading(simulation, "record()", recorder):
                        recorder.record(simulation)
                    if different := _difference(before, simulation.state()):
                        raise CheckError(f"changes {different}", "only read the simulation, and copy arrays")
                    simulation.advance_tick()
                with reading(simulation, "finish()", recorder):
                    recorder.finish(simulation, simulation.results())


def check_resume(recorder: Recorder, case: Case, ticks: int = 10) -> None:
    """Check that the files of a recorder are identical if a run is stopped and resumed."""
    with tempfile.TemporaryDirectory() as place:
        whole, halved = Path(place) / "whole", Path(place) / "halved"
        for folder in (whole, halved):
            folder.mkdir()
        with _scene(case, 2 * ticks), _files_exist():
            made = type(recorder)(**recorder.values())
            simulation = _recorded(case, whole, made)
            _advance(simulation, 2 * ticks)
            made.finish(simulation, simulation.results())
        with _scene(case, 2 * ticks, "resumed in the middle"), _files_exist():
            _record_halved(recorder, case, ticks, halved)
            for path in sorted(path for path in whole.rglob("*") if path.is_file()):
                other = halved / path.relative_to(whole)
                if not other.is_file() or path.read_bytes() != other.read_bytes():
                    raise CheckError(
                        f"{path.name} differs in a run resumed from a checkpoint",
                        "state() must return all that the recorder keeps, and files() the lengths of the files that it"
                        " appends to",
                    )


def _record_halved(recorder: Recorder, case: Case, ticks: int, folder: Path) -> None:
    """Record a run that is resumed after half of its ticks."""
    made = type(recorder)(**recorder.values())
    simulation = _recorded(case, folder, made)
    _advance(simulation, ticks)
    state, kept, files = simulation.state(), simulation.recording.state(), simulation.recording.files()
    _check_state(simulation)
    _advance(simulation, ticks)  # data written after the checkpoint must be truncated on resume
    made.finish(simulation, None)
    made = type(recorder)(**recorder.values())
    simulation = _recorded(case, folder, made)
    simulation.restore(state)
    simulation.recording.restore(simulation, kept, files)
    _advance(simulation, ticks)
    made.finish(simulation, simulation.results())


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


def _scene(case: Case, ticks: int, how: str = "") -> AbstractContextManager[None]:
    return scene(f"{counted(ticks, 'tick')} of {case.title}{', ' if how else ''}{how}")


def _recorded(case: Case, folder: Path, recorder: Recorder) -> Simulation:
    simulation = Simulation(case, folder)
    simulation.recording.recorders = [recorder]
    return simulation


def _advance(simulation: Simulation, ticks: int) -> None:
    for _ in range(ticks):
        if not simulation.ended:
            simulation.advance_tick()


def _run(case: Case, ticks: int, full: bool = False) -> tuple[State, State]:
    """Return the states after a number of ticks and after half of them."""
    simulation = Simulation(case, full=full)
    middle = simulation.state()
    for tick in range(ticks):
        if simulation.ended:
            break
        if tick == ticks // 2:
            middle = simulation.state()
        simulation.advance_tick()
    return simulation.state(), middle


def _difference(first: State, second: State) -> str:
    """Return the name of the first array that differs; empty if there is none."""
    for key, value in first.items():
        if key not in second or not np.array_equal(value, second[key], equal_nan=value.dtype.kind == "f"):
            return key
    return ""
