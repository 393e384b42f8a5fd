"""Travel times that are solved again during a run, with speeds that fall with the density, for the strategy "quickest".

The directions of other strategies belong to an empty building. Those of this one follow the crowd: every few seconds,
the density is found from the places of people, and the routes are solved again on the grids of the building with the
relative speed of Weidmann (1993),

    f = 1 - exp(-1.913 (1 / rho - 1 / 5.4)),    at least `floor`.

The density rho is the sum of Gauss kernels of people, divided by the share of the kernel that lies on the floor, and
averaged over time. A level is solved again only if f has changed on it, or if its ways lead through a level that is.
"""

import math
import time
from collections.abc import Mapping, Set
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from evac.base.defaults import LEAST_FLOOR
from evac.base.saved import taken
from evac.building.model.building import Exit
from evac.directions.descent import descend
from evac.directions.fields import Fields, columns_of
from evac.directions.lengths import exits_of_route, make_ways, routes_at_present, strips_of
from evac.directions.raster.grids import NOTHING, OWN, BuildingGrids
from evac.directions.raster.masks import nearest_marked
from evac.directions.raster.strips import chain
from evac.directions.routes import QUICKEST
from evac.directions.waves import APART, CUT, FAR, FINAL, Waves, deposit, march_waves

#: Weidmann (1993): decline of the speed [1/m2], and the density at which people stand [1/m2].
DECLINE, JAM = 1.913, 5.4

#: Density below which people walk at their own speed; the law has 1 - 1e-16 there [1/m2].
NOBODY = 0.05

#: A level is solved again if the relative speed has changed by more than this share at one of its nodes.
NOTICED = 0.05

#: Least share of a kernel on the floor by which a density is divided, so that a narrow place is not taken for full.
LEAST_SHARE = 0.2


class Settings(Protocol):
    """Parameters of the strategy, see `[directions.quickest]`."""

    period: float
    width: float
    memory: float
    floor: float
    hesitation: float


def relative_speed(density: FloatArray, floor: float) -> FloatArray:
    """Return the speed at a density [1/m2] over that of a single person."""
    speed = np.ones_like(density)
    dense = density > NOBODY
    speed[dense] = np.clip(-np.expm1(-DECLINE * (1.0 / density[dense] - 1.0 / JAM)), floor, 1.0)
    return speed


