"""Each check of an importer finds the promise it is there for, broken."""

import pytest

from evac.building.importer import Importer
from evac.building.surfacemesh import SurfaceMesh
from evac.conformance import check_plugin
from evac.errors import PluginError
from evac.registry import Registry
from evac.scenario.loading import load_case


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


@pytest.mark.parametrize(
    ("importer", "words"),
    [
        (Guessing, "guessing: check_damaged_files: .*reads 2 cells from .* raise ValueError"),
        (Careless, "importer 'careless': KeyError"),
    ],
)
def test_an_importer_that_does_not_refuse_damaged_files_is_found(importer, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(importer)


def test_an_importer_that_reads_another_surface_each_time_is_found(tmp_path):
    registry = Registry()
    registry.add_class(Counting)
    (tmp_path / "room.plan").write_text("square")
    changes = {"building.mesh": str(tmp_path / "room.plan"), "building.areas": []}
    case = load_case("square_room", changes, registry=registry)
    with pytest.raises(PluginError, match=r"two readings .* differ in points"):
        check_plugin(Counting, case)
    with pytest.raises(PluginError, match=r"read by 'meshio'; give a case that uses 'counting'"):
        check_plugin(Counting, load_case("square_room", registry=registry))
