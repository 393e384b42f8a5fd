"""Computation of travel times and directions of a building for given routes.

Two bodies are of different classes if there is a gap that only the narrower one fits through. The walls in each grid
cell are found for interpolation that must not mix values from both sides of a wall.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import shapely

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.defaults import COMFORT, ORDER, SPACING
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.building.geometry import connected_components
from evac.building.model.building import Building, Exit
from evac.building.model.links import levels_reaching
from evac.building.model.narrow import gaps_below, gaps_between_walls
from evac.building.surface.build import measures
from evac.directions.descent import ONE_LABEL, descend
from evac.directions.fields import CellWalls, ClassGrids, Fields, PackedFields
from evac.directions.lengths import (
    Marched,
    MarchedClass,
    barred_on,
    continue_values,
    ends_of_route,
    exits_of_route,
    routes_at_present,
    strips_of,
    take_halos,
)
from evac.directions.march import EikonalProblem
from evac.directions.march.marching import march_all, number_of_workers
from evac.directions.raster.grids import OWN, BuildingGrids, Shared, build_grids, count_nodes, lead_through_doors
from evac.directions.raster.lattice import SLACK, Window, grown, nearest_marked, numbers_between, outward_directions
from evac.directions.routes import PREFERRED, RELUCTANCE, STRATEGIES, Route


def find_cell_walls(classes: Sequence[BuildingGrids], routes: int, steepest: float) -> CellWalls:
    """List the walls, closed links and exits that pass through the interior of each cell, for each class of bodies.

    Exits are treated as walls, so that people in front of an exit use the nodes in front of it. `steepest` is the
    largest increase of a travel time [s] or length [m] per metre in plan.
    """
    cells: list[IndexArray] = [np.zeros(0, dtype=np.int64)]
    walls: list[FloatArray] = [np.zeros((0, 4))]
    offset = np.zeros((len(classes[0].levels), len(classes)), dtype=np.int32)
    for column, grids in enumerate(classes):
        for grid in grids.levels:
            building = grids.building
            exits = [way.segments for way in building.exits_of(grid.level) if building.is_open(way)]
            own = np.concatenate([grids.walls[grid.level], *exits])
            number, through = _cells_of(grid.window, own)
            offset[grid.level, column] = column * grids.size + grid.offset
            cells.append(offset[grid.level, column] + through)
            walls.append(own[number])
    cell = np.concatenate(cells)
    order = np.argsort(cell, kind="stable")
    walled, first = np.unique(cell[order], return_index=True)
    return CellWalls(
        offset=np.repeat(offset, routes, axis=1),
        cell=walled,
        start=np.append(first, len(cell)).astype(np.int64),
        wall=np.ascontiguousarray(np.concatenate(walls)[order]),
        steepest=steepest,
    )


def _cells_of(window: Window, walls: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return indices of walls (w, 4) and flat indices of the first nodes of the cells that each passes through."""
    # They are sorted by wall, then by cell.
    ends = (walls.reshape(-1, 2, 2) - window.origin) / window.lattice.spacing
    step = ends[:, 1] - ends[:, 0]
    # Fractions of the length at which a wall starts, crosses a grid line and ends.
    owners = [np.arange(len(walls)), np.arange(len(walls))]
    shares = [np.zeros(len(walls)), np.ones(len(walls))]
    for axis in (0, 1):
        oblique = np.flatnonzero(np.abs(step[:, axis]) > SLACK)
        between = ends[oblique, :, axis]
        owner, line = numbers_between(np.ceil(between.min(axis=1)), np.floor(between.max(axis=1)))
        owners.append(oblique[owner])
        shares.append((line - between[owner, 0]) / step[oblique[owner], axis])
    owner, share = np.concatenate(owners), np.clip(np.concatenate(shares), 0.0, 1.0)
    order = np.lexsort((share, owner))
    owner, share = owner[order], share[order]
    is_piece = (owner[1:] == owner[:-1]) & (share[1:] > share[:-1])
    owner, halfway = owner[1:][is_piece], (0.5 * (share[1:] + share[:-1]))[is_piece]
    middle = ends[owner, 0] + halfway[:, None] * step[owner]
    # Pieces along a grid line, and tiny pieces at nodes due to rounding, are not in any cell.
    is_in_a_cell = np.all(np.abs(middle - np.round(middle)) > SLACK, axis=1)
    ix, iy = np.floor(middle[is_in_a_cell]).astype(np.int64).T
    number, cell = np.unique(np.stack([owner[is_in_a_cell], ix * window.shape[1] + iy], axis=1), axis=0).T
    return number, cell


