import pickle

import numpy as np
import pytest

import evac
from evac.contract.registry import Registry
from evac.simulation.assembly import make_building, make_importers

PLUGIN = """
from evac import Importer, SurfaceMesh, hookimpl

evac_interface = 3


class Odd(Importer):
    name = "odd"
    suffixes = (".odd",)

    def read(self, path):
        return {"bug": lambda: 1 / 0, "other": lambda: "a building"}[path.read_text()]()


@hookimpl
def evac_importers():
    return [Odd]
"""


@pytest.fixture
def registry(tmp_path):
    (tmp_path / "odd.py").write_text(PLUGIN)
    return Registry([tmp_path / "odd.py"], builtins=())


def square(folder):
    """Return a case as a dictionary, whose mesh lies in a folder."""
    (folder / "room.obj").write_text("v 0 0 0\nv 5 0 0\nv 5 5 0\nv 0 5 0\nf 1 2 3 4\n")
    return {
        "building": {
            "mesh": "room.obj",
            "exits": [{"name": "door", "segment": [(0.0, 2.0), (0.0, 3.0)], "z": 0.0}],
            "areas": [{"name": "room", "polygon": [(1, 1), (4, 1), (4, 4), (1, 4)], "z": 0.0}],
        },
        "people": [{"name": "people", "number": 3, "area": "room"}],
        "contact": {"model": "nsm2"},
    }


def test_a_case_comes_from_a_dictionary(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = square(tmp_path)
    case = evac.load(table, {"people.people.number": 5})
    table["people"][0]["number"] = 7  # the case is its own
    assert (case.mesh, case.people[0].count) == (tmp_path / "room.obj", 5)
    assert [one.name for one in make_importers(case)] == ["obj"]
    assert make_building(case).exits[0].width == 1.0
    assert case.change({"building.closed": ["door"]}).building.closed == ("door",)
    assert evac.run(case).evacuated == 5
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = pickle.loads(pickle.dumps(case))
    assert (again.mesh, again.to_dict()) == (case.mesh, case.to_dict())


def test_a_dictionary_and_a_file_of_the_same_content_start_alike(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = square(tmp_path)
    (tmp_path / "case.toml").write_text(
        'building.mesh = "room.obj"\n'
        '[[building.exits]]\nname = "door"\nsegment = [[0.0, 2.0], [0.0, 3.0]]\nz = 0.0\n'
        '[[building.areas]]\nname = "room"\npolygon = [[1, 1], [4, 1], [4, 4], [1, 4]]\nz = 0.0\n'
        '[[people]]\nname = "people"\nnumber = 3\narea = "room"\n'
        '[contact]\nmodel = "nsm2"\n'
    )
    one, other = (evac.Simulation(evac.load(source)).state() for source in (table, tmp_path))
    assert one.keys() == other.keys()
    for key, value in one.items():
        np.testing.assert_array_equal(value, other[key])
