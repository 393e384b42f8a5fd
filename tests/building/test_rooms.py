"""Short forms of plans: rooms, shafts, storeys like others and ties to walls, and plan files that keep them."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from shapely import box

from evac import BuildingError, Plan, load, read_building
from evac.base.change import Change
from evac.building.model.links import changed
from evac.building.model.marks import marks_of
from evac.building.plan.plantable import plan_of


def house(width=6.0):
    """An office and a hall on both sides of a wall at x = `width`, on three storeys with a dog-leg stair."""
    plan = Plan()
    plan.storey("ground", wall=0.2)
    plan.storey("first", z=3.2, like="ground")
    plan.storey("second", z=6.4, like="first")
    plan.room("office", "ground", box(0, 0, width, 8), use="office", density=0.1)
    plan.room("hall", "ground", [[width, 0], [18, 0], [18, 8], [width, 8]])
    plan.door("ground door", "ground", {"rooms": ["office", "hall"], "at": 3.0, "width": 1.0})
    plan.obstacle("table", "ground", box(1, 1, 2, 2))
    plan.shaft("stair", "ground", "second", [(13, 6.5), (13, 7.8)], length=2.7, direction=(1, 0), turn="right")
    plan.exit("out", "ground", {"rooms": ["hall"], "side": 0, "width": 2.0})
    return plan


def same(one, other):
    """Return whether two buildings are equal to the bit, with all names."""
    arrays = [
        [building.vertices, building.walls, *(way.segments for way in (*building.portals, *building.exits))]
        for building in (one, other)
    ]
    names = [
        [
            [level.name for level in building.levels],
            [(portal.name, portal.levels) for portal in building.portals],
            [(area.name, area.level, area.polygon.wkt) for area in building.areas],
            [(door.name, door.level, door.segment.tolist()) for door in building.doors],
            building.controls,
            [str(one) for one in building.findings if "on the floor" not in one.text],  # of areas, less walls
        ]
        for building in (one, other)
    ]
    return names[0] == names[1] and all(map(np.array_equal, *arrays))


def test_a_short_plan_is_the_building_of_the_long_one():
    plan, names = Plan(), ("ground", "first", "second")
    for k, name in enumerate(names):
        plan.storey(name, [box(0, 0, 6, 8), box(6, 0, 18, 8)], 3.2 * k, wall=0.2)
    for name in names:
        plan.door(f"{name} door".removeprefix("" if name == "ground" else "ground "), name, [(6, 2.5), (6, 3.5)])
        plan.obstacle("table", name, box(1, 1, 2, 2))
        plan.area("office" if name == "ground" else f"{name} office", name, box(0, 0, 6, 8))
    for k, (lower, upper) in enumerate((names[:2], names[1:])):
        edge = [(13, 6.5), (13, 7.8)]
        plan.stair(f"stair {k}", lower, edge, upper, length=2.7, direction=(1, 0), turn="right")
    plan.exit("out", "ground", [(11, 0), (13, 0)])
    assert same(house().building(), plan.building())


def test_doors_exits_and_areas_follow_the_walls_that_they_are_tied_to():
    plan = house(width=7.5)
    plan.area("desk", "ground", {"rooms": ["office"], "inset": 1.0})
    building = plan.building()
    assert [door.segment.tolist() for door in building.doors] == [[7.5, 2.5, 7.5, 3.5]] * 3
    assert sorted(building.exits[0].segments[0][::2]) == [11.75, 13.75]
    sizes = {area.name: area.polygon.area for area in building.areas}
    assert sizes["desk"] == pytest.approx(5.5 * 6.0 - 1.0)
    assert {"office", "first office", "second office", "desk", "first desk", "second desk"} == set(sizes)


def test_a_door_is_in_the_middle_of_a_wall_that_is_drawn_with_both_its_faces():
    plan = Plan()
    plan.storey("ground")
    plan.room("a", "ground", box(0, 0, 4, 3))
    plan.room("b", "ground", box(4.3, 1, 8, 5))
    plan.door("door", "ground", {"rooms": ["b", "a"]})
    (door,) = plan.building(need_exit=False).doors
    assert door.segment.tolist() == [4.15, 1.0, 4.15, 3.0]


@pytest.mark.parametrize(
    ("kind", "given", "length"),
    [("straight", {}, 3.2 * 0.28 / 0.16), ("dog-leg", {"turn": "left", "landing": 1.2}, 1.6 * 0.28 / 0.16)],
)
def test_the_length_of_a_shaft_follows_from_its_steps(kind, given, length):
    plan = Plan()
    plan.storey("ground", box(0, 0, 18, 8))
    plan.storey("first", z=3.2, like="ground")
    steps = {"foot": (4, 3), "width": 1.2, "direction": (1, 0), "rise": 0.16, "going": 0.28}
    plan.shaft("stair", "ground", "first", kind=kind, **steps, **given)
    building = plan.building(need_exit=False)
    flights = [level for level in building.levels if level.kind == "flight"]
    for flight in flights:
        assert np.tan(flight.slope) == pytest.approx(0.16 / 0.28)
        assert np.ptp(np.reshape(flight.polygon.bounds, (2, 2)), axis=0) == pytest.approx([length, 1.2])
    assert len(flights) == (1 if kind == "straight" else 2)


def without(plan, attribute, name):
    setattr(plan, attribute, [one for one in getattr(plan, attribute) if one.name != name])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda plan: without(plan, "rooms", "office"), "door 'ground door'.*'office'"),
        (lambda plan: plan.door("wide", "ground", {"rooms": ["hall"], "side": 1, "width": 9.0}), "'wide'.*8.00 m"),
        (lambda plan: plan.door("side", "ground", {"rooms": ["hall"], "side": 4}), "'side'.*side 4.*0 to 3"),
        (lambda plan: plan.door("one", "ground", {"rooms": ["hall"]}), "'one'.*side"),
        (lambda plan: plan.door("none", "ground", {"rooms": []}), "'none'.*rooms"),
        (lambda plan: plan.door("odd", "ground", {"rooms": ["hall"], "side": "a"}), "'odd'.*side"),
        (lambda plan: plan.room("hall", "ground", box(0, 0, 1, 1)), "'hall'"),
        (lambda plan: plan.room("two", "ground", [box(0, 0, 1, 1), box(2, 0, 3, 1)]), "'two'.*one polygon"),
        (lambda plan: plan.room("full", "ground", box(0, 0, 1, 1), people=1, density=1.0), "'full'.*density"),
        (lambda plan: plan.area("first office", "ground", box(0, 0, 1, 1)), "'first office'"),
        (lambda plan: plan.storey("attic", z=9.0), "'attic'.*polygons.*rooms"),
        (lambda plan: plan.storey("attic", z=9.0, like="frist"), "'attic'.*'frist'.*'first'"),
        (lambda plan: plan.storey("attic", box(0, 0, 1, 1), like="first"), "'attic'.*like"),
        (lambda plan: plan.shaft("s", "ground", "third", [(1, 1), (1, 2)], length=2.0), "'s'.*'third'"),
        (lambda plan: plan.shaft("s", "ground", "first", foot=(1, 1), width=1.0, length=2.0), "'s'.*direction"),
        (lambda plan: plan.shaft("s", "ground", "first", [(1, 1), (1, 2)], rise=0.17), "'s'.*going"),
        (lambda plan: plan.shaft("s", "ground", "first", [(1, 1), (1, 2)], length=2.0, kind="dog-leg"), "'s'.*turn"),
    ],
)
def test_what_does_not_fit_is_named(change, match):
    plan = house()

    def drawn():
        change(plan)
        plan.surface()

    with pytest.raises(BuildingError, match=match):
        drawn()


def test_a_storey_like_itself_is_refused():
    plan = Plan()
    plan.storey("a", like="b")
    plan.storey("b", z=3.0, like="a")
    with pytest.raises(BuildingError, match=r"'a'.*like"):
        plan.surface()


def random_house(rng):
    """Rooms in two rows along a corridor, on storeys alike, with doors, shafts, exits, obstacles and areas."""
    plan, count, wall = Plan("random"), rng.integers(2, 5), round(rng.uniform(0.1, 0.3), 2)
    widths = np.round(np.cumsum([0.0, *rng.uniform(3.0, 7.0, count)]), rng.integers(0, 4)).tolist()
    plan.storey("0", wall=wall)
    storeys = int(rng.integers(1, 4))
    for k in range(1, storeys):
        plan.storey(f"{k}", z=round(3.0 * k + rng.uniform(0.0, 0.2), 2), like=f"{rng.integers(k)}")
    plan.room("corridor", "0", box(-4, 5, widths[-1], 7))
    for k, (left, right) in enumerate(pairwise(widths)):
        for name, low in (("north", 7.0), ("south", 0.0)):
            shape = box(left, low, right, low + 5.0)
            people = [{}, {"people": int(rng.integers(9))}, {"density": 0.1}, {"use": "ward"}][rng.integers(4)]
            plan.room(f"{name} {k}", "0", shape.wkt if rng.random() < 0.5 else shape, **people)
            x, at = round(rng.uniform(left + 1, right - 1), 3), 7.0 if name == "north" else 5.0
            tie = {"rooms": [f"{name} {k}", "corridor"], "width": 0.9}
            control = [None, {"every": 2.0}, {"most": 30, "delay": 1.0}][(k + storeys) % 3]
            line = tie if rng.random() < 0.5 else [(x - 0.45, at), (x + 0.45, at)]
            plan.door(f"{name} {k}", "0", line, control=control)
            plan.obstacle(f"{name} {k}", "0", box(left + 1, low + 2, left + 1.5, low + 3))
    plan.area("rim", "0", {"rooms": ["south 0"], "inset": 0.5})
    if storeys > 1:
        plan.room("stairs", "0", box(-4, 7, 0, 15))
        plan.door("stairs", "0", {"rooms": ["stairs", "corridor"], "width": 1.2})
        way = {"turn": "right", "direction": (0, 1)}
        way |= [{"length": 2.8}, {"rise": 0.175, "going": 0.3}][rng.integers(2)]
        plan.shaft("stairs", "0", f"{storeys - 1}", [(-3.9, 10.0), (-2.6, 10.0)], **way)
    plan.exit("west", "0", {"rooms": ["corridor"], "side": 0, "width": 1.6})
    plan.exit("ends", "0", [[(-4, 6.2), (-4, 6.7)], {"rooms": ["corridor"], "side": 2, "at": 1.5, "width": 0.6}])
    return plan


@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.slow) for first in range(8, 200, 8))])
def test_written_plans_are_read_as_equal_buildings(first, tmp_path):
    for number in range(first, first + 8):
        plan = random_house(np.random.default_rng((20260102, number)))
        plan.write(tmp_path / "random.plan.toml")
        building = read_building(tmp_path / "random.plan.toml")
        assert same(plan.building(), building)
        case = load(
            {"building": plan, "people": [{"name": "one", "area": "rim", "number": 1}], "contact": {"model": "nsm2"}}
        )
        case.write(tmp_path / "case.toml")
        again = load(tmp_path / "case.toml")
        assert again.table == case.table
        assert same(plan_of(again.building.plan, Path("random"), Path()).building(), building)


def test_a_shaft_has_no_name_that_something_else_has():
    plan = house()
    plan.exit("stair", "ground", {"rooms": ["hall"], "side": 2, "width": 1.0})
    building = plan.building()
    assert building.shafts == {"stair 0 - stair 1": ("stair 0", "stair 1")}
    exits = {way.index + len(building.portals) for way in building.exits if way.name == "stair"}
    assert changed(building, Change(1.0, "close", "stair")).closed == exits


def test_a_change_of_a_stair_or_shaft_is_one_of_all_its_pieces():
    building = house().building()
    assert building.shafts == {"stair": ("stair 0", "stair 1")}
    assert house().building().pieces_of("stair") == (*building.stairs["stair 0"], *building.stairs["stair 1"])
    for name, stairs in {"stair 1": ["stair 1"], "stair": ["stair 0", "stair 1"]}.items():
        pieces = {level.index for level in building.levels if level.stair in stairs}
        closed = changed(building, Change(1.0, "close", name)).closed
        assert closed == {portal.index for portal in building.portals if pieces & set(portal.levels)}
        slow = changed(building, Change(1.0, "slow", name, {"value": 0.5}))
        assert {mark.level for mark in marks_of(slow)} == pieces
        up = changed(building, Change(1.0, "one_way", name, {"value": "up"}))
        assert {link for link, _ in up.one_way} == closed


def test_the_walls_of_a_room_are_no_missing_part_of_its_area():
    plan = Plan()
    plan.storey("ground", wall=0.3)
    for k in range(3):
        plan.room(f"{k}", "ground", box(2 * k, 0, 2 * k + 2, 2), use="office")
    plan.exit("out", "ground", [(0, 0.5), (0, 1.5)])
    assert not [one for one in plan.check() if "on the floor" in one.text]
