"""Stairs, floors and openings of the bodies of a building model: flights, landings, spirals, roofs, recesses."""

import math

import numpy as np
import pytest

import evac
from tests.ifcfiles import (
    STAIR_TAIL,
    STRAIGHT,
    U_HOLE,
    IfcFile,
    all_out,
    building_of,
    here,
    house,
    plan_of,
    slabs,
    steps,
    told_by,
    u_shaped,
)

__all__ = ["here"]

pytestmark = pytest.mark.usefixtures("unpictured", "here")

pytest.importorskip("ifclite_geom", reason="the extra evac[ifc] is not installed")


def test_an_opening_that_ends_above_the_foot_of_its_wall_is_no_door(tmp_path):
    ground = []
    for sill in (0.0, 0.2):
        ifc = house(IfcFile(), spaces=False)
        wall = ifc.box("IFCWALL", "W", (2, 0.2, 0), (2.2, 6.2, 3.2))
        ifc.opening((2, 4, sill), (2.2, 5, sill + 2.1), wall=wall)
        ground.append(sum(level.polygon.area for level in building_of(ifc.write(tmp_path / "a.ifc")).levels))
    assert ground[0] - ground[1] == pytest.approx(0.2 * 1.0, rel=1e-2)


@pytest.mark.parametrize("kind", ["IFCSTAIRFLIGHT", "IFCSTAIR"])
def test_a_straight_stair(tmp_path, kind):
    ifc = house(IfcFile(), storeys=2, hole=(6.3, 0.8, 7.7, 5.38))
    ifc.body(kind, "up", *steps(ifc, (7.0, 0.9), (0, 1), 0.0, **STRAIGHT), tail=STAIR_TAIL[kind])
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    assert list(building.stairs) == ["stair 1"]
    flight = next(level for level in building.levels if level.kind == "flight")
    assert (flight.z_min, flight.z_max) == (0.0, 3.0)
    assert flight.polygon.area == pytest.approx(1.2 * 16 * 0.28, rel=1e-3)
    assert len(building.portals) == 2


@pytest.mark.parametrize(("depth", "pieces"), [(0.9, 1), (1.2, 3)])
def test_a_landing_on_the_way_is_level_unless_it_is_short(tmp_path, depth, pieces):
    options = {"width": 1.2, "going": 0.25, "riser": 3.0 / 17}
    x = 2 + 7 * 0.25
    ifc = slabs(IfcFile(), (3, 0.5, x + depth + 8 * 0.25, 1.9))
    solids = steps(ifc, (2, 1.2), (1, 0), 0.0, count=7, **options)
    outline = [(x, 0.6), (x + depth, 0.6), (x + depth, 1.8), (x, 1.8)]
    solids.append(ifc.extruded(outline, 7 * 3.0 / 17, 3.0 / 17))
    solids += steps(ifc, (x + depth, 1.2), (1, 0), 8 * 3.0 / 17, count=8, **options)
    ifc.body("IFCSTAIR", "S", *solids, tail=STAIR_TAIL["IFCSTAIR"])
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    assert sum(level.stair == "stair 1" for level in building.levels) == pieces


@pytest.mark.parametrize("change", [{"riser": 2.94 / 17}, {"count": 17}])
def test_a_flight_that_ends_a_little_below_or_level_with_the_floor(tmp_path, change):
    ifc = house(IfcFile(), storeys=2, hole=(6.3, 0.8, 7.7, 5.38))
    solids = steps(ifc, (7.0, 0.9), (0, 1), 0.0, **(STRAIGHT | change))
    ifc.body("IFCSTAIRFLIGHT", "up", *solids, tail=STAIR_TAIL["IFCSTAIRFLIGHT"])
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    (flight,) = (level for level in building.levels if level.kind == "flight")
    assert (flight.z_min, flight.z_max) == (0.0, 3.0)
    assert flight.polygon.area == pytest.approx(1.2 * 16 * 0.28, rel=1e-3)


