import numpy as np
import pytest
from scipy.spatial import cKDTree

from evac.building.surface.welding import close_pairs, weld_points


def test_close_points_become_the_least_of_them():
    points = np.array([[1.0, 0, 0], [0, 0, 0], [0.0004, 0, 0], [0.0008, 0.0, 0.0], [1.0, 0.0011, 0]])
    vertices, index = weld_points(points, 0.001)
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 0.0011, 0]]
    assert index.tolist() == [1, 0, 0, 0, 2]


def test_without_a_weld_only_equal_points_are_one():
    vertices, index = weld_points(np.array([[0.0, 0, 0], [-0.0, 0, 0], [1e-12, 0, 0]]), 0.0)
    assert vertices.tolist() == [[0, 0, 0], [1e-12, 0, 0]]
    assert index.tolist() == [0, 0, 1]


@pytest.mark.parametrize("count", [200, 2000])
def test_an_arc_of_points_closer_than_the_weld_keeps_its_shape(count):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    points = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), np.zeros(count)])
    vertices, index = weld_points(points, 0.004)
    assert np.linalg.norm(vertices[index] - points, axis=1).max() <= 0.004
    assert np.linalg.norm(vertices[:, None] - vertices, axis=2)[~np.eye(len(vertices), dtype=bool)].min() > 0.004
    assert len(vertices) > 70


def test_the_column_of_a_cad_program_is_not_welded_away(mesh, read):
    """Its outline of 720 corners has sides of 0.87 mm."""
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    x, y = (2.0 + 0.1 * np.cos(angle)).tolist(), (2.0 + 0.1 * np.sin(angle)).tolist()
    for i in range(720):
        quarter = i // 180
        corner = [(4.0, 4.0, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)]
        mesh.face(corner[quarter], (x[i], y[i], 0.0), (x[i + 1], y[i + 1], 0.0))
        if i % 180 == 179:
            mesh.face(corner[quarter], (x[i + 1], y[i + 1], 0.0), corner[(quarter + 1) % 4])
    (level,) = read(mesh, need_exit=False).levels
    assert level.polygon.area == pytest.approx(16.0 - np.pi * 0.1**2, abs=1e-4)


@pytest.mark.parametrize("origin", [0.0, 5e6])
@pytest.mark.parametrize("kind", ["cloud", "walls", "lattice"])
def test_close_pairs_are_those_of_a_tree_in_space(kind, origin):
    """Also of points upon each other in plan, and of points exactly at the distance."""
    generator = np.random.default_rng(3)
    if kind == "cloud":
        points = generator.uniform(0.0, 1.0, (3000, 3))
    elif kind == "walls":
        points = np.column_stack([generator.integers(0, 4, 3000), np.zeros(3000), generator.uniform(0.0, 30.0, 3000)])
    else:
        points = np.stack(np.meshgrid(*[np.arange(8.0) / 16.0] * 3), axis=-1).reshape(-1, 3)
    points = points + origin
    expected = cKDTree(points).query_pairs(0.0625, output_type="ndarray")
    assert len(expected) > 1000
    found = close_pairs(points, 0.0625)
    np.testing.assert_array_equal(found, expected[np.lexsort(expected.T[::-1])])
