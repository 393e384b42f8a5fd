"""Small meshes and ways to write them."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from evac.building.model.building import Building
from evac.simulation.assembly import read_building
from tests.ustair import write_u_stair

U_STAIR_EXIT = {"name": "out", "segment": [[0, 5], [0, 6]], "z": 0.0}


class Mesh:
    """Polygons with tags, on points gathered as they come."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float, float]] = []
        self.faces: list[list[int]] = []
        self.tags: list[str] = []
        self.edges: list[tuple[list[int], str]] = []

    def point(self, point: tuple[float, float, float]) -> int:
        if point not in self.points:
            self.points.append(point)
        return self.points.index(point)

    def face(self, *corners: tuple[float, float, float], tag: str = "") -> "Mesh":
        self.faces.append([self.point(corner) for corner in corners])
        self.tags.append(tag)
        return self

    def rectangle(self, x1, y1, x2, y2, z1=0.0, z2=None, tag: str = "") -> "Mesh":
        """Add a quad that rises from z1 at x1 to z2 at x2."""
        z2 = z1 if z2 is None else z2
        return self.face((x1, y1, z1), (x2, y1, z2), (x2, y2, z2), (x1, y2, z1), tag=tag)

    def edge(self, one: tuple[float, float, float], other: tuple[float, float, float], tag: str) -> "Mesh":
        self.edges.append(([self.point(one), self.point(other)], tag))
        return self

    def write_obj(self, path: Path) -> Path:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in self.points]
        lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in self.faces]
        path.write_text("\n".join(lines) + "\n")
        return path

    def blocks(self) -> tuple[list[tuple[str, list[list[int]]]], list[list[str]]]:
        """One meshio block for each cell, and its tag."""
        kinds = {3: "triangle", 4: "quad"}
        cells = [(kinds.get(len(face), "polygon"), [face]) for face in self.faces]
        cells += [("line", [edge]) for edge, _ in self.edges]
        return cells, [[tag] for tag in self.tags + [tag for _, tag in self.edges]]

    def write_gmsh22(self, path: Path) -> Path:
        cells, tags = self.blocks()
        names = sorted({tag for (tag,) in tags if tag})
        dimension = {tag: 1 if kind == "line" else 2 for (kind, _), (tag,) in zip(cells, tags, strict=True)}
        numbers = [np.array([names.index(tag) + 1 if tag else 0]) for (tag,) in tags]
        mesh = meshio.Mesh(
            np.array(self.points, dtype=float),
            cells,
            cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
            field_data={name: np.array([names.index(name) + 1, dimension[name]]) for name in names},
        )
        meshio.write(path, mesh, file_format="gmsh22", binary=False)
        return path

    def write_vtu(self, path: Path) -> Path:
        cells, tags = self.blocks()
        names = sorted({tag for (tag,) in tags if tag})
        data = {name: [np.array([int(tag == name)]) for (tag,) in tags] for name in names}
        meshio.write(path, meshio.Mesh(np.array(self.points, dtype=float), cells, cell_data=data))
        return path


def straight_stair(width: float = 2.0) -> Mesh:
    """Two floors 10 m long at z = 0 and 3, joined by a straight stair of 6 m in plan."""
    mesh = Mesh()
    mesh.rectangle(0, 0, 10, width, 0.0, tag="floor:ground")
    mesh.rectangle(10, 0, 16, width, 0.0, 3.0, tag="stair:main")
    mesh.rectangle(16, 0, 26, width, 3.0, tag="floor:upper")
    return mesh.edge((0.0, 0.0, 0.0), (0.0, width, 0.0), "exit:door")


@pytest.fixture
def mesh() -> Mesh:
    return Mesh()


@pytest.fixture
def stair_mesh() -> Mesh:
    return straight_stair()


@pytest.fixture
def read(tmp_path):
    """Write a mesh as OBJ and read it as a building."""

    def read_mesh(mesh: Mesh, **options) -> Building:
        return read_building(mesh.write_obj(tmp_path / "mesh.obj"), **options)

    return read_mesh


@pytest.fixture
def u_stair_path(tmp_path) -> Path:
    return write_u_stair(tmp_path / "u_stair.obj")


@pytest.fixture
def u_stair(u_stair_path) -> Building:
    return read_building(u_stair_path, exits=[U_STAIR_EXIT])


def _same_building(one: Building, other: Building) -> None:
    """Compare everything but file, vertices and triangles."""
    assert [level.name for level in one.levels] == [level.name for level in other.levels]
    assert [(level.kind, level.stair) for level in one.levels] == [(level.kind, level.stair) for level in other.levels]
    for a, b in zip(one.levels, other.levels, strict=True):
        np.testing.assert_allclose(a.uphill, b.uphill, rtol=0, atol=1e-9)
        np.testing.assert_allclose([a.slope, a.z_min, a.z_max], [b.slope, b.z_min, b.z_max], rtol=0, atol=1e-9)
        assert a.polygon.symmetric_difference(b.polygon).area < 1e-9
    assert [(p.name, p.levels) for p in one.portals] == [(p.name, p.levels) for p in other.portals]
    assert [(e.name, e.level) for e in one.exits] == [(e.name, e.level) for e in other.exits]
    for a, b in zip((*one.portals, *one.exits), (*other.portals, *other.exits), strict=True):
        np.testing.assert_allclose(a.segments, b.segments, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(one.wall_level, other.wall_level)
    np.testing.assert_allclose(one.walls, other.walls, rtol=0, atol=1e-9)
    assert one.stairs == other.stairs


@pytest.fixture
def assert_same_building():
    return _same_building
