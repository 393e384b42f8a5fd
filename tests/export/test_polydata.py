"""What is written, VTK itself reads back."""

import numpy as np
import pytest
import pyvista

from evac.export.polydata import PolyData, vtp_bytes


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


def test_the_same_data_are_the_same_bytes(data, tmp_path):
    for name in ("one.vtp", "two.vtp"):
        (tmp_path / name).write_bytes(vtp_bytes(data))
    assert (tmp_path / "one.vtp").read_bytes() == (tmp_path / "two.vtp").read_bytes()


def test_arrays_in_any_order_of_memory_and_of_bytes_are_written_alike(data, tmp_path):
    other = PolyData(
        data.points[::-1].astype(">f8"), point_arrays={"wind": np.asfortranarray(data.point_arrays["wind"])}
    )
    (tmp_path / "other.vtp").write_bytes(vtp_bytes(other))
    read = pyvista.read(tmp_path / "other.vtp")
    np.testing.assert_array_equal(read.points, data.points[::-1])
    np.testing.assert_array_equal(read["wind"], data.point_arrays["wind"])


def test_nothing_can_be_written(tmp_path):
    (tmp_path / "empty.vtp").write_bytes(vtp_bytes(PolyData(np.zeros((0, 3)), texts={"names": []})))
    read = pyvista.read(tmp_path / "empty.vtp")
    assert read.n_points == read.n_cells == 0
