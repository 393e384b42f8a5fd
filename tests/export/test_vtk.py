import numpy as np
import pytest
import pyvista

from evac.base.errors import ResultError
from evac.building.model.links import close_links
from evac.export.vtk import CELL_KINDS, PolyData, building_blocks, export_vtk, vtp_bytes
from evac.trajectory.trajectory import TrajectoryWriter, building_to_json, read_trajectory


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


def test_an_animation_is_written_again_in_its_place(exported):
    trajectory, path = exported
    before = {file: file.read_bytes() for file in path.parent.rglob("*.vt?")}
    assert export_vtk(trajectory, path.parent) == path
    assert {file: file.read_bytes() for file in path.parent.rglob("*.vt?")} == before


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
        assert {CELL_KINDS[kind] for kind in surface.cell_data["kind"]} == {item.kind}
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
        kinds[name] = CELL_KINDS[data.cell_arrays["kind"][0]]
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


@pytest.fixture
def data():
    generator = np.random.default_rng(5)
    return PolyData(
        points=generator.uniform(-1e7, 1e7, (6, 3)),
        vertices=np.array([[0], [4]]),
        lines=np.array([[1, 2], [2, 3], [3, 1]], np.int32),
        polygons=np.array([[0, 1, 2], [3, 4, 5]], np.int32),
        point_arrays={
            "number": np.array([5, -1, 2**31 - 1, 0, 7, -(2**31)], np.int32),
            "wind": generator.uniform(size=(6, 3)).astype(np.float32),
        },
        cell_arrays={"height": generator.uniform(size=7).astype(np.float32)},
        texts={"names": ['Süd <&> "Nord"', "", "x" * 300], "one": ["word"]},
        shown="number",
    )


def test_vtk_reads_what_was_written(data, tmp_path):
    (tmp_path / "all.vtp").write_bytes(vtp_bytes(data))
    read = pyvista.read(tmp_path / "all.vtp")
    assert read.points.dtype == np.float64
    np.testing.assert_array_equal(read.points, data.points)
    assert read.verts.reshape(-1, 2).tolist() == [[1, 0], [1, 4]]
    assert read.lines.reshape(-1, 3)[:, 1:].tolist() == data.lines.tolist()
    assert read.faces.reshape(-1, 4)[:, 1:].tolist() == data.polygons.tolist()
    assert list(read.point_data) == ["number", "wind"]
    for name, values in data.point_arrays.items():
        assert read.point_data[name].dtype == values.dtype
        np.testing.assert_array_equal(read.point_data[name], values)
    np.testing.assert_array_equal(read.cell_data["height"], data.cell_arrays["height"])
    assert {name: read.field_data[name].tolist() for name in data.texts} == data.texts
    assert read.active_scalars_name == "number"


def test_arrays_in_any_order_of_memory_and_of_bytes_are_written_alike(data, tmp_path):
    other = PolyData(
        data.points[::-1].astype(">f8"), point_arrays={"wind": np.asfortranarray(data.point_arrays["wind"])}
    )
    (tmp_path / "other.vtp").write_bytes(vtp_bytes(other))
    read = pyvista.read(tmp_path / "other.vtp")
    np.testing.assert_array_equal(read.points, data.points[::-1])
    np.testing.assert_array_equal(read["wind"], data.point_arrays["wind"])
