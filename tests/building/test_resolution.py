import meshio
import numpy as np
import pytest

from evac.base.errors import BuildingError
from evac.simulation.assembly import read_building

UTM = (500000.0, 5000000.0)


def test_float32_utm_coordinates_are_refused(mesh, tmp_path):
    mesh.rectangle(0.13, 0.27, 6.4, 4.1).rectangle(6.4, 1.0, 6.6, 2.1).rectangle(6.6, 0.27, 12.3, 4.1)
    mesh.points = [(x + UTM[0], y + UTM[1], z) for x, y, z in mesh.points]
    assert len(read_building(mesh.write_obj(tmp_path / "a.obj"), need_exit=False).levels) == 1
    mesh.points = [tuple(float(np.float32(x)) for x in point) for point in mesh.points]
    with pytest.raises(BuildingError, match=r"vertex \(5000\d\d.* 0.5 m"):
        read_building(mesh.write_obj(tmp_path / "a.obj"), need_exit=False)


@pytest.mark.parametrize("name", ["a.stl", "a.vtu", "a.ply"])
def test_float32_of_any_format_is_recognized(tmp_path, name):
    corners = np.array([[0.1, 0.2, 0], [6.3, 0.4, 0], [6.1, 4.7, 0], [0.3, 4.1, 0]]) + np.array([*UTM, 0.0])
    mesh = meshio.Mesh(corners.astype(np.float32), [("triangle", [[0, 1, 2], [0, 2, 3]])])
    meshio.write(tmp_path / name, mesh, binary=True)
    with pytest.raises(BuildingError, match=r"vertex \(500006.* 0.5 m"):
        read_building(tmp_path / name, need_exit=False)


def test_rounding_below_the_weld_is_welded_and_above_it_the_weld_is_named(mesh, tmp_path):
    mesh.rectangle(0.13, 0.27, 6.4, 4.1).rectangle(6.4, 0.27, 12.3, 1.53).rectangle(6.4, 1.53, 12.3, 4.1)
    mesh.points = [(float(np.float32(x + 70000.0)), float(np.float32(y + 60000.0)), z) for x, y, z in mesh.points]
    path = mesh.write_obj(tmp_path / "a.obj")
    with pytest.raises(BuildingError, match=r"0.0078 m.*building.weld"):
        read_building(path, need_exit=False)
    (level,) = read_building(path, need_exit=False, weld=0.016).levels
    assert level.polygon.area == pytest.approx(12.17 * 3.83, rel=2e-3)


@pytest.mark.parametrize("weld", [0.0, 1e-5, 0.001])
def test_float32_near_the_origin_is_fine_enough_for_any_weld(mesh, read, weld):
    mesh.rectangle(1000.1, 0.2, 1006.3, 4.1)
    mesh.points = [tuple(float(np.float32(x)) for x in point) for point in mesh.points]
    assert len(read(mesh, need_exit=False, weld=weld).levels) == 1


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_a_building_far_from_the_origin_is_the_same_building(stair_mesh, tmp_path, scale, assert_same_building):
    """In float64 nothing needs to be shifted: what is computed depends on differences of coordinates."""
    stair_mesh.rectangle(3.1, 2.0, 5.7, 4.45, tag="floor:ground").rectangle(3.1, 4.45, 4.2, 6.8, tag="floor:ground")
    near = read_building(stair_mesh.write_vtu(tmp_path / "near.vtu"))
    stair_mesh.points = [((x + UTM[0]) / scale, (y + UTM[1]) / scale, z / scale) for x, y, z in stair_mesh.points]
    far = read_building(stair_mesh.write_vtu(tmp_path / "far.vtu"), scale=scale)
    np.testing.assert_allclose(far.walls - np.tile(UTM, 2), near.walls, rtol=0, atol=5e-9)
    for one, other in zip(far.levels, near.levels, strict=True):
        assert (one.name, one.kind, one.slope) == (other.name, other.kind, pytest.approx(other.slope, abs=1e-8))
        assert one.polygon.area == pytest.approx(other.polygon.area, abs=1e-6)
    for one, other in zip((*far.portals, *far.exits), (*near.portals, *near.exits), strict=True):
        np.testing.assert_allclose(one.segments - np.tile(UTM, 2), other.segments, rtol=0, atol=5e-9)
