import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely

from evac.base.errors import BuildingError
from evac.building.plan.plan import Plan
from evac.building.surface.welding import split_at_vertices
from evac.simulation.assembly import read_building


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


def test_a_surface_without_cells_wider_than_the_weld_is_refused():
    points = [[0, 0, 0], [4, 0, 0], [2, 0.0005, 0], [2, 0, 0]]
    with pytest.raises(BuildingError, match=r"building\.weld.*\(2\.00, "):
        split(points, [[0, 1, 2]], {"exit:a": np.array([[0, 1], [3, 1]])})


def test_two_needles_along_each_other(tmp_path):
    """The second needle passes the corners of the first on both sides of a thin angle: a recursion once."""
    path = tmp_path / "needles.obj"
    path.write_text(
        "v 0.300706 8.999015 14.000106\nv 20.321639 6.999839 13.999560\nv 21.323105 7.000219 14.000500\n"
        "v 0.299540 9.000002 14.000080\nv 21.321573 6.999760 14.000720\nv 24.160467 6.999463 14.000379\n"
        "f 1 2 3\nf 4 5 6\n"
    )
    with pytest.raises(BuildingError, match=r"\(13.98, 7.67, 14.00\)"):
        read_building(path, need_exit=False)


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
