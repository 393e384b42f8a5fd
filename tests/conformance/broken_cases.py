"""Broken laws of the speed in smoke, sources of conditions, importers, exporters and recorders."""

import numpy as np

from evac.building.importer import Importer
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from evac.export.exporter import Exporter
from evac.trajectory.recorder import Recorder
from tests.conformance.broken import Broken, odd, raising


class Halved(SmokeLaw):
    """Half the desired speed in any smoke."""

    name = "halved"

    def speed(self, desired, extinction):
        """Return half the desired speeds where there is smoke."""
        return np.where(extinction > 0.0, 0.5, 1.0) * desired


class Haze(ConditionSource):
    """The same smoke everywhere."""

    name = "haze"

    def open(self, scene):
        """Provide the extinction coefficient."""
        return ("extinction",)

    def at(self, quantities, time, level, position, height):
        """Return 0.5 1/m."""
        return np.full((len(quantities), len(level)), 0.5)


def averaged(self, desired, extinction):
    """Return speeds for the mean of all extinction coefficients."""
    return np.where(extinction > 0.0, 1.0 / (1.0 + extinction.mean()), 1.0) * desired


def consumed(self, desired, extinction):
    """Change the array that was given."""
    desired *= 1.0 / (1.0 + extinction)
    return desired


def negative(self, quantities, time, level, position, height):
    """Return a value that no air has."""
    return np.full((len(quantities), len(level)), -1.0)


def drifting(self, quantities, time, level, position, height):
    """Return more at each call."""
    self.calls = getattr(self, "calls", 0) + 1
    return np.full((len(quantities), len(level)), 0.1 * self.calls)


# Importers


class Guessing(Importer):
    """Finds a square in everything."""

    name = "guessing"
    suffixes = (".plan",)

    def read(self, path):
        return SurfaceMesh([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], [[0, 1, 2, 3]])


class Careless(Guessing):
    """Does not expect a damaged file."""

    name = "careless"

    def read(self, path):
        return SurfaceMesh([], [[{}[path.read_bytes()]]])


class Counting(Guessing):
    """Moves the building every time."""

    name = "counting"
    seen = 0

    def read(self, path):
        if "square" not in path.read_text(errors="replace"):
            raise ValueError("no square")
        Counting.seen += 1
        x = Counting.seen
        points = [[x, 0, 0], [x + 4, 0, 0], [x + 4, 4, 0], [x, 4, 0], [x, 1, 0]]
        return SurfaceMesh(points, [[0, 1, 2, 3]], {"area:room": [1]}, {"exit:door": [[0, 4]]})


def reads_a_plane(self, path):
    """Read points without heights."""
    return SurfaceMesh([[0, 0], [4, 0], [4, 4]], [[0, 1, 2]])


# Exporters


def write_text(self, trajectory, path):
    """Write one file, as every exporter with a suffix does."""
    path.write_text("exported")
    return [path]


def write_stray(self, trajectory, path):
    """Write to another place, too."""
    (path.parent / "stray.txt").write_text("exported")
    return write_text(self, trajectory, path)


def write_chance(self, trajectory, path):
    """Write another file each time."""
    path.write_text(str(np.random.default_rng().random()))
    return [path]


def write_back(self, trajectory, path):
    """Change the result."""
    trajectory.path.write_bytes(b"")
    return write_text(self, trajectory, path)


def write_first_time(self, trajectory, path):
    """Need a frame."""
    path.write_text(f"{trajectory.time[0]}")
    return [path]


def exporter(write):
    """Return an exporter with a method `write`."""
    return odd(Exporter, suffix=".txt", write=write)


FILE, RUN = "scene 'a damaged file damaged.plan", "scene 'a run of some ticks"


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
    Broken(odd(Halved, speed=lambda self, desired, extinction: desired[:1]), "check_speeds", "its speed", "for each"),
    Broken(
        odd(Halved, speed=lambda self, desired, extinction: desired * np.nan), "check_speeds", "its speed", "finite"
    ),
    Broken(
        odd(Halved, speed=lambda self, desired, extinction: 0.5 * desired), "check_speeds", "its speed", "clear air"
    ),
    Broken(odd(Halved, speed=consumed), "check_speeds", "its speed", "arguments; return a new array"),
    Broken(odd(Halved, speed=averaged), "check_speeds", "its speed", "others are there"),
    Broken(odd(Haze, at=negative), "check_source", "its at", "-1 for extinction; return values from 0"),
    Broken(odd(Haze, at=drifting), "check_source", "its at", "asked again"),
    Broken(Guessing, "check_damaged_files", FILE, "surface of 2 triangles; raise ValueError"),
    Broken(Careless, "check_damaged_files", FILE, "importer 'careless': KeyError", KeyError),
    Broken(odd(Guessing, read=reads_a_plane), "check_damaged_files", FILE, r"shape \(3, 2\); it must be \(n, 3\)"),
    Broken(exporter(raising), "check_exports", RUN, "partner", KeyError),
    Broken(exporter(write_stray), "check_exports", RUN, r"stray\.txt outside `path`; write to `path` only"),
    Broken(exporter(write_chance), "check_exports", f"{RUN}, exported again", "differ; do not write"),
    Broken(exporter(write_back), "check_exports", RUN, "trajectory file has changed; only read"),
    Broken(
        exporter(write_first_time),
        "check_exports",
        "scene 'a run without frames",
        "odd.*; correct the plugin",
        IndexError,
    ),
    Broken(Counts, "check_recorder", WITHOUT, r"recorder 'counts' has the attributes calls .* state\(\)"),
    Broken(CountsAnew, "check_recorder", HALVED, r"calls\.txt differs .*; state\(\) must"),
    Broken(Appends, "check_recorder", HALVED, r"appends\.txt differs"),
    Broken(odd(CountsAnew, files=names_no_file), "check_recorder", WITH, r"nothing\.txt: the file was removed"),
]
