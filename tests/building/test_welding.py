"""Welding, and splitting of cells at hanging vertices."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree

from evac.building.geometry import least_height
from evac.building.plan.plan import Plan
from evac.building.surface.welding import close_pairs, split_at_vertices, weld_points


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


def area(vertices, triangles):
    return shapely.area(shapely.polygons(vertices[triangles][:, :, :2])).sum()


def split(points, triangles, edges=None, distance=0.001):
    vertices = np.array(points, dtype=float)
    return vertices, *split_at_vertices(Path("a.obj"), vertices, np.array(triangles), edges or {}, distance)


@pytest.mark.parametrize("on", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 1), (0, 3, 2), (1, 1, 1), (3, 2, 4)])
def test_a_triangle_is_cut_at_all_vertices_on_its_sides(on):
    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, 3.0, 0.0]])
    points, triangles = list(corners), [[0, 1, 2]]
    outside = corners[[0, 1, 2]] + corners[[1, 2, 0]] - corners.mean(axis=0)
    for side, count in enumerate(on):
        a, b = corners[side], corners[(side + 1) % 3]
        stops = [side]
        for k in range(count):
            points.append(a + (k + 1) / (count + 1) * (b - a))
            stops.append(len(points) - 1)
        stops.append((side + 1) % 3)
        if count:
            points.append(outside[side])
            triangles += [[p, q, len(points) - 1] for p, q in itertools.pairwise(stops)]
    vertices, cells, owner, _ = split(points, triangles)
    own = cells[owner == 0]
    assert len(own) == 1 + sum(on)
    assert area(vertices, own) == pytest.approx(6.0)
    sides = np.sort(np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]]), axis=1)
    assert np.unique(sides, axis=0, return_counts=True)[1].max() <= 2


def test_a_vertex_near_two_sides_of_a_cell_splits_the_nearer_one():
    """Both sides of the thin cell pass within the weld of the vertex, without end if each were split there."""
    points = [[0, 0, 0], [20, -0.05, 0], [20, 0.05, 0], [0.15, 0.0002, 0], [0.15, 5, 0], [10, 5, 0]]
    vertices, cells, owner, _ = split(points, [[0, 1, 2], [3, 4, 5]])
    assert area(vertices, cells[owner == 0]) == pytest.approx(1.0, abs=20 * 0.001)
    assert len(np.unique(np.sort(cells, axis=1), axis=0)) == len(cells)


def test_parts_without_a_height_are_dropped_where_splitting_does_not_end():
    """Each of two corners of a thin cell is within the weld of a side that the other leaves."""
    points = [[71.834, 35.517], [72.573554, 35.823892], [72.573, 35.825], [72.575, 35.821], [73.579895, 38.661959]]
    vertices, cells, *_ = split([[x, y, 0.0] for x, y in points], [[0, 1, 2], [0, 3, 1], [1, 3, 4]])
    assert least_height(vertices[cells]).min() > 1e-4
    assert area(vertices, cells) == pytest.approx(area(vertices, np.array([[0, 3, 2], [2, 3, 4]])), rel=1e-6)


def test_tagged_edges_are_cut_with_the_cells():
    points = [[0, 0, 0], [4, 0, 0], [0, 4, 0], [2, 0, 0], [2, -2, 0]]
    edges = {"exit:a": np.array([[1, 0]])}
    _, cells, _, cut = split(points, [[0, 1, 2], [0, 3, 4]], edges)
    assert cut["exit:a"].tolist() == [[1, 3], [3, 0]]
    assert len(cells) == 3


def test_vertices_as_close_as_the_weld_have_an_end():
    rng = np.random.default_rng(3)
    near = rng.uniform(-0.0015, 0.0015, (40, 3)) * [1, 1, 0]
    cells, points = [], []
    for k in range(40):
        angle = 0.15 * k
        points += [
            near[k],
            [5 * np.cos(angle), 5 * np.sin(angle), 0],
            [5 * np.cos(angle + 0.15), 5 * np.sin(angle + 0.15), 0],
        ]
        cells.append([3 * k, 3 * k + 1, 3 * k + 2])
    vertices, made, owner, _ = split(points, cells)
    assert len(made) > len(cells)
    assert area(vertices, made) == pytest.approx(area(vertices, np.array(cells)), abs=0.001 * 40 * 5)
    assert set(owner) == set(range(40))


def test_a_slit_whose_corners_pass_each_other_within_the_weld_is_kept():
    """A valid floor whose triangulation has cells narrower than the weld, which cannot be dropped."""
    first = shapely.box(0.1, 0.025, 1.8, 0.045)
    floor = shapely.box(0, 0, 8, 10).difference(first).difference(shapely.affinity.translate(first, 1.75, 0.0))
    plan = Plan()
    plan.storey("floor", [floor])
    plan.exit("out", "floor", [(8, 1), (8, 2)])
    (level,) = plan.building().levels
    assert level.polygon.area == pytest.approx(floor.area)
    assert len(level.polygon.interiors) == 2
