"""The graph of levels, portals and exits, for reachability."""

from collections.abc import Iterable
from typing import Any

from evac.building.model.building import Building, Exit


def build_graph(building: Building) -> Any:
    """Return the graph of open portals and exits.

    Parameters
    ----------
    building : Building

    Returns
    -------
    networkx.MultiGraph
        Nodes are ``("level", i)`` and ``("exit", e)``; there is an edge for every open portal and exit, whose key
        is the link (portals first, then exits), with its ``width`` [m] and ``name``.
    """
    import networkx  # takes 0.1 s, not needed for a building with one level

    graph = networkx.MultiGraph()
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


def levels_reaching(building: Building, exits: Iterable[Exit]) -> set[int]:
    """Return the levels from which one of some open exits can be reached."""
    found = {exit_.level for exit_ in exits}
    if building.portals:
        import networkx

        # Paths cannot pass through other exits, since each exit is connected to one level only.
        graph = build_graph(building)
        parts = [networkx.node_connected_component(graph, ("level", level)) for level in found]
        found |= {index for part in parts for kind, index in part if kind == "level"}
    return found
