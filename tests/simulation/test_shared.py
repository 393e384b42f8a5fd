"""Building and directions that runs have in common: when they do, and that they are read without copies."""

import mmap

import numpy as np
import pytest

import evac
from evac.simulation.shared import read_shared_scene, shared_key, write_shared_scene
from evac.simulation.simulation import Simulation


@pytest.fixture(scope="module")
def case():
    return evac.load("square_room", {"people.people.number": 5})


def bits(results):
    return results.crowd.exit_time.tobytes(), results.crowd.distance.tobytes()


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({"simulation.seed": 9}, True),
        ({"people.people.number": 7}, True),
        ({"contact.model": "dem"}, True),
        ({"people.people.mass": 80.0}, True),
        ({"people.people.radius": 0.2}, False),
        ({"directions.spacing": 0.11}, False),
        ({"building.scale": 1.001}, False),
        ({"people.people.strategy": "shortest"}, False),
        ({"people.people.exits": ["door"]}, False),
    ],
)
def test_the_key_differs_exactly_where_building_or_directions_do(case, changes, is_same):
    """A case whose key is that of another makes the same scene by itself."""
    changed = case.change(changes)
    assert (shared_key(changed) == shared_key(case)) == is_same
    if is_same:
        one, other = (Simulation(of, will_run=False).scene.shared_scene for of in (case, changed))
        assert one.fields.packed.direction.tobytes() == other.fields.packed.direction.tobytes()
        assert one.world.wall.tobytes() == other.world.wall.tobytes()


def test_another_building_in_the_same_file_has_another_key(tmp_path, case):
    text = case.mesh.read_text()
    (tmp_path / "room.msh").write_text(text)
    one = shared_key(case.change({"building.mesh": str(tmp_path / "room.msh")}))
    (tmp_path / "room.msh").write_text(text + "\n")
    assert shared_key(case.change({"building.mesh": str(tmp_path / "room.msh")})) != one


@pytest.mark.parametrize("kind", [None, "close", "one_way"])
def test_a_run_on_a_scene_from_a_file_has_the_same_bits(tmp_path, case, kind):
    if kind is not None:
        more = {"value": "out"} if kind == "one_way" else {}
        change = {"time": 1.0, "kind": kind, "target": "door", **more}
        case = case.change({"event": [change], "simulation.no_progress": 2.0})
    alone = Simulation(case).run()
    shared = read_shared_scene(write_shared_scene(Simulation(case, will_run=False).scene.shared_scene, tmp_path))
    again = [Simulation(case, shared_scene=shared).run() for _ in range(2)]
    assert bits(again[0]) == bits(again[1]) == bits(alone)


def test_arrays_are_mapped_and_cannot_be_written(tmp_path, case):
    shared = read_shared_scene(write_shared_scene(Simulation(case, will_run=False).scene.shared_scene, tmp_path))
    array = shared.fields.packed.direction
    while array.base is not None and not isinstance(array.base, memoryview | mmap.mmap):
        array = array.base
    assert isinstance(array.base.obj if isinstance(array.base, memoryview) else array.base, mmap.mmap)
    with pytest.raises(ValueError, match="read-only"):
        shared.fields.packed.direction[0] = 0.0


def test_a_door_that_closes_in_one_run_is_open_in_the_next(case):
    shared = Simulation(case, will_run=False).scene.shared_scene
    one, other = Simulation(case, shared_scene=shared), Simulation(case, shared_scene=shared)
    one.scene.set_open("door", False)
    assert one.building.closed
    assert not other.building.closed
    assert not np.array_equal(one.scene.world.wall_open, other.scene.world.wall_open)