def test_treads_that_lie_on_the_steps_of_stringers_are_one_flight(tmp_path):
    ifc = house(IfcFile(), storeys=2, hole=(6.3, 0.8, 7.7, 5.38))
    solids = steps(ifc, (7.0, 0.9), (0, 1), 0.0, **STRAIGHT)
    for k in range(16):
        y, z = 0.9 + 0.28 * k, 3 / 17 * (k + 1)
        solids.append(ifc.extruded([(6.4, y - 0.05), (7.6, y - 0.05), (7.6, y + 0.28), (6.4, y + 0.28)], z, 0.01))
        solids.append(
            ifc.extruded([(6.4, y + 0.05), (7.6, y + 0.05), (7.6, y + 0.28), (6.4, y + 0.28)], z - 0.06, 0.02)
        )
    ifc.body("IFCSTAIR", "up", *solids, tail=STAIR_TAIL["IFCSTAIR"])
    path = ifc.write(tmp_path / "a.ifc")
    (flight,) = (level for level in building_of(path).levels if level.kind == "flight")
    assert (flight.z_min, flight.z_max) == (0.0, 3.0)
    assert not told_by(path, "missing", "warning")


def test_steps_between_half_levels_that_are_shorter_than_a_level(tmp_path):
    ifc = IfcFile()
    storey = ifc.storey("L0", 0)
    ifc.box("IFCSLAB", "high", (0, 0, -0.3), (6, 4, 0), predefined="FLOOR")
    ifc.box("IFCSLAB", "low", (6, 0, -0.9), (12, 4, -0.6), predefined="FLOOR")
    high = ifc.space("high", [(0, 0), (6, 0), (6, 4), (0, 4)], 0.0)
    low = ifc.space("low", [(6, 0), (12, 0), (12, 4), (6, 4)], -0.6)
    ifc.add(f"IFCRELAGGREGATES({ifc.guid()},$,$,$,{storey},({high},{low}))")
    treads = [ifc.extruded([(x, 1), (x + 0.25, 1), (x + 0.25, 3), (x, 3)], -0.6, z) for x, z in ((6, 0.4), (6.25, 0.2))]
    ifc.body("IFCSTAIRFLIGHT", "step", *treads, tail=STAIR_TAIL["IFCSTAIRFLIGHT"])
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    (flight,) = (level for level in building.levels if level.kind == "flight")
    assert (flight.z_min, flight.z_max, flight.polygon.bounds[0]) == (-0.6, 0.0, 6.0)
    assert sorted(level.name for level in building.levels if level.kind == "floor") == ["L0", "L0 z=-0.60"]


def test_the_recess_of_a_slab_in_a_space_is_ground_of_the_floor_below(tmp_path):
    ifc = IfcFile()
    ifc.storey("L0", 0)
    ifc.box("IFCSLAB", "high", (0, 0, -0.3), (6, 4, 0), predefined="FLOOR")
    ifc.box("IFCSLAB", "recess", (6, 0, -0.7), (8, 4, -0.6), predefined="FLOOR")
    ifc.box("IFCSLAB", "low", (8, 0, -0.7), (12, 4, -0.6), predefined="FLOOR")
    ifc.space("high", [(0, 0), (8, 0), (8, 4), (0, 4)], 0.0)
    ifc.space("low", [(8, 0), (12, 0), (12, 4), (8, 4)], -0.6)
    area = {level.z_min: level.polygon.area for level in building_of(ifc.write(tmp_path / "a.ifc")).levels}
    assert area == {0.0: pytest.approx(24.0), -0.6: pytest.approx(24.0)}


def test_a_low_attic_and_a_space_above_the_roof_are_no_storeys(tmp_path):
    ifc = house(IfcFile())
    ifc.storey("attic", 3.0)
    ifc.box("IFCSLAB", "S", (0, 0, 2.8), (10.4, 6.4, 3.0), predefined="FLOOR")
    ifc.space("attic", [(0.2, 0.2), (10.2, 0.2), (10.2, 6.2), (0.2, 6.2)], 3.0, height=1.0)
    ifc.storey("roof", 4.2)
    ifc.box("IFCSLAB", "R", (0, 0, 4.0), (10.4, 6.4, 4.2), predefined="ROOF")
    ifc.space("sky", [(0.2, 0.2), (10.2, 0.2), (10.2, 6.2), (0.2, 6.2)], 4.2)
    path = ifc.write(tmp_path / "a.ifc")
    assert [level.name for level in building_of(path).levels] == ["L0"]
    left_out = told_by(path, "left out")
    assert len(left_out) == 2
    (place,) = (place for _, place, text in left_out if "'attic'" in text)
    assert place == pytest.approx((5.2, 3.2, 3.0))  # with its height, unlike a place in the cellar


