"""Computation of travel times and directions of a building for given routes."""

import math
from collections.abc import Generator, Sequence
from contextlib import closing

import numpy as np
import shapely

from evac.arrays import FloatArray
from evac.building.checks import measures
from evac.building.model import Building, Exit
from evac.building.narrow import gaps_below
from evac.defaults import COMFORT, ORDER, SPACING
from evac.directions.cellwalls import find_cell_walls
from evac.directions.descent import descend
from evac.directions.fields import Fields, PackedFields
from evac.directions.graph import levels_reaching
from evac.directions.grids import NOTHING, OWN, BuildingGrids, build_grids, count_nodes
from evac.directions.lengths import (
    Marched,
    continue_values,
    exits_of_route,
    nodes_not_marched,
    strips_of,
    take_halos,
)
from evac.directions.marching import Metric
from evac.directions.masks import nearest_marked
from evac.directions.routes import STRATEGIES, Route
from evac.directions.strips import outward_directions
from evac.directions.workers import March, march_all, number_of_workers
from evac.errors import ScenarioError
from evac.parameters import did_you_mean

#: The slowness factor is 1 + BEND at a wall and 1 at the clearance, so that paths pass posts at about one clearance.
BEND = 8.0

#: Slowness factor within a cell of the line across a gap that nobody fits through; a detour of about 200 cells is
#: preferred.
AVOID = 100.0

#: Memory during the computation of fields [bytes]: per node, and per node and route after the first.
NODE_BYTES, ROUTE_BYTES = 110.0, 35.0

#: Maximum memory of all fields [bytes], which corresponds to one or two minutes of computing.
MOST_BYTES = 2.5e9

