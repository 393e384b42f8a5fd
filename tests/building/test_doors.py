"""Doors of plans: along the wall between two rooms, kept with level and width, or refused with the place."""

import pytest
from shapely import box

from evac import BuildingError, Plan
from evac.building.geometry import united
from evac.building.plan.outlines import doorway


def two_rooms(segment, **options):
    plan = Plan()
    plan.storey("ground", [box(0, 0, 10, 10), box(10, 0, 18, 10)], wall=0.1)
    plan.door("inner", "ground", segment, **options)
    return plan


@pytest.mark.parametrize("segment", [[(9.5, 7), (10.5, 7)], [(9.7, 7), (10.3, 7)], [(9.97, 7), (10.03, 7)]])
def test_a_door_across_its_wall_is_refused(segment):
    with pytest.raises(BuildingError, match=r"door 'inner'.*\(10\.00, 7\.00\)"):
        two_rooms(segment).surface()


def test_a_door_oblique_to_its_wall_is_refused_with_the_angle():
    with pytest.raises(BuildingError, match=r"door 'inner'.*45 degrees"):
        two_rooms([(9.6, 6.6), (10.4, 7.4)]).surface()


@pytest.mark.parametrize("x", [9.0, 9.7, 5.0])
def test_a_door_inside_a_room_is_refused_with_the_nearest_wall(x):
    with pytest.raises(BuildingError, match=r"door 'inner'.*remedy: segment = \[\[9\.95, 7\.0\]"):
        two_rooms([(x, 7), (x, 7.9)]).surface()


@pytest.mark.parametrize("x", [9.85, 9.93, 9.95, 10.0, 10.07])
def test_a_door_on_or_slightly_beside_its_wall_joins_the_rooms(x):
    building = two_rooms([(x, 7), (x, 7.9)]).building(need_exit=False)
    (level,) = building.levels
    assert level.polygon.area == pytest.approx(179.0 + 0.09)
    (door,) = building.doors
    assert (door.name, door.level, round(door.width, 6)) == ("inner", 0, 0.9)


def test_a_door_at_a_small_angle_is_turned_along_its_wall_with_a_finding():
    building = two_rooms([(9.9, 7), (10.3, 7.9)]).building(need_exit=False)
    assert len(building.levels) == 1
    (door,) = building.doors
    assert door.width == pytest.approx(0.9)
    assert door.segment[0] == door.segment[2]
    assert [(one.kind, one.level) for one in building.findings] == [("assumed", "ground")]


def test_a_door_across_an_opening_that_the_floor_already_has_is_kept():
    plan = Plan()
    plan.storey("ground", [box(0, 0, 5, 4), box(5, 1, 5.2, 2), box(5.2, 0, 9, 4)])
    plan.door("inner", "ground", [(5.1, 1), (5.1, 2)])
    building = plan.building(need_exit=False)
    assert [(door.name, door.width) for door in building.doors] == [("inner", 1.0)]
    assert building.levels[0].polygon.area == pytest.approx(20.0 + 0.2 + 15.2)


def test_doors_belong_to_the_level_of_their_storey_in_metres():
    plan = Plan()
    for name, z in (("ground", 0.0), ("first", 3000.0)):
        plan.storey(name, [box(0, 0, 5000, 4000), box(5200, 0, 9000, 4000)], z=z)
        # Lengths are not metres before building.scale, so the reach is not either.
        plan.door(f"door of {name}", name, [(5100, 1000), (5100, 2000)], reach=600.0)
    building = plan.building(scale=0.001, need_exit=False)
    assert [(door.name, building.levels[door.level].name, door.width) for door in building.doors] == [
        ("door of ground", "ground", 1.0),
        ("door of first", "first", 1.0),
    ]


@pytest.mark.parametrize("x", [9.95, 10.0, 10.05])
def test_an_exit_at_a_wall_between_two_rooms_is_refused(x):
    plan = two_rooms([(10, 7), (10, 7.9)])
    plan.exit("out", "ground", [(x, 4), (x, 5.2)])
    with pytest.raises(BuildingError, match=rf"exit 'out'.*\({x:.2f}, 4\.00\).*'ground'.*both sides.*door"):
        plan.surface()


