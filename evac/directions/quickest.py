"""Travel times that are solved again during a run, with speeds that fall with the density, for the strategy "quickest".

The directions of other strategies belong to an empty building; only the waits for lifts that they weigh against stairs
follow the people on the way to them. Those of this one follow the crowd: every few seconds, the density is found from
the places of people, and the routes are solved again on the grids of the building with the relative speed of Weidmann
(1993),

    f = 1 - exp(-1.913 (1 / rho - 1 / 5.4)),    at least `floor`,

up to the density of the greatest flow, 1.75 per m2, and above it with that which keeps this flow. The density rho is
the sum of Gauss kernels of people, divided by the share of the kernel that lies on the floor, and averaged over time.
Before exits, portals and doors people are also no faster than these are passed (`Gates`). A level is solved again
only if the speeds have changed on it, or if its ways lead through a level that is (`routefield.py`), without the rooms
that no way leads through while nobody is in them (`Pockets` of `routefield.py`).
"""

from typing import Protocol

import numpy as np

from evac.base.arrays import FloatArray, IndexArray, IntArray
from evac.base.saved import Saved
from evac.directions.density import Gates, Kernels, at_nodes_of, gain_of
from evac.directions.fields import Fields, columns_of
from evac.directions.march.compiled import first_car
from evac.directions.routefield import RouteField
from evac.directions.routes import QUICKEST, WaitsForLifts, no_waits


class Settings(Protocol):
    """Parameters of the strategy, see `[directions.quickest]`."""

    period: float
    width: float
    memory: float
    floor: float
    hesitation: float


class Quickest(Saved):
    """The routes with the strategy "quickest" of a run, `columns`, and the density that they avoid.

    `fields` have travel times and directions of their own, which `update` changes in place; `clear` are those of the
    empty building.
    """

    saved = ("_density", "_counts", "_is_solved", "_gates", "columns")

    def __init__(self, fields: Fields, settings: Settings, before: "Quickest | None" = None) -> None:
        self.fields, self.clear = fields.with_own_directions(), fields
        own = self.fields.packed
        self._settings = settings
        self._grids = grids = fields.grids[0].grids
        self._kernels = Kernels(grids, own, settings.width)
        self._gates = Gates(grids)
        self.columns: dict[int, RouteField] = {}
        routes = len(fields.routes)
        for number in range(len(fields.grids) * routes):
            if fields.routes[number % routes].follows_crowd:
                lower = self.columns.get(number - routes)
                column = RouteField(
                    fields, own.travel_time, own.direction, number, self._gates, settings.hesitation, lower
                )
                column.write(set(range(len(grids.levels))))
                self.columns[number] = column
        #: For each column of people: the next gate (nodes,) on their way, the time to it, and the exit or car.
        self._ways = {number: _way_of(one) for number, one in self.columns.items()}
        self._is_solved = np.array(False)
        self._density = np.zeros(grids.size)
        self._counts = np.zeros(2, np.int64)  # updates, levels solved
        if before is not None:
            self._density = at_nodes_of(grids, before._density, before._grids)
            self._counts, self._gates.people = before._counts, before._gates.people

    def is_due(self, tick: int, length: float) -> bool:
        """Return whether an update is due at a tick of this length [s]: each period, and when links have changed."""
        return not self._is_solved or tick % max(1, round(self._settings.period / length)) == 0

    def update(
        self,
        level: IntArray,
        position: FloatArray,
        route: IntArray,
        radius: FloatArray,
        waits: WaitsForLifts = no_waits,
    ) -> None:
        """Solve the routes again for people at levels (n,), -1 for those who have left, and positions (n, 2) [m].

        Bodies fit through gaps by their radii (n,) [m].
        """
        columns = columns_of(self.fields.packed, route, radius)
        inside = level >= 0
        nodes = self._kernels.nodes_at(level, position)
        gain = gain_of(self._settings.period, self._settings.memory) if self._counts[0] else 1.0
        crowded = self._kernels.average(self._density, level, position, gain)
        longer = waits(self._count_on_way(level[inside], nodes[inside], columns[inside], gain))
        for number, column in self.columns.items():
            rows = (columns == number) & inside
            changed = column.leave_out_empty(nodes[rows])
            if self.fields.routes[number % len(self.fields.routes)].strategy == QUICKEST:
                changed |= column.slow_down(self._density, crowded, self._settings.floor)
            changed |= column.wait_for_lifts(longer, gain)
            occupied = set(np.unique(level[rows]).tolist())
            self._counts[1] += column.solve(changed, occupied, not self._is_solved)
        self._counts[0] += 1
        self._is_solved[()] = True

    def report(self) -> dict[str, float]:
        """Return what the summary of a run says about the updates."""
        return dict(zip(("updates", "levels_solved"), self._counts.tolist(), strict=True))

    def _count_on_way(self, level: IntArray, nodes: IndexArray, columns: IntArray, gain: float) -> IntArray:
        """Count people at nodes of levels on their way to gates; return how many are on the way to each car (levels,).

        Those with other strategies walk as in the empty building.
        """
        gate, end, walk = *np.full((2, len(nodes)), -1, np.int32), np.zeros(len(nodes))
        for number in np.unique(columns).tolist():
            if number not in self._ways:
                fields = self.clear
                self._ways[number] = _way_of(
                    RouteField(fields, fields.packed.travel_time, fields.packed.direction, number, self._gates)
                )
            rows = columns == number
            gate[rows], walk[rows], end[rows] = (values[nodes[rows]] for values in self._ways[number])
        self._gates.count(gate, walk, gain)
        building = self._grids.building
        is_in_car = np.array([one.kind == "car" for one in building.levels])[level]
        car = end[~is_in_car] - first_car(building)
        on_way: IntArray = np.bincount(car[car >= 0], minlength=len(building.levels)).astype(np.int32)
        return on_way


def _way_of(column: RouteField) -> tuple[IntArray, FloatArray, IntArray]:
    """Return for each node of a column the next gate on the way, the time to it, and the exit or car."""
    return column.waves.gate, column.waves.walk, column.waves.exit
