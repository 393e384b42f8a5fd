"""Mesh files of other programs: points, cells and tags of each format, and damaged files, which are refused."""

import re

import meshio
import numpy as np
import pytest

from evac.base.errors import BuildingError
from evac.building.surface.build import build_building
from evac.building.surface.surfacemesh import checked
from evac.contract.registry import Registry, built_in
from evac.simulation.assembly import read_building, read_surface
from tests.building.conftest import assert_same_building, stair_mesh

__all__ = ["assert_same_building", "stair_mesh"]

REGISTRY = Registry(builtins=built_in("importer"))

GMSH41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
4
1 7 "exit:door"
2 1 "floor:ground"
2 2 "floor:upper"
2 3 "stair:main"
$EndPhysicalNames
$Entities
0 1 3 0
1 0 0 0 0 2 0 1 7 0
1 0 0 0 10 2 0 1 1 0
2 10 0 0 16 2 3 1 3 0
3 16 0 3 26 2 3 1 2 0
$EndEntities
$Nodes
3 8 1 8
2 1 0 4
1
2
3
4
0 0 0
10 0 0
10 2 0
0 2 0
2 2 0 2
5
6
16 0 3
16 2 3
2 3 0 2
7
8
26 0 3
26 2 3
$EndNodes
$Elements
4 5 1 5
1 1 1 1
1 1 4
2 1 2 2
2 1 2 3
3 1 3 4
2 2 3 1
4 2 5 6 3
2 3 3 1
5 5 7 8 6
$EndElements
"""

PLY = """ply
format ascii 1.0
element vertex 5
property float x
property float y
property float z
property uchar red
element face 2
property list uchar int vertex_indices
end_header
0 0 0 255
4 0 0 255
4 3 0 255
0 3 0 255
6 1 0 255
4 0 1 2 3
3 1 4 2
"""


def read_mesh(path):
    """Return the triangles in a file, checked."""
    return checked(path, read_surface(REGISTRY.importer_for(path)(), path))


def gmsh41(tmp_path):
    path = tmp_path / "building.msh"
    path.write_text(GMSH41)
    return path


def test_gmsh_41_with_physical_groups(tmp_path, stair_mesh, assert_same_building):
    building = read_building(gmsh41(tmp_path))
    assert [level.name for level in building.levels] == ["ground", "main flight z=0.00..3.00", "upper"]
    assert [(way.name, way.level, way.width) for way in building.exits] == [("door", 0, 2.0)]
    assert building.stairs == {"main": (1,)}
    assert_same_building(building, read_building(stair_mesh.write_gmsh22(tmp_path / "old.msh")))
    assert_same_building(building, read_building(stair_mesh.write_vtu(tmp_path / "building.vtu")))


def test_ply_with_colours_and_polygons(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(PLY)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [6, 1, 0]])
    assert len(mesh.triangles) == 3


def test_an_upright_wall_may_zigzag_in_plan(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 4 0.001 0\nv 3.9 -0.001 3\nv 0.1 0.002 3\nf 1 2 3 4\n")
    assert read_mesh(path).triangles.shape == (2, 3)
    path.write_text("v 0 0 0\nv 4 0 0\nv 3 0 3\nv 1 0 -1\nv 0 0 3\nf 1 2 3 4 5\n")  # it crosses itself
    assert read_mesh(path).triangles.tolist() == [[0, 4, 3], [0, 3, 2], [0, 2, 1]]


def vtu(path, *pieces, data=""):
    """Write pieces of (points, cells, types), ``data`` in each."""
    body = ""
    for points, cells, types in pieces:
        ends = np.cumsum([len(cell) for cell in cells]).tolist()
        arrays = [("Int64", "connectivity", np.concatenate(cells).tolist()), ("Int64", "offsets", ends)]
        rows = "".join(
            f'<DataArray type="{kind}" Name="{name}" format="ascii">{" ".join(map(str, values))}</DataArray>'
            for kind, name, values in (*arrays, ("UInt8", "types", types))
        )
        body += (
            f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}"><Points><DataArray type="Float64" '
            f'NumberOfComponents="3" format="ascii">{" ".join(map(str, np.ravel(points)))}</DataArray></Points>'
            f"<Cells>{rows}</Cells><CellData>{data}</CellData></Piece>"
        )
    path.write_text(
        '<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">'
        f"<UnstructuredGrid>{body}</UnstructuredGrid></VTKFile>"
    )
    return path


QUAD = [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]]


@pytest.mark.parametrize(
    ("array", "carried"),
    [('type="Int32"', "1 0"), ('type="Int32" NumberOfComponents="1"', "1 0"), ('type="Float64"', "1 nan")],
)
def test_tags_of_vtu_are_where_they_are_not_zero(tmp_path, array, carried):
    data = f'<DataArray {array} Name="floor:a" format="ascii">{carried}</DataArray>'
    mesh = read_mesh(vtu(tmp_path / "a.vtu", (QUAD, [[0, 1, 2], [0, 2, 3]], [5, 5]), data=data))
    assert mesh.cell_tags["floor:a"].tolist() == [True, False]


def test_gmsh_22_with_negative_groups(tmp_path, stair_mesh):
    """Gmsh writes the negative number for a surface that its group has the other way round."""
    path = stair_mesh.write_gmsh22(tmp_path / "a.msh")
    expected = read_mesh(path).cell_tags
    turned = re.sub(r"^(\d+ 3 2) (\d+)", r"\1 -\2", path.read_text(), flags=re.MULTILINE)
    assert turned != path.read_text()
    path.write_text(turned)
    for name, mask in read_mesh(path).cell_tags.items():
        assert mask.tolist() == expected[name].tolist()
        assert mask.any()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\nv 9 9 9\n", "line 4: 'f 0 1 2'"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n", "line 4: 'f -1 -2 -4'"),
        ("a.obj", "", "the file is empty"),
        ("a.obj", "v 0 0 0\n", "no surface cells"),
        ("a.obj", "v 0 0\n", "line 1"),
        ("a.obj", "v 0 0 0\nf 1 x 2\n", "line 2"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3: 'f 1 2'"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 5\n", "vertex 5, .* 2"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1e300 0\nf 1 2 3\n", r"vertex 3 .* 1e\+11"),
        ("a.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "vertex 2"),
        (
            "a.obj",
            "v 1 2 5\nv 5 2 5\nv 1 4 5\nv 5 4 5\nf 1 2 3 4\n",
            r"polygon at \(1\.00, 2\.00, 5\.00\) crosses itself",
        ),
        ("a.off", "OFF\n3 1 0\n0 0 0\n", "cannot be read"),
        ("a.ply", "nothing", "cannot be read"),
        ("a.ply", PLY[:-4], "cut off"),
        ("a.stl", "nothing", "cannot be read"),
        ("a.vtu", "nothing", "cannot be read"),
        ("a.vtu", "", "the file is empty"),
        ("a.msh", "nothing", "cannot be read"),
        ("a.msh", GMSH41[:400], "cannot be read"),
        ("a.msh", "", "the file is empty"),
        ("a.dwg", "", "'\\.dwg'"),
    ],
)
def test_damaged_files_are_refused_by_name_and_in_silence(tmp_path, capfd, name, content, words):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(BuildingError, match=words) as caught:
        read_mesh(path)
    assert str(path) in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_unknown_tag_is_a_warning(tmp_path, stair_mesh):
    stair_mesh.edge((26.0, 0.0, 3.0), (26.0, 2.0, 3.0), "exits:back")
    building = read_building(stair_mesh.write_gmsh22(tmp_path / "a.msh"))
    (warning,) = building.warnings
    assert "'exits:back'" in warning
    assert len(building.exits) == 1


GROUPS = """
o ground_floor
v 0 0 0
v 8 0 0
v 8 5 0
v 0 5 0
f 1 2 3 4
g f0_exit_L
v 8 2 0
v 9 2 0
v 9 3 0
v 8 3 0
f 5 6 7 8
g f0_room_b0
v 0 5 0
v 4 5 0
v 4 9 0
v 0 9 0
f 9 10 11 12
g back exit
v 3 9 0
v 4 9 0
l 13 14
g Tuer
v 0 1 0
v 0 2 0
v 0 2 2
v 0 1 2
f 15 16 17 18
"""


def test_groups_of_obj_are_tags(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(GROUPS)
    building = read_building(path)
    assert [level.name for level in building.levels] == ["ground_floor"]
    assert [(way.name, way.width) for way in building.exits] == [("back exit", 1.0), ("f0_exit_L", 1.0)]
    assert [(area.name, area.polygon.area) for area in building.areas] == [("f0_room_b0", 16.0)]
    names = {"tuer*": "exit", "*room*": "floor", "back*": ""}
    mesh = read_surface(REGISTRY.importer_for(path)(names=names), path)
    building = build_building(mesh, path)
    assert [level.name for level in building.levels] == ["f0_room_b0", "ground_floor"]
    # An upright face is a door, whose lower edge is the exit.
    assert [(way.name, way.segments.tolist()) for way in building.exits] == [
        ("Tuer", [[0.0, 2.0, 0.0, 1.0]]), ("f0_exit_L", [[8.0, 2.0, 8.0, 3.0]]),
    ]  # fmt: skip
    ignored = read_surface(REGISTRY.importer_for(path)(names={"*": "ignore"}), path)
    assert len(ignored.cells) == 0


def test_cells_that_are_no_surface_are_noted(tmp_path):
    points = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [0, 0, 3]]
    cells = [("quad", [[0, 1, 2, 3]]), ("tetra", [[0, 1, 3, 4]]), ("vertex", [[0]])]
    meshio.Mesh(points, cells).write(tmp_path / "a.vtu")
    found = REGISTRY.importer_for(tmp_path / "a.vtu")().read(tmp_path / "a.vtu")
    assert [list(cell) for cell in found.cells] == [[0, 1, 2, 3]]
    assert found.points.tolist() == points
    assert [*found.findings] == ["1 cells of type 'tetra' are not surface cells and are ignored"]
