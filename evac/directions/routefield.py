"""The travel times and directions of a route, for a class of bodies, that follow the crowd."""

import math
from collections.abc import Mapping, Set
from copy import copy as shallow_copy
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray, IntArray, pairs_of
from evac.base.progress import show_steps
from evac.base.saved import Saved, taken
from evac.directions.density import STEP, Gates
from evac.directions.descent import ONE_LABEL, descend
from evac.directions.fields import Fields, PackedFields
from evac.directions.lengths import make_ways, routes_at_present
from evac.directions.march import EikonalProblem
from evac.directions.march.compiled import CompiledMarch
from evac.directions.march.waves import APART, FAR, FINAL, MarchState, find_speeds
from evac.directions.raster.grids import OWN, BuildingGrids, Shared, lead_through_doors
from evac.directions.raster.lattice import grown, nearest_marked, parts_of

#: Half of the width up to which a passage is a narrow place [m].
REACH = 0.75

#: Pockets with fewer nodes, such as doorways and niches, are only left out with what is before them.
FEWEST_NODES = 400


class Pockets:
    """The pockets of a building: parts that no way from elsewhere leads through, such as rooms with one door.

    While nobody is in a pocket, the times in it are not needed, and a march through the rest of the building does not
    need them either. The nodes are divided at narrow places: a part is what a square of twice `REACH` covers as it
    moves about without leaving the floor, or what is left between such parts. Parts that are connected to one other
    part only are pockets, and so are parts that are so once these are removed.

    The nodes are those that a march goes through: those that join (nodes,), with those at which it starts.
    The latter, `starts` (nodes,), belong to no pocket. `beside` and `twin` (nodes,) are the node that each node
    represents, and the one at the same position on another level; -1 for none. `of` (nodes,) is the part of each node,
    -1 for none.
    """

    def __init__(
        self, grids: BuildingGrids, joins: BoolArray, starts: BoolArray, beside: IntArray, twin: IntArray
    ) -> None:
        part = _parts(grids, joins)
        number = int(part.max(initial=-1)) + 1
        around: list[set[int]] = [set() for _ in range(number)]
        for one, other in np.unique(_connections(grids, part, beside, twin), axis=0).tolist():
            around[one].add(other)
            around[other].add(one)
        size = np.bincount(part[joins], minlength=number)
        rooted = np.zeros(number, np.bool_)
        rooted[part[starts]] = True
        self._behind: list[tuple[int, int]] = []  # pockets and the part before each, those farthest behind first
        waiting = [one for one in range(number) if not rooted[one] and len(around[one]) == 1]
        while waiting:
            one = waiting.pop()
            if len(around[one]) == 1:
                (before,) = around[one]
                around[before].remove(one)
                self._behind.append((one, before))
                if not rooted[before] and len(around[before]) == 1:
                    waiting.append(before)
        self._is_worth_it = np.zeros(number + 1, np.bool_)  # to leave it out if it is empty; the last: no part
        self._is_worth_it[[one for one, _ in self._behind if size[one] >= FEWEST_NODES]] = True
        self.of = part

    def empty(self, nodes: IndexArray) -> BoolArray:
        """Return which parts (parts + 1,) can be left out while people are at these nodes only."""
        is_empty = np.ones(len(self._is_worth_it), np.bool_)
        is_empty[self.of[nodes]] = False
        for one, before in self._behind:
            is_empty[before] &= is_empty[one]
        is_empty &= self._is_worth_it
        for one, before in reversed(self._behind):
            is_empty[one] |= is_empty[before]
        return is_empty


def _parts(grids: BuildingGrids, joins: BoolArray) -> IntArray:
    """Return the part (nodes,) of each node of a march, -1 for other nodes."""
    part = np.full(grids.size, -1, np.int32)
    reach = round(REACH / grids.lattice.spacing)
    number, shared = 0, Shared()
    for grid in grids.levels:
        nodes = joins[grid.packed].reshape(grid.window.shape)
        own: IndexArray = shared.get(partial(_parts_on, nodes, reach), nodes.tobytes(), nodes.shape)
        part[grid.packed] = np.where(own >= 0, number + own, -1)
        number += int(own.max(initial=-1)) + 1
    return part