class Quickest:
    """The routes with the strategy "quickest" of a run, and the density that they avoid.

    Parameters
    ----------
    fields : Fields
        Directions of the building, with the grids that they were solved on; not changed.
    settings : Settings
    before : Quickest, optional
        Those of the same run before a link was opened or closed, whose densities and counts are kept.

    Attributes
    ----------
    fields : Fields
        With travel times and directions of their own, which `update` changes in place.
    """

    def __init__(self, fields: Fields, settings: Settings, before: "Quickest | None" = None) -> None:
        packed = fields.packed
        own = packed.replace(direction=packed.direction.copy(), travel_time=packed.travel_time.copy())
        self.fields = replace(fields, packed=own, uncongested=fields)
        self._settings = settings
        grids = fields.grids[0].grids
        self._first = np.array([grid.offset for grid in grids.levels], dtype=np.int64)
        self._grids, self._weight = grids, _weights_on_floor(grids, settings.width)
        self._columns: list[_Column] = []
        routes = len(fields.routes)
        for number, of_class in enumerate(fields.grids):
            for index, route in enumerate(fields.routes):
                if route.strategy == QUICKEST:
                    lower = self._columns[-sum(one.strategy == QUICKEST for one in fields.routes)] if number else None
                    blocked = fields.marched.classes[number].blocked if fields.marched else ()
                    self._columns.append(
                        _Column(
                            fields,
                            own.travel_time,
                            own.direction,
                            number * routes + index,
                            of_class.factor,
                            of_class.grids,
                            blocked[index] if blocked else np.zeros(0, np.int64),
                            lower,
                            settings.hesitation,
                        )
                    )
        self._is_solved = False
        if before is None:
            self._density, self._speed = np.zeros(grids.size), np.ones(grids.size)
            self._exit_of, self._left = np.zeros(0, np.int32), np.zeros((0, len(grids.building.exits)), np.uint8)
            self._counts = np.zeros(4, np.int64)  # updates, levels solved, changes of exit, returns to an exit
            self._seconds = 0.0
        else:
            self._density = _at_nodes_of(grids, before._density, before._grids, 0.0)
            self._speed = _at_nodes_of(grids, before._speed, before._grids, 1.0)
            self._exit_of, self._left = before._exit_of, before._left
            self._counts, self._seconds = before._counts, before._seconds

    def is_due(self, tick: int, length: float) -> bool:
        """Return whether an update is due at a tick of this length [s]: each period, and when links have changed."""
        return not self._is_solved or tick % max(1, round(self._settings.period / length)) == 0

    def update(self, level: IntArray, position: FloatArray, route: IntArray, radius: FloatArray) -> None:
        """Solve the routes again for people at these places.

        Parameters
        ----------
        level : (n,) int32
            -1 for those who have left.
        position : (n, 2) float64 [m]
        route : (n,) int32
        radius : (n,) float64
            Radii of the bodies, by which they fit through gaps [m].
        """
        began = time.process_time()
        changed = self._changed_levels(level, position)
        columns = columns_of(self.fields.packed, route, radius)
        for column in self._columns:
            occupied = set(np.unique(level[(columns == column.number) & (level >= 0)]).tolist())
            self._counts[1] += column.solve(changed, occupied, self._speed, not self._is_solved)
        self._counts[0] += 1
        self._is_solved = True
        if len(self._exit_of) < len(level):
            self._exit_of = np.full(len(level), -1, np.int32)
            self._left = np.zeros((len(level), self._left.shape[1]), np.uint8)
        self._count_changes(level, position, columns)
        self._seconds += time.process_time() - began

    def report(self) -> dict[str, float]:
        """Return what the summary of a run says about the updates."""
        names = "updates", "levels_solved", "exit_changes", "exit_returns"
        return {**dict(zip(names, self._counts.tolist(), strict=True)), "cpu_seconds": self._seconds}

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of the arrays that are needed to continue with the same bits."""
        state: dict[str, NDArray[Any]] = {
            "density": self._density.copy(),
            "speed": self._speed.copy(),
            "exit_of": self._exit_of.copy(),
            "left": self._left.copy(),
            "counts": self._counts.copy(),
            "seconds": np.array(self._seconds),
            "is_solved": np.array(self._is_solved, np.uint8),
        }
        for number, column in enumerate(self._columns):
            waves = column.waves
            state |= {
                f"travel_time.{number}": column.values(self.fields.packed.travel_time),
                f"direction.{number}": column.values(self.fields.packed.direction),
                f"stale.{number}": np.array(sorted(column.stale), np.int64),
                f"time.{number}": waves.time.copy(),
                f"exit.{number}": waves.exit.copy(),
                f"former.{number}": waves.former.copy(),
                f"leans.{number}": waves.leans.copy(),
            }
        return state

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned.

        Raises
        ------
        SavedError
            An array is not what `state` returns.
        """
        exits = len(self._grids.building.exits)
        self._density[:] = taken(state, "density", np.float64, self._density.shape, 0.0, np.inf)
        self._speed[:] = taken(state, "speed", np.float64, self._speed.shape, LEAST_FLOOR, 1.0)
        self._exit_of = taken(state, "exit_of", np.int32, (None,), -1, exits - 1)
        self._left = taken(state, "left", np.uint8, (len(self._exit_of), exits), 0, 1)
        self._counts[:] = taken(state, "counts", np.int64, self._counts.shape, 0, np.iinfo(np.int64).max)
        self._seconds = float(taken(state, "seconds", np.float64, (), 0.0, np.inf))
        self._is_solved = bool(taken(state, "is_solved", np.uint8, (), 0, 1))
        for number, column in enumerate(self._columns):
            waves = column.waves
            column.slow_down(self._speed)
            waves.time[:] = taken(state, f"time.{number}", np.float64, waves.time.shape, -np.inf, np.inf)
            waves.exit[:] = taken(state, f"exit.{number}", np.int32, waves.exit.shape, -1, exits - 1)
            waves.former[:] = taken(state, f"former.{number}", np.int32, waves.exit.shape, -1, exits - 1)
            waves.leans[:] = taken(state, f"leans.{number}", np.uint8, waves.leans.shape, 0, 1)
            column.stale = set(taken(state, f"stale.{number}", np.int64, (None,), 0, len(self._first) - 1).tolist())
            size = len(column.values(self.fields.packed.travel_time))
            column.take(
                taken(state, f"travel_time.{number}", np.float64, (size,), -np.inf, np.inf),
                taken(state, f"direction.{number}", np.float64, (size, 2)),
            )

    def _changed_levels(self, level: IntArray, position: FloatArray) -> set[int]:
        """Find the density, and the speeds that follow from it; return the levels on which they have changed."""
        settings, packed = self._settings, self.fields.packed
        found = np.zeros(len(self._density))
        deposit(position, level, packed.origin, packed.shape, self._first, packed.spacing, settings.width, found)
        occupied = set(np.unique(level[level >= 0]).tolist())
        changed = set()
        gain = -math.expm1(-settings.period / settings.memory) if settings.memory > 0.0 and self._counts[0] else 1.0
        for grid in self._grids.levels:
            near = {portal.other(grid.level) for portal in self._grids.portals_of(grid.level)}
            density = self._density[grid.packed]
            if not occupied & {grid.level, *near} and not density.any():
                continue
            now = found[grid.packed].copy()
            for portal in self._grids.portals_of(grid.level):
                # People close behind a portal: their kernels reach into its halo on their own level.
                there = self._grids.levels[portal.other(grid.level)]
                halo = (there.sheet == 1 + portal.index).ravel()
                now[there.source.ravel()[halo] - grid.offset] += found[there.packed][halo]
            now *= self._weight[grid.packed]
            density += gain * (now - density)
            density[density < NOBODY * 1e-3] = 0.0
            wanted = relative_speed(density, settings.floor)
            speed = self._speed[grid.packed]
            if (np.abs(wanted - speed) > NOTICED * speed).any():
                speed[:] = wanted
                changed.add(grid.level)
        return changed

    def _count_changes(self, level: IntArray, position: FloatArray, column: IntArray) -> None:
        """Count the people whose way now ends at another exit than after the last update."""
        packed = self.fields.packed
        for one in self._columns:
            rows = np.flatnonzero((level >= 0) & (column == one.number))
            at = level[rows]
            nodes = np.rint((position[rows] - packed.origin[at]) / packed.spacing).astype(np.int64)
            nodes = np.clip(nodes, 0, packed.shape[at] - 1)
            now = one.waves.exit[self._first[at] + nodes[:, 0] * packed.shape[at, 1] + nodes[:, 1]]
            before = self._exit_of[rows]
            known = now >= 0
            moved = rows[known & (before >= 0) & (now != before)]
            target = now[known & (before >= 0) & (now != before)]
            self._counts[2] += len(moved)
            self._counts[3] += int(self._left[moved, target].sum())
            self._left[moved, self._exit_of[moved]] = 1
            self._exit_of[rows[known]] = now[known]