#: Greatest number of classes; where more would be needed, widths are rounded down further.
MOST_CLASSES = 8

#: Steps to which widths of gaps are rounded down, tried in turn [m], and the rounding error of a width [m].
STEPS, ROUNDING = (1e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5), 1e-6


class BodyClass(NamedTuple):
    """Bodies that fit through the same gaps."""

    width: float  # greatest width of a body of the class below [m]
    barred: float  # gaps narrower than this are walls for the class [m]


def find_classes(building: Building, narrowest: float, widest: float) -> tuple[BodyClass, ...]:
    """Return the classes above that of the narrowest body; none if there is no gap between the two widths [m]."""
    if not narrowest < widest:
        return ()
    links = [link for level in building.levels for link in building.links_of(level.index) if building.is_open(link)]
    gaps = [gaps_between_walls(building, level, widest) for level in building.levels]
    across = [np.hypot(*(gap[:, 2:] - gap[:, :2]).T) for gap in gaps]
    widths = np.concatenate([*across, [link.width for link in links]])
    widths = np.unique(widths[(narrowest <= widths) & (widths < widest)])
    if not len(widths):
        return ()
    for step in STEPS:
        rounded = np.maximum(step * np.floor((widths + ROUNDING) / step), narrowest)
        fitting, first = np.unique(rounded, return_index=True)
        if len(fitting) < MOST_CLASSES:
            break
    last = np.append(first[1:], len(widths)) - 1
    return tuple(
        BodyClass(float(width) + ROUNDING, float(barred) + ROUNDING)
        for width, barred in zip(fitting, widths[last], strict=True)
    )


#: The slowness factor is 1 + BEND at a wall and 1 at the clearance, so that paths pass posts at about one clearance.
BEND = 8.0

#: Slowness factor within a cell of the line across a gap that nobody fits through, where there is no other way.
AVOID = 100.0

#: Slowness factor of barred areas: a metre of them is as long as any other way through a building.
BARRED = 1e5

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
    widest: float = 0.0,
    workers: int | None = 1,
    anywhere: bool = False,
    keep_grids: bool = False,
) -> Fields:
    """Compute the travel times and directions of a building by fast marching.

    The travel time T of a route solves the eikonal equation |grad T| = s with T = 0 on its exits. The slowness s is
    the time per metre in plan, 1 / (speed cos slope), with the speed for the use (flat, up, down) of each level.
    Directions are the steepest descent of a second such field, whose slowness is multiplied by
    ``1 + BEND (1 - d / clearance)^2`` at distances d < `clearance` from walls. This keeps bodies away from posts and
    corners, and a narrow door remains passable, because its middle is still the best way.

    A gap, portal or exit that a body does not fit through is a wall for it. Where its destination can then not be
    reached, the body has the directions of the next narrower class.

    Lengths are in metres, `speeds` (flat, up, down) along the slope relative to that on the flat, and `comfort` weighs
    the time on stairs for the strategy "comfortable". `narrowest` and `widest` are the diameters of the smallest and
    the largest body: for each gap between them there is another class of bodies with its own fields. With `anywhere`,
    routes lead to any exit from where none of their own can be reached; with `keep_grids`, the fields may be solved
    again during a run. At most `workers` fields are marched at the same time, each in a process; None is one for each
    core. Their number changes no bit.
    """
    _check_routes(building, routes)
    _check_spacing(building, spacing)
    classes = find_classes(building, narrowest, widest)
    _check_memory(building, len(routes) * (1 + len(classes)), spacing, clearance)
    present = routes_at_present(building, routes)
    solver = _Solver(
        building=building,
        routes=present,
        spacing=spacing,
        clearance=clearance,
        rates=tuple(_rates(route, speeds, comfort) for route in routes),
        order=order,
        workers=workers,
        reaching=tuple(_levels_leading(building, route, anywhere) for route in present),
    )
    solved = solver.solve_classes(narrowest, classes)
    if anywhere:
        _lead_anywhere(solver, solved, narrowest, classes)
    keep_grids = keep_grids or any(route.follows_crowd for route in routes)
    return Fields(
        routes=tuple(routes),
        packed=_packed(solver, solved, classes),
        marched=Marched(building, spacing, clearance, solver.rates, tuple(own.marched for own in solved)),
        comfort=float(comfort),
        clearance=float(clearance),
        grids=tuple(ClassGrids(own.grids, own.factor) for own in solved) if keep_grids else (),
    )


