"""Checks of plugins in a running case: reproducibility, declared arrays, read-only recorders."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.checkpoints import without_state
from evac.errors import PluginError
from evac.output.recorder import Recorder
from evac.physics.state import Crowd
from evac.scenario.case import Case
from evac.simulation import Simulation

State = dict[str, NDArray[Any]]


def check_same_bits(case: Case, ticks: int = 20) -> None:
    """Check that results are bitwise equal: when repeated, resumed, and with all optional parts included."""
    whole, middle = _run(case, ticks)
    if different := _difference(whole, _run(case, ticks)[0]):
        raise PluginError(f"{case.title}: two runs differ in {different}; use only the generator scene.generator")
    resumed = Simulation(case)
    resumed.restore(middle)
    while resumed.step < whole["simulation.clock"][0]:
        resumed.advance_tick()
    if different := _difference(whole, resumed.state()):
        raise PluginError(f"{case.title}: a resumed run differs in {different}; state() must return all private arrays")
    if missing := without_state(resumed):
        raise PluginError(missing[0])
    full, _ = _run(case, ticks, full=True)
    moving = {key: value for key, value in whole.items() if key.startswith("population.") and key != "population.route"}
    if different := _difference(moving, full):
        raise PluginError(f"{case.title}: omitting parts that are not needed changes {different}; correct is_needed()")


def check_declared_arrays(case: Case, name: str, ticks: int = 20) -> None:
    """Check that a behaviour reads and writes only the arrays that it declares."""
    simulation = Simulation(case, full=True)
    found = next((pair for pair in simulation.behaviours if pair[0].name == name), None)
    if found is None:
        raise PluginError(f"{case.title}: the case does not use behaviour {name!r}; give a case that does")
    behaviour, scene = found
    scene.crowd = watched = _WatchedCrowd(**scene.crowd.values())
    crowd = simulation.population.crowd
    try:
        behaviour.prepare(scene)
        for _ in range(ticks):
            before = {key: array.copy() for key, array in crowd.values().items() if key not in behaviour.writes}
            behaviour.act(scene.crowd, simulation.time)
            for key, array in before.items():
                if not np.array_equal(array, getattr(crowd, key), equal_nan=True):
                    raise PluginError(f"{name}: writes {key!r} without declaring it; add it to `writes`")
            if simulation.ended:
                break
            simulation.advance_tick()
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise PluginError(f"{name}: writes an array without declaring it in `writes`: {error}") from error
    if undeclared := sorted(watched.seen - {*behaviour.reads, *behaviour.writes}):
        raise PluginError(f"{name}: reads {', '.join(undeclared)} without declaring it; add it to `reads`")


def check_read_only(recorder: Recorder, case: Case, ticks: int = 5) -> None:
    """Check that a recorder does not change a run, works without a result folder, and can finish without a start."""
    with tempfile.TemporaryDirectory() as place:
        for folder in (None, Path(place)):
            simulation = Simulation(case, folder)
            simulation.recording.recorders = []
            type(recorder)(**recorder.values()).finish(simulation, None)
            recorder.start(simulation)
            for _ in range(ticks):
                before = simulation.state()
                recorder.record(simulation)
                if different := _difference(before, simulation.state()):
                    raise PluginError(f"{recorder.name}: changes {different}; a recorder must not change the run")
                simulation.advance_tick()
            recorder.finish(simulation, simulation.results())


def check_resume(recorder: Recorder, case: Case, ticks: int = 10) -> None:
    """Check that the files of a recorder are identical if a run is stopped and resumed."""
    with tempfile.TemporaryDirectory() as place:
        whole, halved = Path(place) / "whole", Path(place) / "halved"
        for folder in (whole, halved):
            folder.mkdir()
        made = type(recorder)(**recorder.values())
        simulation = _recorded(case, whole, made)
        _advance(simulation, 2 * ticks)
        made.finish(simulation, simulation.results())
        made = type(recorder)(**recorder.values())
        simulation = _recorded(case, halved, made)
        _advance(simulation, ticks)
        state, kept, files = simulation.state(), simulation.recording.state(), simulation.recording.files()
        if missing := without_state(simulation):
            raise PluginError(missing[0])
        _advance(simulation, ticks)  # data written after the checkpoint must be truncated on resume
        made.finish(simulation, None)
        made = type(recorder)(**recorder.values())
        simulation = _recorded(case, halved, made)
        simulation.restore(state)
        simulation.recording.restore(simulation, kept, files)
        _advance(simulation, ticks)
        made.finish(simulation, simulation.results())
        for path in sorted(path for path in whole.rglob("*") if path.is_file()):
            other = halved / path.relative_to(whole)
            if not other.is_file() or path.read_bytes() != other.read_bytes():
                raise PluginError(
                    f"{recorder.name}: {path.name} differs in a run resumed from a checkpoint; state() must return "
                    "everything that the recorder keeps, and files() the lengths of the files that it appends to"
                )


def _recorded(case: Case, folder: Path, recorder: Recorder) -> Simulation:
    simulation = Simulation(case, folder)
    simulation.recording.recorders = [recorder]
    return simulation


def _advance(simulation: Simulation, ticks: int) -> None:
    for _ in range(ticks):
        if not simulation.ended:
            simulation.advance_tick()


class _WatchedCrowd(Crowd):
    """A crowd that records which arrays are accessed."""

    def __getattribute__(self, name: str) -> Any:
        if name in Crowd.kinds:
            self.seen.add(name)
        return super().__getattribute__(name)

    @property
    def seen(self) -> set[str]:
        noted: set[str] = self.__dict__.setdefault("noted", set())
        return noted


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