def _parts_on(nodes: BoolArray, reach: int) -> IndexArray:
    """Return the part of each node of a mask (nx, ny), -1 for those that are not marked."""
    wide = grown(~grown(~nodes, reach), reach)
    part, number = np.full(nodes.shape, -1, np.int64), 0
    for some in (wide, nodes & ~wide):
        component = parts_of(some)
        part[some] = number + component
        number += int(component.max(initial=-1)) + 1
    return part.ravel()


def _connections(grids: BuildingGrids, part: IntArray, beside: IntArray, twin: IntArray) -> IndexArray:
    """Return the pairs (n, 2) of different parts that have neighbouring nodes."""
    pairs = []
    for grid in grids.levels:
        nodes = grid.offset + np.flatnonzero(part[grid.packed] >= 0)
        for step in (1, -1, grid.window.shape[1], -grid.window.shape[1], 0):
            other = beside[nodes + step] if step else twin[nodes]
            here, there = part[nodes], np.where(other >= 0, part[other], -1)
            differ = (there >= 0) & (there != here)
            pairs.append(np.stack([here[differ], there[differ]], axis=1))
    return np.concatenate(pairs)


#: A level is solved again if the slowness has changed on it by more than this share of what the crowd adds to it.
NOTICED = 0.1

#: What is shown while the waves of a route are made.
PREPARING = "preparing ways round crowds"

#: Change of the wait for a lift by which its ways are solved again [s].
LONGER = 1.0


