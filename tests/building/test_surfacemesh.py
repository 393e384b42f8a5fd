import pytest
import shapely

from evac.building.surface.build import build_building
from evac.building.surface.surfacemesh import SurfaceMesh, checked

SQUARE = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]


def test_cells_of_any_number_of_corners_keep_their_tags(tmp_path):
    points = [*SQUARE, [6, 0, 0], [6, 4, 0], [8, 2, 0]]
    cells = [[4, 6, 5], [0, 1, 2, 3], [1, 4, 5, 2]]
    mesh = checked(tmp_path, SurfaceMesh(points, cells, {"floor:a": [1, 0, 1], "area:b": [0, 1, 0]}))
    area = shapely.area(shapely.polygons(mesh.points[mesh.triangles][:, :, :2]))
    assert area[mesh.cell_tags["floor:a"]].sum() == pytest.approx(12.0)
    assert area[mesh.cell_tags["area:b"]].sum() == pytest.approx(16.0)


def test_polygons_become_levels_with_exits_and_holes(tmp_path):
    """Neighbours need share no vertex: a stair meets the middle of the hall's side."""
    hall = shapely.box(0, 0, 10, 8).difference(shapely.box(4, 3, 5, 4))
    mesh = SurfaceMesh.of_polygons(
        [
            ("floor:hall", hall, 0.0),
            ("stair:main", shapely.box(10, 2, 14, 5), lambda x, y: 0.5 * (x - 10.0)),
            ("floor:upper", shapely.box(14, 0, 20, 8), 2.0),
        ],
        [("exit:door", (0.0, 1.0, 0.0), (0.0, 2.5, 0.0)), ("exit:door", (0.0, 4.0, 0.0), (0.0, 5.0, 0.0))],
    )
    building = build_building(mesh, tmp_path)
    assert [(level.name, level.kind) for level in building.levels] == [
        ("hall", "floor"),
        ("main flight z=0.00..2.00", "flight"),
        ("upper", "floor"),
    ]
    assert [level.polygon.area for level in building.levels] == pytest.approx([79.0, 12.0, 48.0])
    assert [(way.name, way.width) for way in building.exits] == [("door", 2.5)]
    assert [portal.width for portal in building.portals] == [3.0, 3.0]


def test_a_multipolygon_with_heights_of_its_own_is_flattened(tmp_path):
    plan = shapely.MultiPolygon([shapely.box(0, 0, 2, 2), shapely.box(3, 0, 5, 2)])
    mesh = checked(tmp_path, SurfaceMesh.of_polygons([("floor:a", shapely.force_3d(plan, 9.0), 1.0)]))
    assert (mesh.points[:, 2] == 1.0).all()
    assert shapely.area(shapely.polygons(mesh.points[mesh.triangles][:, :, :2])).sum() == pytest.approx(8.0)