class _Column:
    """The travel times and directions of a route for a class of bodies."""

    def __init__(
        self,
        fields: Fields,
        travel_time: FloatArray,
        direction: FloatArray,
        number: int,
        factor: FloatArray,
        grids: BuildingGrids,
        blocked: IndexArray,
        lower: "_Column | None",
        hesitation: float,
    ) -> None:
        packed, marched = fields.packed, fields.marched
        assert marched is not None
        index = number % len(fields.routes)
        self.number, self._grids, self._factor, self._lower, self._blocked = number, grids, factor, lower, blocked
        self._places = {
            grid.level: slice(first, first + grid.sheet.size)
            for grid in grids.levels
            if (field := packed.field_of[grid.level, number]) >= 0
            for first in [int(packed.offset[field])]
        }
        self._travel_time, self._all_directions = travel_time, direction
        base = np.full(grids.size, math.inf)
        self._direction = np.zeros((grids.size, 2))
        for level, place in self._places.items():
            base[grids.levels[level].packed] = travel_time[place]
            self._direction[grids.levels[level].packed] = direction[place]
        ways = make_ways(grids, np.zeros(0))
        slowness = marched.rates[index] / ways.cosine[:, None]
        exits = exits_of_route(grids.building, routes_at_present(marched.building, fields.routes)[index])
        is_own = np.concatenate([(grid.sheet == OWN).ravel() for grid in grids.levels])
        strips, starts = _strips_and_starts(grids, exits, base, slowness)
        joins = (is_own | strips) & np.isfinite(base)
        joins[blocked] = False
        starts &= joins
        self._solved = joins & ~starts
        self._sizes = np.array([np.count_nonzero(self._solved[grid.packed]) for grid in grids.levels])
        nodes = np.flatnonzero(self._solved)
        is_border = ways.twin[nodes] >= 0
        for step in (1, ways.stride[ways.level_of[nodes]].astype(np.int64)):
            for beside in (ways.source[nodes - step], ways.source[nodes + step]):
                is_border |= (beside >= 0) & (starts[beside] | (ways.level_of[beside] != ways.level_of[nodes]))
        source, twin = _one_way(grids, ways.source, ways.twin)
        self.waves = Waves(
            level_of=ways.level_of,
            border=nodes[is_border],
            source=source,
            beside=ways.source,
            twin=twin,
            stride=ways.stride,
            uphill=ways.uphill,
            slowness=slowness,
            factor=np.ones(grids.size),
            spacing=grids.lattice.spacing,
            state=np.where(joins, FINAL, APART).astype(np.uint8),
            time=np.where(joins, base, math.inf),
            exit=np.full(grids.size, -1, np.int32),
            former=np.full(grids.size, -1, np.int32),
            hesitation=float(hesitation),
            before=np.full(grids.size, -1, np.int64),
            leans=np.zeros((len(grids.levels), len(grids.levels)), np.uint8),
            heap=np.zeros(grids.size, np.int64),
            place=np.zeros(grids.size, np.int64),
        )
        for grid in grids.levels:
            nodes = np.flatnonzero(starts[grid.packed])
            ends = [exit_ for exit_ in exits if exit_.level == grid.level]
            if len(nodes) and ends:
                points = shapely.points(
                    grid.window.places(np.stack(np.unravel_index(nodes, grid.window.shape), axis=1))
                )
                away = np.stack([shapely.distance(chain(exit_.segments), points) for exit_ in ends])
                self.waves.exit[grid.offset + nodes] = np.array([exit_.index for exit_ in ends])[away.argmin(axis=0)]
        self.stale: set[int] = set()
        self._halos = [np.flatnonzero(grids.is_ground(grid) & (grid.sheet != OWN)) for grid in grids.levels]
        self._fills = [self._fill_of(level, joins, base) for level in range(len(grids.levels))]

    def _fill_of(self, level: int, joins: BoolArray, base: FloatArray) -> tuple[IndexArray, IndexArray]:
        """Return the nodes of a level that are not marched, and for each the node whose direction it takes."""
        grid = self._grids.levels[level]
        sheet, source = grid.sheet.ravel(), grid.source.ravel()
        known = joins[grid.packed] & (sheet == OWN)
        is_halo = (sheet > OWN) & (sheet <= len(self._grids.building.portals))
        halo = np.flatnonzero(is_halo & joins[np.maximum(source, 0)])
        left_out, stand_in, _ = grid.stands_for
        stands = joins[stand_in]
        to, from_ = [grid.offset + halo, left_out[stands]], [source[halo], stand_in[stands]]
        missing = sheet == NOTHING
        missing[left_out[stands] - grid.offset] = False
        missing[is_halo] = ~joins[source[is_halo]]
        if known.any():
            shape = grid.window.shape
            nearest = nearest_marked(known.reshape(shape), missing.reshape(shape))
            to.append(grid.offset + np.flatnonzero(missing))
            from_.append(grid.offset + np.ravel_multi_index(nearest, shape))
        return np.concatenate(to), np.concatenate(from_)

    def values(self, packed: FloatArray) -> FloatArray:
        """Return the values (n, ...) of this column among those of all fields, level by level."""
        return np.concatenate([packed[:0], *(packed[place] for place in self._places.values())])

    def take(self, travel_time: FloatArray, direction: FloatArray) -> None:
        """Write values that `values` returned to the fields."""
        first = 0
        for level, place in self._places.items():
            some = slice(first, first + place.stop - place.start)
            self._travel_time[place], self._all_directions[place] = travel_time[some], direction[some]
            self._direction[self._grids.levels[level].packed] = direction[some]
            first = some.stop

    def slow_down(self, speed: FloatArray, levels: Set[int] | None = None) -> None:
        """Take the relative speeds (nodes,) of some levels, or of all."""
        for level in self._places if levels is None else levels & set(self._places):
            packed = self._grids.levels[level].packed
            np.divide(self._factor[packed], speed[packed], out=self.waves.factor[packed])

    def solve(self, changed: Set[int], occupied: Set[int], speed: FloatArray, everything: bool) -> int:
        """Solve the levels again on which the speed (nodes,) has changed, and those whose ways lead through them.

        The march ends when the times on the levels that are `occupied` by people on this route are known: others would
        be higher. Levels that are not solved to their end keep their directions, and are stale until they are.

        Returns
        -------
        int
            The number of levels that were solved.
        """
        waves, grids = self.waves, self._grids
        levels = set(self._places) if everything else self._behind((changed & set(self._places)) | self.stale)
        self.slow_down(speed, None if everything else changed)
        lowered = np.zeros(len(grids.levels), np.uint8)
        solved = 0
        for level in levels - self.stale:
            packed = grids.levels[level].packed
            waves.former[packed] = waves.exit[packed]
        self.stale = set()
        while levels:
            chosen = np.zeros(len(grids.levels), np.uint8)
            chosen[list(levels)] = 1
            for level in levels:
                packed = grids.levels[level].packed
                nodes = self._solved[packed]
                waves.state[packed][nodes], waves.time[packed][nodes] = FAR, math.inf
                waves.exit[packed][nodes] = -1
                waves.leans[level] = 0
            lowered[:] = 0
            needed = np.zeros(len(grids.levels), np.uint8)
            needed[list(levels if everything else levels & occupied)] = 1
            known = [waves.time[grids.levels[level].packed] for level in occupied - levels]
            least = max((times[np.isfinite(times)].max(initial=-math.inf) for times in known), default=-math.inf)
            march_waves(waves, chosen, needed, int(self._sizes[needed == 1].sum()), least, lowered)
            if not lowered.any():
                self.stale = {level for level in levels if (waves.state[grids.levels[level].packed] < FINAL).any()}
                self.write(sorted(levels - self.stale))
                solved += len(levels - self.stale)
                break
            more = self._behind(levels | set(np.flatnonzero(lowered).tolist()))
            for level in more - levels:
                packed = grids.levels[level].packed
                waves.former[packed] = waves.exit[packed]
            levels = more
        return solved

    def _behind(self, levels: Set[int]) -> set[int]:
        """Return some levels and all those whose ways lead through one of them."""
        found = set(levels)
        waiting = sorted(levels)
        while waiting:
            for level in np.flatnonzero(self.waves.leans[:, waiting.pop()]).tolist():
                if level not in found:
                    found.add(level)
                    waiting.append(level)
        return found

    def write(self, levels: list[int]) -> None:
        """Write travel times and directions of levels that were solved, and of those beside them, to the fields."""
        waves, grids = self.waves, self._grids
        beside = {p.other(level) for level in levels for p in grids.portals_of(level)}
        touched = [level for level in sorted({*levels, *beside} - self.stale) if level in self._places]
        for level in touched:
            grid = grids.levels[level]
            shape = grid.window.shape
            halo = self._halos[level]
            source = grid.source.ravel()[halo]
            is_known = waves.state[source] == FINAL
            cost = waves.time[grid.packed]
            cost[halo[is_known]] = waves.time[source[is_known]]
            chosen = (self._solved[grid.packed] & np.isfinite(cost)).view(np.uint8).reshape(shape)
            descend(cost.reshape(shape), chosen, waves.spacing, False, self._direction[grid.packed])
        for level in touched:
            grid, place = grids.levels[level], self._places[level]
            to, from_ = self._fills[level]
            self._direction[to], waves.exit[to] = self._direction[from_], waves.exit[from_]
            known = waves.time[grid.packed].copy()
            left_out, stand_in, next_one = grid.stands_for
            with np.errstate(invalid="ignore"):  # infinite times
                more = waves.time[stand_in] - waves.time[next_one]
            known[left_out - grid.offset] = waves.time[stand_in] + np.where(np.isfinite(more), more, 0.0)
            self._travel_time[place] = known
            self._all_directions[place] = self._direction[grid.packed]
        if self._lower is not None and len(self._blocked):
            self._take_lower(self._lower)

    def _take_lower(self, lower: "_Column") -> None:
        """Take what the class below has where no way is wide enough for the bodies of this one."""
        for level, place in self._places.items():
            packed = self._grids.levels[level].packed
            nodes = self._blocked[(self._blocked >= packed.start) & (self._blocked < packed.stop)] - packed.start
            there = lower._places[level].start
            self._travel_time[place.start + nodes] = self._travel_time[there + nodes]
            self._all_directions[place.start + nodes] = self._all_directions[there + nodes]


