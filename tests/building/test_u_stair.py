"""A bare surface: two floors and a U-shaped stair, in every format and order."""

import meshio
import numpy as np
import pytest
import shapely

from evac.building.model.elevation import elevation
from evac.simulation.assembly import read_building

EXIT = {"name": "out", "segment": [[0, 5], [0, 6]], "z": 0.0}
SLOPE = np.arctan(1.625 / 5.0)


def read_plain(path):
    """Points and triangles by the simplest parser there is."""
    lines = [line.split() for line in path.read_text().splitlines()]
    points = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    return points, np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1


def shuffled(points, triangles, seed):
    random = np.random.default_rng(seed)
    order = random.permutation(len(points))
    triangles = np.argsort(order)[triangles]
    triangles = random.permuted(triangles, axis=1)  # turns and flips
    return points[order], triangles[random.permutation(len(triangles))]


def unwelded(points, triangles):
    return points[triangles].reshape(-1, 3), np.arange(triangles.size).reshape(-1, 3)


def test_five_levels_and_four_portals_in_a_chain(u_stair):
    assert [(level.kind, level.z_min, level.z_max) for level in reversed(u_stair.levels)] == [
        ("floor", 3.25, 3.25),
        ("flight", 1.625, 3.25),
        ("landing", 1.625, 1.625),
        ("flight", 0.0, 1.625),
        ("floor", 0.0, 0.0),
    ]
    assert [portal.levels for portal in u_stair.portals] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert [portal.width for portal in u_stair.portals] == [3.0, 3.0, 3.0, 3.0]
    assert u_stair.stairs == {"stair 1": (3, 2, 1)}
    assert u_stair.warnings == ()


def test_wall_between_the_flights_stands_on_both(u_stair):
    for level, ends in ((1, [12, 8, 7, 8]), (3, [7, 8, 12, 8])):
        own = u_stair.walls[u_stair.wall_level == level]
        assert ends in own.tolist()
        assert len(own) == 2


def test_walls_and_portals_are_the_outline_with_the_inside_on_the_left(u_stair):
    seen = [(level, wall) for level, wall in zip(u_stair.wall_level, u_stair.walls, strict=True)]
    seen += [(way.level, segment) for way in u_stair.exits for segment in way.segments]
    for portal in u_stair.portals:
        for x1, y1, x2, y2 in portal.segments:
            seen += [(portal.levels[0], (x1, y1, x2, y2)), (portal.levels[1], (x2, y2, x1, y1))]
    for index, level in enumerate(u_stair.levels):
        own = np.array([segment for on, segment in seen if on == index])
        step = own[:, 2:] - own[:, :2]
        assert np.hypot(*step.T).sum() == pytest.approx(level.polygon.length)
        inward = np.column_stack([-step[:, 1], step[:, 0]]) / np.hypot(*step.T)[:, None]
        assert shapely.contains_xy(level.polygon, (own[:, :2] + own[:, 2:]) / 2 + 0.01 * inward).all()


def test_elevation_is_exact(u_stair):
    position = np.array([[7, 6], [9.5, 6], [12, 7], [9.5, 10], [13, 8], [1, 1], [1, 1], [0, 0]])
    level = np.array([1, 1, 1, 3, 2, 0, 4, -1])
    expected = [0.0, 0.8125, 1.625, 2.4375, 1.625, 0.0, 3.25, np.nan]
    np.testing.assert_allclose(elevation(u_stair, level, position), expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["a.ply", "text.ply", "a.stl", "text.stl", "a.off", "a.vtu", "a.obj"])
def test_same_building_from_every_format_and_order(u_stair, u_stair_path, tmp_path, assert_same_building, name, seed):
    points, triangles = shuffled(*read_plain(u_stair_path), seed)
    if name.endswith((".ply", ".stl")):
        points, triangles = unwelded(points, triangles)
    mesh = meshio.Mesh(points, [("triangle", triangles.astype(np.int32))])
    options = {"binary": "text" not in name} if name.endswith((".ply", ".stl")) else {}
    mesh.write(tmp_path / name, **options)
    other = read_building(tmp_path / name, exits=[EXIT])
    assert_same_building(u_stair, other)
    np.testing.assert_array_equal(u_stair.vertices, other.vertices)
    for a, b in zip(u_stair.levels, other.levels, strict=True):
        np.testing.assert_array_equal(a.triangles, b.triangles)


def test_obj_with_texture_normals_groups_and_lines(u_stair, u_stair_path, tmp_path, assert_same_building):
    points, triangles = read_plain(u_stair_path)
    lines = ["mtllib a.mtl", "o building", *(f"v {x} {y} {z} 0.5 0.5 0.5" for x, y, z in points)]
    lines += ["vt 0.5 0.5", "vn 0 0 1", "g part", "usemtl grey", "s off", "l 1 2"]
    lines += ["f " + " ".join(f"{i + 1}/1/1" for i in triangle) for triangle in triangles[:20]]
    lines += ["g rest", *("f " + " ".join(f"{i - len(points)}//1" for i in triangle) for triangle in triangles[20:])]
    path = tmp_path / "exported.obj"
    path.write_text("\n".join(lines))
    assert_same_building(u_stair, read_building(path, exits=[EXIT]))
