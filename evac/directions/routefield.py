"""The travel times and directions of a route, for a class of bodies, that follow the crowd."""

import math
from collections.abc import Mapping, Set
from copy import copy as shallow_copy
from functools import partial
from typing import Any, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray, pairs_of
from evac.base.phases import tell
from evac.base.saved import Bounds, Saved, taken
from evac.building.model.building import FLAT, Area, Building, Exit
from evac.directions.density import STEP, Gates
from evac.directions.descent import Ways, descend
from evac.directions.fields import Fields, PackedFields
from evac.directions.lengths import (
    barred_on,
    ends_of_route,
    exits_of_route,
    make_ways,
    routes_at_present,
    slowness_of,
    strips_of,
)
from evac.directions.march.waves import APART, FAR, FINAL, MarchState, find_speeds, march_waves
from evac.directions.pockets import Pockets
from evac.directions.raster.grids import OWN, BuildingGrids, Shared, lead_through_doors
from evac.directions.raster.lattice import chain, grown, nearest_marked
from evac.directions.routes import Route

#: A level is solved again if the slowness has changed on it by more than this share of what the crowd adds to it.
NOTICED = 0.1

#: What is shown while the waves of a route are made.
PREPARING = "preparing ways round crowds"

#: Change of the wait for a lift by which its ways are solved again [s].
LONGER = 1.0

#: Arrays of the waves that marches and speeds change.
_CHANGED = (
    "factor",
    "state",
    "time",
    "exit",
    "gate",
    "walk",
    "former",
    "before",
    "leans",
    "jump_time",
)

#: Arrays of the waves whose values no march takes over; of the memory, only what a march writes to is used.
_SCRATCH = ("heap", "key", "place")


