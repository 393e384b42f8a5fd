"""Fast marching through a building, level by level, through the halos of portals; several marches at the same time.

scikit-fmm holds the lock of the interpreter, so that threads would march one after another. A worker process is sent
the grids once, and then the problem of each march; it answers with the costs.
"""

import heapq
import math
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import shapely
import skfmm
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from evac.base.arrays import FloatArray, IndexArray
from evac.base.progress import show_steps
from evac.building.model.building import DOWN, FLAT, UP, Area, Exit, Portal
from evac.directions.march import EikonalProblem, EikonalSolver
from evac.directions.raster.grids import OWN, RING, BuildingGrids, LevelGrid, use_towards
from evac.directions.raster.lattice import SLACK, points_along
from evac.jit.loading import cores

#: Largest remaining cost difference at a portal, in units of the time per cell.
TOLERANCE = 0.25

#: Slowness factor of slits, which no body fits through: they lead to times of their own ground only.
SLIT = 10.0

#: Rounding error of two marches through levels that are alike, relative in speeds and of contours in cells: only the
#: first is made.
ALIKE = 1e-9


class FastMarching(EikonalSolver):
    """The solver of fields that stand still, by scikit-fmm.

    A level is marched from the exits on it, and from each portal behind which the cost is lower. A march from a portal
    starts at the contour of the neighbour's field at its minimum on the portal. This contour is in the halo, so that
    the wave reaches the portal as it does on the grid of the neighbour. Portals are processed in the order of this
    minimum until the cost of no level decreases any more. Ways end at an exit or an area with its cost, and at the
    start of a jump with its time and the cost at its end. `told` is called with the number of levels that have been
    reached so far.
    """

    def __init__(
        self, grids: BuildingGrids, problem: EikonalProblem, order: int, told: Callable[[int], object] | None = None
    ) -> None:
        super().__init__(grids, problem)
        self.order, self.told = order, told
        self.spacing = grids.lattice.spacing
        self.jumps = grids.jumps(problem.lifts)
        #: By level, the numbers of the jumps that end on it.
        self.jumps_to: dict[int, list[int]] = {}
        for k, level in enumerate(
            np.searchsorted([one.offset for one in grids.levels], [one.end for one in self.jumps], side="right")
        ):
            self.jumps_to.setdefault(int(level) - 1, []).append(k)
        alike = [grid.alike for grid in grids.levels]
        self.repeated = {level for level in alike if alike.count(level) > 1}

    def solve(self) -> FloatArray:
        """Return the minimum cost (nodes,): that of own nodes and of halos as marched with each level."""
        self.cost = np.full(self.grids.size, math.inf)
        #: Cost, portal and level entered; instead of a portal, -1 for doors of one direction, -2 - k for jump k.
        self.pending: list[tuple[float, int, int]] = []
        #: Number of times that the cost of each level decreased.
        self.falls = [0] * len(self.grids.levels)
        #: Per (portal, level entered): decreases of the level behind, and the last cost marched from since then.
        self.tried: dict[tuple[int, int], tuple[int, float]] = {}
        #: Per portal: the cost difference that is tolerated at points along it, and these points on each level.
        self.tolerated: dict[int, tuple[FloatArray, dict[int, _Points]]] = {}
        #: Marches through levels that others are like, by the first of these and the portal: speed, contour, times.
        self.made: dict[tuple[int, bytes], list[tuple[FloatArray, FloatArray, FloatArray]]] = {}
        exits = self.problem.ends
        for grid in self.grids.levels:
            areas = [one for one in exits if isinstance(one, Area) and one.level == grid.level]
            for area in areas:
                self._march_from_area(area, self.grids.building.cost_of(area))
            alike: dict[tuple[int, int, float], list[Exit]] = {}
            for exit_ in exits:
                if isinstance(exit_, Exit) and exit_.level == grid.level:
                    level = self.grids.building.levels[grid.level]
                    use, rows = use_towards(level, exit_.segments), grid.strip_rows[exit_.index]
                    alike.setdefault((use, rows, self.grids.building.cost_of(exit_)), []).append(exit_)
            for (use, rows, cost), some in sorted(alike.items()):
                self._march_from_exits(grid, use, rows, cost, some)
            if alike or areas:
                self._queue_portals(grid.level)
        while self.pending:
            _, portal, entered = heapq.heappop(self.pending)
            if portal < -1:
                self._jump(-2 - portal)
            elif portal < 0:
                self._march_through_doors(self.grids.levels[entered])
            else:
                self._enter(self.grids.building.portals[portal], entered)
            if self.told is not None:
                self.told(sum(map(bool, self.falls)))
        return self.cost

    def _queue_portals(self, level: int) -> None:
        """Add all portals of a level to the queue, in both directions, its doors of one direction, and jumps to it."""
        through = self._times_before_doors(self.grids.levels[level])
        if np.isfinite(through).any():
            heapq.heappush(self.pending, (float(through.min()), -1, level))
        for k in self.jumps_to.get(level, ()):
            if self._is_lowered(k):
                heapq.heappush(self.pending, (self._after_jump(k), -2 - k, self.jumps[k].area.level))
        for portal in self.grids.portals_of(level):
            for entered in portal.levels:
                if (portal.index, entered) in self.problem.barred:
                    continue
                start = self._start(portal, entered)
                if start < math.inf and self.grids.building.leads_from(portal, entered):
                    heapq.heappush(self.pending, (start, portal.index, entered))

    def _after_jump(self, number: int) -> float:
        """Return the cost at the start of a jump by this jump."""
        return self.jumps[number].time + float(self.cost[self.jumps[number].end])

    def _jump(self, number: int) -> None:
        """March from the start of a jump, if this lowers the cost there."""
        if self._is_lowered(number):
            area = self.jumps[number].area
            self._march_from_area(area, self._after_jump(number))
            self._queue_portals(area.level)

    def _is_lowered(self, number: int) -> bool:
        """Return whether a jump lowers the cost at its start."""
        jump = self.jumps[number]
        slowness = float(self.problem.slowness[jump.area.level, FLAT])
        cost = self._after_jump(number) + jump.away * slowness
        return bool((cost < self.cost[jump.nodes] - TOLERANCE * self.spacing * slowness).any())

    def _start(self, portal: Portal, entered: int) -> float:
        """Return the minimum cost on a portal where the level behind has a lower cost than `entered`; inf if nowhere.

        Costs that were marched from before are used again only if the level behind has decreased since. More than one
        march may be needed because a wave from the minimum cost is not the first one everywhere, for example if two
        exits are behind a wide portal.
        """
        beyond = portal.other(entered)
        if not self.falls[beyond]:  # as that of most cars: it has no cost
            return math.inf
        slack, points = self._tolerated(portal)
        behind = points[beyond].mean(self.cost)
        falls, before = self.tried.get((portal.index, entered), (-1, -math.inf))
        here = points[entered].mean(self.cost)
        lower = behind < np.subtract(here, slack, out=here, where=np.isfinite(here))
        if falls == self.falls[beyond]:
            lower &= behind > before + self._step(portal)
        return float(behind[lower].min()) if lower.any() else math.inf

    def _tolerated(self, portal: Portal) -> tuple[FloatArray, "dict[int, _Points]"]:
        """Return the cost difference that is tolerated at points along a portal, inf in slits, and these points."""
        if portal.index not in self.tolerated:
            places, _ = points_along(portal.segments, 0.5 * self.spacing)
            points = {level: _Points.of(self.grids.levels[level], places) for level in portal.levels}
            factor = np.maximum(*(points[level].mean(self.problem.factor) for level in portal.levels))
            slack = self._step(portal) * np.where(factor > SLIT, math.inf, factor)
            self.tolerated[portal.index] = slack, points
        return self.tolerated[portal.index]

    def _step(self, portal: Portal) -> float:
        """Return the cost difference that is tolerated at a portal [s]."""
        return TOLERANCE * self.spacing * float(self.problem.slowness[list(portal.levels)].max())

    def _enter(self, portal: Portal, level: int) -> None:
        """March a level from one of its portals, if this lowers its cost."""
        start = self._start(portal, level)
        if start == math.inf:
            return
        self.tried[portal.index, level] = (self.falls[portal.other(level)], start)
        self._march_from_portal(self.grids.levels[level], portal, start)
        self._queue_portals(level)

    def _march_from_exits(self, grid: LevelGrid, use: int, rows: int, cost: float, exits: list[Exit]) -> None:
        """March from the lines of exits with a given cost, whose strips have a given number of `rows`."""
        # A plain field starts at an exact ring around the lines, since the field has a kink at the ends of a line,
        # which reduces the accuracy of the second-order stencil. A field with clearance starts behind the exits, half a
        # cell before the last row of nodes that is certainly in the strip. Without a strip, it starts at a ring around
        # the middle of each exit, at a clearance from its posts.
        behind = np.isin(grid.sheet, [1 + self.grids.building.link_of(exit_) for exit_ in exits])
        walkable = behind | self.grids.is_ground(grid)
        ring = (RING if self.problem.is_plain or rows == 0 else 1.5 - rows) * self.spacing
        off_posts = self.grids.clearance if rows == 0 and not self.problem.is_plain else 0.0
        lines = shapely.multilinestrings([line for exit_ in exits for line in _middles(exit_.segments, off_posts)])
        # At larger distances, phi is the spacing.
        distance = self._distance_from(grid, lines, behind, max(0.0, ring + self.spacing))
        distance[behind] *= -1.0
        self._march_from_ring(grid, distance, ring, use, cost, walkable)

    def _march_from_area(self, area: Area, cost: float) -> None:
        """March from a ring around the innermost point of an area, which has a cost."""
        grid = self.grids.levels[area.level]
        distance, ring = grid.distances_from(area), RING * self.spacing
        self._march_from_ring(grid, distance, ring, FLAT, cost, self.grids.is_ground(grid))

    def _march_from_ring(
        self, grid: LevelGrid, distance: FloatArray, ring: float, use: int, cost: float, walkable: NDArray[np.bool_]
    ) -> None:
        """March from where a distance is that of a ring [m], within which that of the distance is added to a cost."""
        slowness = self.problem.slowness[grid.level, use]
        exact = walkable & (distance <= ring)
        known = cost + distance[exact] * slowness
        phi = np.subtract(distance, ring, out=distance)
        time = self._solve(grid, np.minimum(phi, self.spacing, out=phi), use, None, walkable)
        if time is None:
            # No nodes outside the ring, as on a level with few cells.
            time = np.full(phi.shape, math.inf)
        time += cost + ring * slowness
        time[exact] = known
        self._lower(grid, time)

    def _distance_from(
        self, grid: LevelGrid, lines: BaseGeometry, behind: NDArray[np.bool_], reach: float
    ) -> FloatArray:
        """Return the distance of nodes from lines on exits.

        It is given for nodes `behind` the exits and for own nodes within `reach` [m] of the lines, and inf for all
        other nodes and for own nodes hidden by a wall.
        """
        x, y = grid.window.coordinates()
        distance = np.full(x.shape, math.inf)
        near = grid.window.around(shapely.get_parts(lines), reach)
        near &= grid.sheet == OWN
        nodes = behind | near
        shapely.prepare(lines)
        distance[nodes] = shapely.distance(lines, shapely.points(x[nodes], y[nodes]))
        close = np.argwhere(near)
        building = self.grids.building
        walls = building.walls[building.wall_level == grid.level].reshape(-1, 2, 2)
        if len(close) and len(walls):
            barrier = shapely.multilinestrings(shapely.linestrings(walls))
            shapely.prepare(barrier)
            sight = shapely.shortest_line(shapely.points(grid.window.places(close)), lines)
            # Exclude the ends: a node may be on a wall, and walls begin at the ends of an exit.
            ends = shapely.get_coordinates(sight).reshape(-1, 2, 2)
            inner = np.array([[0.99, 0.01], [0.01, 0.99]]) @ ends
            hidden = shapely.crosses(barrier, shapely.linestrings(inner))
            ground = shapely.buffer(building.levels[grid.level].polygon, SLACK * self.spacing, join_style="mitre")
            shapely.prepare(ground)
            hidden |= ~shapely.covers(ground, sight)
            distance[tuple(close[hidden].T)] = math.inf
        return distance

    def _march_from_portal(self, grid: LevelGrid, portal: Portal, start: float) -> None:
        """March from the neighbour's contour at `start`."""
        neighbour = self.grids.levels[portal.other(grid.level)]
        phi = np.full(grid.window.shape, math.inf)
        shared = grid.source >= 0
        shared &= (grid.source >= neighbour.offset) & (grid.source < neighbour.packed.stop)
        phi[shared] = self.cost[grid.source[shared]] - start
        here, there = grid.window.overlap(neighbour.window)
        neighbour_cost = self.cost[neighbour.packed].reshape(neighbour.window.shape)
        ours = (grid.sheet[here] == OWN) & (neighbour.sheet[there] == 1 + portal.index)
        phi[here][ours] = neighbour_cost[there][ours] - start
        on_portal, theirs = grid.seams[portal.index]
        on_portal = on_portal - grid.offset
        phi.ravel()[on_portal] = self.cost[theirs] - start
        level = self.grids.building.levels[grid.level]
        walkable = self.grids.is_ground(grid)
        below = walkable & (phi <= 0.0)
        cost_below = start + phi[below]
        phi[~np.isfinite(phi)] = self.spacing
        time = self._solve(grid, phi, use_towards(level, portal.segments), portal, walkable)
        if time is None:
            return
        time += start
        time[below] = cost_below
        self._lower(grid, time)

    def _times_before_doors(self, grid: LevelGrid) -> FloatArray:
        """Return the costs (d,) of nodes before doors of one direction by these, inf where they are not lower."""
        before, behind = grid.passages
        first, second = (np.stack(np.unravel_index(nodes - grid.offset, grid.window.shape)) for nodes in grid.passages)
        away = self.spacing * np.hypot(*(first - second))
        slowness = self.problem.slowness[grid.level, FLAT]
        time = self.cost[behind] + away * slowness * self.problem.factor[before]
        return np.where(time < self.cost[before] - TOLERANCE * self.spacing * slowness, time, math.inf)

    def _march_through_doors(self, grid: LevelGrid) -> None:
        """March from the nodes before doors of one direction, if these lower the cost of the level."""
        through = self._times_before_doors(grid)
        start = float(through.min(initial=math.inf))
        if start == math.inf:
            return
        slowness = self.problem.slowness[grid.level, FLAT]
        nodes, by_node = np.unique(grid.passages[0][np.isfinite(through)] - grid.offset, return_inverse=True)
        known = np.full(len(nodes), math.inf)
        np.minimum.at(known, by_node, through[np.isfinite(through)])
        phi = np.full(grid.window.shape, self.spacing)
        phi.ravel()[nodes] = np.minimum((known - start) / slowness - 0.5 * self.spacing, self.spacing)
        time = self._solve(grid, phi, FLAT, None, self.grids.is_ground(grid))
        if time is None:
            return
        time += start
        time.ravel()[nodes] = np.minimum(time.ravel()[nodes], known)
        self._lower(grid, time)
        self._queue_portals(grid.level)

    def _solve(
        self, grid: LevelGrid, phi: FloatArray, use: int, through: Portal | None, walkable: NDArray[np.bool_]
    ) -> FloatArray | None:
        """Return the cost from the zero contour of `phi`, inf where no wave arrives; None without a contour."""
        if not _has_contour(phi, walkable):
            return None
        by_sheet = self._slowness_by_sheet(grid, use, through)
        slowness = by_sheet[grid.sheet]
        if through is not None:
            # A wave that grazes the portal propagates along it at the larger of the two speeds.
            on_portal = grid.seams[through.index][0] - grid.offset
            slowness.ravel()[on_portal] = min(by_sheet[OWN], by_sheet[1 + through.index])
        halo = self.grids.is_ground(grid) & (grid.sheet != OWN)
        beyond = slowness[halo] * self.problem.factor[grid.source[halo]]
        slowness *= self.problem.factor[grid.packed].reshape(slowness.shape)
        slowness[halo] = beyond
        speed = np.divide(1.0, slowness, out=slowness)
        if grid.alike not in self.repeated:
            return self._marched(phi, speed, walkable)
        made = self.made.setdefault((grid.alike, b"" if through is None else through.segments.tobytes()), [])
        for other_speed, contour, times in made:
            is_alike = (np.abs(speed - other_speed) <= ALIKE * speed).all()
            if is_alike and np.abs(phi - contour).max() <= ALIKE * self.spacing:
                return times.copy()
        given = speed.copy(), phi.copy()
        times = self._marched(phi, speed, walkable)
        made.append((*given, times.copy()))
        return times

    def _marched(self, phi: FloatArray, speed: FloatArray, walkable: NDArray[np.bool_]) -> FloatArray:
        """Return the cost from the zero contour of `phi`, inf where no wave arrives."""
        # The march takes some ten times the memory of an array of its nodes: nothing is copied here.
        front = np.ma.array(phi, mask=~walkable)
        cost = skfmm.travel_time(front, speed, dx=self.spacing, order=self.order)
        if (cost < 0.0).any():  # where the speed jumps, the second-order stencil may extrapolate below the front
            cost = skfmm.travel_time(front, speed, dx=self.spacing, order=1)
        times: FloatArray = np.ma.getdata(cost)
        times[np.ma.getmaskarray(cost)] = math.inf
        return times

    def _slowness_by_sheet(self, grid: LevelGrid, use: int, through: Portal | None) -> FloatArray:
        """Return the cost per metre on each sheet: walking from halos to this level, or into the halo `through`."""
        building = self.grids.building
        table: FloatArray = np.full(building.n_links + 2, self.problem.slowness[grid.level, use])
        for portal in self.grids.portals_of(grid.level):
            beyond = portal.other(grid.level)
            towards_us = use_towards(building.levels[beyond], portal.segments)
            away = {FLAT: FLAT, UP: DOWN, DOWN: UP}[towards_us]
            table[1 + portal.index] = self.problem.slowness[beyond, away if portal is through else towards_us]
        return table

    def _lower(self, grid: LevelGrid, time: FloatArray) -> None:
        """Update the costs of a level where the new ones are lower."""
        cost = self.cost[grid.packed]
        new = time.ravel()
        noticed = TOLERANCE * self.spacing * self.problem.slowness[grid.level].min()
        self.falls[grid.level] += bool((new < cost - noticed).any())
        np.minimum(cost, new, out=cost)