def _strips_and_starts(
    grids: BuildingGrids, exits: list[Exit], base: FloatArray, slowness: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return masks (nodes,) of the strips behind exits, and of the nodes whose times are known.

    A march starts with the last rows of the strips, as that of the empty building, so that it keeps its clearance from
    the posts of an exit; without a strip, within a cell of the exit.
    """
    strips, starts = np.zeros(grids.size, np.bool_), np.zeros(grids.size, np.bool_)
    for exit_ in exits:
        grid = grids.levels[exit_.level]
        strip = grid.offset + strips_of(grids, grid)[exit_.index]
        strips[strip] = True
        cell = grids.lattice.spacing * slowness[exit_.level].min()
        if rows := grid.strip_rows[exit_.index]:
            starts[strip] = base[strip] <= (1.5 - rows) * cell
        else:
            starts[grid.packed] |= base[grid.packed] <= cell
    return strips, starts


def _at_nodes_of(grids: BuildingGrids, values: FloatArray, before: BuildingGrids, elsewhere: float) -> FloatArray:
    """Return the values (nodes,) of the grids before at the nodes of other ones, whose windows include open halos."""
    found = np.full(grids.size, elsewhere)
    for old, new in zip(before.levels, grids.levels, strict=True):
        windows = [np.array([one.window.first, np.add(one.window.first, one.window.shape)]) for one in (old, new)]
        common = np.array([np.maximum(*windows)[0], np.minimum(*windows)[1]])
        there, here = (tuple(slice(*ends) for ends in (common - window[0]).T) for window in windows)
        found[new.packed].reshape(new.window.shape)[here] = values[old.packed].reshape(old.window.shape)[there]
    return found


def _one_way(grids: BuildingGrids, source: IndexArray, twin: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return sources and twins (nodes,) without those that would lead through portals against their direction."""
    if grids.building.one_way:
        source, twin = source.copy(), twin.copy()
    for grid in grids.levels if grids.building.one_way else ():
        for portal in grids.portals_of(grid.level):
            if not grids.building.leads_from(portal, grid.level):
                source[grid.packed][(grid.sheet == 1 + portal.index).ravel()] = -1
                _, there = grid.seams[portal.index]
                twin[there] = -1
    return source, twin


def _weights_on_floor(grids: BuildingGrids, width: float) -> FloatArray:
    """Return one over the share of the kernel around each own node that lies on the floor, at most 1 / `LEAST_SHARE`.

    It is 0 at other nodes.
    """
    spacing = grids.lattice.spacing
    reach = int(CUT * width / spacing)
    weight = np.exp(-0.5 * (spacing * np.arange(-reach, reach + 1) / width) ** 2)
    weight *= spacing / (width * math.sqrt(2.0 * math.pi))
    found = np.empty(grids.size)
    for grid in grids.levels:
        floor = grids.is_ground(grid).astype(np.float64)
        for axis in (0, 1):
            wide = np.pad(floor, [(reach, reach) if axis == other else (0, 0) for other in (0, 1)])
            size = floor.shape[axis]
            floor = sum(w * np.take(wide, range(k, k + size), axis) for k, w in enumerate(weight))
        found[grid.packed] = ((grid.sheet == OWN) / np.maximum(floor, LEAST_SHARE)).ravel()
    return found