class RouteField(Saved):
    """The travel times and directions of a route, for a class of bodies; at first those of the empty building.

    They are the column `number` of all travel times (nodes,) and directions (nodes, 2), which `write` changes. The way
    to another exit must be shorter by the time `hesitation` [s]; `lower` is the column of narrower bodies. Times, next
    gates and exits are in `waves`, solved with relative speeds `speed` (nodes,); levels that were not solved to their
    end are `stale`.
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
        self.number, self._grids, self._gates = number, grids, gates
        self._travel_time, self._all_directions = travel_time, direction
        tell(PREPARING, 0, 3)
        base = self._read(fields.packed)
        ways = make_ways(grids, np.zeros(0))
        present = routes_at_present(marched.building, fields.routes)[index]
        slowness = slowness_of(grids.building, marched.rates[index], present)
        exits = exits_of_route(grids.building, present)
        strips, starts = _strips_and_starts(grids, exits, base, slowness)
        joins = (grids.own_nodes | strips) & np.isfinite(base)
        of_widths, nothing = marched.classes[of_class], np.zeros(0, np.int64)
        blocked = of_widths.blocked[index] if of_widths.blocked else nothing
        elsewhere = of_widths.elsewhere.get(index, nothing)
        joins[blocked] = joins[elsewhere] = False
        # Nodes from which no exit of the route can be reached keep their values, and those from which no way is wide
        # enough for the bodies take those of the class below.
        elsewhere, blocked = (of[np.isin(ways.level_of[of], list(self._places))] for of in (elsewhere, blocked))
        self._elsewhere = self._in_fields(elsewhere), base[elsewhere], self._direction[elsewhere]
        self._blocked = None if lower is None else (self._in_fields(blocked), lower._in_fields(blocked))
        for end in ends_of_route(grids.building, present):
            if isinstance(end, Area):
                starts[grids.around(end)[0]] = True
        starts &= joins
        self._solved = joins & ~starts
        self.waves = self._make_waves(ways, slowness, joins, starts, base, float(hesitation), present)
        tell(PREPARING, 1, 3)
        _start_at_exits(self.waves, grids, exits, starts)
        self.speed = np.ones(grids.size)
        self.stale: set[int] = set()
        self._at_once = self.waves.jump_time.copy()
        self._halos = [np.flatnonzero(grids.is_ground(grid) & (grid.sheet != OWN)) for grid in grids.levels]
        shared = Shared()
        self._fills = [self._fill_of(level, joins, base, shared) for level in range(len(grids.levels))]
        jumps = np.zeros(grids.size, np.bool_)  # whose nodes belong to no pocket
        jumps[self.waves.jump_start] = jumps[self.waves.jump_end] = True
        self._pockets = Pockets(grids, joins, starts | (jumps & joins), ways.source, ways.twin)
        for to, from_ in self._fills:
            self._pockets.of[to] = self._pockets.of[from_]
        self._empty = np.zeros_like(self._pockets.empty(np.zeros(0, np.int64)))
        self._resting: set[int] = set()  # levels all of whose nodes are left out
        self.is_local = False
        tell(PREPARING, 2, 3)
        self._march(set(self._places), set(self._places))
        tell(PREPARING, 3, 3)

    def copy(self, travel_time: FloatArray, direction: FloatArray) -> Self:
        """Return this column as it is now, to be written to other travel times (nodes,) and directions (nodes, 2)."""
        other, waves = shallow_copy(self), self.waves
        other._travel_time, other._all_directions = travel_time, direction
        arrays = {name: getattr(waves, name).copy() for name in _CHANGED}
        other.waves = waves.replace(**arrays, **{name: np.empty_like(getattr(waves, name)) for name in _SCRATCH})
        other.speed, other._direction = self.speed.copy(), self._direction.copy()
        return other

    def keep_links(self) -> None:
        """Keep the next link on the way from each node, so that people go round a crowd only on the way to it.

        From now on, times are those to the next portal or exit plus its time without a crowd, and are not written.
        """
        waves = self.waves
        if self._factor is not self._clear:  # with the speeds that smoke leaves
            self._march(set(self._places), set(self._places))
        links, nodes = self._gates.at, np.arange(len(waves.before))
        after = np.where(waves.before >= 0, waves.before, nodes)
        after = np.where(after == waves.twin, np.where(waves.before[after] >= 0, waves.before[after], after), after)
        leads_through = self._solved & (links >= 0) & (links < self._grids.building.n_links)
        lines = np.flatnonzero(leads_through & (waves.level_of[after] != waves.level_of))
        self._solved[lines] = False
        waves.exit[:] = -1
        ends = np.flatnonzero((waves.state == FINAL) & ~self._solved)
        waves.exit[ends] = waves.gate[ends]
        waves.exit[lines] = links[lines]
        waves.twin = waves.twin.copy()
        there = waves.twin[lines]
        waves.twin[there[there >= 0]] = waves.twin[lines] = -1
        steps = np.stack([np.ones(len(lines), np.int64), waves.stride[waves.level_of[lines]]])
        beside = waves.beside[np.concatenate([lines + sign * step for sign in (1, -1) for step in steps])]
        border = np.union1d(waves.border, beside[beside >= 0])
        waves.border = border[self._solved[border]]
        self._march(set(self._places), set(self._places))
        waves.former[:], waves.hesitation = waves.exit, math.inf
        self.is_local = True

    def _read(self, packed: PackedFields) -> FloatArray:
        """Read directions and places of the levels from the fields of the empty building; return the times (nodes,)."""
        grids = self._grids
        self._places = {
            grid.level: slice(first, first + grid.sheet.size)
            for grid in grids.levels
            if (field := packed.field_of[grid.level, self.number]) >= 0
            for first in [int(packed.offset[field])]
        }
        time = np.full(grids.size, math.inf)
        self._direction = np.zeros((grids.size, 2))
        for level, place in self._places.items():
            time[grids.levels[level].packed] = packed.travel_time[place]
            self._direction[grids.levels[level].packed] = packed.direction[place]
        return time

    def _make_waves(
        self,
        ways: Ways,
        slowness: FloatArray,
        joins: BoolArray,
        starts: BoolArray,
        time: FloatArray,
        hesitation: float,
        route: Route,
    ) -> MarchState:
        """Return waves whose times are known at the nodes that join."""
        grids = self._grids
        nodes = np.flatnonzero(self._solved)
        is_border = ways.twin[nodes] >= 0
        for step in (1, ways.stride[ways.level_of[nodes]].astype(np.int64)):
            for beside in (ways.source[nodes - step], ways.source[nodes + step]):
                is_border |= (beside >= 0) & (starts[beside] | (ways.level_of[beside] != ways.level_of[nodes]))
        source, twin = _one_way(grids, ways.source, ways.twin, barred_on(grids.building, route))
        nobody = np.full(grids.size, -1, np.int32)
        is_car = np.array([level.kind == "car" for level in grids.building.levels])
        label = np.where(is_car, first_car(grids.building) + np.arange(len(is_car)), -1).astype(np.int32)
        return MarchState(
            level_of=ways.level_of,
            border=nodes[is_border],
            source=source,
            beside=ways.source,
            twin=twin,
            **_jumps(grids, slowness, bool(route.lifts)),
            stride=ways.stride,
            uphill=ways.uphill,
            slowness=slowness,
            factor=self._factor.copy(),
            spacing=grids.lattice.spacing,
            state=np.where(joins, FINAL, APART).astype(np.uint8),
            time=np.where(joins, time, math.inf),
            exit=nobody,
            label=label,
            gate_at=self._gates.at,
            gate=nobody.copy(),
            walk=np.zeros(grids.size),
            former=nobody.copy(),
            hesitation=hesitation,
            before=np.full(grids.size, -1, np.int32),
            leans=np.zeros((len(grids.levels), len(grids.levels)), np.uint8),
            heap=np.zeros(grids.size, np.int32),
            key=np.zeros(grids.size),
            place=np.zeros(grids.size, np.int32),
        )

    def _fill_of(self, level: int, joins: BoolArray, base: FloatArray, shared: Shared) -> tuple[IndexArray, IndexArray]:
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
        return np.concatenate(to), np.concatenate(from_)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of the arrays that are needed to continue with the same bits."""
        own = {
            "travel_time": np.concatenate(
                [self._travel_time[:0], *(self._travel_time[at] for at in self._places.values())]
            ),
            # its own: ways round the crowd may have been written to the fields since
            "direction": np.concatenate([self._direction[:0], *(self._direction[nodes] for nodes in self._nodes())]),
            "stale": np.array(sorted(self.stale), np.int64),
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
        self.stale = set(taken(state, "stale", np.int64, (None,), 0, levels - 1).tolist())
        size = sum(place.stop - place.start for place in self._places.values())
        travel_time = taken(state, "travel_time", np.float64, (size,), -np.inf, np.inf)
        direction = taken(state, "direction", np.float64, (size, 2))
        first = 0
        for level, place in self._places.items():
            some = slice(first, first + place.stop - place.start)
            self._travel_time[place], self._all_directions[place] = travel_time[some], direction[some]
            self._direction[self._grids.levels[level].packed] = direction[some]
            first = some.stop
        self._write_where_no_way_is()

    def bounds(self) -> dict[str, Bounds]:
        """Return the bounds of the arrays of the waves."""
        links = Bounds(-1, first_car(self._grids.building) + len(self._grids.levels) - 1)
        any_time = Bounds(-np.inf, np.inf)
        gates, sides = Bounds(-1, len(self._gates.people) - 1), Bounds(0, 1)
        bounds = {
            "jump_time": any_time,
            "time": any_time,
            "walk": any_time,
            "exit": links,
            "former": links,
            "gate": gates,
            "leans": sides,
        }
        return {f"waves.{name}": bound for name, bound in bounds.items()}

    def _nodes(self) -> list[slice]:
        """Return the nodes of the levels with a field."""
        return [self._grids.levels[level].packed for level in self._places]

    def leave_out_empty(self, people: IndexArray) -> set[int]:
        """Leave out the pockets in which none of the people at these nodes are; return the levels of those taken in."""
        return self._leave_out(self._pockets.empty(people))

    def _leave_out(self, empty: BoolArray) -> set[int]:
        """Leave out these parts, and take in all others that were left out; return the levels of the latter."""
        waves, changed = self.waves, empty != self._empty
        self._empty = empty
        if not changed.any():
            return set()
        nodes = np.flatnonzero(self._solved & changed[self._pockets.of])
        out = empty[self._pockets.of[nodes]]
        waves.state[nodes], waves.time[nodes] = np.where(out, APART, FAR), math.inf
        waves.exit[nodes] = -1
        if not self.is_local:
            waves.former[nodes] = -1
        packed = {level: self._grids.levels[level].packed for level in self._places}
        marched = {level for level, own in packed.items() if (waves.state[own][self._solved[own]] != APART).any()}
        self._resting = set(self._places) - marched
        return set(np.flatnonzero(np.bincount(waves.level_of[nodes[~out]])).tolist())

    def slow_down(self, density: FloatArray, levels: Set[int], floor: float, noticed: float = NOTICED) -> set[int]:
        """Take the speeds of some levels from the density (nodes,) and the queues; return those that have changed."""
        waves, changed, wanted = self.waves, set(), np.empty_like(self.speed)
        for level in levels & set(self._places):
            packed = self._grids.levels[level].packed
            queues = self._gates.queues
            differs = find_speeds(packed.start, packed.stop, density, floor, waves, queues, STEP, self.speed, wanted)
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
        levels, solved = self._behind(changed | self.stale) - self._resting, self.stale
        later: set[int] = set()
        if self.is_local:
            self.stale = later = levels - occupied
            levels -= later
        while levels:
            for level in levels - solved if not (is_first or self.is_local) else ():
                packed = self._grids.levels[level].packed
                former[packed] = waves.exit[packed]
            solved = levels
            others = frozenset[int]() if self.is_local else occupied - levels
            lowered = self._march(levels, levels & occupied, others)
            self.stale |= later
            levels = self._behind(levels | lowered) - self._resting
            if not lowered or levels == solved:  # times on resting levels stay as they are
                self.write(solved - self.stale)
                return len(solved - self.stale)
        return 0

    def _march(self, levels: Set[int], needed: Set[int], others: Set[int] = frozenset()) -> set[int]:
        """March through some levels until the times on those of them that are needed, and on others, are known."""
        waves, grids = self.waves, self._grids
        missing = 0
        for level in levels:
            packed = grids.levels[level].packed
            nodes = self._solved[packed] & (waves.state[packed] != APART)
            missing += int(np.count_nonzero(nodes)) if level in needed else 0
            waves.state[packed][nodes], waves.time[packed][nodes] = FAR, math.inf
            waves.exit[packed][nodes] = waves.gate[packed][nodes] = -1
            waves.leans[level] = 0
        chosen, ends, lowered = np.zeros((3, len(grids.levels)), np.uint8)
        chosen[list(levels)] = 1
        ends[list(needed)] = 1
        known = [waves.time[grids.levels[level].packed] for level in others]
        least = max((times[np.isfinite(times)].max(initial=-math.inf) for times in known), default=-math.inf)
        march_waves(waves, chosen, ends, missing, least, lowered)
        self.stale = {level for level in levels if (waves.state[grids.levels[level].packed] < FINAL).any()}
        return set(np.flatnonzero(lowered).tolist())

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
        touched = sorted(({*levels, *beside} - self.stale) & set(self._places))
        for level in touched:
            grid = grids.levels[level]
            shape = grid.window.shape
            halo = self._halos[level]
            source = grid.source.ravel()[halo]
            is_known = waves.state[source] == FINAL
            cost = waves.time[grid.packed]
            chosen = (self._solved[grid.packed] & np.isfinite(cost)).view(np.uint8)
            if self.is_local:
                label = waves.exit[grid.packed]
                for link in np.flatnonzero(np.bincount(label[chosen.view(np.bool_)] + 1)) - 1:
                    own = np.where(label == link, cost, math.inf)
                    descend(own.reshape(shape), chosen.reshape(shape), waves.spacing, self._direction[grid.packed])
            else:
                cost[halo[is_known]] = waves.time[source[is_known]]
                descend(cost.reshape(shape), chosen.reshape(shape), waves.spacing, self._direction[grid.packed])
            lead_through_doors(grid, cost.reshape(shape), self._direction[grid.packed])
        pairs = pairs_of(self._direction)
        for level in touched:
            grid, place = grids.levels[level], self._places[level]
            to, from_ = self._fills[level]
            pairs[to], waves.exit[to] = pairs[from_], waves.exit[from_]
            if not self.is_local:
                known = waves.time[grid.packed].copy()
                left_out, stand_in, next_one = grid.stands_for
                with np.errstate(invalid="ignore"):  # infinite times
                    more = waves.time[stand_in] - waves.time[next_one]
                known[left_out - grid.offset] = waves.time[stand_in] + np.where(np.isfinite(more), more, 0.0)
                np.copyto(self._travel_time[place], known, where=np.isfinite(known))
            self._all_directions[place] = self._direction[grid.packed]
        self._write_where_no_way_is()

    def _write_where_no_way_is(self) -> None:
        """Write the values of nodes from which bodies of this class find no way, or none at all, to the fields."""
        if self._blocked is not None:
            to, from_ = self._blocked
            self._travel_time[to], self._all_directions[to] = self._travel_time[from_], self._all_directions[from_]
        to, time, direction = self._elsewhere
        self._travel_time[to], self._all_directions[to] = time, direction

    def _in_fields(self, nodes: IndexArray) -> IndexArray:
        """Return the indices among all fields of nodes of levels on which the route has a field."""
        shift = np.zeros(len(self._grids.levels), np.int64)
        for level, place in self._places.items():
            shift[level] = place.start - self._grids.levels[level].offset
        level_of = np.searchsorted([grid.offset for grid in self._grids.levels], nodes, side="right") - 1
        return nodes + shift[level_of]


def first_car(building: Building) -> int:
    """Return what is added to the level of a car for the label of the ways into it, beside the numbers of links."""
    return len(building.links)


def _strips_and_starts(
    grids: BuildingGrids, exits: list[Exit], base: FloatArray, slowness: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return masks (nodes,) of the strips behind exits, and of the nodes whose times are known."""
    # A march starts with the last rows of the strips, as that of the empty building, so that it keeps its clearance
    # from the posts of an exit; without a strip, within a cell of the exit.
    strips, starts = np.zeros(grids.size, np.bool_), np.zeros(grids.size, np.bool_)
    for exit_ in exits:
        grid = grids.levels[exit_.level]
        strip = grid.offset + strips_of(grids, grid)[exit_.index]
        strips[strip] = True
        cell = grids.lattice.spacing * slowness[exit_.level].min()
        cost = grids.building.cost_of(exit_)
        if rows := grid.strip_rows[exit_.index]:
            starts[strip] = base[strip] - cost <= (1.5 - rows) * cell
        else:
            near = grid.nodes_near(exit_.segments, 2.0 * grids.lattice.spacing)
            starts[near] |= np.abs(base[near] - cost) <= cell
    return strips, starts


def _jumps(grids: BuildingGrids, slowness: FloatArray, lifts: bool) -> dict[str, NDArray[Any]]:
    """Return the arrays of jumps of `MarchState`: from the node at the end of each to the nodes around its start."""
    rows = []
    for jump in grids.jumps(lifts):
        time = jump.time + jump.away * slowness[jump.area.level, FLAT]
        rows += [*zip([jump.end] * len(time), jump.nodes.tolist(), time.tolist(), strict=True)]
    ends, starts, times = (np.array(column) for column in zip(*sorted(rows), strict=True)) if rows else ((), (), ())
    first = np.full(grids.size if rows else 0, -1, np.int32)
    first[np.array(ends[::-1], np.int64)] = np.arange(len(rows))[::-1]
    return {
        "jump_end": np.array(ends, np.int64),
        "jump_start": np.array(starts, np.int64),
        "jump_time": np.array(times, np.float64),
        "first_jump": first,
    }


def _start_at_exits(waves: MarchState, grids: BuildingGrids, exits: list[Exit], starts: BoolArray) -> None:
    """Give the nodes (nodes,) where a march starts the nearest exit of their level, and its gate."""
    for grid in grids.levels:
        nodes = np.flatnonzero(starts[grid.packed])
        ends = [exit_ for exit_ in exits if exit_.level == grid.level]
        if len(nodes) and ends:
            points = shapely.points(grid.window.places(np.stack(np.unravel_index(nodes, grid.window.shape), axis=1)))
            away = np.stack([shapely.distance(chain(exit_.segments), points) for exit_ in ends]).argmin(axis=0)
            waves.exit[grid.offset + nodes] = np.array([exit_.index for exit_ in ends])[away]
            waves.gate[grid.offset + nodes] = np.array([grids.building.link_of(exit_) for exit_ in ends])[away]


def _one_way(
    grids: BuildingGrids, source: IndexArray, twin: IndexArray, barred: frozenset[tuple[int, int]]
) -> tuple[IndexArray, IndexArray]:
    """Return sources and twins (nodes,) to which times go on, which none do through links against their direction."""
    # The portals `barred` are not passed from the level with which they are given.
    building = grids.building
    if not (building.one_way or barred):
        return source, twin
    source, twin = source.copy(), twin.copy()
    for grid in grids.levels:
        for portal in grids.portals_of(grid.level):
            if not building.leads_from(portal, grid.level) or (portal.index, grid.level) in barred:
                source[grid.packed][(grid.sheet == 1 + portal.index).ravel()] = -1
                _, there = grid.seams[portal.index]
                twin[there] = -1
        before, behind = grid.passages
        twin[before] = -1
        twin[behind] = before
    return source, twin