def _packed(solver: "_Solver", solved: Sequence["_Solved"], classes: Sequence[BodyClass]) -> PackedFields:
    """Return the fields of all classes in arrays; those of `solved` are let go, since they may be large."""
    steepest = max([1.0, *(rate.max() for rate in solver.rates)])
    steepest /= min(math.cos(level.slope) for level in solver.building.levels)
    levels = solved[0].grids.levels
    field_of = np.full((len(levels), len(solved) * len(solver.routes)), -1, dtype=np.int32)
    sizes: list[int] = []
    for column, reaching in enumerate(solver.reaching * len(solved)):
        field_of[list(reaching), column] = range(len(sizes), len(sizes) + len(reaching))
        sizes += [levels[level].sheet.size for level in reaching]
    walls = find_cell_walls([own.grids for own in solved], len(solver.routes), steepest)
    direction = _joined([part for own in solved for part in own.directions], (2,))
    for own in solved:
        own.directions.clear()
    return PackedFields(
        origin=np.array([grid.window.origin for grid in levels]),
        shape=np.array([grid.window.shape for grid in levels], dtype=np.int32),
        spacing=float(solver.spacing),
        width=np.array([own.width for own in classes], dtype=np.float64),
        field_of=field_of,
        offset=np.cumsum([0, *sizes], dtype=np.int64)[: len(sizes)],
        direction=direction,
        travel_time=_joined([part for own in solved for part in own.travel_times], ()),
        walls=walls,
    )


@dataclass(frozen=True)
class _Solved:
    """The fields of a class of bodies, of each route on the levels that it leads out from."""

    grids: BuildingGrids
    factor: FloatArray  # (nodes,) factor of the slowness for directions
    reaching: tuple[tuple[int, ...], ...]  # levels that each route leads out from
    directions: list[FloatArray]  # list of (n, 2) float64
    travel_times: list[FloatArray]  # list of (n,) float64: in seconds
    marched: MarchedClass

    def travel_time_on(self, route: int) -> FloatArray:
        """Return the travel times (nodes,) of a route on all grids [s]."""
        time = np.full(self.grids.size, math.inf)
        first = 0
        for level in self.reaching[route]:
            packed = self.grids.levels[level].packed
            size = packed.stop - packed.start
            time[packed] = self.travel_times[route][first : first + size]
            first += size
        return time


@dataclass(frozen=True)
class _Solver:
    """What the fields of all classes have in common; see `build_fields`."""

    building: Building
    routes: tuple[Route, ...]
    spacing: float
    clearance: float
    rates: tuple[FloatArray, ...]
    order: int
    workers: int | None
    reaching: tuple[tuple[int, ...], ...]
    shared: Shared = field(default_factory=Shared)

    def solve_classes(self, narrowest: float, classes: Sequence[BodyClass]) -> list[_Solved]:
        """Return the fields of all classes, those of the narrowest body [m] first."""
        solved = [_narrowest_class(self, narrowest)]
        for body_class in classes:
            solved.append(_over(self.solve(body_class.barred), solved[-1]))
        return solved

    def solve(self, barred: float, avoided: float = 0.0) -> _Solved:
        """Return the fields with gaps narrower than `barred` [m] as walls, and those narrower than `avoided` slow."""
        grids = build_grids(self.building, self.spacing, self.clearance, barred, self.shared)
        factor, for_directions = _slowed(grids, _factor(grids, avoided))
        bent = _bent(grids, self.clearance, for_directions) if self.clearance > 0.0 else None
        solved = _Solved(
            grids=grids,
            factor=factor if bent is None else bent,
            reaching=self.reaching,
            directions=[],
            travel_times=[],
            marched=MarchedClass(barred, [], {}),
        )
        with closing(_solve(grids, self, factor, bent)) as fields:
            for reaching, (direction, travel_time) in zip(self.reaching, fields, strict=True):
                take_halos(grids, travel_time)
                continue_values(grids, travel_time)
                solved.directions.append(_on_levels(grids, direction, reaching))
                solved.travel_times.append(_on_levels(grids, travel_time, reaching))
        return solved