def test_a_flat_roof_of_slabs_is_no_storey(tmp_path):
    ifc = house(IfcFile(), spaces=False)
    ifc.storey("Roof", 3.0)
    ifc.box("IFCSLAB", "R", (0, 0, 3.0), (10.4, 6.4, 3.2), predefined="FLOOR")
    ifc.box("IFCWALL", "parapet", (0, 0, 3.2), (10.4, 0.2, 4.0))
    path = ifc.write(tmp_path / "a.ifc")
    assert [level.name for level in building_of(path).levels] == ["L0"]
    assert [(level, "roof" in text) for level, _, text in told_by(path, "left out")] == [("Roof", True)]


def test_openings_and_shafts_are_no_exits(tmp_path):
    ifc = IfcFile()
    ifc.storey("L0", 0)
    ifc.box("IFCSLAB", "S", (0, 0, -0.2), (10.4, 6.4, 0), predefined="FLOOR")
    wall = ifc.box("IFCWALL", "W", (0, 0.2, 0), (0.2, 6.2, 3))
    ifc.opening((0, 3, 0), (0.2, 4.2, 2.1), wall=wall)
    shaft = [((4, 2), (6, 2.2)), ((4, 3.8), (6, 4)), ((4, 2.2), (4.2, 3.8)), ((5.8, 2.2), (6, 3.8))]
    walls = [ifc.box("IFCWALL", f"L{k}", (*low, 0), (*high, 3)) for k, (low, high) in enumerate(shaft)]
    ifc.opening((4, 2.5, 0), (4.2, 3.5, 2.1), wall=walls[2], door="lift")
    outline = [
        (0.2, 0.2),
        (10.2, 0.2),
        (10.2, 6.2),
        (0.2, 6.2),
        (0.2, 3),
        (4, 3),
        (4, 4),
        (6, 4),
        (6, 2),
        (4, 2),
        (4, 3),
    ]
    ifc.space("room", [*outline, (0.2, 3)], 0)
    building = building_of(ifc.write(tmp_path / "a.ifc"), exits="all")
    assert building.exits == ()
    # Without spaces, the ground of the shaft has a door, which is named as that of a lift.
    ifc.lines = [line for line in ifc.lines if "IFCSPACE" not in line]
    assert not [one for one in building_of(ifc.write(tmp_path / "a.ifc")).levels if one.polygon.area < 5.0]


@pytest.mark.parametrize("name", ["Lift 2", "E01"])
def test_a_pit_a_handrail_and_steps_before_the_door_are_left_out_and_the_building_is_whole(tmp_path, name):
    ifc = house(IfcFile(), spaces=False, hole=(8.1, 2, 10.1, 4))
    ifc.space("001", [(0.2, 0.2), (5.1, 0.2), (5.1, 6.2), (0.2, 6.2)], 0)
    ifc.space("002", [(5.3, 0.2), (7.9, 0.2), (7.9, 6.2), (5.3, 6.2)], 0)
    ifc.space(name, [(8.1, 2), (10.1, 2), (10.1, 4), (8.1, 4)], -1.3, 3.9)
    ifc.box("IFCSLAB", "pit", (8.1, 2, -1.5), (10.1, 4, -1.3), predefined="BASESLAB")
    ifc.box("IFCSTAIR", "rail", (-1, 2.9, -0.4), (0, 2.95, 1.0), tail=",.NOTDEFINED.")
    stair = {"width": 1.2, "going": 0.3, "riser": 0.15, "count": 3}
    solids = steps(ifc, (-0.9, 3.6), (1, 0), -0.45, **stair)
    ifc.body("IFCSTAIRFLIGHT", "outside", *solids, tail=STAIR_TAIL["IFCSTAIRFLIGHT"])
    made = evac.import_building([ifc.write(tmp_path / "a.ifc")], tmp_path / "case", people=3)
    assert (made.missing, made.fault, [way.name for way in made.building.exits]) == ((), "", ["front"])
    assert sum(level.polygon.area for level in made.building.levels) == pytest.approx(
        4.9 * 6 + 2.6 * 6 + 0.2 + 0.12, 0.01
    )
    told = [one.text for one in made.findings if one.kind == "left out"]
    assert all(any(repr(word) in text for text in told) for word in ("rail", "outside"))
    assert [text for text in told if "shaft" in text or "pit" in text]


