"""Computation of travel times and directions of a building for given routes."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.arrays import FloatArray
from evac.building.checks import measures
from evac.building.model import FLAT, Building, Exit
from evac.building.narrow import gaps_below
from evac.defaults import COMFORT, ORDER, SPACING
from evac.directions.cellwalls import find_cell_walls
from evac.directions.descent import Ways, add_lengths, descend, find_lowest
from evac.directions.fields import Fields, PackedFields
from evac.directions.graph import levels_reaching
from evac.directions.grids import NOTHING, OWN, BuildingGrids, build_grids, count_nodes, use_towards
from evac.directions.marching import Metric, march
from evac.directions.masks import nearest_marked
from evac.directions.routes import STRATEGIES, Route
from evac.directions.strips import outward_directions
from evac.errors import ScenarioError
from evac.parameters import did_you_mean

#: The slowness factor is 1 + BEND at a wall and 1 at the clearance, so that paths pass posts at about one clearance.
BEND = 8.0

#: Slowness factor within a cell of the line across a gap that nobody fits through; a detour of about 200 cells is
#: preferred.
AVOID = 100.0

#: Memory during the computation of fields [bytes]: per node, and per node and route after the first.
NODE_BYTES, ROUTE_BYTES = 190.0, 50.0

#: Maximum memory of all fields [bytes], which corresponds to one or two minutes of computing.
MOST_BYTES = 2.5e9


def build_fields(
    building: Building,
    routes: Sequence[Route],
    *,
    spacing: float = SPACING,
    clearance: float = 0.25,
    speeds: tuple[float, float, float] = (1.0, 0.5, 0.7),
    comfort: float = COMFORT,
    order: int = ORDER,
    narrowest: float = 0.0,
) -> Fields:
    """Compute the travel times and directions of a building by fast marching.

    The travel time T of a route solves the eikonal equation |grad T| = s with T = 0 on its exits. The slowness s is
    the time per metre in plan, 1 / (speed cos slope), with the speed for the use (flat, up, down) of each level.
    Directions are the steepest descent of a second such field, whose slowness is multiplied by
    ``1 + BEND (1 - d / clearance)^2`` at distances d < `clearance` from walls. This keeps bodies away from posts and
    corners, and a narrow door remains passable, because its middle is still the best way.

    Parameters
    ----------
    building : Building
    routes : sequence of Route
    spacing : float
        Grid spacing [m].
    clearance : float
        Approximately the largest body radius [m]; 0 gives the directions of the plain travel time.
    speeds : (flat, up, down)
        Reference speeds along the slope [m/s].
    comfort : float
        Weight of the time on stairs for the strategy "comfortable".
    order : {1, 2}
        Order of the marching stencil.
    narrowest : float
        Diameter of the smallest body [m]. Narrower gaps are used only if there is no other way.

    Returns
    -------
    Fields
        ``travel_time`` is the cost that the strategy minimises, in seconds: "shortest" assumes 1 m/s everywhere,
        "comfortable" weights the time on stairs by `comfort`.

    Raises
    ------
    ScenarioError
        A route names an exit or a strategy that does not exist, the grid has too many nodes, or an exit is
        narrower than two of its cells. Ranges of numbers are checked with the case.
    """
    _check_routes(building, routes)
    _check_spacing(building, spacing)
    _check_memory(building, len(routes), spacing, clearance)
    grids = build_grids(building, spacing, clearance)
    avoided = _avoided(grids, narrowest)
    bent = avoided * _bent(grids, clearance) if clearance > 0.0 else None
    greatest_rate = max([1.0, *(_rates(route.strategy, speeds, comfort).max() for route in routes)])
    steepest = greatest_rate / min(math.cos(level.slope) for level in building.levels)
    field_of = np.full((len(building.levels), len(routes)), -1, dtype=np.int32)
    offsets: list[int] = []
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    filled = 0
    for index, route in enumerate(routes):
        allowed = [e for e in building.exits if route.leads_to(e.name)]
        exits = [e for e in allowed if building.is_open(e)]
        rates = _rates(route.strategy, speeds, comfort)
        direction, travel_time, lengths = _solve(grids, exits, rates, avoided, bent, order)
        for level in sorted(levels_reaching(building, exits)):
            nodes = grids.levels[level].packed
            field_of[level, index] = len(parts)
            offsets.append(filled)
            parts.append((direction[nodes], travel_time[nodes], lengths[nodes]))
            filled += nodes.stop - nodes.start
    return Fields(
        routes=tuple(routes),
        packed=PackedFields(
            origin=np.array([grid.window.origin for grid in grids.levels]),
            shape=np.array([grid.window.shape for grid in grids.levels], dtype=np.int32),
            spacing=float(spacing),
            field_of=field_of,
            offset=np.array(offsets, dtype=np.int64),
            direction=np.concatenate([np.zeros((0, 2)), *(part[0] for part in parts)]),
            travel_time=np.concatenate([np.zeros(0), *(part[1] for part in parts)]),
            walls=find_cell_walls(grids, steepest),
        ),
        lengths=np.concatenate([np.zeros((0, 3)), *(part[2] for part in parts)]),
        comfort=float(comfort),
        clearance=float(clearance),
    )


def _check_routes(building: Building, routes: Sequence[Route]) -> None:
    """Refuse routes with unknown exits or strategies, and routes whose exits are all closed."""
    names = [exit_.name for exit_ in building.exits]
    for route in routes:
        if route.strategy not in STRATEGIES:
            raise ScenarioError(f"unknown strategy {route.strategy!r}; {did_you_mean(route.strategy, STRATEGIES)}")
        for name in route.exits:
            if name not in names:
                raise ScenarioError(
                    f"a route leads to exit {name!r}, which {building.source} does not have;"
                    f" {did_you_mean(name, names)}"
                )
        if route.exits and not any(building.is_open(e) for e in building.exits if e.name in route.exits):
            raise ScenarioError(
                f"a route leads only to {' or '.join(map(repr, route.exits))}, which building.closed closes; "
                "add another exit to the route, or open one"
            )


def _check_spacing(building: Building, spacing: float) -> None:
    """Refuse a grid too coarse for an exit."""
    for exit_ in building.exits:
        if exit_.width < 2.0 * spacing:
            raise ScenarioError(
                f"directions.spacing: exit {exit_.name!r} is {exit_.width:.3g} m wide, less than two cells of "
                f"{spacing} m; widen the exit or reduce the spacing"
            )


def _check_memory(building: Building, n_routes: int, spacing: float, clearance: float) -> None:
    """Refuse grids that need too much memory, before any is allocated; the message names the responsible key."""
    most = MOST_BYTES / (NODE_BYTES + ROUTE_BYTES * max(0, n_routes - 1))
    nodes = count_nodes(building, spacing, clearance)
    if nodes <= most:
        return
    alone = count_nodes(building, spacing, 0.0)
    many = f"{nodes:.2g} nodes for {n_routes} routes, more than {most:.1g}"
    if alone <= 0.5 * most:
        raise ScenarioError(
            f"directions.clearance: {clearance:g} m requires grids of {many}; reduce it (by default, it is "
            "approximately the largest body radius)"
        )
    least = spacing * math.sqrt(nodes / most)
    raise ScenarioError(
        f"directions.spacing: {spacing:g} m requires grids of {many}; use at least {least:.2g} m; {measures(building)}"
    )


def _avoided(grids: BuildingGrids, width: float) -> FloatArray:
    """Return the slowness factors (nodes,) in gaps narrower than a width [m]; 1 elsewhere."""
    factor = np.ones(grids.size)
    for grid in grids.levels:
        gaps = gaps_below(grids.building.levels[grid.level].polygon, width)
        if len(gaps):
            lines = shapely.multilinestrings(gaps.reshape(-1, 2, 2))
            shapely.prepare(lines)
            nodes = shapely.dwithin(lines, shapely.points(*grid.window.coordinates()), grids.lattice.spacing)
            factor[grid.packed][nodes.ravel()] = AVOID
    return factor


def _bent(grids: BuildingGrids, clearance: float) -> FloatArray:
    """Return the slowness factors (nodes,) near walls; see `build_fields`."""
    near = np.concatenate([grid.distance.ravel() for grid in grids.levels])
    return np.asarray(1.0 + BEND * (1.0 - near / clearance) ** 2)


def _solve(
    grids: BuildingGrids,
    exits: list[Exit],
    rates: FloatArray,
    avoided: FloatArray,
    bent: FloatArray | None,
    order: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return directions (nodes, 2), travel times (nodes,) and lengths (nodes, 3) to given exits on all grids."""
    cosine = np.array([math.cos(level.slope) for level in grids.building.levels])
    slowness = rates / cosine[:, None]
    plain = march(grids, Metric(slowness, avoided), exits, order)
    guide = plain if bent is None else march(grids, Metric(slowness, bent, is_plain=False), exits, order)
    direction = _directions(grids, guide, exits, bent is None)
    lengths = _lengths(grids, plain, exits, rates, cosine)
    return direction, _continued(grids, _with_halos(grids, plain)), _continued(grids, lengths)


