"""The graph of levels, portals and exits: who can reach what."""

from typing import Any

import networkx as nx

from evac.building.model import Building


def build_graph(building: Building) -> Any:
    """Return the graph of what is open.

    Parameters
    ----------
    building : Building

    Returns
    -------
    networkx.MultiGraph
        Nodes ``("level", i)`` and ``("exit", e)``; an edge for every open portal and exit, whose key
        is the link (portals first, then exits), with its ``width`` [m] and ``name``.
    """
    graph = nx.MultiGraph()
    graph.add_nodes_from((("level", level.index), {"name": level.name}) for level in building.levels)
    graph.add_nodes_from((("exit", exit_.index), {"name": exit_.name}) for exit_ in building.exits)
    for portal in building.portals:
        if building.is_open(portal):
            first, second = portal.levels
            graph.add_edge(("level", first), ("level", second), key=portal.index, width=portal.width, name=portal.name)
    for exit_ in building.exits:
        if building.is_open(exit_):
            link = building.link_of(exit_)
            graph.add_edge(("level", exit_.level), ("exit", exit_.index), key=link, width=exit_.width, name=exit_.name)
    return graph


def levels_reaching(graph: Any, exits: list[int]) -> set[int]:
    """Return the levels from which one of `exits` (indices) can be reached."""
    found: set[int] = set()
    for exit_ in exits:
        # A way leads through no other exit: exits hang on one level each, so they are ends of the graph.
        component = nx.node_connected_component(graph, ("exit", exit_))
        found |= {index for kind, index in component if kind == "level"}
    return found
