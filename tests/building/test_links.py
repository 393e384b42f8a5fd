"""Portals, exits and stairs that are closed."""

import networkx
import pytest
from shapely import box

from evac.base.change import Control
from evac.base.errors import BuildingError, ResultError
from evac.building.model.links import close_links, levels_reaching, ways_onto, with_controls
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
