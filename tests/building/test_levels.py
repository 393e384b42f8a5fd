import numpy as np
import pytest

from evac.simulation.assembly import read_building

EXIT = {"name": "out", "segment": [[0, 0], [0, 1]], "z": 0.0}


def test_flat_angle_divides_flat_from_sloped(mesh, read):
    rise = float(10 * np.tan(np.deg2rad(2.9)))
    mesh.rectangle(0, 0, 10, 2).rectangle(10, 0, 20, 2, 0, rise).rectangle(20, 0, 30, 2, rise)
    assert [level.kind for level in read(mesh, exits=[EXIT]).levels] == ["floor"]
    assert [level.kind for level in read(mesh, exits=[EXIT], flat_angle=2.8).levels] == ["floor", "flight", "floor"]


def test_the_slope_of_a_flight_is_the_mean_over_its_area(mesh, read):
    """1 m in plan that rises by 0.4 m, and 3 m that rise by 1.5 m: by cells the mean would be 0.45, not 0.475."""
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 5, 2, 0, 0.4).rectangle(5, 0, 8, 2, 0.4, 1.9).rectangle(8, 0, 12, 2, 1.9)
    (flight,) = (level for level in read(mesh, exits=[EXIT]).levels if level.kind == "flight")
    assert flight.slope == pytest.approx(np.arctan(0.475), rel=1e-12)
    assert flight.uphill == pytest.approx([1.0, 0.0], abs=1e-12)


def test_ridge_divides_flights(mesh, read):
    mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(8, 0, 12, 2, 2, 0).rectangle(12, 0, 16, 2)
    building = read(mesh, exits=[EXIT])
    assert sorted(level.kind for level in building.levels) == ["flight", "flight", "floor", "floor"]
    assert building.stairs == {"stair 1": (2, 3)}


def test_floor_between_flights_is_a_landing_only_if_small(mesh, read):
    def storeys(depth):
        mesh.faces.clear()
        mesh.rectangle(0, 0, 4, 2).rectangle(4, 0, 8, 2, 0, 2).rectangle(8, 0, 8 + depth, 2, 2)
        mesh.rectangle(8 + depth, 0, 12 + depth, 2, 2, 4).rectangle(12 + depth, 0, 16 + depth, 2, 4)
        return read(mesh, exits=[EXIT])

    small, large = storeys(2.0), storeys(9.0)
    assert [level.kind for level in small.levels] == ["floor", "flight", "landing", "flight", "floor"]
    assert small.stairs == {"stair 1": (3, 2, 1)}
    assert [level.kind for level in large.levels] == ["floor", "flight", "floor", "flight", "floor"]
    assert large.stairs == {"stair 1": (1,), "stair 2": (3,)}


def test_floor_tags_divide_and_areas_do_not(mesh, tmp_path):
    mesh.rectangle(0, 0, 4, 4, tag="floor:west").rectangle(4, 0, 8, 4, tag="area:class")
    mesh.rectangle(8, 0, 12, 2, tag="floor:east").rectangle(8, 2, 12, 4)
    mesh.edge((0, 0, 0), (0, 4, 0), "exit:out")
    building = read_building(mesh.write_vtu(tmp_path / "a.vtu"))
    # The class and the untagged cell touch the west along 4 m, the east along 2 + 4 m.
    assert [(lv.name, lv.polygon.area) for lv in building.levels] == [("west", 16.0), ("east", 32.0)]
    (area,) = building.areas
    assert (area.name, area.level, area.polygon.bounds) == ("class", 1, (4.0, 0.0, 8.0, 4.0))
    assert building.portals[0].segments.tolist() == [[4, 0, 4, 4]]


def test_landing_tagged_as_stair_is_a_level_of_its_own(mesh, tmp_path):
    mesh.rectangle(0, 0, 4, 2, tag="floor:ground").rectangle(4, 0, 6, 2, tag="stair:A")
    mesh.rectangle(6, 0, 10, 2, 0, 2, tag="stair:A").rectangle(10, 0, 14, 2, 2, tag="floor:upper")
    mesh.edge((0, 0, 0), (0, 2, 0), "exit:out")
    building = read_building(mesh.write_gmsh22(tmp_path / "a.msh"))
    assert [(lv.name, lv.kind) for lv in building.levels] == [
        ("ground", "floor"), ("A landing z=0.00", "landing"), ("A flight z=0.00..2.00", "flight"), ("upper", "floor"),
    ]  # fmt: skip
    assert building.stairs == {"A": (2, 1)}


