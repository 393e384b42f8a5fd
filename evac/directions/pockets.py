"""Pockets: parts of a building that no way from elsewhere leads through, such as rooms with one door.

While nobody is in a pocket, the times in it are not needed, and a march through the rest of the building does not
need them either. The nodes are divided at narrow places: a part is what a square of twice `REACH` covers as it moves
about without leaving the floor, or what is left between such parts. Parts that are connected to one other part only
are pockets, and so are parts that are so once these are removed.
"""

from functools import partial

import numpy as np

from evac.base.arrays import BoolArray, IndexArray, IntArray
from evac.directions.raster.grids import BuildingGrids, Shared
from evac.directions.raster.lattice import grown, parts_of

#: Half of the width up to which a passage is a narrow place [m].
REACH = 0.75

#: Pockets with fewer nodes, such as doorways and niches, are only left out with what is before them.
FEWEST_NODES = 400


class Pockets:
    """The pockets of the nodes that a march goes through: those that join (nodes,), with those at which it starts.

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
