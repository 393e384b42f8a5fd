"""The compiled march: one wave through all levels, which solves some of them again during a run."""

import math
from collections.abc import Set
from copy import copy as shallow_copy
from typing import Any, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IntArray
from evac.building.model.building import FLAT, Area, Building, Exit
from evac.directions.descent import Ways
from evac.directions.lengths import strips_of
from evac.directions.march import EikonalProblem, EikonalSolver
from evac.directions.march.waves import APART, FAR, FINAL, MarchState, march_waves
from evac.directions.raster.grids import BuildingGrids
from evac.directions.raster.lattice import chain

#: Arrays of the waves that marches and speeds change once the next links are kept.
_CHANGED = ("factor", "state", "time", "exit", "leans", "jump_time")

#: Arrays of the waves whose values no march takes over; of the memory, only what a march writes to is used.
_SCRATCH = ("before", "heap", "key", "place")


def first_car(building: Building) -> int:
    """Return what is added to the level of a car for the label of the ways into it, beside the numbers of links."""
    return len(building.links)


class CompiledMarch(EikonalSolver):
    """The solver of fields that change during a run, by a wave through all levels.

    The march begins near the ends of ways, at nodes whose times are those of `ways.cost`, which the other solver found,
    and which it changes.
    Nodes are solved again if they are `solved` (nodes,); times, next gates and exits are in `waves`. Levels that were
    not solved to their end are `stale`. The way to another exit must be shorter by the time `hesitation` [s];
    `gate_at` (nodes,) is the gate whose line a node is on, -1 for none.
    """

    def __init__(
        self, grids: BuildingGrids, problem: EikonalProblem, ways: Ways, gate_at: IntArray, hesitation: float
    ) -> None:
        super().__init__(grids, problem)
        exits = [end for end in problem.ends if isinstance(end, Exit)]
        strips, starts = _strips_and_starts(grids, exits, ways.cost, problem.slowness)
        joins = (grids.own_nodes | strips) & np.isfinite(ways.cost)
        for end in problem.ends:
            if isinstance(end, Area):
                starts[grids.around(end)[0]] = True
        starts &= joins
        ways.cost[~joins] = math.inf
        self.solved = joins & ~starts
        self.stale: set[int] = set()
        self.waves = self._make_waves(ways, joins, gate_at, hesitation)
        _start_at_exits(self.waves, grids, exits, starts)

    def copy(self) -> Self:
        """Return this march as `keep_links` has left it, with its own of the arrays that change from then on."""
        other, waves = shallow_copy(self), self.waves
        arrays = {name: getattr(waves, name).copy() for name in _CHANGED}
        other.waves = waves.replace(**arrays, **{name: np.empty_like(getattr(waves, name)) for name in _SCRATCH})
        return other

    def _make_waves(self, ways: Ways, joins: BoolArray, gate_at: IntArray, hesitation: float) -> MarchState:
        """Return waves whose times are known at the nodes that join."""
        grids, problem, starts = self.grids, self.problem, joins & ~self.solved
        nodes = np.flatnonzero(self.solved)
        is_border = ways.twin[nodes] >= 0
        for step in (1, ways.stride[ways.level_of[nodes]]):
            for beside in (ways.source[nodes - step], ways.source[nodes + step]):
                is_border |= (beside >= 0) & (starts[beside] | (ways.level_of[beside] != ways.level_of[nodes]))
        source, twin = _one_way(grids, ways.source, ways.twin, problem.barred)
        nobody = np.full(grids.size, -1, np.int32)
        is_car = np.array([level.kind == "car" for level in grids.building.levels])
        label = np.where(is_car, first_car(grids.building) + np.arange(len(is_car)), -1).astype(np.int32)
        return MarchState(
            level_of=ways.level_of,
            border=nodes[is_border],
            source=source,
            beside=ways.source,
            twin=twin,
            **_jumps(grids, problem.slowness, problem.lifts),
            stride=ways.stride,
            uphill=ways.uphill,
            slowness=problem.slowness,
            factor=problem.factor.copy(),
            spacing=grids.lattice.spacing,
            state=np.where(joins, np.uint8(FINAL), np.uint8(APART)),
            time=ways.cost,
            exit=nobody,
            label=label,
            gate_at=gate_at,
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

    def solve(self) -> FloatArray:
        """Return the times (nodes,) on all levels, those of `waves`; nodes that are left out keep infinite ones."""
        levels = set(range(len(self.grids.levels)))
        self.solve_on(levels, levels)
        times: FloatArray = self.waves.time
        return times

    def solve_on(self, levels: Set[int], needed: Set[int], others: Set[int] = frozenset()) -> set[int]:
        """Solve some levels until the times on those of them that are needed, and on others, are known.

        Return the other levels on which times would decrease.
        """
        waves, grids = self.waves, self.grids
        missing = 0
        for level in levels:
            packed = grids.levels[level].packed
            nodes = self.solved[packed] & (waves.state[packed] != APART)
            missing += int(np.count_nonzero(nodes)) if level in needed else 0
            values = {"state": FAR, "time": math.inf, "exit": -1} | ({"gate": -1} if len(waves.gate) else {})
            for name, value in values.items():
                np.copyto(getattr(waves, name)[packed], value, where=nodes)
            waves.leans[level] = 0
        chosen, ends, lowered = np.zeros((3, len(grids.levels)), np.uint8)
        chosen[list(levels)] = 1
        ends[list(needed)] = 1
        known = [waves.time[grids.levels[level].packed] for level in others]
        least = max((times[np.isfinite(times)].max(initial=-math.inf) for times in known), default=-math.inf)
        march_waves(waves, chosen, ends, missing, least, lowered)
        self.stale = {level for level in levels if (waves.state[grids.levels[level].packed] < FINAL).any()}
        return set(np.flatnonzero(lowered).tolist())

    def keep_links(self) -> None:
        """Keep the next link on the way from each node; from now on times are those to it plus its time now.

        The way to a link is all that is solved then, so that gates are not followed any more.
        """
        waves = self.waves
        links, before = waves.gate_at, waves.before
        nodes = np.flatnonzero(self.solved & (links >= 0) & (links < self.grids.building.n_links))
        after = np.where(before[nodes] >= 0, before[nodes], nodes)
        after = np.where((after == waves.twin[nodes]) & (before[after] >= 0), before[after], after)
        lines = nodes[waves.level_of[after] != waves.level_of[nodes]]
        self.solved[lines] = False
        waves.exit[:] = -1
        ends = np.flatnonzero((waves.state == FINAL) & ~self.solved)
        waves.exit[ends] = waves.gate[ends]
        waves.exit[lines] = links[lines]
        waves.twin = waves.twin.copy()
        there = waves.twin[lines]
        waves.twin[there[there >= 0]] = waves.twin[lines] = -1
        steps = np.stack([np.ones(len(lines), np.int64), waves.stride[waves.level_of[lines]]])
        beside = waves.beside[np.concatenate([lines + sign * step for sign in (1, -1) for step in steps])]
        border = np.union1d(waves.border, beside[beside >= 0])
        waves.border = border[self.solved[border]]
        nowhere = np.zeros(0, np.int32)
        self.waves = waves = waves.replace(gate_at=nowhere, gate=nowhere, walk=np.zeros(0))
        self.solve()
        waves.former[:], waves.hesitation = waves.exit, math.inf


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
    grids: BuildingGrids, source: IntArray, twin: IntArray, barred: frozenset[tuple[int, int]]
) -> tuple[IntArray, IntArray]:
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
