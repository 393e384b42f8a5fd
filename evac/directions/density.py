"""The density of people at the nodes of the grids, averaged over time, and the queues before exits, portals and doors.

A law of the density alone takes the crowd before a door for too fast, since people stand wherever there is room but
leave through the door one after another. The crowd on the way to each of these gates is therefore counted by its
walking time to it, and advances no faster than the gate is passed. Those who are still on their way are in the count,
so that people do not turn to an exit that others will have reached before them.
"""

import math

import numpy as np

from evac.base.arrays import FloatArray, IndexArray, IntArray
from evac.base.saved import Saved
from evac.directions.fields import PackedFields
from evac.directions.march.waves import CUT, JAM, average, deposit, find_queues
from evac.directions.raster.grids import OWN, BuildingGrids, LevelGrid

#: Least share of a kernel on the floor by which a density is divided, so that a narrow place is not taken for full.
LEAST_SHARE = 0.2


class Kernels:
    """The Gauss kernels of a standard deviation `width` [m] with which people add to densities on grids."""

    def __init__(self, grids: BuildingGrids, packed: PackedFields, width: float) -> None:
        self.grids, self._packed, self._width = grids, packed, width
        self.first = np.array([grid.offset for grid in grids.levels], dtype=np.int64)
        if width not in grids.weights:
            grids.weights[width] = _weights_on_floor(grids, width)
        self._weight = grids.weights[width]
        self._ends = np.append(self.first, grids.size)
        halos = [halo for grid in grids.levels for halo in _behind_portals(grids, grid)]
        columns = zip(*halos, strict=True) if halos else [()] * 4
        # The levels on both sides of portals; the nodes of halos, and those behind the portals.
        self._here, self._there, self._halo, self._behind = (
            np.concatenate([np.zeros(0, np.int64), *nodes]) for nodes in columns
        )

    def nodes_at(self, level: IntArray, position: FloatArray) -> IndexArray:
        """Return the nodes nearest to people, of level 0 for those who have left."""
        packed, at = self._packed, np.maximum(level, 0)
        place = np.rint((position - packed.origin[at]) / packed.spacing).astype(np.int64)
        place = np.clip(place, 0, packed.shape[at] - 1)
        nodes: IndexArray = self.first[at] + place[:, 0] * packed.shape[at, 1] + place[:, 1]
        return nodes

    def beside(self, level: IntArray, position: FloatArray, radius: FloatArray, own: float) -> FloatArray:
        """Return the density (nodes,) that bodies of a radius `own` [m] meet beside people (n,) who stand [1/m2].

        It is infinite where bodies touch these people, or a wall before they have passed between, and that of a jam
        where they only just pass. With room of the radius `own`, they pass as easily as without these people.
        """
        room = np.full(self.grids.size, np.inf)
        for at, place, reach in zip(level.tolist(), position, radius + own, strict=True):
            grid, first = self.grids.levels[at], self._packed.origin[at] - place
            x, y = (
                start + self._packed.spacing * np.arange(nodes)
                for start, nodes in zip(first, grid.window.shape, strict=True)
            )
            np.minimum(room[grid.packed], np.hypot(*np.ix_(x, y)).ravel() - reach, out=room[grid.packed])
        for at in np.unique(level).tolist():
            grid = self.grids.levels[at]
            room[grid.ring] += np.minimum(grid.distance - own, 0.0)
        return np.where(room < 0.0, np.inf, JAM * np.clip(1.0 - room / own, 0.0, 1.0))

    def average(
        self, density: FloatArray, level: IntArray, position: FloatArray, gain: float, against: IntArray | None = None
    ) -> set[int]:
        """Average a density (nodes,) in place with that of people now; return the levels with people now or before.

        Levels (n,) are -1 for those who do not count. `gain` is the weight of the density now. The density of people
        with levels in `against` (n,) is taken away from that of the others.
        """
        present, is_near = np.zeros(len(density)), np.zeros(len(self.first), np.uint8)
        deposit(self._packed, self.first, position, level, self._width, present)
        occupied = np.unique(level[level >= 0])
        if against is not None and (against >= 0).any():
            other = np.zeros(len(density))
            deposit(self._packed, self.first, position, against, self._width, other)
            for grid in [self.grids.levels[at] for at in occupied.tolist()]:
                own = present[grid.packed]
                np.maximum(np.subtract(own, other[grid.packed], out=own), 0.0, out=own)
        is_near[occupied] = 1
        is_near[self._here[is_near[self._there] > 0]] = 1
        average(self._ends, is_near, self._behind, self._halo, present, self._weight, gain, density)
        return set(np.flatnonzero(is_near).tolist())


