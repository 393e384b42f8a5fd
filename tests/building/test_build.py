import numpy as np
import pytest
import shapely

from evac import Plan
from evac.simulation.assembly import read_building


def draw(mesh):
    """Three floors of one height, a stair and an upper floor; quads, one polygon with a bay, hanging nodes."""
    mesh.rectangle(0, 0, 10, 6, tag="floor:a").rectangle(10, 0, 16, 6, 0.0, 3.0, tag="stair:main")
    mesh.rectangle(16, 0, 26, 6, 3.0, tag="floor:upper")
    mesh.rectangle(0, 6, 3, 12, tag="area:start").rectangle(3, 6, 10, 12, tag="floor:b")
    mesh.rectangle(10, 6, 12, 12, tag="floor:b")
    bay = [(0, 12), (12, 12), (12, 20), (8, 20), (8, 14), (4, 14), (4, 20), (0, 20)]
    mesh.face(*[(x, y, 0) for x, y in bay], tag="floor:c")
    mesh.rectangle(18, 0, 20, 2.5, 3.0, tag="obstacle:counter")
    for y in range(6):
        mesh.rectangle(26, y, 27, y + 1, 3.0, tag="area:gallery")
    return mesh.edge((0, 0, 0), (0, 6, 0), "exit:door")


def shuffle(mesh, seed):
    random = np.random.default_rng(seed)
    faces = random.permutation(len(mesh.faces))
    points = random.permutation(len(mesh.points))
    new = np.argsort(points)
    mesh.points = [mesh.points[row] for row in points]
    mesh.tags = [mesh.tags[row] for row in faces]
    mesh.faces = [
        new[np.roll(mesh.faces[row][:: random.choice([1, -1])], random.integers(8))].tolist() for row in faces
    ]
    mesh.edges = [(new[edge[::-1]].tolist(), tag) for edge, tag in mesh.edges]
    return mesh


@pytest.fixture
def building(mesh, tmp_path):
    return read_building(draw(mesh).write_vtu(tmp_path / "drawn.vtu"))


def test_everything_a_tagged_mesh_can_say(building):
    assert [(level.name, level.kind) for level in building.levels] == [
        ("a", "floor"),
        ("b", "floor"),
        ("c", "floor"),
        ("main flight z=0.00..3.00", "flight"),
        ("upper", "floor"),
    ]
    assert [level.polygon.area for level in building.levels] == pytest.approx([60, 72, 72, 36, 61])
    assert [(portal.levels, portal.segments.tolist()) for portal in building.portals] == [
        ((0, 1), [[10, 6, 0, 6]]),
        ((0, 3), [[10, 0, 10, 6]]),
        ((1, 2), [[12, 12, 0, 12]]),
        ((3, 4), [[16, 0, 16, 6]]),
    ]
    assert [(area.name, area.level, area.polygon.area) for area in building.areas] == [
        ("gallery", 4, 6),
        ("start", 1, 18),
    ]
    assert [(way.name, way.level, way.segments.tolist()) for way in building.exits] == [("door", 0, [[0, 6, 0, 0]])]
    assert building.warnings == ()


@pytest.mark.parametrize("seed", range(8))
def test_the_order_of_the_file_means_nothing(mesh, building, tmp_path, assert_same_building, seed):
    other = read_building(shuffle(mesh, seed).write_vtu(tmp_path / "shuffled.vtu"))
    assert_same_building(building, other)
    np.testing.assert_array_equal(other.walls, building.walls)
    np.testing.assert_array_equal(other.vertices, building.vertices)
    for one, two in zip(building.levels, other.levels, strict=True):
        np.testing.assert_array_equal(one.triangles, two.triangles)
    assert [area.polygon.wkt for area in other.areas] == [area.polygon.wkt for area in building.areas]


@pytest.mark.parametrize("upper", [[], [(1, 1, 3, 2)]])
def test_a_tagged_obstacle_stands_on_the_floor_below_it_alone(mesh, tmp_path, upper):
    mesh.rectangle(0, 0, 4, 3, tag="floor:ground").rectangle(0, 0, 4, 3, 3.0, tag="floor:upper")
    mesh.rectangle(1, 1, 2, 2, 0.75, tag="obstacle:table").edge((0, 0, 0), (0, 3, 0), "exit:door")
    for box in upper:
        mesh.rectangle(*box, 3.75, tag="obstacle:table")
    building = read_building(mesh.write_vtu(tmp_path / "table.vtu"))
    assert [level.polygon.area for level in building.levels] == [11.0, 10.0 if upper else 12.0]
    assert np.bincount(building.wall_level).tolist() == [3 + 4, 4 + 4 * len(upper)]


def test_an_area_over_a_divided_floor_is_divided_too():
    plan = Plan()
    plan.storey("floor", [shapely.box(0, 0, 4, 5), shapely.box(5, 0, 11, 5)])
    plan.area("room", "floor", shapely.box(2, 0, 9, 5))
    plan.area("room (2)", "floor", shapely.box(0, 0, 1, 5))
    building = plan.building(need_exit=False)
    assert [(area.name, area.level, area.polygon.area) for area in building.areas] == [
        ("room", 1, pytest.approx(20.0)),
        ("room (3)", 0, pytest.approx(10.0)),
        ("room (2)", 0, pytest.approx(5.0)),
    ]
    (note,) = [one for one in building.findings if one.kind == "assumed"]
    assert "'room'" in note.text