class _Points(NamedTuple):
    """Points on a level, for interpolation."""

    nodes: IndexArray  # (4, p) int64: packed indices of the nodes around each
    weights: FloatArray  # (4, p) float64: their weights

    @classmethod
    def of(cls, grid: LevelGrid, places: FloatArray) -> "_Points":
        """Return the points at places (p, 2) [m]."""
        cells = (places - grid.window.origin) / grid.window.lattice.spacing
        (ix, iy), (fx, fy) = np.floor(cells).astype(np.int64).T, (cells - np.floor(cells)).T
        corners = ((0, 0), (0, 1), (1, 0), (1, 1))
        nodes = [grid.offset + np.ravel_multi_index((ix + a, iy + b), grid.window.shape) for a, b in corners]
        # A corner of weight zero is used if it is the only one with a value.
        weights = [np.abs(1 - a - fx) * np.abs(1 - b - fy) + 1e-12 for a, b in corners]
        return cls(np.stack(nodes), np.stack(weights))

    def mean(self, values: FloatArray) -> FloatArray:
        """Interpolate packed values at the points, from the nodes with finite values; inf without one."""
        around = values[self.nodes]
        is_known = np.isfinite(around)
        weights = np.where(is_known, self.weights, 0.0)
        total, weight = (weights * np.where(is_known, around, 0.0)).sum(axis=0), weights.sum(axis=0)
        return np.where(weight > 0.0, total / np.where(weight > 0.0, weight, 1.0), math.inf)


