import meshio
import numpy as np
import pytest

from evac.building.meshfile import read_mesh
from evac.building.reading import read_building
from evac.errors import BuildingError

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
comment written by hand
element vertex 4
property float x
property float y
property float z
property uchar red
element face 1
property list uchar int vertex_index
property float quality
element edge 1
property int vertex1
property int vertex2
end_header
0 0 0 255
4 0 0 255
4 3 0 255
0 3 0 255
4 0 1 2 3 0.5
0 1
"""


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


def test_gmsh_41_cell_in_two_groups(tmp_path):
    text = GMSH41.replace("\n4\n1 7", '\n5\n2 9 "area:class"\n1 7', 1).replace("10 2 0 1 1 0", "10 2 0 2 1 9 0")
    path = tmp_path / "building.msh"
    path.write_text(text)
    (area,) = read_building(path).areas
    assert (area.name, area.level, area.polygon.area) == ("class", 0, 20.0)


def test_ply_with_colours_edges_and_vertex_index(tmp_path):
    path = tmp_path / "hand.ply"
    path.write_text(PLY)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]])
    assert len(mesh.triangles) == 2


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_of_either_byte_order(tmp_path, order):
    word = {"<": "little", ">": "big"}[order]
    head = PLY[: PLY.index("end_header")].replace("ascii", f"binary_{word}_endian").replace("property uchar red\n", "")
    points = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]], dtype=f"{order}f4")
    face = bytes([4]) + np.arange(4, dtype=f"{order}i4").tobytes() + np.array(0.5, dtype=f"{order}f4").tobytes()
    path = tmp_path / "binary.ply"
    path.write_bytes(
        head.encode() + b"end_header\n" + points.tobytes() + face + np.array([0, 1], dtype=f"{order}i4").tobytes()
    )
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(np.unique(mesh.triangles), np.arange(4))


def test_off_with_colours_comments_and_polygons(tmp_path):
    path = tmp_path / "a.off"
    path.write_text("COFF 5 2 0 # counts\n\n0 0 0 1 1 1\n4 0 0 1 1 1\n4 3 0 1 1 1\n0 3 0 1 1 1\n6 1 0 1 1 1\n"
                    "4 0 1 2 3 255 0 0\n3 1 4 2\n")  # fmt: skip
    mesh = read_mesh(path)
    assert len(mesh.points) == 5
    assert len(mesh.triangles) == 3


def test_obj_with_continued_lines_and_repeated_o(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("o one\nv 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nf 1 2 \\\n3 4\no two\nv 8 0 0\nv 8 3 0\nf 2 -2 -1 3\n")
    assert read_mesh(path).triangles.shape == (4, 3)


def test_second_order_cells_count_by_their_corners(tmp_path):
    points = [[0, 0, 0], [4, 0, 0], [0, 4, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    path = tmp_path / "curved.vtu"
    meshio.Mesh(np.array(points, dtype=float), [("triangle6", [[0, 1, 2, 3, 4, 5]])]).write(path)
    np.testing.assert_array_equal(read_mesh(path).triangles, [[0, 1, 2]])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", "", "the file is empty"),
        ("a.obj", "v 0 0 0\n", "no surface cells"),
        ("a.obj", "v 0 0\n", "line 1"),
        ("a.obj", "v 0 0 0\nf 1 x 2\n", "line 2"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3: 'f 1 2': a face has only 2 corners"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 5\n", "refers to vertex 5, but the file has 2"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1e300 0\nf 1 2 3\n", r"vertex 3 lies at .* farther than 1e\+11 from"),
        ("a.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", r"vertex 2 is not finite"),
        ("a.off", "nothing", "first word must be OFF"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n", "but 1 lines follow"),
        ("a.off", "OFF # corners\n3 1 0\n\n0 0 0\n1 0 0\n1 1 0\n2 0 1\n", "line 7: '2 0 1': a face has only 2 corners"),
        ("a.off", "OFF 3 1 0\n0 0 0\n1 0\n1 1 0\n3 0 1 2\n", "line 3: '1 0'"),
        ("a.off", "OFF\n", "numbers of vertices and faces are missing"),
        ("a.ply", "nothing", "no PLY file"),
        ("a.ply", PLY[:-10], "ends before the rows"),
        ("a.ply", PLY.replace("float x", "float32x x"), "'property float32x x' is wrong"),
        ("a.ply", PLY.replace("float x", "float a"), "no x, y, z"),
        ("a.ply", PLY.replace("vertex_index", "corners"), "no list vertex_indices"),
        ("a.stl", "nothing", "cannot be read"),
        ("a.vtu", "nothing", "cannot be read"),
        ("a.vtu", "", "the file is empty"),
        ("a.msh", "nothing", "cannot be read"),
        ("a.msh", GMSH41[:400], "cannot be read"),
        ("a.msh", "", "the file is empty"),
        ("a.dxf", "", "cannot read files ending in '.dxf'"),
    ],
)
def test_damaged_files_are_refused_by_name_and_in_silence(tmp_path, capfd, name, content, words):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(BuildingError, match=words) as caught:
        read_mesh(path)
    assert str(path) in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_missing_file(tmp_path):
    with pytest.raises(BuildingError, match="no such file"):
        read_mesh(tmp_path / "none.obj")


def test_unknown_tag_is_a_warning(tmp_path, stair_mesh):
    stair_mesh.edge((26.0, 0.0, 3.0), (26.0, 2.0, 3.0), "exits:back")
    building = read_building(stair_mesh.write_gmsh22(tmp_path / "a.msh"))
    (warning,) = building.warnings
    assert "'exits:back' is not known" in warning
    assert len(building.exits) == 1


def test_exit_tag_on_a_surface_is_refused(tmp_path, stair_mesh):
    stair_mesh.rectangle(30, 0, 31, 1, tag="exit:wrong")
    with pytest.raises(BuildingError, match="'exit:wrong' is on no edge"):
        read_building(stair_mesh.write_vtu(tmp_path / "a.vtu"))