@pytest.mark.parametrize("has_stair", [False, True])
def test_a_door_to_a_terrace_is_an_exit_and_a_gallery_to_a_stair_stays(tmp_path, has_stair):
    ifc = house(IfcFile(), spaces=False)
    ifc.box("IFCSLAB", "terrace", (-3, 0, -0.2), (0, 6.4, 0), predefined="FLOOR")
    if has_stair:
        ifc.body("IFCSTAIR", "S", *steps(ifc, (-3, 3), (-1, 0), -3.0, **STRAIGHT), tail=",.NOTDEFINED.")
    plan = plan_of(ifc.write(tmp_path / "a.ifc"))
    assert ([way.name for way in plan.exits], len(plan.doors)) == (([], 2) if has_stair else (["front"], 1))


@pytest.mark.parametrize(("width", "is_outside"), [(0.58, False), (0.62, True)])
def test_a_door_into_a_recess_is_an_exit_unless_the_recess_is_narrower_than_60_cm(tmp_path, width, is_outside):
    """Ground within 0.3 m of the walls on both sides belongs to the building."""
    ifc, left, right = IfcFile(), 5.0, 5.0 + width
    ifc.storey("L0", 0)
    boxes = [((0, 6.2), (10.4, 6.4)), ((0, 0.2), (0.2, 6.2)), ((10.2, 0.2), (10.4, 6.2)), ((0, 0), (left, 0.2))]
    boxes += [((right, 0), (10.4, 0.2)), ((left - 0.2, 0.2), (left, 3)), ((right, 0.2), (right + 0.2, 3))]
    boxes.append(((left - 0.2, 3), (right + 0.2, 3.2)))
    made = [ifc.box("IFCWALL", f"W{k}", (*low, 0), (*high, 3)) for k, (low, high) in enumerate(boxes)]
    ifc.opening((left - 0.2, 1.2, 0), (left, 2.2, 2.1), wall=made[5], door="side")
    recess = [(right + 0.2, 0.2), (right + 0.2, 3.2), (left - 0.2, 3.2), (left - 0.2, 0.2)]
    ifc.space("hall", [(0.2, 0.2), (0.2, 6.2), (10.2, 6.2), (10.2, 0.2), *recess], 0)
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    assert [way.name for way in building.exits] == ["side"] * is_outside


def test_a_curtain_wall_does_not_close_its_doors(tmp_path):
    ifc = IfcFile()
    ifc.storey("L0", 0.0)
    ifc.box("IFCSLAB", "S", (0, 0, -0.2), (10, 6, 0), predefined="FLOOR")
    for number, (low, high) in enumerate([((0, 0), (10, 0.1)), ((0, 5.9), (10, 6)), ((9.9, 0.1), (10, 5.9))]):
        ifc.box("IFCWALL", f"W{number}", (*low, 0), (*high, 3))
    ifc.box("IFCCURTAINWALL", "outer", (0, 0.1, 0), (0.1, 5.9, 3), tail="")
    ifc.box("IFCPLATE", "inner", (5, 0.1, 0), (5.05, 5.9, 3))
    for name, x in (("front", 0.0), ("between", 5.0)):
        ifc.box("IFCDOOR", name, (x, 2, 0), (x + 0.06, 3, 2.1), tail=",$,$,.DOOR.,.NOTDEFINED.,$")
    ifc.space("hall", [(0.1, 0.1), (5, 0.1), (5, 5.9), (0.1, 5.9)], 0)
    ifc.space("room", [(5.05, 0.1), (9.9, 0.1), (9.9, 5.9), (5.05, 5.9)], 0)
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    assert len(building.levels) == 1
    assert [(way.name, round(way.width, 2)) for way in building.exits] == [("front", 1.0)]
    assert [(door.name, round(door.width, 2)) for door in building.doors] == [("between", 1.0)]


def test_a_stair_that_is_there_twice_is_left_out_once(tmp_path):
    ifc = house(IfcFile(), storeys=2, hole=(6.3, 0.8, 7.7, 5.38))
    solids = steps(ifc, (7.0, 0.9), (0, 1), 0.0, **STRAIGHT)
    for kind, name in (("IFCSTAIRFLIGHT", "up"), ("IFCSTAIR", "again")):
        ifc.body(kind, name, *solids, tail=STAIR_TAIL[kind])
    path = ifc.write(tmp_path / "a.ifc")
    assert not told_by(path, "missing", "warning")
    assert [level for level, _, text in told_by(path, "left out") if "'again'" in text] == ["L0"]
    assert list(building_of(path).stairs) == ["stair 1"]


