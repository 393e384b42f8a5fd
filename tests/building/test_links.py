"""Portals, exits and stairs that are closed."""

import networkx
import numpy as np
import pytest
from shapely import box

from evac.base.change import BODIES, LEAVE, Change, Control
from evac.base.errors import BuildingError, ResultError
from evac.building.model.links import (
    building_at,
    changed,
    close_links,
    levels_reaching,
    states_of,
    ways_onto,
    with_controls,
)
from evac.building.plan.plan import Plan
from tests.three_storeys import three_storeys

EXITS = [{"name": name, "segment": [[x, 0], [x, 2]], "z": z} for name, x, z in (("west", 0, 0.0), ("east", 26, 3.0))]


@pytest.fixture
def building(stair_mesh, read):
    """Two floors, a stair between them, an exit on either."""
    return read(stair_mesh, exits=EXITS)


def test_exits_portals_and_stairs_are_closed_by_name(building):
    west, east = building.exits
    assert building.is_open(west)
    closed = close_links(building, ["west", building.portals[1].name])
    assert [closed.is_open(link) for link in (west, east, *building.portals)] == [False, True, True, False]
    closed = close_links(building, ["stair 1"])
    assert [closed.is_open(link) for link in (west, east, *building.portals)] == [True, True, False, False]


@pytest.mark.parametrize(
    ("name", "ends"),
    [
        ("west 0", ["low - west 0", "west 0 - middle"]),
        ("west", ["low - west 0", "middle - west 1", "west 0 - middle", "west 1 - high"]),
    ],
)
def test_a_stair_and_a_shaft_let_people_through_at_their_ends(name, ends):
    plan = Plan()
    for row, storey in enumerate(["low", "middle", "high"]):
        plan.storey(storey, box(0, 0, 10, 10), z=3.0 * row)
    plan.shaft("west", "low", "high", [(2, 2), (3.2, 2)], length=2.4, direction=(0, 1), turn="right")
    building = with_controls(plan.building(need_exit=False), {name: Control(every=1.0)})
    assert sorted(building.links[link].name for link in building.controlled) == ends


def test_what_is_cut_off_is_warned_of(building):
    west = building.exits[0].name
    assert close_links(building, [west]).warnings == building.warnings
    assert close_links(building, ["stair 1"]).warnings == building.warnings
    (note,) = close_links(building, [west, "stair 1"]).findings
    assert note.level == "floor z=0.00"


def test_levels_reach_exits_through_open_portals(building):
    assert levels_reaching(building, building.exits[1:]) == {0, 1, 2}
    assert levels_reaching(building, []) == set()
    lower = close_links(building, [building.portals[0].name])
    assert levels_reaching(lower, lower.exits[:1]) == {0}
    assert levels_reaching(lower, lower.exits[1:]) == {1, 2}


def test_unknown_names_are_refused(stair_mesh, read):
    with pytest.raises(BuildingError, match=r"'stair 2'.*'stair 1'.*building.closed"):
        read(stair_mesh, exits=EXITS, closed=["stair 2"])


def test_ways_onto_a_level_have_the_names_of_portals_and_of_the_stairs_behind_them():
    building = three_storeys()
    found = {
        level: {name: [portal.index for portal in ways] for name, ways in ways_onto(building, level).items()}
        for level in range(3)
    }
    assert found == {
        0: {"portal 0": [0], "lower": [0]},
        1: {"portal 0": [0], "portal 1": [1]},
        2: {"portal 1": [1], "lower": [1], "portal 2": [2], "upper": [2]},
    }


@pytest.mark.parametrize("closed", [[], ["west"], ["stair 1"], [0]])
def test_the_graph_has_what_is_open(building, closed):
    names = [building.portals[one].name if isinstance(one, int) else one for one in closed]
    building = close_links(building, names)
    graph = building.graph()
    links = [*building.portals, *building.exits]
    found = {key: (kept["name"], kept["width"]) for _, _, key, kept in graph.edges(keys=True, data=True)}
    assert found == {k: (link.name, link.width) for k, link in enumerate(links) if building.is_open(link)}
    for way in filter(building.is_open, building.exits):
        part = networkx.node_connected_component(graph, ("exit", way.index))
        assert levels_reaching(building, [way]) == {index for kind, index in part if kind == "level"}