#: Memory that worker processes may take together, even if the fields take less [bytes].
WORKERS_BYTES = 0.5e9


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
    threads: int | None = 1,
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
    threads : int, optional
        Greatest number of fields that are marched at the same time, each in a process; fewer are if the grids are small
        or memory is short. None means one for each core. The fields are identical.

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
    bent = _bent(grids, clearance, avoided) if clearance > 0.0 else None
    rates = tuple(_rates(route.strategy, speeds, comfort) for route in routes)
    steepest = max([1.0, *(rate.max() for rate in rates)]) / min(math.cos(level.slope) for level in building.levels)
    field_of = np.full((len(building.levels), len(routes)), -1, dtype=np.int32)
    offsets: list[int] = []
    parts: list[list[FloatArray]] = [[], []]
    filled = 0
    not_marched, costs = nodes_not_marched(grids), []
    ways = [exits_of_route(building, route) for route in routes]
    with closing(_solve(grids, ways, rates, avoided, bent, order, threads)) as solved:
        for index, (direction, travel_time) in enumerate(solved):
            costs.append(travel_time[not_marched])
            take_halos(grids, travel_time)
            continue_values(grids, travel_time)
            reaching = sorted(levels_reaching(building, ways[index]))
            for level in reaching:
                field_of[level, index] = len(offsets)
                offsets.append(filled)
                filled += grids.levels[level].sheet.size
            # Where one route leads out from everywhere, as in most cases, nothing is copied: grids can fill the memory.
            chosen = reaching if len(reaching) < len(building.levels) else None
            for part, values in zip(parts, (direction, travel_time), strict=True):
                part += [values] if chosen is None else [values[grids.levels[level].packed] for level in chosen]
    direction, travel_time = (_joined(parts.pop(0), rest) for rest in ((2,), ()))
    return Fields(
        routes=tuple(routes),
        packed=PackedFields(
            origin=np.array([grid.window.origin for grid in grids.levels]),
            shape=np.array([grid.window.shape for grid in grids.levels], dtype=np.int32),
            spacing=float(spacing),
            field_of=field_of,
            offset=np.array(offsets, dtype=np.int64),
            direction=direction,
            travel_time=travel_time,
            walls=find_cell_walls(grids, steepest),
        ),
        marched=Marched(building, spacing, clearance, rates, not_marched, tuple(costs)),
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
    most = MOST_BYTES / _bytes_per_node(n_routes)
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


def _bytes_per_node(n_routes: int) -> float:
    """Return the memory of the fields of so many routes, without that of workers."""
    return NODE_BYTES + ROUTE_BYTES * max(0, n_routes - 1)


def _memory_of_workers(nodes: int, n_routes: int) -> float:
    """Return what workers may take together [bytes]: what is left, but at most as much as the fields or a minimum."""
    needed = nodes * _bytes_per_node(n_routes)
    return min(MOST_BYTES - needed, max(needed, WORKERS_BYTES))


def _joined(arrays: list[FloatArray], rest: tuple[int, ...]) -> FloatArray:
    """Return arrays (n, *rest) one after another; of one, itself."""
    return arrays[0] if len(arrays) == 1 else np.concatenate([np.zeros((0, *rest)), *arrays])


def _avoided(grids: BuildingGrids, width: float) -> FloatArray:
    """Return the slowness factors (nodes,) in gaps narrower than a width [m]; 1 elsewhere."""
    avoided = [np.zeros(0, np.int64)]
    for grid in grids.levels:
        gaps = gaps_below(grids.building.levels[grid.level].polygon, width)
        if len(gaps):
            lines = shapely.multilinestrings(gaps.reshape(-1, 2, 2))
            shapely.prepare(lines)
            near = np.argwhere(grid.window.around(shapely.get_parts(lines), grids.lattice.spacing))
            near = near[shapely.dwithin(lines, shapely.points(grid.window.places(near)), grids.lattice.spacing)]
            avoided.append(grid.offset + np.ravel_multi_index(tuple(near.T), grid.window.shape))
    nodes = np.concatenate(avoided)
    if not len(nodes):
        return np.broadcast_to(1.0, grids.size)  # takes no memory
    factor = np.ones(grids.size)
    factor[nodes] = AVOID
    return factor


def _bent(grids: BuildingGrids, clearance: float, avoided: FloatArray) -> FloatArray:
    """Return the slowness factors (nodes,) near walls, times those of `avoided`; see `build_fields`."""
    factor = avoided.copy()
    for grid in grids.levels:
        factor[grid.ring] *= 1.0 + BEND * (1.0 - grid.distance / clearance) ** 2
    return factor


def _solve(
    grids: BuildingGrids,
    ways: Sequence[list[Exit]],
    rates: Sequence[FloatArray],
    avoided: FloatArray,
    bent: FloatArray | None,
    order: int,
    threads: int | None,
) -> Generator[tuple[FloatArray, FloatArray], None, None]:
    """Yield directions (nodes, 2) and travel times (nodes,) to the exits of each route on all grids, as marched."""
    cosine = np.array([math.cos(level.slope) for level in grids.building.levels])
    marches = []
    for rate, exits in zip(rates, ways, strict=True):
        slowness = rate / cosine[:, None]
        marches.append(March(Metric(slowness, avoided), exits))
        if bent is not None:
            marches.append(March(Metric(slowness, bent, is_plain=False), exits))
    workers = number_of_workers(grids, len(marches), _memory_of_workers(grids.size, len(ways)), threads)
    with closing(march_all(grids, marches, order, workers)) as costs:
        for exits in ways:
            plain = next(costs)
            yield _directions(grids, plain if bent is None else next(costs), exits, bent is None), plain


def _rates(strategy: str, speeds: tuple[float, float, float], comfort: float) -> FloatArray:
    """Return the costs (3,) per metre along the slope in each use, for a strategy [s/m]."""
    if strategy == "shortest":
        return np.ones(3)
    rates = 1.0 / np.array(speeds, dtype=np.float64)
    if strategy == "comfortable":
        rates[1:] *= comfort
    return rates


def _directions(grids: BuildingGrids, cost: FloatArray, exits: list[Exit], is_plain: bool) -> FloatArray:
    """Return unit vectors (nodes, 2): steepest descent, exit normals behind exits, extended into walls."""
    direction = np.zeros((grids.size, 2))
    for grid in grids.levels:
        chosen = (grid.sheet == OWN).view(np.uint8)
        packed = direction[grid.packed]
        descend(cost[grid.packed].reshape(grid.window.shape), chosen, grids.lattice.spacing, is_plain, packed)
        strips = strips_of(grids, grid)
        for exit_ in exits:
            if exit_.level == grid.level:
                strip = strips[exit_.index]
                nodes = np.stack(np.unravel_index(strip, grid.window.shape), axis=1)
                packed[strip] = outward_directions(exit_.segments, grid.window.places(nodes))
    take_halos(grids, direction)
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
