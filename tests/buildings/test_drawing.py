"""Drawings become conforming, tagged meshes."""

from collections import Counter

import meshio
import numpy as np
import pytest
from shapely import box

from evac_buildings.drawing import Drawing


def mesh_of(drawing, tmp_path):
    drawing.write(tmp_path / "drawing.msh")
    return meshio.read(tmp_path / "drawing.msh", file_format="gmsh")


def cells_of(mesh, tag):
    """Return the cells of a physical group, corners as rows of the points."""
    number, dim = mesh.field_data[tag]
    kind = {1: "line", 2: "triangle"}[dim]
    blocks = zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True)
    return np.vstack([block.data[tags == number] for block, tags in blocks if block.type == kind])


def sides_of(triangles):
    return Counter(tuple(sorted((t[i], t[i - 2]))) for t in triangles for i in range(3))


def area_of(mesh, tag):
    """Return the area of a surface on its slope."""
    a, b, c = np.moveaxis(mesh.points[cells_of(mesh, tag)], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.fixture
def flight_beside_floor():
    """A floor 6 m wide with a hole, and a flight 2 m wide that rises 3 m over 4 m from its northern side."""
    drawing = Drawing()
    drawing.surface("floor:hall", box(0, 0, 6, 4).difference(box(1, 1, 2, 2)))
    drawing.surface("stair:main", box(2, 4, 4, 8), lambda x, y: 0.75 * (y - 4))
    drawing.edge("exit:door", (2.5, 0), (3.5, 0))
    return drawing


def test_surfaces_keep_their_areas(flight_beside_floor, tmp_path):
    mesh = mesh_of(flight_beside_floor, tmp_path)
    assert area_of(mesh, "floor:hall") == pytest.approx(23.0)
    assert area_of(mesh, "stair:main") == pytest.approx(2.0 * 5.0)


def test_neighbours_share_their_edge(flight_beside_floor, tmp_path):
    mesh = mesh_of(flight_beside_floor, tmp_path)
    shared = sides_of(cells_of(mesh, "floor:hall")).keys() & sides_of(cells_of(mesh, "stair:main")).keys()
    ends = [sorted(map(tuple, mesh.points[list(side)].tolist())) for side in shared]
    assert ends == [[(2.0, 4.0, 0.0), (4.0, 4.0, 0.0)]]


def test_an_edge_lies_on_the_side_of_one_cell(flight_beside_floor, tmp_path):
    mesh = mesh_of(flight_beside_floor, tmp_path)
    sides = sides_of(cells_of(mesh, "floor:hall"))
    assert [sides[tuple(sorted(line))] for line in cells_of(mesh, "exit:door")] == [1]


def test_an_edge_is_cut_where_a_corner_lies_on_it(tmp_path):
    drawing = Drawing()
    drawing.surface("floor:west", box(0, 0, 2, 2))
    drawing.surface("floor:east", box(2, 0, 4, 2))
    drawing.edge("exit:wide", (1, 0), (3, 0))
    mesh = mesh_of(drawing, tmp_path)
    assert mesh.points[cells_of(mesh, "exit:wide")][:, :, 0].tolist() == [[1.0, 2.0], [2.0, 3.0]]


def test_surfaces_at_different_heights_share_nothing(tmp_path):
    drawing = Drawing()
    drawing.surface("floor:lower", box(0, 0, 4, 4))
    drawing.surface("floor:upper", box(0, 0, 2, 4), 3.0)
    mesh = mesh_of(drawing, tmp_path)
    assert len(mesh.points) == 8
    assert not set(cells_of(mesh, "floor:lower").ravel()) & set(cells_of(mesh, "floor:upper").ravel())


def test_writes_the_same_bytes_again(flight_beside_floor, tmp_path):
    flight_beside_floor.write(tmp_path / "one.msh")
    flight_beside_floor.write(tmp_path / "two.msh")
    assert (tmp_path / "one.msh").read_bytes() == (tmp_path / "two.msh").read_bytes()
