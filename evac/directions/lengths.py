"""Lengths of paths, flat, up and down: computed on request, since few runs need them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evac.base.arrays import FloatArray, IndexArray, IntArray
from evac.building.model.building import FLAT, Area, Building, Exit
from evac.directions.descent import Ways, add_lengths
from evac.directions.raster.grids import OWN, BuildingGrids, LevelGrid, build_grids, use_towards
from evac.directions.routes import RELUCTANCE, Route

if TYPE_CHECKING:
    from evac.directions.fields import PackedFields


@dataclass(frozen=True)
class MarchedClass:
    """The part of `Marched` for a class of bodies."""

    barred: float  # gaps narrower than this are walls [m]
    # list of (b,) int64: for each route, the nodes from which no way is as wide as the bodies; empty if there is none
    # for any route
    blocked: list[IndexArray]
    elsewhere: dict[int, IndexArray]  # dict of (e,) int64: by route, nodes from which it leads to an exit of others


@dataclass(frozen=True)
class Marched:
    """Data that lengths are computed from, in addition to the travel times."""

    building: Building  # with the portals and exits that were closed
    # spacing, clearance: of the grids [m]
    spacing: float
    clearance: float
    # tuple of (3,) float64: cost of a metre along the slope in each use, for each route [s/m]
    rates: tuple[FloatArray, ...]
    classes: tuple[MarchedClass, ...]


def slowness_of(building: Building, rate: FloatArray, route: Route) -> FloatArray:
    """Return the time per metre in plan of each level and use (levels, 3) on a route, from that along the slope [s/m].

    On levels that are too steep for it, ways are short ones back.

    On escalators that move, it is the time of people who stand, except for the shortest way, which heeds no speeds.
    Moving walkways count as the floor, as travel times are at least those at 1 m/s.
    """
    slowness: FloatArray = rate / np.array([[math.cos(level.slope)] for level in building.levels])
    if (rate != rate[0]).any():
        for level, x, y in building.moving:
            if building.levels[level].slope > 0.0:
                slowness[level] = 1.0 / math.hypot(x, y)
    slowness[[*too_steep(building, route)]] *= RELUCTANCE
    return slowness


def routes_at_present(building: Building, routes: Sequence[Route]) -> tuple[Route, ...]:
    """Return routes that lead to any exit instead of those whose exits are all closed."""
    names = [exit_.name for exit_ in building.exits if building.is_open(exit_)]
    return tuple(
        route if route.area or any(map(route.leads_to, names)) else replace(route, exits=()) for route in routes
    )


def exits_of_route(building: Building, route: Route) -> list[Exit]:
    """Return the open exits that a route may end at."""
    return [exit_ for exit_ in building.exits if route.leads_to(exit_.name) and building.is_open(exit_)]


def ends_of_route(building: Building, route: Route) -> list[Exit | Area]:
    """Return the open exits, or the areas, that a route may end at."""
    return [*exits_of_route(building, route), *(area for area in building.areas if area.name == route.area)]


def too_steep(building: Building, route: Route) -> set[int]:
    """Return the levels that are too steep for a route, and the landings that lead to such levels alone."""
    if route.steepest is None:
        return set()
    steep = {level.index for level in building.levels if math.tan(level.slope) > route.steepest}
    landings = (level.index for level in building.levels if level.kind == "landing")
    return steep | {one for one in landings if steep.issuperset(way.other(one) for way in building.portals_of(one))}


def barred_on(building: Building, route: Route) -> frozenset[tuple[int, int]]:
    """Return the portals that lead to levels that are too steep for a route, each with the level before it.

    Off these levels the route leads, so that somebody who was pushed onto a stair finds back.
    """
    steep = too_steep(building, route)
    pairs = ((portal, level) for portal in building.portals for level in portal.levels)
    return frozenset((one.index, level) for one, level in pairs if one.other(level) in steep and level not in steep)


def find_lengths(marched: Marched, routes: tuple[Route, ...], packed: "PackedFields") -> FloatArray:
    """Return the flat, up and down lengths (nodes, 3) of the path from each node of packed fields [m].

    Each column is contiguous, since they are sampled one by one.
    """
    in_fields: FloatArray = np.empty((3, len(packed.travel_time))).T
    for number, of_class in enumerate(marched.classes):
        grids = build_grids(marched.building, marched.spacing, marched.clearance, of_class.barred)
        cost = np.empty(grids.size)
        ways = make_ways(grids, cost)
        for index, route in enumerate(routes_at_present(marched.building, routes)):
            cost[:] = math.inf
            places = _places_of(packed, number * len(routes) + index)
            for on_grids, place in places:
                cost[on_grids] = packed.travel_time[place]
            for grid in grids.levels:
                cost[grid.stands_for[0]] = math.inf
            lengths = _lengths(grids, ways, exits_of_route(grids.building, route), marched.rates[index])
            if of_class.blocked:
                lengths[of_class.blocked[index]] = math.inf
            for on_grids, place in places:
                in_fields[place] = lengths[on_grids]
    return in_fields


def passable_times(marched: Marched, packed: "PackedFields") -> FloatArray:
    """Return the travel times (nodes,) of packed fields, inf from where no way is as wide as the bodies [s]."""
    if not any(blocked.size for of_class in marched.classes for blocked in of_class.blocked):
        return packed.travel_time  # which may be large
    times: FloatArray = packed.travel_time.copy()
    for number, of_class in enumerate(marched.classes):
        for index, blocked in enumerate(of_class.blocked):
            for on_grids, place in _places_of(packed, number * len(of_class.blocked) + index):
                own = blocked[(blocked >= on_grids.start) & (blocked < on_grids.stop)]
                times[own + (place.start - on_grids.start)] = math.inf
    return times


def _places_of(packed: "PackedFields", column: int) -> list[tuple[slice, slice]]:
    """Return where each level of a column is in values on all grids, and where in packed fields."""
    sizes = packed.shape.prod(axis=1, dtype=np.int64)
    each = zip(np.cumsum(sizes) - sizes, sizes, packed.field_of[:, column], strict=True)
    starts = ((first, size, packed.offset[field]) for first, size, field in each if field >= 0)
    return [(slice(first, first + size), slice(start, start + size)) for first, size, start in starts]


def take_halos(grids: BuildingGrids, values: FloatArray) -> None:
    """Fill the halos of packed values from the neighbouring levels."""
    for grid in grids.levels:
        halo = (grid.sheet > OWN) & (grid.source >= 0)
        values[grid.packed][halo.ravel()] = values[grid.source[halo]]


def continue_values(grids: BuildingGrids, values: FloatArray) -> None:
    """Extrapolate packed values linearly to nodes that are excluded from marching."""
    left_out, stand_in, next_one = np.concatenate([grid.stands_for for grid in grids.levels], axis=1)
    with np.errstate(invalid="ignore"):  # infinite costs
        rise = values[stand_in] - values[next_one]
    values[left_out] = values[stand_in] + np.where(np.isfinite(rise), rise, 0.0)


def strips_of(grids: BuildingGrids, grid: LevelGrid) -> dict[int, IndexArray]:
    """Return the flat indices of the nodes behind each exit of a level, by index of the exit."""
    nodes = np.flatnonzero(grid.sheet > len(grids.building.portals))
    links = grid.sheet.ravel()[nodes] - 1
    return {exit_.index: nodes[links == grids.building.link_of(exit_)] for exit_ in grids.building.exits_of(grid.level)}


def _lengths(grids: BuildingGrids, ways: Ways, exits: list[Exit], rates: FloatArray) -> FloatArray:
    """Return the flat, up and down lengths (nodes, 3) of the path from each node [m]; it ends where a jump starts."""
    building, cost = grids.building, ways.cost
    is_walked = not (building.costs or building.jumps)  # so that the lengths follow from the cost
    lengths = np.full((grids.size, 3), math.inf)
    strips = {level: strips_of(grids, grids.levels[level]) for level in {exit_.level for exit_ in exits}}
    for exit_ in exits:
        behind = grids.levels[exit_.level].offset + strips[exit_.level][exit_.index]
        use = use_towards(building.levels[exit_.level], exit_.segments)
        lengths[behind] = 0.0
        lengths[behind, use] = (cost[behind] - building.cost_of(exit_)) / rates[use]
    node = np.flatnonzero(grids.own_nodes & np.isfinite(cost))
    node = node[np.argsort(cost[node], kind="stable")]
    add_lengths(node, ways, lengths)
    # Paths also end at nodes without a lower neighbour, in front of an exit without a strip and occasionally beside its
    # ends. The node with the lowest cost among those without lengths is one of them.
    uses = {exit_.level: use_towards(building.levels[exit_.level], exit_.segments) for exit_ in exits}
    while (without := node[np.isinf(lengths[node, 0])]).size:
        stride = ways.stride[ways.level_of[without]]
        beside = np.min([ways.cost[without + step] for step in (stride, -stride, 1, -1)], axis=0)
        begins = without[(beside >= ways.cost[without]) & (ways.twin[without] < 0)]
        begins = begins if begins.size else without[:1]
        towards = np.array([uses.get(level, FLAT) for level in ways.level_of[begins].tolist()])
        lengths[begins] = 0.0
        lengths[begins, towards] = cost[begins] / rates[towards] * is_walked
        add_lengths(node, ways, lengths)
    # Lengths are of first order, the cost of second; scale the lengths so that they sum up to the cost.
    if is_walked:
        along = lengths[node] @ rates
        usable = (along > 0.0) & (cost[node] > 0.0) & np.isfinite(along)
        lengths[node[usable]] *= (cost[node[usable]] / along[usable])[:, None]
    take_halos(grids, lengths)
    continue_values(grids, lengths)
    return lengths


def make_ways(grids: BuildingGrids, cost: FloatArray) -> Ways:
    """Return the data for path lengths along the steepest descent of a cost."""
    return Ways(
        level_of=np.concatenate([np.full(grid.sheet.size, grid.level, dtype=np.int32) for grid in grids.levels]),
        source=np.concatenate([grid.source.ravel() for grid in grids.levels]),
        twin=_twins(grids),
        cost=cost,
        stride=np.array([grid.window.shape[1] for grid in grids.levels], dtype=np.int32),
        uphill=np.array([level.climb for level in grids.building.levels], dtype=np.float64),
        cosine=np.array([math.cos(level.slope) for level in grids.building.levels]),
        spacing=grids.lattice.spacing,
    )


def _twins(grids: BuildingGrids) -> IntArray:
    """Return the node at the same position on the other level for nodes on a portal, and -1 for others."""
    # Nodes before a door of one direction have the nearest one behind it.
    twin = np.full(grids.size, -1, dtype=np.int32)
    for grid in grids.levels:
        for ours, theirs in grid.seams.values():
            twin[ours] = theirs
        twin[grid.passages[0]] = grid.passages[1]
    return twin
