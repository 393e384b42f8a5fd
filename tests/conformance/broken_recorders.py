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


class Impatient(Counts):
    """Cannot finish without a start."""

    def finish(self, simulation, results):
        assert self.calls > 0


class NeedsFolder(Recorder):
    """Takes it for granted that there is a result folder."""

    name = "needs_folder"

    def record(self, simulation):
        (simulation.folder / "calls.txt").write_text("1")


def names_no_file(self):
    """Name a file that nobody has written."""
    return {"nothing.txt": 3}


WITHOUT, WITH = (f"scene '20 ticks of .*, {what} a result folder" for what in ("without", "with"))
HALVED = "scene '20 ticks of .*, resumed in the middle"

BROKEN = [
    Broken(Meddles, "check_recorder", WITHOUT, "read-only; only read the simulation", ValueError),
    Broken(Counts, "check_recorder", WITH, r"recorder 'counts' has the attributes calls .* state\(\)"),
    Broken(CountsAnew, "check_recorder", HALVED, r"calls\.txt differs .*; state\(\) must"),
    Broken(Appends, "check_recorder", HALVED, r"appends\.txt differs"),
    Broken(Impatient, "check_recorder", WITHOUT, "has no attribute 'calls'", AttributeError),
    Broken(NeedsFolder, "check_recorder", WITHOUT, "'NoneType' and 'str'", TypeError),
    Broken(odd(CountsAnew, start=raising), "check_recorder", WITHOUT, "partner", KeyError),
    Broken(odd(CountsAnew, record=raising), "check_recorder", WITHOUT, "partner", KeyError),
    Broken(odd(CountsAnew, finish=raising), "check_recorder", WITHOUT, "partner", KeyError),
    Broken(odd(CountsAnew, state=raising), "check_recorder", WITH, "state: .*partner", KeyError),
    Broken(odd(CountsAnew, state=lambda self: {"a": [1]}), "check_recorder", WITH, r"\[1\] for 'a'; return arrays"),
    Broken(odd(CountsAnew, restore=raising), "check_recorder", HALVED, "restore: .*partner", KeyError),
    Broken(
        odd(CountsAnew, restore=lambda self: 0),
        "check_contract",
        "the class",
        r"restore\(self\); define",
    ),
    Broken(odd(CountsAnew, files=raising), "check_recorder", WITH, "files: .*partner", KeyError),
    Broken(odd(CountsAnew, files=names_no_file), "check_recorder", WITH, r"nothing\.txt: the file was removed"),
]
