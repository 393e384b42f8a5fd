"""Broken importers and exporters."""

import numpy as np

from evac.building.importer import Importer
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.export.exporter import Exporter
from tests.conformance.broken import Broken, odd, raising

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


def shift_time(self, trajectory, path):
    """Change the trajectory in memory."""
    trajectory.radius[:] += 1.0
    return write_text(self, trajectory, path)


def write_first_time(self, trajectory, path):
    """Need a frame."""
    path.write_text(f"{trajectory.time[0]}")
    return [path]


def exporter(write):
    """Return an exporter with a method `write`."""
    return odd(Exporter, suffix=".txt", write=write)


FILE, RUN = "scene 'a damaged file damaged.plan", "scene 'a run of some ticks"

BROKEN = [
    Broken(Guessing, "check_damaged_files", FILE, "surface of 2 triangles; raise ValueError"),
    Broken(Careless, "check_damaged_files", FILE, "importer 'careless': KeyError", KeyError),
    Broken(odd(Guessing, read=reads_a_plane), "check_damaged_files", FILE, r"shape \(3, 2\); it must be \(n, 3\)"),
    Broken(exporter(raising), "check_exports", RUN, "partner", KeyError),
    Broken(exporter(write_stray), "check_exports", RUN, r"stray\.txt outside `path`; write to `path` only"),
    Broken(exporter(write_chance), "check_exports", f"{RUN}, exported again", "differ; do not write"),
    Broken(exporter(write_back), "check_exports", RUN, "trajectory file has changed; only read"),
    Broken(exporter(shift_time), "check_exports", RUN, "read-only; copy the arrays", ValueError),
    Broken(
        exporter(write_first_time),
        "check_exports",
        "scene 'a run without frames",
        "odd.*; correct the plugin",
        IndexError,
    ),
]
