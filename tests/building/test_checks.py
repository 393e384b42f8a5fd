import numpy as np
import pytest

from evac.base.errors import BuildingError

EXIT = {"name": "out", "segment": [[0, 0], [0, 1]], "z": 0.0}


def test_no_exit_says_how_to_add_one_that_works(mesh, read):
    with pytest.raises(BuildingError, match=r"building\.exits") as caught:
        read(mesh.rectangle(0, 0, 6, 3))
    assert 'segment = [[0.00, 0.00], [6.00, 0.00]], level = "floor z=0.00"' in str(caught.value)
    exits = [{"name": "exit", "segment": [[0.0, 0.0], [6.0, 0.0]], "level": "floor z=0.00"}]
    assert read(mesh, exits=exits).exits[0].width == 6.0


@pytest.mark.parametrize(("depth", "is_refused"), [(0.99, True), (1.0, False), (1.01, False)])
def test_level_between_two_portals_is_at_least_1_m_deep(mesh, read, depth, is_refused):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(8, 0, 8 + depth, 2, 2)
    mesh.rectangle(8 + depth, 0, 12 + depth, 2, 2, 4).rectangle(12 + depth, 0, 16 + depth, 2, 4)
    if not is_refused:
        assert len(read(mesh, exits=[EXIT]).levels) == 5
        return
    with pytest.raises(BuildingError, match=r"'landing z=2.00' .* 0.99 m .* at \(8.(49|50), "):
        read(mesh, exits=[EXIT])


def test_portals_at_the_corner_of_a_quarter_landing_may_touch(mesh, read):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(8, 0, 10, 2, 2)
    mesh.face((8, 2, 2), (10, 2, 2), (10, 6, 4), (8, 6, 4)).rectangle(8, 6, 12, 10, 4)
    assert [level.kind for level in read(mesh, exits=[EXIT]).levels] == [
        "floor",
        "flight",
        "landing",
        "flight",
        "floor",
    ]


def test_level_over_itself_is_refused(mesh, read):
    for step in range(30):  # a spiral ramp of 450 degrees
        angle = np.deg2rad([15 * step, 15 * step + 15])
        inner, outer = (np.column_stack([r * np.cos(angle), r * np.sin(angle)]) for r in (2, 4))
        z = np.array([step, step + 1]) * 0.02
        corners = [(*inner[0], z[0]), (*outer[0], z[0]), (*outer[1], z[1]), (*inner[1], z[1])]
        mesh.face(*[tuple(np.round(corner, 9).tolist()) for corner in corners])
    with pytest.raises(BuildingError, match=r"'floor z=0.00' .* at \(") as caught:
        read(mesh, exits=[EXIT])
    x, y = (float(word) for word in str(caught.value).split("at (")[1].split(")")[0].split(","))
    assert 2 < np.hypot(x, y) < 4
    assert 0 < np.arctan2(y, x) < np.pi / 2


def test_stair_that_joins_nothing_is_refused(mesh, read):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(8.1, 0, 12.1, 2, 2)
    with pytest.raises(BuildingError, match=r"stair 'stair 1' at \(.*z = 0.00 to 2.00, .*'floor z=0.00'"):
        read(mesh, exits=[EXIT])
    mesh.points = [tuple(1000.0 * x for x in point) for point in mesh.points]
    with pytest.raises(BuildingError, match=r"joins only .*; the building measures .*building\.scale = 0\.001"):
        read(mesh, exits=[EXIT])


def test_ramp_to_an_exit_joins_something(mesh, read):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, -1)
    way = {"name": "ramp", "segment": [[8, 0], [8, 2]], "z": -1.0}
    building = read(mesh, exits=[way])
    assert building.levels[building.exits[0].level].kind == "flight"


def test_edge_of_three_cells_is_refused(mesh, read):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2).rectangle(4, 0, 8, 2, 0, 2)
    with pytest.raises(BuildingError, match=r"edge \(4.00, 0.00, 0.00\) - \(4.00, 2.00"):
        read(mesh, exits=[EXIT])


def test_fold_is_refused(mesh, read):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(4, 0, 8, 2, 4, 2).rectangle(0, 0, 4, 2, 4)
    with pytest.raises(BuildingError, match=r"edge \(8.00, 0.00, 2.00\)"):
        read(mesh, exits=[EXIT])


@pytest.mark.parametrize(("z", "is_refused"), [(0.0, True), (0.5, True), (3.0, False)])
def test_floors_on_the_same_ground_are_refused(mesh, read, z, is_refused):
    mesh.rectangle(0, 0, 10, 10).rectangle(6, 2, 20, 8, z, z)
    exits = [EXIT, {"name": "other", "segment": [[20, 4], [20, 5]], "z": z, "level": None}]
    if not is_refused:
        assert len(read(mesh, exits=exits).levels) == 2
        return
    with pytest.raises(BuildingError, match=rf"'floor .*' .* 24 m2 .* at \(.* 0.00 and {z:.2f}"):
        read(mesh, exits=exits)


@pytest.mark.parametrize(("z", "is_refused"), [(0.0, True), (1.0, True), (-0.5, False), (2.5, False)])
def test_a_flight_through_a_floor_is_refused(mesh, read, z, is_refused):
    """Two floors, the stair between them, and a floor that does not touch it, below, above or across it."""
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(8, 0, 12, 2, 2).rectangle(4.1, 0.5, 7.9, 1.5, z)
    if not is_refused:
        assert len(read(mesh, need_exit=False).levels) == 4
        return
    with pytest.raises(BuildingError, match=r"'f.*' and 'f.*' .* 3.8 m2 .* at \(\d"):
        read(mesh, need_exit=False)


@pytest.mark.parametrize(("gap", "weld", "walls"), [(0.002, 0.001, 8), (0.012, 0.001, 8), (0.002, 0.003, 4)])
def test_walls_closer_than_any_wall_is_thick_are_warned_of(mesh, read, gap, weld, walls):
    building = read(mesh.rectangle(0, 0, 4, 3).rectangle(4 + gap, 0, 8, 3), need_exit=False, weld=weld)
    assert len(building.walls) == walls
    notes = [one for one in building.findings if one.place == (4.0, 1.5) and one.level == "floor z=0.00"]
    assert len(notes) == len(building.warnings) == (gap == 0.002 and walls == 8)
    assert all("'floor z=0.00 (2)'" in one.text and "2.0 mm" in one.text for one in notes)


@pytest.mark.parametrize(("depth", "is_usable"), [(0.2, False), (0.4, True)])
def test_an_exit_before_which_nobody_can_stand_is_told(mesh, read, depth, is_usable):
    exits = [{"name": "back", "segment": [[3, 0], [4, 0]], "z": 0.0}, EXIT]
    stair = {"name": "stair", "polygon": [[2, depth], [5, depth], [5, 2], [2, 2]], "z": 0.0}
    building = read(mesh.rectangle(0, 0, 6, 3), exits=exits, obstacles=[stair])
    told = [(one.item, one.place) for one in building.findings if one.kind == "warning"]
    assert told == ([] if is_usable else [("exits.back", (3.5, 0.0))])
