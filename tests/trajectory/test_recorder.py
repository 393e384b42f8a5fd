"""Recorders of a run: their calls, files and states, and a run that goes on from a checkpoint."""

from types import SimpleNamespace

import numpy as np
import pytest

from evac.base.errors import PluginError, ResultError
from evac.base.saved import SavedError, taken
from evac.contract.registry import Registry
from evac.trajectory.recorder import Recorder, Recording

REGISTRY = Registry(builtins=())


class Lines(Recorder):
    """A file with a line for each state, whose number is saved."""

    name = "lines"

    def start(self, simulation):
        self.number = 0
        (simulation.folder / "lines.txt").write_bytes(b"begin\n")

    def record(self, simulation):
        self.number += 1
        with (simulation.folder / "lines.txt").open("ab") as file:
            file.write(b"%g\n" % simulation.time)

    def finish(self, simulation, results):
        self.results = results
        (simulation.folder / "end.txt").write_text("end")

    def state(self):
        return {"number": np.array(self.number)}

    def check_state(self, simulation, state, folder, files):
        taken(state, "number", np.int64, ())

    def restore(self, simulation, state):
        self.folder, self.number = simulation.folder, int(state["number"])

    def files(self):
        return {"lines.txt": 6 + 2 * self.number}


@pytest.fixture
def simulation(tmp_path):
    crowd = SimpleNamespace(values=lambda: {"position": position})
    position = np.zeros((2, 2))
    return SimpleNamespace(
        folder=tmp_path,
        time=0.0,
        displacement_velocity=np.zeros((2, 2)),
        population=SimpleNamespace(crowd=crowd, is_read_only=False),
    )


def started(simulation, recorder=Lines):
    recording = Recording([recorder()], simulation.folder)
    recording.start(simulation)
    return recording


def test_a_run_that_goes_on_has_the_files_and_numbers_of_the_checkpoint(simulation):
    path = simulation.folder / "lines.txt"
    first = started(simulation)
    state, files = first.state(), first.sync()
    assert (state, [*files]) == ({"lines.number": 1}, ["lines.txt"])
    assert first.plugin_files() == ["lines.txt"]
    for simulation.time in (1.0, 2.0):
        first.record(simulation)
    assert path.read_bytes() == b"begin\n0\n1\n2\n"
    assert first.files() == {"lines.txt": 12}
    again = Recording([Lines()], simulation.folder)
    known = {name: (one["length"], one["sha256"]) for name, one in files.items()}
    again.check(simulation, state, simulation.folder, known)
    assert path.read_bytes() == b"begin\n0\n1\n2\n"
    again.restore(simulation, state, {"lines.txt": 8}, ["lines.txt", "old.txt"])
    assert (again.is_started, path.read_bytes()) == (True, b"begin\n0\n")
    assert again.plugin_files() == ["lines.txt", "old.txt"]
    simulation.time = 3.0
    again.record(simulation)
    again.finish(simulation, REGISTRY, None, None)
    assert path.read_bytes() == b"begin\n0\n3\n"
    assert again.plugin_files() == ["end.txt", "lines.txt", "old.txt"]


@pytest.mark.parametrize("change", [b"Begin\n0\n1\n", b"begin\n"])
def test_a_file_that_was_changed_or_cut_is_no_file_of_the_checkpoint(simulation, change):
    recording = started(simulation)
    files = {name: (one["length"], one["sha256"]) for name, one in recording.sync().items()}
    (simulation.folder / "lines.txt").write_bytes(change)
    with pytest.raises(ResultError, match=r"lines\.txt"):
        Recording([Lines()], simulation.folder).check(simulation, recording.state(), simulation.folder, files)


def test_a_state_of_no_recorder_is_refused_by_its_name(simulation):
    recording = started(simulation)
    with pytest.raises(SavedError, match=r"^lines\.number: the array is missing"):
        Recording([Lines()], simulation.folder).check(simulation, {}, simulation.folder, {})
    recording.finish(simulation, REGISTRY, None, None)


class Failing(Lines):
    """Fails to go on."""

    def restore(self, simulation, state):
        raise ValueError("oops")


class Longer(Lines):
    """Names another length than that of the checkpoint."""

    def restore(self, simulation, state):
        self.number, self.folder = 9, simulation.folder


@pytest.mark.parametrize(
    ("kind", "words"), [(Failing, "'lines': restore: ValueError: oops"), (Longer, "other lengths")]
)
def test_a_restore_that_fails_leaves_the_files_as_they_were(simulation, kind, words):
    recording, path = started(simulation), simulation.folder / "lines.txt"
    state = recording.state()
    for simulation.time in (1.0, 2.0):
        recording.record(simulation)
    again = Recording([kind()], simulation.folder)
    with pytest.raises((PluginError, ResultError), match=words):
        again.restore(simulation, state, {"lines.txt": 8})
    assert path.read_bytes() == b"begin\n0\n1\n2\n"
    assert not again.is_started


def test_every_recorder_finishes_and_the_first_error_is_raised_or_added(simulation):
    class Odd(Lines):
        name = "odd"

        def files(self):
            return {}

        def finish(self, simulation, results):
            raise ValueError("oops")

    recorders = [Odd(), Lines()]
    recording = Recording(recorders, simulation.folder)
    recording.start(simulation)
    with pytest.raises(PluginError, match="recorder 'odd': finish: ValueError: oops"):
        recording.finish(simulation, REGISTRY, "results", None)
    assert recorders[1].results == "results"
    error = ResultError("first")
    recording.finish(simulation, REGISTRY, None, error)
    assert "recorder 'odd': finish: ValueError: oops" in error.__notes__[0]


def test_a_recorder_only_reads_and_its_files_stay(simulation):
    class Writing(Lines):
        def record(self, simulation):
            simulation.population.crowd.values()["position"][0] = 1.0

    with pytest.raises(PluginError, match=r"t = 0\.000 s: recorder 'lines'.*read-only.*copy arrays"):
        started(simulation, Writing)
    position = simulation.population.crowd.values()["position"]
    assert position.flags.writeable
    assert not position.any()
    assert not simulation.population.is_read_only
    recording = started(simulation)
    (simulation.folder / "lines.txt").unlink()
    with pytest.raises(ResultError, match=r"lines\.txt"):
        recording.record(simulation)


def test_files_are_checked_at_the_end_of_a_run_that_started_and_went_well(simulation):
    recorder = Lines()
    recorder.number = 5  # of which there is no file
    Recording([recorder], simulation.folder).finish(simulation, REGISTRY, None, None)
    recording, error = started(simulation), ResultError("first")
    (simulation.folder / "lines.txt").unlink()
    recording.finish(simulation, REGISTRY, None, error)
    assert not hasattr(error, "__notes__")
    with pytest.raises(ResultError, match=r"lines\.txt"):
        recording.finish(simulation, REGISTRY, None, None)
