import numpy as np
import pytest
import shapely

from evac.base.errors import BuildingError
from evac.simulation.assembly import read_building


@pytest.fixture
def room(mesh):
    return mesh.rectangle(0, 0, 6, 4)


def way(*segment, name="out", **where):
    return {"name": name, "segment": segment, **(where or {"z": 0.0})}


def test_exit_on_part_of_an_edge_splits_the_wall(room, read):
    building = read(room, exits=[way([6, 1], [6, 1.82])])
    np.testing.assert_allclose(building.exits[0].segments, [[6, 1, 6, 1.82]])
    assert building.exits[0].width == pytest.approx(0.82)
    np.testing.assert_allclose(
        building.walls, [[0, 0, 6, 0], [0, 4, 0, 0], [6, 0, 6, 1], [6, 1.82, 6, 4], [6, 4, 0, 4]]
    )


@pytest.mark.parametrize("x", [2.96, 3.0, 3.04])
def test_an_exit_at_a_wall_between_two_rooms_is_refused(mesh, read, x):
    mesh.rectangle(0, 0, 2.96, 4).rectangle(3.04, 0, 6, 4)
    mesh.face((0, 4, 0), (2.96, 4, 0), (3.04, 4, 0), (6, 4, 0), (6, 5, 0), (0, 5, 0))
    with pytest.raises(BuildingError, match=rf"'out'.*both sides.*\({x:.2f}, 1\.50\)"):
        read(mesh, exits=[way([x, 1], [x, 2])])
    (found,) = read(mesh, exits=[way([6, 1], [6, 2])]).exits
    assert found.width == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("segment", "words"),
    [
        (([3, 1], [3, 2]), "(6.00, 0.00), 1.00 m away"),
        (([6.06, 1], [6.06, 2]), "(6.00, 4.00), 0.06 m away"),
        (([6, 3], [6, 5]), "1.00 m of it"),
    ],
)
def test_exit_off_the_edge_names_the_nearest(room, read, segment, words):
    with pytest.raises(BuildingError, match="exit 'out'") as caught:
        read(room, exits=[way(*segment)])
    assert words in str(caught.value)
    assert [one.item for one in caught.value.findings] == ["building.exits.out"]


def test_level_by_name_and_by_height(stair_mesh, read):
    up = read(stair_mesh, exits=[way([0, 0], [0, 2]), way([26, 0], [26, 2], name="roof", z=2.8)])
    assert [found.level for found in up.exits] == [0, 2]
    by_name = read(stair_mesh, exits=[way([26, 0], [26, 2], level="floor z=3.00")])
    assert by_name.exits[0].level == 2
    with pytest.raises(BuildingError, match=r"'floor z=3'.*'floor z=3.00'"):
        read(stair_mesh, exits=[way([26, 0], [26, 2], level="floor z=3")])
    with pytest.raises(BuildingError, match=r"'roof'.*floor z=0.00, floor z=3.00"):
        read(stair_mesh, exits=[way([26, 0], [26, 2], level="roof")])
    with pytest.raises(BuildingError, match="z = 6 m"):
        read(stair_mesh, exits=[way([26, 0], [26, 2], z=6.0)])
    with pytest.raises(BuildingError, match="level"):
        read(stair_mesh, exits=[{"name": "out", "segment": [[0, 0], [0, 2]]}])


@pytest.mark.parametrize("shift", [0.0, 0.02, -0.02])
def test_at_the_end_of_a_flight_a_height_finds_what_things_lie_on(stair_mesh, read, shift):
    """The flight from x = 10 to 16 ends at the heights of both floors, and touches what lies beside it."""
    areas = [
        {"name": "up", "polygon": [[16 + shift, 0], [18, 0], [18, 2], [16 + shift, 2]], "z": 3.0},
        {"name": "down", "polygon": [[8, 0], [10 + shift, 0], [10 + shift, 2], [8, 2]], "z": 0.0},
        {"name": "on", "polygon": [[15, 0], [16 + shift, 0], [16 + shift, 2], [15, 2]], "z": 2.9},
    ]
    exits = [way([16 + shift, 0], [17, 0], name="up", z=3.0), way([9, 2], [10 + shift, 2], name="down")]
    exits += [way([15, 0], [16, 0], name="on", z=2.8)]
    building = read(stair_mesh, exits=exits, areas=areas)
    assert [area.level for area in building.areas] == [2, 0, 1]
    assert [exit_.level for exit_ in building.exits] == [2, 0, 1]