def _has_contour(phi: FloatArray, walkable: NDArray[np.bool_]) -> bool:
    """Return whether phi changes its sign between two neighbouring walkable nodes."""
    below, above = walkable & (phi <= 0.0), walkable & (phi > 0.0)
    return bool(
        (below & (phi < 0.0)).any()
        and (
            (below[1:] & above[:-1] | above[1:] & below[:-1]).any()
            or (below[:, 1:] & above[:, :-1] | above[:, 1:] & below[:, :-1]).any()
        )
    )


def _middles(segments: FloatArray, off_ends: float) -> list[BaseGeometry]:
    """Return the lines of an exit shortened by `off_ends` [m] at each end, but at least half of each line."""
    lines = shapely.linestrings(segments.reshape(-1, 2, 2))
    if off_ends == 0.0:
        return list(lines)
    middles = []
    for line in shapely.get_parts(shapely.line_merge(shapely.multilinestrings(lines))):
        off = 0.0 if line.is_closed else min(off_ends, 0.25 * line.length)
        middles.append(substring(line, off, line.length - off))
    return middles


#: What takes this time, in words.
DIRECTIONS = "computing directions"

#: A worker pays from so many nodes on, counted once for each march: it takes a quarter of a second to start.
NODES_PER_WORKER = 2_500_000