def _on_levels(grids: BuildingGrids, values: FloatArray, levels: Sequence[int]) -> FloatArray:
    """Return the values on some levels, one after another."""
    if len(levels) == len(grids.levels):
        return values  # as in most cases: nothing is copied, since grids can fill the memory
    return np.concatenate([values[:0], *(values[grids.levels[level].packed] for level in levels)])


def _narrowest_class(solver: _Solver, narrowest: float) -> _Solved:
    """Return the fields of the class of the narrowest body, for which gaps that nobody fits through are walls."""
    # Ground that is reached only through such a gap has the fields of a second solution, in which they are slow
    # instead.
    own = solver.solve(narrowest)
    nodes = own.grids.own_nodes
    is_lost = any(np.isinf(own.travel_time_on(route)[nodes]).any() for route in range(len(solver.routes)))
    if not is_lost or not _has_gaps(solver.building, narrowest):
        return own
    return _over(own, solver.solve(0.0, avoided=narrowest))


def _has_gaps(building: Building, width: float) -> bool:
    """Return whether a link is narrower than a width [m], or a gap between walls."""
    return any(link.width < width for link in building.links) or any(
        len(gaps_between_walls(building, level, width)) for level in building.levels
    )


def _blocked(upper: _Solved, lower: _Solved) -> list[IndexArray]:
    """Return the nodes of each route from which only the bodies of the class below have a way."""
    routes = range(len(upper.travel_times))
    times = ([one.travel_time_on(route) for one in (upper, lower)] for route in routes)
    return [np.flatnonzero(~np.isfinite(wide) & np.isfinite(narrow)) for wide, narrow in times]


def _over(upper: _Solved, lower: _Solved) -> _Solved:
    """Fill the fields of a class with those of the class below where the destination cannot be reached."""
    upper.marched.blocked.extend(_blocked(upper, lower))
    for route in range(len(upper.directions)):
        _fill(upper, route, lower, route)
    return upper


def _fill(upper: _Solved, route: int, lower: _Solved, other: int) -> None:
    """Fill the fields of a route with those of another one where its destination cannot be reached."""
    direction, time = upper.directions[route], upper.travel_times[route]
    lost = ~np.isfinite(time)
    time[lost] = lower.travel_times[other][lost]
    lost &= np.isfinite(time) | ~direction.any(axis=1)  # nodes in walls keep the directions of their surroundings
    direction[lost] = lower.directions[other][lost]


def _levels_leading(building: Building, route: Route, anywhere: bool) -> tuple[int, ...]:
    """Return the levels that a route leads out from; `anywhere` as for `build_fields`."""
    barred = barred_on(building, route)
    routes = (route, replace(route, exits=())) if anywhere else (route,)
    ends = (ends_of_route(building, one) for one in routes)
    return tuple(sorted(set().union(*(levels_reaching(building, own, barred, bool(route.lifts)) for own in ends))))


def _lead_anywhere(solver: _Solver, solved: list[_Solved], narrowest: float, classes: Sequence[BodyClass]) -> None:
    """Lead routes to any exit from where none of their own exits can be reached."""
    own_nodes = solved[0].grids.own_nodes
    lost = [
        index
        for index, route in enumerate(solver.routes)
        if route.exits and np.isinf(solved[0].travel_time_on(index)[own_nodes]).any()
    ]
    if not lost:
        return
    others = replace(
        solver,
        routes=tuple(replace(solver.routes[index], exits=()) for index in lost),
        rates=tuple(solver.rates[index] for index in lost),
        reaching=tuple(solver.reaching[index] for index in lost),
    )
    for own, other in zip(solved, others.solve_classes(narrowest, classes), strict=True):
        for place, index in enumerate(lost):
            is_lost = np.isinf(own.travel_time_on(index))
            _fill(own, index, other, place)
            own.marched.elsewhere[index] = np.flatnonzero(is_lost & np.isfinite(own.travel_time_on(index)))