def test_two_portals_where_two_levels_meet_twice(mesh, tmp_path):
    for y, tag in ((0, "area:a"), (2, ""), (4, "area:b")):
        mesh.rectangle(0, y, 4, y + 2, tag="floor:west")
        if tag:
            mesh.rectangle(4, y, 8, y + 2, tag="floor:east")
    mesh.rectangle(8, 0, 10, 2, tag="floor:east").rectangle(8, 2, 10, 4, tag="floor:east")
    mesh.rectangle(8, 4, 10, 6, tag="floor:east").edge((0, 0, 0), (0, 2, 0), "exit:out")
    building = read_building(mesh.write_vtu(tmp_path / "a.vtu"))
    assert [portal.segments.tolist() for portal in building.portals] == [[[4, 0, 4, 2]], [[4, 4, 4, 6]]]
    assert [portal.name for portal in building.portals] == ["west - east", "west - east (2)"]


def winding_ramp(mesh, steps):
    """A ramp about (4, 4) that turns by 15 degrees and rises by 0.25 m in each step, from a floor to another one."""
    mesh.rectangle(0, 0, 4, 2)
    for step in range(steps):
        angle = np.deg2rad(np.array([15 * step, 15 * step + 15]) - 90)
        inner, outer = (np.column_stack([4 + r * np.cos(angle), 4 + r * np.sin(angle)]) for r in (2, 4))
        z = np.array([step, step + 1]) * 0.25
        corners = [(*inner[0], z[0]), (*outer[0], z[0]), (*outer[1], z[1]), (*inner[1], z[1])]
        mesh.face(*[tuple(np.round(corner, 9).tolist()) for corner in corners])
    return mesh


def test_a_flight_that_winds_is_told(mesh, read):
    winding_ramp(mesh, 6).rectangle(6, 4, 8, 8, 1.5)
    building = read(mesh, exits=[EXIT])
    assert [level.kind for level in building.levels] == ["floor", "flight", "floor"]
    (finding,) = (one for one in building.findings if "winds" in one.text)
    assert (finding.kind, finding.level) == ("assumed", "stair 1")
    # its cells rise 0.25 m over 15 degrees of a circle; at 3 m from its centre that is 0.25 / 0.785
    assert np.tan(building.levels[1].slope) == pytest.approx(0.25 / np.deg2rad(15) / 3, rel=0.05)


@pytest.mark.parametrize(("steps", "end", "parts"), [(12, (2, 6, 4, 8), 2), (18, (0, 2, 2, 4), 3)])
def test_a_flight_that_turns_back_is_divided(mesh, read, steps, end, parts):
    winding_ramp(mesh, steps).rectangle(*end, steps * 0.25)
    building = read(mesh, exits=[EXIT])
    flights = [level.index for level in building.levels if level.kind == "flight"]
    assert len(flights) == parts
    assert sorted(building.stairs["stair 1"]) == flights


def test_one_tag_through_storeys_is_a_stair_from_each_to_the_next(mesh, tmp_path):
    """Three stairs of one tag: between floors, from a floor to a landing beside a floor, and on from this landing."""
    for below in range(3):
        x, z = 10.0 * below, 3.0 * below
        for y, depth in ((0, 2), (2, 8)):
            mesh.rectangle(x, y, x + 4, y + depth, z, tag=f"floor:storey {below}")
        mesh.rectangle(x + 4, 0, x + 10, 2, z, z + 3, tag="stair:west")
    mesh.rectangle(30, 0, 32, 2, 9, tag="stair:west").rectangle(30, 2, 32, 6, 9, tag="floor:top")
    mesh.rectangle(32, 0, 36, 2, 9, 11, tag="stair:west").rectangle(36, 0, 40, 2, 11, tag="floor:roof")
    mesh.edge((0, 0, 0), (0, 2, 0), "exit:out")
    building = read_building(mesh.write_vtu(tmp_path / "a.vtu"))
    pieces = {name: [building.levels[k].name for k in own] for name, own in building.stairs.items()}
    assert list(pieces) == ["west 0", "west 1", "west 2", "west 3"]
    assert pieces["west 2"] == ["west 2 landing z=9.00", "west 2 flight z=6.00..9.00"]
    names = [portal.name for portal in building.portals]
    assert names[:3] == ["storey 0 - west 0", "west 0 - storey 1", "storey 1 - west 1"]
    assert "west 2 flight z=6.00..9.00 - west 2 landing z=9.00" in names
    assert "west 2 - top" in names