def test_levels_are_found_by_name_and_index(building):
    for level in building.levels:
        assert building.level_at(level.index) is level is building.level_at(level.name)
    for wrong in (-1, len(building.levels), "roof"):
        with pytest.raises(ResultError, match=str(wrong)):
            building.level_at(wrong)


def two_rooms():
    """Return two rooms with a door between them, a stair up to a hall with an exit, and a slope beside it."""
    plan = Plan()
    plan.storey("low", [box(0, 0, 5, 4), box(5.2, 0, 10, 4)])
    plan.storey("high", box(0, 9, 10, 13), z=3.0)
    plan.area("left", "low", box(0, 0, 5, 4))
    plan.area("right", "low", box(5.2, 0, 10, 4))
    plan.door("inner", "low", [(5.1, 1.0), (5.1, 2.0)])
    plan.stair("stair", "low", [(6, 4), (7.2, 4)], "high", length=5.0, direction=(0, 1))
    plan.exit("out", "low", [(0, 1), (0, 2)])
    plan.exit("gate", "high", [(10, 10), (10, 11)])
    return plan.building()


def after(building, *changes):
    for kind, what, *value in changes:
        building = changed(building, Change(0.0, kind, what, {"value": value[0]} if value else {}))
    return building


def named(building, pairs):
    return {building.links[link].name: rest[0] if len(rest) == 1 else rest for link, *rest in pairs}


def test_links_open_and_close_and_what_has_no_effect_is_the_same_building():
    building = two_rooms()
    closed = after(building, ("close", "out"))
    assert [closed.links[k].name for k in closed.closed] == ["out"]
    assert changed(closed, Change(1.0, "close", "out")) is closed
    assert changed(building, Change(1.0, "open", "out")) is building
    assert changed(building, Change(1.0, "tell", "out")) is building
    assert not after(closed, ("open", "out")).closed
    stair = after(building, ("close", "stair"))
    assert sorted(stair.links[k].name for k in stair.closed) == ["low - stair", "stair - high"]
    waiting = after(building, ("close", "out", BODIES))
    assert [waiting.links[k].name for k in waiting.awaited] == ["out"]
    assert after(waiting, ("close", "out")).awaited == frozenset()
    assert after(waiting, ("open", "out")).awaited == frozenset()


def test_a_door_an_exit_and_a_portal_are_passed_in_one_direction():
    building, level = two_rooms(), {one.title: one.index for one in two_rooms().levels}
    ways = (("inner", "right", 0), ("inner", "left", 1), ("out", "out", level["low"]), ("out", "in", -1))
    ways += (("low - stair", "up", level["low"]), ("low - stair", "down", level["stair"]))
    ways += (("stair - high", "high", level["stair"]), ("stair - high", "stair", level["high"]))
    sides = set()
    for what, towards, expected in ways:
        ((name, origin),) = named(building, after(building, ("one_way", what, towards)).one_way).items()
        assert name == what
        if what == "inner":
            sides.add(origin)
        else:
            assert origin == expected
    assert sides == {0, 1}
    both = after(building, ("one_way", "out", "in"), ("one_way", "stair", "up"))
    assert named(both, both.one_way) == {"out": -1, "low - stair": level["low"], "stair - high": level["stair"]}
    assert named(both, after(both, ("one_way", "out", False)).one_way).keys() == {"low - stair", "stair - high"}
    turned = after(both, ("one_way", "stair", "down"))
    assert named(turned, turned.one_way)["low - stair"] == level["stair"]
    for what, towards, words in (
        ("inner", "low", "name an area on one side of it"),
        ("out", "up", "'in' or 'out'"),
        ("low - stair", "lift", "use one of 'up', 'down'"),
    ):
        with pytest.raises(BuildingError, match=words):
            after(building, ("one_way", what, towards))


def test_the_side_of_a_door_is_that_of_the_area_beyond_it():
    building = two_rooms()
    (door,) = building.doors
    x1, y1, x2, y2 = door.segment
    for towards, x in (("right", 1.0), ("left", 9.0)):
        ((_, side),) = after(building, ("one_way", "inner", towards)).one_way
        is_left = (x2 - x1) * (1.5 - y1) - (y2 - y1) * (x - x1) > 0
        assert side == (0 if is_left else 1)


