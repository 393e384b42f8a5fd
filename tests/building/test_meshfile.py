"""Surfaces are written to files that are read again as they were."""

import numpy as np
from shapely import box

from evac.building.surface.build import build_building
from evac.building.surface.meshfile import write_surface
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.simulation.assembly import read_building


def surface():
    floor = [(("floor:Büro", "area:a"), box(0, 0, 2, 3), 0.0), ("floor:Büro", box(2, 0, 4.1234567, 3), 0.0)]
    return SurfaceMesh.of_polygons(
        [*floor, ("stair:up", box(1, 3, 2, 6), lambda x, y: y - 3), ("floor:top", box(0, 6, 2, 8), 3.0)],
        [("exit:door", (0, 1, 0), (0, 2, 0))],
    )


def test_a_surface_is_read_as_it_was_written(tmp_path, assert_same_building):
    path = tmp_path / "a.msh"
    write_surface(surface(), path)
    one, other = build_building(surface(), path), read_building(path)
    assert_same_building(one, other)
    assert np.array_equal(one.vertices, other.vertices)
    assert [(area.name, area.polygon.area) for area in other.areas] == [("a", 6.0)]
    write_surface(surface(), tmp_path / "b.msh")
    assert path.read_bytes() == (tmp_path / "b.msh").read_bytes()


def test_cells_without_a_tag_are_kept(tmp_path):
    points = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [8, 0, 0], [8, 4, 0]]
    write_surface(SurfaceMesh(points, [[0, 1, 2, 3], [1, 4, 5, 2]]), tmp_path / "bare.msh")
    (level,) = read_building(tmp_path / "bare.msh", need_exit=False).levels
    assert level.polygon.area == 32.0
