"""Broken recorders."""

from evac.trajectory.recorder import Recorder
from tests.conformance.broken import Broken, odd, raising


class Meddles(Recorder):
    """Stops everybody."""

    name = "meddles"

    def record(self, simulation):
        simulation.population.crowd.velocity[:] *= 0.5


class Counts(Recorder):
    """Writes at the end how often it was called."""

    name = "counts"

    def start(self, simulation):
        self.calls = 0

    def record(self, simulation):
        self.calls += 1

    def finish(self, simulation, results):
        if simulation.folder is not None and hasattr(self, "calls"):
            (simulation.folder / "calls.txt").write_text(str(self.calls))


class CountsAnew(Counts):
    """Says that it has nothing to keep."""

    def state(self):
        return {}

    def restore(self, simulation, state):
        self.calls = 0


class Appends(Recorder):
    """Appends to a file, and does not say how far it has got."""

    name = "appends"

    def record(self, simulation):
        if simulation.folder is not None:
            with (simulation.folder / "appends.txt").open("a") as file:
                file.write(f"{simulation.time}\n")


def names_no_file(self):
    """Name a file that nobody has written."""
    return {"nothing.txt": 3}


WITHOUT, WITH = (f"scene '20 ticks of .*, {what} a result folder" for what in ("without", "with"))
HALVED = "scene '20 ticks of .*, resumed in the middle"

BROKEN = [
    Broken(Meddles, "check_recorder", WITHOUT, "read-only; only read the simulation", ValueError),
    Broken(Counts, "check_recorder", WITHOUT, r"recorder 'counts' has the attributes calls .* state\(\)"),
    Broken(CountsAnew, "check_recorder", HALVED, r"calls\.txt differs .*; state\(\) must"),
    Broken(Appends, "check_recorder", HALVED, r"appends\.txt differs"),
    Broken(odd(CountsAnew, start=raising), "check_recorder", WITHOUT, "partner", KeyError),
    Broken(odd(CountsAnew, files=names_no_file), "check_recorder", WITH, r"nothing\.txt: the file was removed"),
]