@pytest.mark.parametrize("landing", ["own", "LANDING", "FLOOR"])
def test_a_stair_that_turns_back(tmp_path, landing):
    ifc = u_shaped(house(IfcFile(), storeys=2, hole=U_HOLE), landing=landing)
    building = building_of(ifc.write(tmp_path / "a.ifc"))
    heights = sorted((level.z_min, level.z_max) for level in building.levels if level.kind == "flight")
    assert np.allclose(heights, [(0.0, 1.5), (1.5, 3.0)])


def test_a_closed_slab_leaves_the_stair_out_unless_it_is_cut(tmp_path):
    ifc = house(IfcFile(), storeys=2)
    ifc.body(
        "IFCSTAIRFLIGHT", "up", *steps(ifc, (7.0, 0.9), (0, 1), 0.0, **STRAIGHT), tail=STAIR_TAIL["IFCSTAIRFLIGHT"]
    )
    path = ifc.write(tmp_path / "a.ifc")
    ((level, place, text),) = told_by(path, "missing", "warning")
    assert (level, "cut_slabs" in text) == ("L1", True)
    assert 6.4 < place[0] < 7.6
    assert list(building_of(path, cut_slabs=True).stairs) == ["stair 1"]


def spiral(ifc, inner, outer, count, degrees):
    """Add a spiral stair about (8, 3) from angle 0, whose last tread ends at a platform of the upper storey."""
    solids = []
    for k in range(count):
        a, b = (math.radians(degrees * s) for s in (k, k + 1))
        corners = ((inner, a), (outer, a), (outer, b), (inner, b))
        ring = [(8 + r * math.cos(t), 3 + r * math.sin(t)) for r, t in corners]
        solids.append(ifc.extruded(ring, 3.0 / (count + 1) * k, 3.0 / (count + 1)))
    ifc.body("IFCSTAIR", "round", *solids, tail=",$,.SPIRAL_STAIR.")
    ifc.box("IFCSLAB", "P", (8.1, 3, 2.8), (9.5, 4.5, 3.0), predefined="FLOOR")
    return ifc


def test_a_spiral_stair_is_walked_where_its_treads_are_deep_enough(tmp_path):
    ifc = spiral(house(IfcFile(), storeys=2, hole=(6.5, 1.5, 9.5, 4.5)), 0.3, 1.4, 16, 22.5)
    path = ifc.write(tmp_path / "a.ifc")
    building = building_of(path)
    flights = [level for level in building.levels if level.kind == "flight"]
    assert list(building.stairs) == ["stair 1"]
    assert (min(level.z_min for level in flights), max(level.z_max for level in flights)) == (0.0, 3.0)
    # From the radius at which a tread is as deep as its riser to the outer one, around the whole circle.
    inner = 3.0 / 17 / (2 * math.sin(math.radians(11.25)))
    assert sum(level.polygon.area for level in flights) == pytest.approx(
        16 * 0.5 * math.sin(math.radians(22.5)) * (1.4**2 - inner**2), rel=0.02
    )
    (found,) = [text for _, _, text in told_by(path, "found") if text.startswith("'stair 1'")]
    assert "3.00 m high, 17 risers, going 0.3" in found
    assert all_out(path, tmp_path)


def test_a_spiral_over_several_storeys_in_one_body_joins_each_of_them(tmp_path):
    """Treads whose outer side is an arc of two chords, and platforms 4 cm beside the floors."""
    ifc = house(IfcFile(), storeys=4, hole=(6.5, 1.5, 9.5, 4.5))
    solids = []
    for turn in range(3):
        for k in range(12):
            a, b, c = (math.radians(180.0 + 22.5 * s) for s in (k, k + 0.5, k + 1))
            ring = [
                (8 + r * math.cos(t), 3 + r * math.sin(t))
                for r, t in ((0.15, a), (1.5, a), (1.5, b), (1.5, c), (0.15, c))
            ]
            solids.append(ifc.extruded(ring, 3.0 * turn + 3.0 / 13 * (k + 1) - 0.06, 0.06))
        solids.append(ifc.extruded([(6.54, 3), (8, 3), (8, 4.46), (6.54, 4.46)], 3.0 * turn + 2.94, 0.06))
    ifc.body("IFCSTAIR", "round", *solids, tail=",$,.SPIRAL_STAIR.")
    path = ifc.write(tmp_path / "a.ifc")
    building = building_of(path)
    assert not told_by(path, "missing", "warning")
    assert [sorted({building.levels[k].z_min for k in own})[0] for own in building.stairs.values()] == [0.0, 3.0, 6.0]