def gain_of(period: float, memory: float) -> float:
    """Return the weight of the present beside an average over the time `memory`, taken each `period` [s]."""
    return -math.expm1(-period / memory) if memory > 0.0 else 1.0


def _behind_portals(grids: BuildingGrids, grid: LevelGrid) -> list[tuple[IntArray, IntArray, IndexArray, IndexArray]]:
    """Return a level and those behind its portals, each with the nodes of its halo there, and its own nodes there."""
    # The kernels of people close behind a portal reach into its halo on their own level.
    rows = []
    for portal in grids.portals_of(grid.level):
        there = grids.levels[portal.other(grid.level)]
        halo = np.flatnonzero(there.sheet == 1 + portal.index)
        levels = np.array([[grid.level], [there.level]], np.int32)
        rows.append((*levels, there.offset + halo, there.source.ravel()[halo]))
    return rows


def at_nodes_of(grids: BuildingGrids, values: FloatArray, before: BuildingGrids) -> FloatArray:
    """Return the values (nodes,) of the grids before at the nodes of other ones, whose windows include open halos."""
    moved = np.zeros(grids.size)
    for old, new in zip(before.levels, grids.levels, strict=True):
        here, there = new.window.overlap(old.window)
        moved[new.packed].reshape(new.window.shape)[here] = values[old.packed].reshape(old.window.shape)[there]
    return moved


def _weights_on_floor(grids: BuildingGrids, width: float) -> FloatArray:
    """Return one over the share of the kernel around each own node that lies on the floor, at most 1 / `LEAST_SHARE`.

    It is 0 at other nodes.
    """
    spacing = grids.lattice.spacing
    reach = int(CUT * width / spacing)
    weight = np.exp(-0.5 * (spacing * np.arange(-reach, reach + 1) / width) ** 2)
    weight *= spacing / (width * math.sqrt(2.0 * math.pi))
    weights = np.empty(grids.size)
    for grid in grids.levels:
        if grid.alike < grid.level:
            weights[grid.packed] = weights[grids.levels[grid.alike].packed]
            continue
        floor = grids.is_ground(grid).astype(np.float64)
        for axis in (0, 1):
            wide = np.pad(floor, [(reach, reach) if axis == other else (0, 0) for other in (0, 1)])
            size = floor.shape[axis]
            floor = sum(w * np.take(wide, range(k, k + size), axis) for k, w in enumerate(weight))
        weights[grid.packed] = ((grid.sheet == OWN) / np.maximum(floor, LEAST_SHARE)).ravel()
    return weights


#: Flow through a metre of a door: mean of the doors of 0.8 to 2.5 m measured by Seyfried et al. (2009), Kretz et al.
#: (2006) and in Duesseldorf (2006), see `evac evidence people`; and of a stair, where it is 0.88 to 1.16 [1/s/m].
THROUGH_DOORS, ON_STAIRS = 1.85, 1.0

#: Length [s] and number of the bins of walking times; people farther away do not queue yet.
STEP, BINS = 1.0, 300


class Gates(Saved):
    """Gates of a building: its links, by their numbers. A node is on the line of the gate `at` (nodes,), -1 for none.

    `people` (gates, BINS) are on the way to each gate, by their walking time to it, averaged over time; `queues`
    (gates, BINS) are the relative speeds that follow.
    """

    saved = ("people",)

    def __init__(self, grids: BuildingGrids) -> None:
        building = grids.building
        self.at = np.full(grids.size, -1, np.int32)
        width = np.array([link.width for link in building.links])
        flow = np.full(len(width), THROUGH_DOORS)
        for portal in building.portals:
            if any(building.levels[level].climb.any() for level in portal.levels):
                flow[portal.index] = ON_STAIRS
        self._capacity = width * flow
        reach = 0.501 * grids.lattice.spacing  # which no path avoids
        for grid in grids.levels:
            for door in building.doors:
                if door.level == grid.level:
                    self.at[grid.nodes_near(door.segments, reach)] = building.link_of(door)
            for index, (ours, _) in grid.seams.items():
                self.at[ours] = index
        self.people, self.queues = np.zeros((len(width), BINS)), np.ones((len(width), BINS))

    def count(self, gate: IntArray, walk: FloatArray, gain: float) -> None:
        """Count people (n,) on the way to gates (-1: none), `walk` [s] away, with a weight beside those before."""
        step = (walk / STEP).astype(np.int64)
        queueing = (gate >= 0) & (step < BINS)
        now = np.bincount(gate[queueing] * BINS + step[queueing], minlength=self.people.size)
        self.people += gain * (now.reshape(self.people.shape) - self.people)
        find_queues(self.people, self._capacity, STEP, self.queues)
