import numpy as np
import pytest
import pyvista

from evac.base.errors import ResultError
from evac.building.model.links import close_links
from evac.export.vtk import KINDS, building_blocks, export_vtk
from evac.trajectory.header import building_to_json
from evac.trajectory.trajectory import read_trajectory
from evac.trajectory.writer import TrajectoryWriter


@pytest.fixture
def exported(descent, tmp_path):
    trajectory = read_trajectory(descent(people=5, frames=4).path)
    return trajectory, export_vtk(trajectory, tmp_path)


def test_every_frame_holds_the_people_at_true_height_with_their_arrays(exported):
    trajectory, path = exported
    for k in range(len(trajectory)):
        people = pyvista.read(path.parent / "frames" / f"frame_{k:05d}.vtp")
        frame = trajectory[k]
        assert people.points.dtype == np.float64
        np.testing.assert_array_equal(people.points[:, :2], frame["position"])
        np.testing.assert_array_equal(people.points[:, 2], frame["z"])
        assert people.n_verts == people.n_points
        np.testing.assert_array_equal(people["person"], frame["person"])
        np.testing.assert_array_equal(people["group"], frame["person"] % 2)
        np.testing.assert_array_equal(people["level"], frame["level"])
        np.testing.assert_allclose(people["speed"], frame["speed"], rtol=1e-6)
        np.testing.assert_allclose(people["velocity"], frame["velocity"], rtol=1e-6)
        np.testing.assert_allclose(people["contact_force"], frame["contact_force"])
        np.testing.assert_allclose(people["crowd_pressure"], frame["crowd_pressure"])
        np.testing.assert_allclose(people["radius"], 0.2, rtol=1e-6)
        assert people.field_data["group_names"].tolist() == ["even", "odd"]


def test_building_has_its_parts_by_name_at_their_heights(exported):
    trajectory, path = exported
    blocks = pyvista.read(path.parent / "building.vtm")
    names = {block: blocks[block].keys() for block in blocks.keys()}  # noqa: SIM118
    levels = [item.name for item in trajectory.building.levels]
    portals = [f"portal {k}" for k in range(4)]
    assert names == {"levels": levels, "walls": levels, "exits": ["door"], "portals": portals, "areas": ["room"]}
    for item in trajectory.building.levels:
        surface, walls = blocks["levels"][item.name], blocks["walls"][item.name]
        assert surface.bounds[4:] == pytest.approx((item.z_min, item.z_max))
        assert walls.bounds[4:] == pytest.approx((item.z_min, item.z_max))
        assert surface.cell_data["level"].tolist() == [item.index] * 2
        assert {KINDS[kind] for kind in surface.cell_data["kind"]} == {item.kind}
        assert surface.field_data["level_names"].tolist() == levels
    for portal in trajectory.building.portals:
        line = blocks["portals"][portal.name]
        assert line.cell_data["level"].tolist() == [portal.levels[0]] * len(portal.segments)
    assert blocks["exits"]["door"].cell_data["level"].tolist() == [trajectory.building.exits[0].level]
    area = sum(blocks["levels"][k].area for k in (1, 3))
    assert area == pytest.approx(2 * 2.0 * 5.0)
    assert blocks["areas"]["room"].area == pytest.approx(5.0 * 6.0)
    assert blocks["areas"]["room"].bounds[4:] == (6.0, 6.0)


def test_closed_exits_and_portals_are_kinds_of_their_own(building):
    kinds = {}
    for _, name, data in building_blocks(close_links(building, ["door", "portal 3"])):
        kinds[name] = KINDS[data.cell_data["kind"][0]]
    assert (kinds["door"], kinds["portal 3"], kinds["portal 2"]) == ("closed exit", "closed portal", "portal")


def test_far_from_the_origin_nothing_is_rounded(descent, tmp_path):
    export_vtk(read_trajectory(descent(people=3, frames=1, shift=(5.0e6, 4.0e6)).path), tmp_path)
    people = pyvista.read(tmp_path / "frames" / "frame_00000.vtp")
    np.testing.assert_allclose(people.points[0, :2], [5.0e6 + 10.5, 4.0e6 + 3.0], rtol=0.0, atol=1e-5)


def test_trajectory_without_frames_is_refused(tmp_path, building):
    header = {"groups": [], "group": [], "radius": [], "height": [], "building": building_to_json(building)}
    TrajectoryWriter(tmp_path / "empty.evac", header, np.zeros(2)).close()
    with pytest.raises(ResultError, match="frame"):
        export_vtk(read_trajectory(tmp_path / "empty.evac"), tmp_path)