#: Memory of a worker [bytes]: of the process, per node of all grids, and per node of the largest grid for its march.
WORKER_BYTES, WORKER_NODE_BYTES, MARCH_BYTES = 6e7, 40.0, 100.0


def number_of_workers(grids: BuildingGrids, marches: int, memory: float, wanted: int | None) -> int:
    """Return how many processes march at the same time; 1 means that this process does.

    All workers may take `memory` [bytes]; at most `wanted` are started, None means one for each core.
    """
    each = WORKER_BYTES + WORKER_NODE_BYTES * grids.size + MARCH_BYTES * max(grid.sheet.size for grid in grids.levels)
    most = (wanted or cores(), cores(), marches, grids.size * marches // NODES_PER_WORKER, int(memory // each))
    return max(1, min(most))


def march_all(
    grids: BuildingGrids, problems: Sequence[EikonalProblem], order: int, workers: int
) -> Generator[FloatArray, None, None]:
    """Yield the costs (nodes,) of problems in their order, with the same bits for any number of workers.

    What the workers do not answer, because one could not be started or was killed, is marched in this process.
    """
    futures: deque[Future[FloatArray]] = deque()
    with ExitStack() as stack:
        if workers > 1:
            from evac.base.processes import Pool

            with suppress(OSError, BrokenExecutor):
                pool = stack.enter_context(Pool(workers, _take, (grids, order), is_quiet=True))
                for problem in problems:
                    factor = problem.factor[:1] if problem.factor.strides == (0,) else problem.factor  # one number
                    futures.append(pool.submit(_march, replace(problem, factor=factor)))
        levels, count = len(grids.levels), len(problems) * len(grids.levels)
        for number, problem in enumerate(problems):
            done = number * levels
            show_steps(DIRECTIONS, done, count)
            cost = _answer(futures.popleft()) if futures else None
            if cost is None:
                told = partial(lambda before, reached: show_steps(DIRECTIONS, before + reached, count), done)
                cost = FastMarching(grids, problem, order, told).solve()
            yield cost
        show_steps(DIRECTIONS, count, count)


def _answer(future: "Future[FloatArray]") -> FloatArray | None:
    """Return the answer of a worker; None if it died, or could not march for lack of memory, for example."""
    try:
        return future.result()
    except Exception:
        return None


# Worker process

_given: list[tuple[BuildingGrids, int]] = []


def _take(grids: BuildingGrids, order: int) -> None:
    """Keep what all marches need."""
    _given.append((grids, order))


def _march(problem: EikonalProblem) -> FloatArray:
    """Return the costs of a problem."""
    ((grids, order),) = _given
    return FastMarching(grids, replace(problem, factor=np.broadcast_to(problem.factor, grids.size)), order).solve()