def test_an_exit_past_a_corner_is_refused_with_the_part_beside_the_floor():
    plan = two_rooms([(10, 7), (10, 7.9)])
    plan.exit("out", "ground", [(0, 9.5), (0, 10.5)])
    with pytest.raises(BuildingError, match=r"exit 'out'.*0\.50 of 1\.00 m.*\(0\.00, 10\.00\) - \(0\.00, 9\.50\)"):
        plan.surface()


def rooms_in_a_square(number, plan):
    """Rooms of 4 x 3 m, 0.2 m apart, with doors along the rows and along the first column; return the added area."""
    for column in range(number):
        for row in range(number):
            x, y = 4.2 * column, 3.2 * row
            if column:
                plan.door(f"row {column} {row}", "a", [(x - 0.1, y + 1.0), (x - 0.1, y + 2.0)])
            elif row:
                plan.door(f"column {row}", "a", [(x + 1.0, y - 0.1), (x + 2.0, y - 0.1)])
    return 0.2 * (number * number - 1)


def test_a_door_meets_only_the_rooms_near_it(monkeypatch):
    """Of 64 rooms; each door joins its two, as do all of them together."""
    met = []

    def unite(parts):
        met.append(len(parts))
        return united(parts)

    monkeypatch.setattr("evac.building.plan.drawing.united", unite)
    plan = Plan()
    plan.storey("a", [box(4.2 * i, 3.2 * j, 4.2 * i + 4.0, 3.2 * j + 3.0) for i in range(8) for j in range(8)])
    added = rooms_in_a_square(8, plan)
    building = plan.building(need_exit=False)
    assert len(building.levels) == 1
    assert building.levels[0].polygon.area == pytest.approx(64 * 12.0 + added, abs=1e-6)
    assert len(building.doors) == 63
    assert sum(number > 20 for number in met) == 2  # all rooms, and all rooms with all doors


def test_only_doors_whose_ground_meets_are_opened_one_after_the_other(monkeypatch):
    """Of four rooms around a corner, each has a door to the next one; a fifth door overlaps the first."""
    met = []

    def found(floor, ends, reach):
        met.append(ends.tolist())
        return doorway(floor, ends, reach)

    monkeypatch.setattr("evac.building.plan.drawing.doorway", found)
    plan = Plan()
    plan.storey("a", [box(x, y, x + 3.9, y + 3.9) for x in (0, 4) for y in (0, 4)])
    for name, (x, y) in {"south": (3.95, 2), "north": (3.95, 6), "again": (3.95, 2.5)}.items():
        plan.door(name, "a", [(x, y - 0.45), (x, y + 0.45)])
    for name, (x, y) in {"west": (2, 3.95), "east": (6, 3.95)}.items():
        plan.door(name, "a", [(x - 0.45, y), (x + 0.45, y)])
    building = plan.building(need_exit=False)
    assert met == [[[3.95, 2.05], [3.95, 2.95]]]
    assert len(building.levels) == 1
    assert building.levels[0].polygon.area == pytest.approx(4 * 3.9**2 + (3 * 0.9 + 1.4) * 0.1)


def test_an_exit_that_a_wall_makes_narrower_is_told():
    plan = two_rooms([(10, 7), (10, 7.9)])
    plan.exit("beside", "ground", [(10, 0), (11, 0)])
    plan.exit("whole", "ground", [(12, 0), (13, 0)])
    building = plan.building()
    assert [way.width for way in building.exits] == pytest.approx([0.95, 1.0])
    (told,) = [finding for finding in building.findings if "exit 'beside'" in finding.text]
    assert (told.kind, told.place) == ("warning", pytest.approx((10.5, 0.0)))
    assert "0.950 m" in told.text
    assert not any("'whole'" in finding.text for finding in building.findings)


def test_doors_in_line_that_look_through_many_rooms_leave_no_ground_out():
    """A triangulation of the floor has cells from jamb to jamb through fourteen rooms, narrower than the weld."""
    plan = Plan()
    plan.storey("a", [box(4 * i + 0.05, 0, 4 * i + 3.95, 3.9) for i in range(100)])
    for column in range(1, 100):
        plan.door(f"door {column}", "a", [(4 * column, 1), (4 * column, 2)])
    building = plan.building(need_exit=False)
    assert sum(level.polygon.area for level in building.levels) == pytest.approx(100 * 3.9 * 3.9 + 99 * 0.1)
    assert building.findings == ()
