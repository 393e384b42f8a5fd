import numpy as np
import pytest
import shapely
from shapely import box

from evac.base.errors import BuildingError
from evac.building.geometry import triangulate
from evac.building.surface.build import build_building
from evac.building.surface.surface import write_surface
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.simulation.assembly import read_building

EXIT = {"name": "out", "segment": [[0, 0], [0, 1]], "z": 0.0}


def test_rectangle_has_four_walls_less_the_exit(mesh, read):
    building = read(mesh.rectangle(0, 0, 4, 3), exits=[EXIT])
    assert building.walls.tolist() == [[0, 0, 4, 0], [0, 3, 0, 1], [4, 0, 4, 3], [4, 3, 0, 3]]
    assert building.exits[0].segments.tolist() == [[0, 1, 0, 0]]
    (level,) = building.levels
    assert (level.name, level.kind, level.polygon.area) == ("floor z=0.00", "floor", 12.0)


def test_hanging_nodes_on_two_edges_of_a_cell_and_off_by_less_than_the_weld(mesh, read):
    mesh.face((0, 0, 0), (4, 0, 0), (0, 4, 0))
    mesh.face((0, 0, 0), (2, 0.0004, 0), (1, -3, 0)).face((2, 0.0004, 0), (4, 0, 0), (3, -3, 0))
    mesh.face((0, 0, 0), (0, 1, 0), (-2, 0, 0)).face((0, 1, 0), (0, 4, 0), (-2, 3, 0))
    exit_ = {"name": "out", "segment": [[4, 0], [0, 4]], "z": 0.0}
    (level,) = read(mesh, exits=[exit_]).levels
    assert level.polygon.area == pytest.approx(8 + 3 + 3 + 1 + 3, abs=0.01)
    assert level.polygon.geom_type == "Polygon"
    assert not level.polygon.interiors


def test_gaps_below_the_weld_close_and_above_stay(mesh, read):
    mesh.rectangle(0, 0, 4, 3).rectangle(4.0009, 0, 8, 3)
    assert len(read(mesh, exits=[EXIT]).levels) == 1
    assert len(read(mesh, exits=[EXIT], weld=0.0005).levels) == 2


def test_degenerate_steep_and_double_cells_are_dropped(mesh, read):
    mesh.rectangle(0, 0, 4, 3).rectangle(0, 0, 4, 3)
    mesh.face((0, 0, 0), (2, 0, 0), (4, 0, 0))
    mesh.face((4, 0, 0), (4, 3, 0), (4, 3, 2.5), (4, 0, 2.5))
    mesh.face((0, 3, 0), (4, 3, 0), (4, 4, 1.2), (0, 4, 1.2))  # 50.2 degrees
    building = read(mesh, exits=[EXIT])
    assert building.levels[0].polygon.area == 12.0
    assert len(building.walls) == 4
    degenerate, steep = building.findings
    assert degenerate.place == (0.0, 0.0, 0.0)
    assert "1 cell " in degenerate.text
    assert "4 cells" in steep.text
    assert "50 degrees" in steep.text
    with pytest.raises(BuildingError, match=r"stair 'stair 1'.*'floor z=0.00'"):
        read(mesh, exits=[EXIT], walkable_angle=50.5)


@pytest.mark.parametrize("turn", range(8))
@pytest.mark.parametrize("flip", [1, -1])
def test_polygons_give_the_same_triangles_however_they_start(turn, flip):
    outline = np.array([[0, 0], [4, 0], [4, 4], [3, 4], [3, 1], [1, 1], [1, 4], [0, 4]], dtype=float)
    points = np.column_stack([outline, np.zeros(8)])
    triangles, owner = triangulate(points, np.roll(np.arange(8)[::flip], turn)[None, :])
    expected, _ = triangulate(points, np.arange(8)[None, :])
    assert {frozenset(t) for t in triangles.tolist()} == {frozenset(t) for t in expected.tolist()}
    pieces = shapely.polygons(outline[triangles])
    assert shapely.area(pieces).sum() == pytest.approx(10.0)
    assert shapely.union_all(pieces).equals(shapely.Polygon(outline))
    assert (owner == 0).all()


@pytest.mark.parametrize("y", [1e-7, -1e-7])
def test_a_narrow_cell_of_a_floor_may_be_turned_over_by_rounding(mesh, read, y):
    """The cell between two others and a corner on their common side is left out if rounding moves the corner across."""
    mesh.face((0, 0, 0), (4, 0, 0), (2, -3, 0)).face((0, 0, 0), (2, y, 0), (2, 3, 0)).face(
        (2, y, 0), (4, 0, 0), (2, 3, 0)
    )
    mesh.face((0, 0, 0), (4, 0, 0), (2, y, 0))
    (level,) = read(mesh, need_exit=False).levels
    assert level.polygon.area == pytest.approx(12.0)
    assert not level.polygon.interiors


def test_a_narrow_cell_beside_one_that_welding_collapses_is_kept(mesh, read):
    a, b, p = (-1.924, 0.932, 0), (-1.975, -0.267, 0), (0, 0, 0)
    q, r, s = (0.0012, 0, 0), (0.02, -0.001, 0), (0, -0.13, 0)
    mesh.face(a, b, p).face(b, s, p).face(s, q, p).face(s, r, q).face(a, p, q).face(a, q, r)
    mesh.face(a, (-1.924, 0.9321, 0), p)
    (level,) = read(mesh, need_exit=False).levels
    assert level.polygon.area == pytest.approx(shapely.Polygon([a, b, s, r]).area, abs=1e-5)
    assert not level.polygon.interiors


def tagged():
    floor = [(("floor:Büro", "area:a"), box(0, 0, 2, 3), 0.0), ("floor:Büro", box(2, 0, 4.1234567, 3), 0.0)]
    return SurfaceMesh.of_polygons(
        [*floor, ("stair:up", box(1, 3, 2, 6), lambda x, y: y - 3), ("floor:top", box(0, 6, 2, 8), 3.0)],
        [("exit:door", (0, 1, 0), (0, 2, 0))],
    )


def test_a_surface_is_read_as_it_was_written(tmp_path, assert_same_building):
    path = tmp_path / "a.msh"
    write_surface(tagged(), path)
    one, other = build_building(tagged(), path), read_building(path)
    assert_same_building(one, other)
    assert np.array_equal(one.vertices, other.vertices)
    assert [(area.name, area.polygon.area) for area in other.areas] == [("a", 6.0)]
    write_surface(tagged(), tmp_path / "b.msh")
    assert path.read_bytes() == (tmp_path / "b.msh").read_bytes()


def test_cells_without_a_tag_are_kept(tmp_path):
    points = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [8, 0, 0], [8, 4, 0]]
    write_surface(SurfaceMesh(points, [[0, 1, 2, 3], [1, 4, 5, 2]]), tmp_path / "bare.msh")
    (level,) = read_building(tmp_path / "bare.msh", need_exit=False).levels
    assert level.polygon.area == 32.0