def _rates(strategy: str, speeds: tuple[float, float, float], comfort: float) -> FloatArray:
    """Return the costs (3,) per metre along the slope in each use, for a strategy [s/m]."""
    if strategy == "shortest":
        return np.ones(3)
    rates = 1.0 / np.array(speeds, dtype=np.float64)
    if strategy == "comfortable":
        rates[1:] *= comfort
    return rates


def _with_halos(grids: BuildingGrids, values: FloatArray) -> FloatArray:
    """Return packed values with halos filled from the neighbouring levels."""
    seen = values.copy()
    for grid in grids.levels:
        halo = (grid.sheet > OWN) & (grid.source >= 0)
        seen[grid.packed][halo.ravel()] = values[grid.source[halo]]
    return seen


def _continued(grids: BuildingGrids, values: FloatArray) -> FloatArray:
    """Return packed values, extrapolated linearly to nodes that are excluded from marching."""
    left_out, stand_in, next_one = np.concatenate([grid.stands_for for grid in grids.levels], axis=1)
    with np.errstate(invalid="ignore"):  # infinite costs
        rise = values[stand_in] - values[next_one]
    values[left_out] = values[stand_in] + np.where(np.isfinite(rise), rise, 0.0)
    return values


def _directions(grids: BuildingGrids, cost: FloatArray, exits: list[Exit], is_plain: bool) -> FloatArray:
    """Return unit vectors (nodes, 2): steepest descent, exit normals behind exits, extended into walls."""
    direction = np.zeros((grids.size, 2))
    for grid in grids.levels:
        own = direction[grid.packed].reshape(*grid.window.shape, 2)
        chosen = (grid.sheet == OWN).view(np.uint8)
        packed = direction[grid.packed]
        descend(cost[grid.packed].reshape(grid.window.shape), chosen, grids.lattice.spacing, is_plain, packed)
        for exit_ in exits:
            if exit_.level == grid.level:
                strip = grid.sheet == 1 + grids.building.link_of(exit_)
                points = np.stack([x[strip] for x in grid.window.coordinates()], axis=1)
                own[strip] = outward_directions(exit_.segments, points)
    direction = _with_halos(grids, direction)
    for grid in grids.levels:
        own = direction[grid.packed].reshape(*grid.window.shape, 2)
        pointing = np.any(own != 0.0, axis=2)
        halo = grids.is_ground(grid) & (grid.sheet != OWN)
        reached = np.isfinite(cost[grid.packed].reshape(grid.window.shape))
        left_out, stand_in, _ = grid.stands_for
        direction[left_out] = direction[stand_in]
        known = pointing & ~halo
        missing = (~pointing & reached) | (grid.sheet == NOTHING) | ((grid.sheet > OWN) & ~pointing)
        missing.ravel()[left_out - grid.offset] &= ~np.any(direction[stand_in] != 0.0, axis=1)
        if known.any():
            own[missing] = own[nearest_marked(known, missing)]
    return direction