def test_a_level_that_nobody_enters_is_left_by_its_links_alone():
    building, level = two_rooms(), {one.title: one.index for one in two_rooms().levels}
    barred = after(building, ("no_entry", "high"))
    assert named(building, barred.one_way) == {"stair - high": level["high"], "gate": level["high"]}
    assert after(barred, ("no_entry", "high", False)).one_way == frozenset()
    room = after(building, ("no_entry", "left"))
    assert named(room, room.one_way).keys() == {"inner", "out"}
    stair = after(building, ("no_entry", "stair"))
    assert named(stair, stair.one_way) == {"low - stair": level["stair"], "stair - high": level["stair"]}
    emptying = after(building, ("close", "stair", LEAVE))
    assert (emptying.one_way, emptying.emptying) == (stair.one_way, {"stair"})
    opened = after(emptying, ("open", "stair"))
    assert (opened.one_way, opened.emptying, opened.closed) == (frozenset(), frozenset(), frozenset())
    closed = after(emptying, ("close", "stair", "all"))
    assert (closed.one_way, closed.emptying, len(closed.closed)) == (frozenset(), frozenset(), 2)
    with pytest.raises(BuildingError, match="'attic'"):
        after(building, ("no_entry", "attic"))


def test_areas_are_slow_or_barred_until_they_are_not():
    building = two_rooms()
    slowed = after(building, ("slow", "left", 0.5), ("slow", "right", 0.25))
    assert slowed.slowed == {("left", 0.5), ("right", 0.25)}
    assert after(slowed, ("slow", "left", 0.75)).slowed == {("left", 0.75), ("right", 0.25)}
    assert after(slowed, ("slow", "left", 1.0)).slowed == {("right", 0.25)}
    barred = after(building, ("bar", "left"), ("bar", "right", True))
    assert barred.barred == {"left", "right"}
    assert after(barred, ("bar", "left", False)).barred == {"right"}


@pytest.mark.parametrize("towards", ["up", "down", "high", "low"])
def test_a_stair_that_moves_carries_along_its_slope_and_is_passed_that_way(towards):
    building, level = two_rooms(), {one.title: one.index for one in two_rooms().levels}
    moving = after(building, ("move", "stair", {"towards": towards, "speed": 0.5}))
    stair, is_up = building.levels[level["stair"]], towards in ("up", "high")
    ((number, *velocity),) = moving.moving
    assert number == stair.index
    expected = 0.5 * np.cos(stair.slope) * stair.uphill * (1.0 if is_up else -1.0)
    assert velocity == pytest.approx(expected.tolist())
    low, high = ("low", "stair") if is_up else ("stair", "high")
    assert named(moving, moving.one_way) == {"low - stair": level[low], "stair - high": level[high]}
    stopped = after(moving, ("move", "stair", False))
    assert (stopped.moving, stopped.one_way) == (frozenset(), frozenset())
    with pytest.raises(BuildingError, match="kind 'move'"):
        after(moving, ("one_way", "stair", "up"))
    for what, to, words in (("stairs", "up", "no stair is named 'stairs'"), ("stair", "east", "does not move towards")):
        with pytest.raises(BuildingError, match=words):
            after(building, ("move", what, {"towards": to, "speed": 0.5}))


def test_a_building_at_a_time_has_the_changes_until_then():
    building = two_rooms()
    times = ((1.0, "close"), (2.0, "open"), (2.0, "close"), (3.0, "open"))
    changes = [Change(time, kind, "gate") for time, kind in times]
    gate = building.link_of(building.exits[[one.name for one in building.exits].index("gate")])
    states = states_of(building, changes)
    assert states[gate] == [(0.0, True), (1.0, False), (2.0, True), (2.0, False), (3.0, True)]
    assert [len(one) for k, one in enumerate(states) if k != gate] == [1] * (len(states) - 1)
    assert [gate in building_at(building, changes, time).closed for time in (0.9, 1.0, 2.5, 3.0)] == [0, 1, 1, 0]