def _check_routes(building: Building, routes: Sequence[Route]) -> None:
    """Refuse routes with unknown exits or strategies."""
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
    least = least_spacing(building, n_routes, spacing, clearance)
    if least <= spacing:
        return
    alone = count_nodes(building, spacing, 0.0)
    many = f"{nodes:.2g} nodes for {n_routes} routes, more than {most:.1g}"
    if alone <= 0.5 * most:
        raise ScenarioError(
            f"directions.clearance: {clearance:g} m requires grids of {many}; reduce it (by default, it is "
            "approximately the largest body radius)"
        )
    raise ScenarioError(
        f"directions.spacing: {spacing:g} m requires grids of {many}; use at least {least:.2g} m; {measures(building)}"
    )


def least_spacing(building: Building, n_routes: int, spacing: float = SPACING, clearance: float = 0.25) -> float:
    """Return the spacing, or a larger one, at which the fields of so many routes fit into memory [m]."""
    share = count_nodes(building, spacing, clearance) * _bytes_per_node(n_routes) / MOST_BYTES
    return spacing * math.sqrt(max(share, 1.0))


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


def _factor(grids: BuildingGrids, avoided: float) -> FloatArray:
    """Return the slowness factors (nodes,): `AVOID` in gaps narrower than a width [m], 1 elsewhere."""
    if avoided == 0.0:
        return np.broadcast_to(1.0, grids.size)  # takes no memory
    factor = np.ones(grids.size)
    for grid in grids.levels:
        gaps = gaps_below(grids.building.levels[grid.level].polygon, avoided)
        factor[grid.nodes_near(gaps, grids.lattice.spacing)] = AVOID
    return factor


def _within(grids: BuildingGrids, names: Iterable[str]) -> BoolArray:
    """Mark the nodes (nodes,) in some areas, and between them and walls where no body fits."""
    # These strips, and outlines along walls, would otherwise be ways of their own, in which people are stuck at posts.
    is_within = np.zeros(grids.size, np.bool_)
    for area in (part for name in names for part in grids.building.parts_named(name)):
        grid = grids.levels[area.level]
        free = grids.building.levels[area.level].polygon - area.polygon
        strips = shapely.get_parts(free - free.buffer(-grids.clearance).buffer(grids.clearance))
        strips = strips[shapely.dwithin(strips, area.polygon, grids.lattice.spacing)]
        ground = shapely.union_all([area.polygon, *strips]).buffer(0.5 * grids.lattice.spacing, join_style="mitre")
        shapely.prepare(ground)
        inside = shapely.intersects_xy(ground, *grid.window.coordinates()) & (grid.sheet == OWN)
        is_within[grid.packed] |= inside.ravel()
    return is_within