class RouteField(Saved):
    """The travel times and directions of a route, for a class of bodies; at first those of the empty building.

    They are the column `number` of all travel times (nodes,) and directions (nodes, 2), which `write` changes. The way
    to another exit must be shorter by the time `hesitation` [s]; `lower` is the column of narrower bodies. Times, next
    gates and exits are those of `march`, solved with relative speeds `speed` (nodes,).
    """

    saved = ("waves.time", "waves.exit", "waves.gate", "waves.walk", "waves.former", "waves.leans", "waves.jump_time")

    def __init__(
        self,
        fields: Fields,
        travel_time: FloatArray,
        direction: FloatArray,
        number: int,
        gates: Gates,
        hesitation: float = 0.0,
        lower: "RouteField | None" = None,
    ) -> None:
        marched = fields.marched
        assert marched is not None
        of_class, index = divmod(number, len(fields.routes))
        grids, self._factor = fields.grids[of_class].grids, fields.grids[of_class].factor
        self._clear = self._factor
        self.number, self._grids, self._queues = number, grids, gates.queues
        self._travel_time, self._direction = travel_time, direction
        show_steps(PREPARING, 0, 3)
        base = self._read(fields.packed)
        of_widths, nothing = marched.classes[of_class], np.zeros(0, np.int64)
        blocked = of_widths.blocked[index] if of_widths.blocked else nothing
        elsewhere = of_widths.elsewhere.get(index, nothing)
        ways = make_ways(grids, base)
        # Nodes from which no exit of the route can be reached keep their values, and those from which no way is wide
        # enough for the bodies take those of the class below.
        elsewhere, blocked = (of[np.isin(ways.level_of[of], list(self._places))] for of in (elsewhere, blocked))
        to, narrow = (of + self._shift[ways.level_of[of]] for of in (elsewhere, blocked))
        self._elsewhere = to, base[elsewhere], direction[to]
        self._blocked = None if lower is None else (narrow, lower._in_fields(blocked))
        base[blocked] = base[elsewhere] = math.inf
        present = routes_at_present(marched.building, fields.routes)[index]
        problem = EikonalProblem.of(grids.building, present, marched.rates[index], self._factor)
        self.march = CompiledMarch(grids, problem, ways, gates.at, hesitation)
        show_steps(PREPARING, 1, 3)
        self.speed = np.ones(grids.size)
        self._at_once = self.waves.jump_time.copy()
        joins = self.waves.state != APART
        self._halos = [np.flatnonzero(grids.is_ground(grid) & (grid.sheet != OWN)) for grid in grids.levels]
        shared = Shared()
        self._fills = {level: self._fill_of(level, joins, shared) for level in self._places}
        jumps = np.zeros(grids.size, np.bool_)  # whose nodes belong to no pocket
        jumps[self.waves.jump_start] = jumps[self.waves.jump_end] = True
        self._pockets = Pockets(grids, joins, joins & (jumps | ~self.march.solved), ways.source, ways.twin)
        self._empty = np.zeros_like(self._pockets.empty(np.zeros(0, np.int64)))
        self._level_of_part = np.zeros(len(self._empty), np.int32)
        self._level_of_part[self._pockets.of[joins]] = ways.level_of[joins]
        for fill, taken_from in self._fills.values():
            self._pockets.of[fill] = self._pockets.of[taken_from]
        self._resting: set[int] = set()  # levels all of whose nodes are left out
        self._unseen = set(self._places)  # levels of which it is not known yet whether they rest
        self.is_local = False
        show_steps(PREPARING, 2, 3)
        self.march.solve()
        show_steps(PREPARING, 3, 3)

    @property
    def waves(self) -> MarchState:
        """Times, next gates and exits of the march."""
        return self.march.waves

    def copy(self, travel_time: FloatArray, direction: FloatArray) -> Self:
        """Return this column as it is now, to be written to other travel times (nodes,) and directions (nodes, 2)."""
        other = shallow_copy(self)
        other._travel_time, other._direction = travel_time, direction
        other.march, other.speed = self.march.copy(), self.speed.copy()
        return other

    def keep_links(self) -> None:
        """Keep the next link on the way from each node, so that people go round a crowd only on the way to it.

        From now on, times are those to the next portal or exit plus its time without a crowd, and are not written.
        """
        if self._factor is not self._clear:  # with the speeds that smoke leaves
            self.march.solve()
        self.march.keep_links()
        self.is_local = True

    def _read(self, packed: PackedFields) -> FloatArray:
        """Read directions and places of the levels from the fields of the empty building; return the times (nodes,)."""
        grids = self._grids
        self._places: dict[int, slice] = {}
        self._shift = np.zeros(len(grids.levels), np.int64)  # by level, from its grid to its place
        time = np.full(grids.size, math.inf)
        for grid, field in zip(grids.levels, packed.field_of[:, self.number].tolist(), strict=True):
            if field >= 0:
                first = int(packed.offset[field])
                place = self._places[grid.level] = slice(first, first + grid.sheet.size)
                self._shift[grid.level] = first - grid.offset
                time[grid.packed] = packed.travel_time[place]
        places = [*self._places.values()] or [slice(0, 0)]
        self._column = slice(places[0].start, places[-1].stop)  # the fields of a column are one after another
        self._direction[self._column] = packed.direction[self._column]
        return time

    def _fill_of(self, level: int, joins: BoolArray, shared: Shared) -> tuple[IntArray, IntArray]:
        """Return the nodes of a level that are not marched, and for each the node whose direction it takes."""
        grid = self._grids.levels[level]
        sheet, source = grid.sheet.ravel(), grid.source.ravel()
        known = joins[grid.packed] & (sheet == OWN)
        is_halo = (sheet > OWN) & (sheet <= len(self._grids.building.portals))
        halo = np.flatnonzero(is_halo & joins[np.maximum(source, 0)])
        left_out, stand_in, _ = grid.stands_for
        stands = joins[stand_in]
        to, from_ = [grid.offset + halo, left_out[stands]], [source[halo], stand_in[stands]]
        missing = self._grids.is_beside(grid).ravel()
        missing[left_out[stands] - grid.offset] = False
        missing[is_halo] = ~joins[source[is_halo]]
        shape = grid.window.shape
        leads = np.zeros(shape, np.bool_)
        leads.ravel()[halo] = True
        cut = missing.reshape(shape) & grown(leads, 1)  # halo nodes that were left out lead through their portal
        missing &= ~cut.ravel()
        if cut.any():
            to.append(grid.offset + np.flatnonzero(cut))
            from_.append(source[np.ravel_multi_index(nearest_marked(leads, cut), shape)])
        if known.any():
            masks = known.reshape(shape), missing.reshape(shape)
            nearest = shared.get(partial(nearest_marked, *masks), *(mask.tobytes() for mask in masks), shape)
            to.append(grid.offset + np.flatnonzero(missing))
            from_.append(grid.offset + np.ravel_multi_index(nearest, shape))
        return np.concatenate(to).astype(np.int32), np.concatenate(from_).astype(np.int32)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of the arrays that are needed to continue with the same bits."""
        own = {
            "travel_time": self._travel_time[self._column].copy(),
            "direction": self._direction[self._column].copy(),
            "stale": np.array(sorted(self.march.stale), np.int64),
            "speed": self.speed.copy(),
            "empty": self._empty.copy(),
        }
        return super().state() | own

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned."""
        levels = len(self._grids.levels)
        self._leave_out(taken(state, "empty", np.bool_, self._empty.shape))
        super().restore(state)
        speed = taken(state, "speed", np.float64, self.speed.shape, 1e-9, 1.0)
        for level in self._places:
            self._take_speeds(level, speed[self._grids.levels[level].packed])
        self.march.stale = set(taken(state, "stale", np.int64, (None,), 0, levels - 1).tolist())
        size = self._column.stop - self._column.start
        self._travel_time[self._column] = taken(state, "travel_time", np.float64, (size,), -np.inf, np.inf)
        self._direction[self._column] = taken(state, "direction", np.float64, (size, 2))
        self._write_where_no_way_is()

    def leave_out_empty(self, people: IndexArray) -> set[int]:
        """Leave out the pockets in which none of the people at these nodes are; return the levels of those taken in."""
        return self._leave_out(self._pockets.empty(people))

    def _leave_out(self, empty: BoolArray) -> set[int]:
        """Leave out these parts, and take in all others that were left out; return the levels of the latter."""
        waves, changed = self.waves, empty != self._empty
        self._empty = empty
        if not changed.any():
            return set()
        solved, part = self.march.solved, self._pockets.of
        touched, self._unseen = self._unseen | set(self._level_of_part[changed].tolist()), set()
        packed = {level: self._grids.levels[level].packed for level in sorted(touched)}
        nodes = np.concatenate(
            [own.start + np.flatnonzero(solved[own] & changed[part[own]]) for own in packed.values()]
        )
        out = empty[part[nodes]]
        waves.state[nodes], waves.time[nodes] = np.where(out, APART, FAR), math.inf
        waves.exit[nodes] = -1
        if not self.is_local:
            waves.former[nodes] = -1
        marched = {level for level, own in packed.items() if (waves.state[own][solved[own]] != APART).any()}
        self._resting = (self._resting | touched) - marched
        return set(np.flatnonzero(np.bincount(waves.level_of[nodes[~out]])).tolist())

    def slow_down(self, density: FloatArray, levels: Set[int], floor: float, noticed: float = NOTICED) -> set[int]:
        """Take the speeds of some levels from the density (nodes,) and the queues; return those that have changed."""
        waves, changed, wanted = self.waves, set(), np.empty_like(self.speed)
        for level in levels & set(self._places):
            packed = self._grids.levels[level].packed
            differs = find_speeds(
                packed.start, packed.stop, density, floor, waves, self._queues, STEP, self.speed, wanted
            )
            if differs > noticed:
                self._take_speeds(level, wanted[packed])
                changed.add(level)
        return changed

    def wait_for_lifts(self, waits: Mapping[int, float], gain: float) -> set[int]:
        """Take the waits [s] for lifts in the rooms of their cars, averaged over time; return the levels of these."""
        waves, changed = self.waves, set()
        for level, wait in waits.items():
            own = waves.level_of[waves.jump_start] == level
            more = (1.0 - gain) * (waves.jump_time[own] - self._at_once[own]) + gain * wait
            if (np.abs(self._at_once[own] + more - waves.jump_time[own]) > LONGER).any():
                waves.jump_time[own] = self._at_once[own] + more
                changed.add(level)
        return changed

    def take_smoke(self, level: int, share: FloatArray) -> None:
        """Take the share (nodes,) of the speed that smoke leaves on a level; it multiplies all relative speeds."""
        if level not in self._places:
            return
        packed = self._grids.levels[level].packed
        if self._factor is self._clear:
            self._factor = self._clear.copy()
        np.divide(self._clear[packed], share[packed], out=self._factor[packed])
        self._take_speeds(level, self.speed[packed])

    def _take_speeds(self, level: int, speed: FloatArray) -> None:
        """Take the relative speeds of the nodes of a level."""
        packed = self._grids.levels[level].packed
        self.speed[packed] = speed
        np.divide(self._factor[packed], speed, out=self.waves.factor[packed])

    def solve(self, changed: Set[int], occupied: Set[int], is_first: bool) -> int:
        """Solve the levels again on which the speeds have changed, and those whose ways lead through them.

        The march ends when the times on the levels that are `occupied` by people on this route are known: others would
        be higher. Levels that are not solved to their end keep their directions, and are stale until they are. The
        first time, nobody has chosen an exit yet. Local ways end at the next link, so that they wait for people on
        their own level.
        """
        waves, former = self.waves, self.waves.former
        levels, solved = self._behind(changed | self.march.stale) - self._resting, self.march.stale
        later: set[int] = set()
        if self.is_local:
            self.march.stale = later = levels - occupied
            levels -= later
        while levels:
            for level in levels - solved if not (is_first or self.is_local) else ():
                packed = self._grids.levels[level].packed
                former[packed] = waves.exit[packed]
            solved = levels
            others = frozenset[int]() if self.is_local else occupied - levels
            lowered = self.march.solve_on(levels, levels & occupied, others)
            self.march.stale |= later
            levels = self._behind(levels | lowered) - self._resting
            if not lowered or levels == solved:  # times on resting levels stay as they are
                self.write(solved - self.march.stale)
                return len(solved - self.march.stale)
        return 0

    def _behind(self, levels: Set[int]) -> set[int]:
        """Return some levels and all those whose ways lead through one of them."""
        behind = set(levels)
        waiting = [] if self.is_local else sorted(levels)  # a local way ends at the next link
        while waiting:
            for level in np.flatnonzero(self.waves.leans[:, waiting.pop()]).tolist():
                if level not in behind:
                    behind.add(level)
                    waiting.append(level)
        return behind

    def write(self, levels: Set[int]) -> None:
        """Write travel times and directions of levels that were solved, and of those beside them, to the fields."""
        waves, grids = self.waves, self._grids
        beside = set() if self.is_local else {p.other(level) for level in levels for p in grids.portals_of(level)}
        touched = sorted(({*levels, *beside} - self.march.stale) & set(self._places))
        for level in touched:
            grid = grids.levels[level]
            shape = grid.window.shape
            cost = waves.time[grid.packed]
            chosen = (self.march.solved[grid.packed] & np.isfinite(cost)).view(np.uint8)
            direction = self._direction[self._places[level]]
            label = waves.exit[grid.packed].reshape(shape) if self.is_local else ONE_LABEL
            if not self.is_local:
                halo = self._halos[level]
                source = grid.source.ravel()[halo]
                is_known = waves.state[source] == FINAL
                cost[halo[is_known]] = waves.time[source[is_known]]
            descend(cost.reshape(shape), label, chosen.reshape(shape), waves.spacing, direction)
            lead_through_doors(grid, cost.reshape(shape), direction)
        pairs = pairs_of(self._direction)
        for level in touched:
            to, from_ = self._fills[level]
            pairs[to + self._shift[level]], waves.exit[to] = pairs[self._in_fields(from_)], waves.exit[from_]
            if not self.is_local:
                grid = grids.levels[level]
                known = waves.time[grid.packed].copy()
                left_out, stand_in, next_one = grid.stands_for
                with np.errstate(invalid="ignore"):  # infinite times
                    more = waves.time[stand_in] - waves.time[next_one]
                known[left_out - grid.offset] = waves.time[stand_in] + np.where(np.isfinite(more), more, 0.0)
                np.copyto(self._travel_time[self._places[level]], known, where=np.isfinite(known))
        self._write_where_no_way_is()

    def _write_where_no_way_is(self) -> None:
        """Write the values of nodes from which bodies of this class find no way, or none at all, to the fields."""
        if self._blocked is not None:
            to, from_ = self._blocked
            self._travel_time[to], self._direction[to] = self._travel_time[from_], self._direction[from_]
        to, time, direction = self._elsewhere
        self._travel_time[to], self._direction[to] = time, direction

    def _in_fields(self, nodes: IndexArray | IntArray) -> IndexArray:
        """Return the indices among all fields of nodes of levels on which the route has a field."""
        moved: IndexArray = nodes + self._shift[self.waves.level_of[nodes]]
        return moved
