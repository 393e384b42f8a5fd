"""Ways round the crowd: directions that use the whole width at corners, at junctions and before stairs.

The directions of an empty building lead everybody along the same line, close to each corner. Where people keep
distances, they take a longer way beside the crowd instead. Every few seconds, the density of the people who walk the
same way is found, less that of those who come towards them: without this, both would spread over the whole width.
Crowded floors are marched again with speeds that fall with the density, as for the strategy "quickest"
(`quickest.py`), but not stairs and their landings, where people would step back over portals. People who stand firm, at
a refuge for example, count as a jam on all levels, so that others pass them where there is most room. Each node keeps
the next portal or exit of the empty building, so that people neither choose other exits and stairs nor turn round.
Travel times stay those of the empty building.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from evac.base.saved import Saved, part_of, taken
from evac.directions.density import Gates, Kernels, at_nodes_of, gain_of
from evac.directions.fields import Fields, columns_of
from evac.directions.quickest import Settings
from evac.directions.routefield import RouteField

#: Density from which on ways lead round a crowd [1/m2]; two people beside each other are fewer.
CROWDED = 1.0

#: A floor is solved again if the slowness has changed on it by more than this share of what the crowd adds to it; more
#: than for "quickest", because here it decides on which side of a crowd people pass, not through which exit they leave.
NOTICED = 0.3


class LocalWays(Saved):
    """The ways of a run that lead round the crowd: `fields` have directions of their own, which `update` changes in
    place.

    The columns of `first` are those of all runs with this building before there is a crowd, made by the first run that
    needs them.
    """

    def __init__(
        self,
        fields: Fields,
        clear: Fields,
        settings: Settings,
        before: "LocalWays | None" = None,
        first: dict[int, RouteField] | None = None,
    ) -> None:
        self.fields, self._clear, self._settings, self._first = fields, clear, settings, first
        self._grids = fields.grids[0].grids
        self._kernels = Kernels(self._grids, fields.packed, settings.width)
        self._floors = {level.index for level in self._grids.building.levels if level.kind == "floor"}
        self._columns: dict[int, RouteField] = {}
        self._solved: dict[int, set[int]] = {}  # by column, the levels with speeds other than those without a crowd
        self._density: dict[int, FloatArray] = {}
        self._beside: dict[int, FloatArray] = {}  # the density beside people who stand firm, if there are any
        self._smoke: FloatArray | None = None
        if before is not None and before.fields.routes == fields.routes:
            for number, density in before._density.items():
                self._density[number] = at_nodes_of(self._grids, density, before._grids)

    def is_due(self, tick: int, length: float) -> bool:
        """Return whether an update is due at a tick of this length [s]."""
        return tick % max(1, round(self._settings.period / length)) == 0

    def update(
        self, level: IntArray, position: FloatArray, route: IntArray, radius: FloatArray, is_firm: BoolArray
    ) -> None:
        """Find the ways again for people at these places, also round those who stand firm, (n,) bool.

        The other arguments are as for `Quickest.update`.
        """
        columns = columns_of(self.fields.packed, route, radius)
        inside = level >= 0
        firm, walking = inside & is_firm, inside & ~is_firm
        nodes = self._kernels.nodes_at(level, position)
        ways = self._headings(columns, level, nodes)
        routes = self.fields.routes
        used = set(np.unique(columns[inside]).tolist()) | self._columns.keys()
        for number in sorted(used):
            if not routes[number % len(routes)].goes_round_crowd:
                continue
            others = self._headings(np.full_like(columns, number), level, nodes)
            cosine = (ways * others).sum(axis=1)
            alike = np.where(cosine > 0.0, level, -1)
            against = np.where(cosine < 0.0, level, -1)
            beside = None
            own = (columns == number) & inside
            if firm.any() and (own & walking).any():
                widest = float(radius[own & walking].max())
                beside = self._kernels.beside(level[firm], position[firm], radius[firm], widest)
            self._follow(number, alike, against, position, nodes[own], level[own], beside)

    def _follow(
        self,
        number: int,
        alike: IntArray,
        against: IntArray,
        position: FloatArray,
        nodes: IndexArray,
        occupied: IntArray,
        beside: FloatArray | None,
    ) -> None:
        """Find the ways of one column again, from the levels of people who walk the same way or come towards them."""
        settings = self._settings
        gain = gain_of(settings.period, settings.memory) if number in self._density else 1.0
        density = self._density.setdefault(number, np.zeros(self._grids.size))
        levels = self._kernels.average(density, alike, position, gain, against)
        solved = self._solved.setdefault(number, set())
        crowded = {
            level for level in levels & self._floors if density[self._grids.levels[level].packed].max() >= CROWDED
        }
        moved = self._count_firm(number, beside)
        if beside is not None:
            of_floors = [np.full(grid.sheet.size, grid.level in self._floors) for grid in self._grids.levels]
            density = beside + np.where(np.concatenate(of_floors), density, 0.0)
            crowded |= self._levels_with(beside > 0.0)
        column = self._columns.get(number)
        if not (crowded | solved | moved or (column is not None and column.march.stale)):
            return
        column = column or self._made(number)
        changed = column.leave_out_empty(nodes)
        changed |= column.slow_down(density, (crowded | solved) - moved, settings.floor, NOTICED)
        changed |= column.slow_down(density, moved, settings.floor, 0.0)
        column.solve(changed, set(np.unique(occupied).tolist()), False)
        self._solved[number] = crowded

    def _count_firm(self, number: int, beside: FloatArray | None) -> set[int]:
        """Take the density beside people who stand firm for a column; return the levels on which it has changed."""
        before = self._beside.pop(number, None)
        if beside is not None:
            self._beside[number] = beside
        if before is None and beside is None:
            return set()
        nobody = np.zeros(1)
        return self._levels_with((nobody if before is None else before) != (nobody if beside is None else beside))

    def _levels_with(self, marked: BoolArray) -> set[int]:
        """Return the levels with a node that is marked, of all nodes (nodes,)."""
        return {grid.level for grid in self._grids.levels if marked[grid.packed].any()}

    def _made(self, number: int) -> RouteField:
        """Return the column of this number, with the next link of each node."""
        packed, routes, grids = self.fields.packed, len(self.fields.routes), self._grids
        first = self._first if self._smoke is None else None
        if first is not None and number in first:
            self._columns[number] = first[number].copy(packed.travel_time, packed.direction)
            return self._columns[number]
        lower = self._columns.get(number - routes)
        base = self._clear if self._smoke is None else self.fields
        column = RouteField(base, packed.travel_time, packed.direction, number, Gates(grids), 0.0, lower)
        if self._smoke is not None:
            for level in range(len(grids.levels)):
                column.take_smoke(level, self._smoke)
        column.keep_links()
        if first is not None:
            first[number] = column.copy(base.packed.travel_time, base.packed.direction)
        self._columns[number] = column
        return column

    def _headings(self, columns: IntArray, level: IntArray, nodes: IndexArray) -> FloatArray:
        """Return the directions (n, 2) of columns (n,) in the empty building at nodes (n,)."""
        packed, at = self._clear.packed, np.maximum(level, 0)
        if not len(packed.direction):  # no way is open
            return np.zeros((len(level), 2))
        field = packed.field_of[at, columns]
        place = packed.offset[np.maximum(field, 0)] + nodes - self._kernels.first[at]
        return np.where((field >= 0)[:, None], packed.direction[place], 0.0)

    def take_smoke(self, share: FloatArray) -> set[int]:
        """Begin anew with the share (nodes,) of the speed that smoke leaves; return the columns to be written again."""
        removed = set(self._columns)
        self._columns.clear()
        self._solved.clear()
        self._beside.clear()
        self._smoke = share
        return removed

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of the arrays that are needed to continue with the same bits."""
        state: dict[str, NDArray[Any]] = {}
        for number, density in self._density.items():
            state[f"{number}.density"] = density.copy()
        for number, beside in self._beside.items():
            state[f"{number}.beside"] = beside.copy()
        for number, column in self._columns.items():
            state[f"{number}.solved"] = np.array(sorted(self._solved[number]), np.int64)
            state |= {f"{number}.column.{name}": values for name, values in column.state().items()}
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned; routes in smoke have been restored."""
        for key in state:
            number, _, name = key.partition(".")
            if name in ("density", "beside"):
                values = taken(state, key, np.float64, (self._grids.size,), 0.0, np.inf).copy()
                (self._density if name == "density" else self._beside)[int(number)] = values
            elif name == "solved":
                levels = taken(state, key, np.int64, (None,), 0, len(self._grids.levels) - 1)
                self._solved[int(number)] = set(levels.tolist())
                with part_of(state, f"{number}.column.") as own:
                    self._made(int(number)).restore(own)