def _slowed(grids: BuildingGrids, factor: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return slowness factors (nodes,) for travel times and for directions, greater in slow and in barred areas."""
    # For directions, what barred areas cut off from all exits is as slow as these: otherwise, people who have no other
    # way would walk along the edge of the area, and queue at a corner of it.
    building = grids.building
    if not building.has_areas_to_heed:
        return factor, factor
    factor = factor.copy()
    for name, share in sorted(building.slowed):
        factor[_within(grids, [name])] /= share
    if not building.barred:
        return factor, factor
    barred = _within(grids, building.barred)
    pairs, ends = [], []
    for grid in grids.levels:
        ground, source = grids.is_ground(grid), grid.source.reshape(grid.window.shape)
        for one, two in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
            linked = ground[one] & ground[two]
            pairs.append(np.stack([source[one][linked], source[two][linked]], axis=1))
        ways = [way for way in building.exits_of(grid.level) if building.is_open(way)]
        doors = np.concatenate([np.zeros((0, 4)), *(way.segments for way in ways)])
        ends.append(grid.nodes_near(doors, grids.lattice.spacing))
    links = np.concatenate(pairs)
    part = connected_components(grids.size, links[~barred[links].any(axis=1)].astype(np.int64))
    is_cut_off = grids.own_nodes & ~np.isin(part, part[np.concatenate(ends)])
    return factor * np.where(barred, BARRED, 1.0), factor * np.where(barred | is_cut_off, BARRED, 1.0)


def _bent(grids: BuildingGrids, clearance: float, avoided: FloatArray) -> FloatArray:
    """Return the slowness factors (nodes,) near walls, times those of `avoided`; see `build_fields`."""
    factor = avoided.copy()
    for grid in grids.levels:
        factor[grid.ring] *= 1.0 + BEND * (1.0 - grid.distance / clearance) ** 2
    return factor


def _solve(
    grids: BuildingGrids, solver: _Solver, avoided: FloatArray, bent: FloatArray | None
) -> Generator[tuple[FloatArray, FloatArray], None, None]:
    """Yield directions (nodes, 2) and travel times (nodes,) to the exits of each route on all grids, as marched."""
    building, problems = grids.building, []
    for route, rate in zip(solver.routes, solver.rates, strict=True):
        problems.append(EikonalProblem.of(building, route, rate, avoided, is_plain=not building.has_areas_to_heed))
        if bent is not None:
            problems.append(replace(problems[-1], factor=bent, is_plain=False))
    memory = _memory_of_workers(grids.size, len(solver.routes))
    workers = number_of_workers(grids, len(problems), memory, solver.workers)
    with closing(march_all(grids, problems, solver.order, workers)) as costs:
        for route in solver.routes:
            plain = next(costs)
            cost = plain if bent is None else next(costs)
            yield _directions(grids, cost, exits_of_route(building, route)), plain


def _rates(route: Route, speeds: tuple[float, float, float], comfort: float) -> FloatArray:
    """Return the costs (3,) per metre along the slope in each use, for a route [s/m]."""
    rates = np.ones(3) if route.strategy == "shortest" else 1.0 / np.array(speeds, dtype=np.float64)
    if route.strategy == "comfortable":
        rates[1:] *= comfort
    if route.lifts == PREFERRED:
        rates[1:] *= RELUCTANCE
    return rates


def _directions(grids: BuildingGrids, cost: FloatArray, exits: list[Exit]) -> FloatArray:
    """Return unit vectors (nodes, 2): steepest descent, exit normals behind exits, extended into walls."""
    direction = np.zeros((grids.size, 2))
    for grid in grids.levels:
        chosen = (grid.sheet == OWN).view(np.uint8)
        packed = direction[grid.packed]
        own_cost = cost[grid.packed].reshape(grid.window.shape)
        descend(own_cost, ONE_LABEL, chosen, grids.lattice.spacing, packed)
        lead_through_doors(grid, own_cost, packed)
        strips = strips_of(grids, grid)
        for exit_ in exits:
            if exit_.level == grid.level:
                strip = strips[exit_.index]
                nodes = np.stack(np.unravel_index(strip, grid.window.shape), axis=1)
                packed[strip] = outward_directions(exit_.segments, grid.window.places(nodes))
    take_halos(grids, direction)
    shared = Shared()
    for grid in grids.levels:
        own = direction[grid.packed].reshape(*grid.window.shape, 2)
        pointing = np.any(own != 0.0, axis=2)
        halo = grids.is_ground(grid) & (grid.sheet != OWN)
        reached = np.isfinite(cost[grid.packed].reshape(grid.window.shape))
        left_out, stand_in, _ = grid.stands_for
        direction[left_out] = direction[stand_in]
        known = pointing & ~halo
        missing = (~pointing & reached) | grids.is_beside(grid) | ((grid.sheet > OWN) & ~pointing)
        missing.ravel()[left_out - grid.offset] &= ~np.any(direction[stand_in] != 0.0, axis=1)
        # Halo nodes that were left out lead through their portal, as those beside them do.
        leading = pointing & halo
        cut = missing & grown(leading, 1)
        own[cut] = own[nearest_marked(leading, cut)]
        if known.any():
            missing &= ~cut
            masks = known.tobytes(), missing.tobytes(), known.shape
            own[missing] = own[shared.get(partial(nearest_marked, known, missing), *masks)]
    return direction