def test_area_is_clipped_to_its_level(room, read):
    square = {"name": "start", "polygon": [[5, 3], [8, 3], [8, 6], [5, 6]], "z": 0.0}
    building = read(room, exits=[way([6, 1], [6, 2])], areas=[square])
    (area,) = building.areas
    (warning,) = building.findings
    assert warning.level == "floor z=0.00"
    assert "area 'start': 1.00 of its 9.00 m2" in warning.text
    assert building.levels[0].polygon.contains(shapely.Point(warning.place))
    assert (area.name, area.level) == ("start", 0)
    assert area.polygon.equals(shapely.box(5, 3, 6, 4))
    with pytest.raises(BuildingError, match=r"area 'start' .*\(0.00, 0.00\) to \(6.00, 4.00\)"):
        read(room, exits=[way([6, 1], [6, 2])], areas=[{**square, "polygon": [[8, 8], [9, 8], [9, 9]]}])
    with pytest.raises(BuildingError, match=r"building\.areas\.start"):
        read(room, exits=[way([6, 1], [6, 2])], areas=[square, square])
    with pytest.raises(BuildingError, match="Self-intersection"):
        read(room, exits=[way([6, 1], [6, 2])], areas=[{**square, "polygon": [[0, 0], [2, 2], [2, 0], [0, 1]]}])


def test_obstacle_is_subtracted_and_walled(room, read):
    building = read(
        room,
        exits=[way([6, 1], [6, 2])],
        areas=[{"name": "all", "polygon": [[0, 0], [6, 0], [6, 4], [0, 4]], "z": 0.0}],
        obstacles=[
            {"name": "desk", "polygon": [[1, 1], [2, 1], [2, 2], [1, 2]], "z": 0.0},
            {"name": "shelf", "polygon": [[3, 3], [4, 3], [4, 5], [3, 5]], "z": 0.0},
        ],
    )
    expected = shapely.box(0, 0, 6, 4) - shapely.box(1, 1, 2, 2) - shapely.box(3, 3, 4, 5)
    assert building.levels[0].polygon.equals(expected)
    assert building.areas[0].polygon.equals(expected)
    own = building.walls.tolist()
    assert [wall for wall in own if max(wall) <= 2] == [[1, 1, 1, 2], [1, 2, 2, 2], [2, 1, 1, 1], [2, 2, 2, 1]]
    assert [wall for wall in own if min(wall) >= 3 and max(wall) <= 4] == [[3, 3, 3, 4], [4, 3, 3, 3], [4, 4, 4, 3]]
    assert building.wall_level.dtype == np.int32


def test_no_walls_are_left_inside_an_obstacle(mesh, read):
    """Of a pillar in the middle that is inside it."""
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)):
        mesh.rectangle(2 * i, 2 * j, 2 * i + 2, 2 * j + 2)
    counter = {"name": "counter", "polygon": [[1, 1], [5, 1], [5, 5], [1, 5]], "z": 0.0}
    building = read(mesh, exits=[way([0, 0], [0, 1])], obstacles=[counter])
    assert len(building.walls) == 4 + 4
    assert building.levels[0].polygon.area == 36.0 - 16.0


@pytest.mark.parametrize(
    ("polygon", "words"),
    [
        ([[5, 1.5], [6, 1.5], [6, 3], [5, 3]], r"obstacle 'desk'.* 0.50 m .* exit 'out' at \(6.00, 1.75\)"),
        ([[8, 1], [9, 1], [9, 2]], "obstacle 'desk'.* level"),
        ([[-1, -1], [5.9, -1], [5.9, 5], [-1, 5]], "area 'start'"),
        ([[1, 1], [2, 1]], "polygon"),
    ],
)
def test_obstacles_that_cannot_be(room, read, polygon, words):
    area = {"name": "start", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "z": 0.0}
    with pytest.raises(BuildingError, match=words):
        read(
            room, exits=[way([6, 1], [6, 2])], areas=[area], obstacles=[{"name": "desk", "polygon": polygon, "z": 0.0}]
        )


@pytest.mark.parametrize(("is_cut_out", "height"), [(True, 0.0), (False, 0.0), (False, 0.75)])
def test_tagged_obstacle_becomes_walls(mesh, tmp_path, is_cut_out, height):
    for x in range(3):
        for y in range(3):
            if (x, y) != (1, 1) or not is_cut_out:
                mesh.rectangle(x, y, x + 1, y + 1, tag="floor:room")
    mesh.rectangle(1, 1, 2, 2, height, tag="obstacle:desk")
    mesh.face((1, 1, 0), (2, 1, 0), (2, 1, 0.7), tag="obstacle:desk")
    mesh.edge((0, 0, 0), (0, 1, 0), "exit:out")
    building = read_building(mesh.write_gmsh22(tmp_path / "a.msh"))
    (level,) = building.levels
    assert level.polygon.equals(shapely.box(0, 0, 3, 3) - shapely.box(1, 1, 2, 2))
    inner = [wall for wall in building.walls.tolist() if min(wall) == 1 and max(wall) == 2]
    assert inner == [[1, 1, 1, 2], [1, 2, 2, 2], [2, 1, 1, 1], [2, 2, 2, 1]]


def test_tagged_exit_on_part_of_an_edge(mesh, tmp_path):
    mesh.rectangle(0, 0, 4, 3).edge((4, 1, 0), (4, 2, 0), "exit:door")
    building = read_building(mesh.write_vtu(tmp_path / "a.vtu"))
    assert building.exits[0].segments.tolist() == [[4, 1, 4, 2]]
    assert building.walls.tolist() == [[0, 0, 4, 0], [0, 3, 0, 0], [4, 0, 4, 1], [4, 2, 4, 3], [4, 3, 0, 3]]
