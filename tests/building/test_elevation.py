import numpy as np

from evac.building.model.elevation import elevation

EXIT = {"name": "out", "segment": [[0, 0], [0, 2]], "z": 0.0}


def test_flight_goes_on_beyond_its_edge(stair_mesh, read):
    building = read(stair_mesh, exits=[EXIT])
    x = np.array([9.0, 10.0, 13.0, 16.0, 17.0])
    position = np.column_stack([x, np.linspace(-1, 3, 5)])
    np.testing.assert_allclose(elevation(building, np.ones(5, dtype=int), position), (x - 10) / 2, atol=1e-12)


def test_uneven_level_follows_its_cells(mesh, read):
    # A flat floor in two planes: level, then a fall of 2 in 100 towards a drain.
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0.0, -0.08)
    building = read(mesh, exits=[EXIT])
    assert len(building.levels) == 1
    x = np.array([-1.0, 1.0, 4.0, 6.0, 8.0, 9.0])
    position = np.column_stack([x, np.full(6, 0.7)])
    np.testing.assert_allclose(
        elevation(building, np.zeros(6, dtype=int), position), [0, 0, 0, -0.04, -0.08, -0.1], atol=1e-12
    )


def test_nobody_is_nowhere(mesh, read):
    building = read(mesh.rectangle(0, 0, 4, 2), exits=[EXIT])
    assert elevation(building, np.empty(0, dtype=int), np.empty((0, 2))).shape == (0,)
    assert np.isnan(elevation(building, np.array([-1]), np.array([[1.0, 1.0]]))).all()
