"""The graph of what is open."""

from dataclasses import replace

from evac.directions.graph import build_graph, levels_reaching


def test_closed_links_are_left_out(drawing):
    for x in (0, 2, 4):
        drawing.level((x, 0, x + 2, 2))
    drawing.portal(0, 1, (2, 0), (2, 2))
    drawing.portal(1, 2, (4, 0), (4, 2))
    drawing.exit("west", 0, (0, 0), (0, 2))
    drawing.exit("east", 2, (6, 0), (6, 2))
    building = drawing.build()
    graph = build_graph(building)
    assert graph.edges[("level", 0), ("level", 1), 0]["width"] == 2.0
    assert graph.edges[("level", 2), ("exit", 1), 3]["name"] == "east"
    assert levels_reaching(building, building.exits[1:]) == {0, 1, 2}
    assert levels_reaching(building, []) == set()
    building = replace(building, closed=frozenset({0}))
    assert levels_reaching(building, building.exits[:1]) == {0}
    assert levels_reaching(building, building.exits[1:]) == {1, 2}


def test_a_building_of_one_level_needs_no_graph(drawing):
    drawing.level((0, 0, 2, 2))
    drawing.exit("west", 0, (0, 0), (0, 2))
    building = drawing.build()
    assert levels_reaching(building, building.exits) == {0}
