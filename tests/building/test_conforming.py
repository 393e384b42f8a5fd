"""Polygons become conforming, tagged meshes."""

from collections import Counter

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from evac.building.surface.surfacemesh import SurfaceMesh


def sides_of(triangles):
    return Counter(tuple(sorted((t[i], t[i - 2]))) for t in triangles for i in range(3))


def cells_of(mesh, tag):
    """Return the cells of a tag, corners as rows of the points."""
    return np.array(mesh.cells)[np.array(mesh.cell_tags[tag])]


@pytest.fixture
def flight_beside_floor():
    """A floor 6 m wide with a hole, and a flight 2 m wide that rises 3 m over 4 m from its northern side."""
    surfaces = [
        ("floor:hall", box(0, 0, 6, 4).difference(box(1, 1, 2, 2)), 0.0),
        ("stair:main", box(2, 4, 4, 8), lambda x, y: 0.75 * (y - 4)),
    ]
    return SurfaceMesh.of_polygons(surfaces, [("exit:door", (2.5, 0, 0), (3.5, 0, 0))])


def test_neighbours_share_their_edge(flight_beside_floor):
    floor, flight = (sides_of(cells_of(flight_beside_floor, tag)) for tag in ("floor:hall", "stair:main"))
    points = np.array(flight_beside_floor.points)
    ends = [sorted(map(tuple, points[list(side)].tolist())) for side in floor.keys() & flight.keys()]
    assert ends == [[(2.0, 4.0, 0.0), (4.0, 4.0, 0.0)]]


def test_an_edge_lies_on_the_side_of_one_cell(flight_beside_floor):
    sides = sides_of(cells_of(flight_beside_floor, "floor:hall"))
    assert [sides[tuple(sorted(line))] for line in flight_beside_floor.edge_tags["exit:door"]] == [1]


def test_an_edge_is_cut_where_a_corner_lies_on_it():
    surfaces = [("floor:west", box(0, 0, 2, 2), 0.0), ("floor:east", box(2, 0, 4, 2), 0.0)]
    mesh = SurfaceMesh.of_polygons(surfaces, [("exit:wide", (1, 0, 0), (3, 0, 0))])
    assert np.array(mesh.points)[mesh.edge_tags["exit:wide"]][:, :, 0].tolist() == [[1.0, 2.0], [2.0, 3.0]]


def test_a_sliver_with_the_corners_of_others_on_both_of_its_long_sides_is_divided():
    ends, corners = [(-17.706212, -84.822172), (-17.7062, -84.8222)], [(-17.773912, -84.850704), (-17.7739, -84.8507)]
    sliver, beside = Polygon([(-17.773912, -84.850705), *ends]), Polygon([*corners, (-17.7, -84.9)])
    mesh = SurfaceMesh.of_polygons([("floor:a", sliver, 0.0), ("floor:b", beside, 0.0)])
    areas = shapely.area(shapely.polygons(np.asarray(mesh.points)[np.asarray(mesh.cells)][:, :, :2]))
    assert areas.sum() == pytest.approx(sliver.area + beside.area, abs=1e-6)