@pytest.mark.parametrize("length", [0.4, 0.6])
def test_a_narrow_spiral_is_walked_in_single_file_unless_its_treads_are_too_short(tmp_path, length):
    ifc = spiral(house(IfcFile(), storeys=2, hole=(6.5, 1.5, 9.5, 4.5)), 0.1, 0.1 + length, 16, 22.5)
    path = ifc.write(tmp_path / "a.ifc")
    told = told_by(path, *(("missing",) if length < 0.5 else ("assumed",)))
    (place,) = [place for _, place, text in told if "'round'" in text]
    assert math.dist(place, (8, 3)) < 0.8
    assert length < 0.5 or all_out(path, tmp_path, people=5, spacing=0.1)


def test_winders_between_straight_flights(tmp_path):
    ifc = house(IfcFile(), storeys=2, hole=(6.3, 0.6, 9.9, 4.3))
    rise = 3.0 / 17
    solids = steps(ifc, (7.0, 0.9), (0, 1), 0.0, width=1.2, going=0.28, riser=rise, count=8)
    for k in range(3):  # a quarter turn to the right about (7.6, 3.14)
        angles = [math.radians(180 - 30 * s) for s in (k, k + 1)]
        outer = [(7.6 + 1.2 * math.cos(t), 3.14 + 1.2 * math.sin(t)) for t in angles]
        solids.append(ifc.extruded([(7.6, 3.14), *outer], rise * (8 + k), rise))
    solids += steps(ifc, (7.6, 3.74), (1, 0), rise * 11, width=1.2, going=0.28, riser=rise, count=5)
    ifc.body("IFCSTAIR", "up", *solids, tail=",$,.QUARTER_WINDING_STAIR.")
    ifc.box("IFCSLAB", "P", (9.0, 3.14, 2.8), (9.9, 4.3, 3.0), predefined="FLOOR")
    path = ifc.write(tmp_path / "a.ifc")
    assert not told_by(path, "missing")
    assert all_out(path, tmp_path)


@pytest.mark.parametrize("kind", ["IFCRAMP", "IFCRAMPFLIGHT", "IFCSTAIRFLIGHT"])
def test_a_flight_without_treads_and_a_ramp(tmp_path, kind):
    ifc = IfcFile()
    for k, x in enumerate((0.0, 10.0)):
        z = 0.6 * k
        ifc.storey(f"L{k}", z)
        ifc.box("IFCSLAB", "S", (x, 0, z - 0.2), (x + 4, 4, z), predefined="FLOOR")
    ramp = ifc.lying([(4, -0.2), (10, 0.4), (10, 0.6), (4, 0.0)], 3.0, 1.5)
    tail = {"IFCRAMP": ",$,.STRAIGHT_RUN_RAMP.", "IFCRAMPFLIGHT": ",$,.STRAIGHT."}.get(
        kind, STAIR_TAIL["IFCSTAIRFLIGHT"]
    )
    ifc.body(kind, "up", ramp, tail=tail)
    path = ifc.write(tmp_path / "a.ifc")
    building = building_of(path)
    (flight,) = [level for level in building.levels if level.kind == "flight"]
    assert (flight.z_min, flight.z_max) == (0.0, 0.6)
    assert flight.polygon.area == pytest.approx(6.0 * 1.5, rel=1e-3)
    assert len(building.portals) == 2
    assert [text for _, _, text in told_by(path, "found") if "without steps, 1.50 m wide" in text]


def test_a_stair_that_leads_nowhere_is_named_with_its_place(tmp_path):
    ifc = house(IfcFile(), storeys=1)
    ifc.body(
        "IFCSTAIRFLIGHT", "up", *steps(ifc, (7.0, 0.9), (0, 1), 0.0, **STRAIGHT), tail=STAIR_TAIL["IFCSTAIRFLIGHT"]
    )
    ((level, place, text),) = told_by(ifc.write(tmp_path / "a.ifc"), "missing")
    assert (level, "'up'" in text) == ("L0", True)
    assert place == pytest.approx((7.0, 0.9 + 16 * 0.28), abs=0.01)


def test_storeys_without_a_stair_are_told_and_the_ground_floor_runs_if_that_is_wanted(tmp_path):
    path = house(IfcFile(), storeys=4).write(tmp_path / "a.ifc")
    made = evac.import_building([path], tmp_path / "case", people=5, partial=True)
    assert made.fault == ""
    assert made.missing[0].startswith("3 of 4 storeys have no way out")
    assert {made.building.levels[room.level].name for room in made.rooms if room.number} == {"L0"}