def _lengths(
    grids: BuildingGrids, cost: FloatArray, exits: list[Exit], rates: FloatArray, cosine: FloatArray
) -> FloatArray:
    """Return the flat, up and down lengths (nodes, 3) of the path from each node [m]."""
    building = grids.building
    lengths = np.full((grids.size, 3), math.inf)
    for exit_ in exits:
        grid = grids.levels[exit_.level]
        behind = grid.offset + np.flatnonzero(grid.sheet == 1 + building.link_of(exit_))
        use = use_towards(building.levels[exit_.level], exit_.segments)
        lengths[behind] = 0.0
        lengths[behind, use] = cost[behind] / rates[use]
    own = np.concatenate([(grid.sheet == OWN).ravel() for grid in grids.levels])
    node = np.flatnonzero(own & np.isfinite(cost))
    node = node[np.argsort(cost[node], kind="stable")]
    ways = _ways(grids, cost, cosine)
    add_lengths(node, ways, lengths)
    # Paths also end at nodes without a lower neighbour, in front of an exit without a strip and occasionally beside its
    # ends. The node with the lowest cost among those without lengths is one of them.
    uses = {exit_.level: use_towards(building.levels[exit_.level], exit_.segments) for exit_ in exits}
    while (without := node[np.isinf(lengths[node, 0])]).size:
        is_lowest = np.zeros(without.size, np.uint8)
        find_lowest(without, ways, is_lowest)
        begins = without[is_lowest == 1]
        begins = begins if begins.size else without[:1]
        towards = np.array([uses.get(level, FLAT) for level in ways.level_of[begins].tolist()])
        lengths[begins] = 0.0
        lengths[begins, towards] = cost[begins] / rates[towards]
        add_lengths(node, ways, lengths)
    # Lengths are of first order, the cost of second; scale the lengths so that they sum up to the cost.
    along = lengths[node] @ rates
    usable = (along > 0.0) & (cost[node] > 0.0) & np.isfinite(along)
    lengths[node[usable]] *= (cost[node[usable]] / along[usable])[:, None]
    return _with_halos(grids, lengths)


def _ways(grids: BuildingGrids, cost: FloatArray, cosine: FloatArray) -> Ways:
    """Return the data for path lengths along the steepest descent of a cost."""
    return Ways(
        level_of=np.concatenate([np.full(grid.sheet.size, grid.level, dtype=np.int32) for grid in grids.levels]),
        source=np.concatenate([grid.source.ravel() for grid in grids.levels]),
        twin=_twins(grids),
        cost=cost,
        stride=np.array([grid.window.shape[1] for grid in grids.levels], dtype=np.int32),
        uphill=np.array([level.uphill for level in grids.building.levels], dtype=np.float64),
        cosine=cosine,
        spacing=grids.lattice.spacing,
    )


def _twins(grids: BuildingGrids) -> NDArray[np.int64]:
    """Return, for each node on a portal, the node at the same position on the other level; -1 for other nodes."""
    twin = np.full(grids.size, -1, dtype=np.int64)
    for grid in grids.levels:
        for ours, theirs in grid.seams.values():
            twin[ours] = theirs
    return twin
