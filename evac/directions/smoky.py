"""Routes that are solved again with the speeds in smoke, for every strategy.

Until smoke is first noticed, directions are those of the building. Then each route has a `RouteField`, as those that
follow the crowd have, whose slowness is divided by the share of the speed at each node. A level is solved again if the
share has changed on it, or if its ways lead through a level that is.
"""

from collections.abc import Set

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.saved import Saved
from evac.directions.density import Gates
from evac.directions.fields import Fields
from evac.directions.local import LocalWays
from evac.directions.quickest import Quickest
from evac.directions.routefield import RouteField

#: Least share of the speed, so that travel times remain finite.
LEAST_SHARE = 1e-5


class Smoky(Saved):
    """The routes of a run in smoke, with the fields of the run, those of the empty building, and ways that follow the
    crowd.

    `fields` have travel times and directions of their own, which `solve` changes in place; `share` (nodes,) is the
    share of the speed with which they are solved.
    """

    saved = ("_smoke", "_columns")
    growing = ("_smoke",)  # so that it is assigned

    def __init__(
        self, fields: Fields, clear: Fields, quickest: Quickest | None = None, local: LocalWays | None = None
    ) -> None:
        self.fields = fields.with_own_directions() if fields is clear else fields
        self._grids = grids = fields.grids[0].grids
        self.share, self._local = np.ones(grids.size), local
        self._followers = {} if quickest is None else quickest.columns
        self._columns: dict[int, RouteField] = {}
        routes, packed, gates = len(fields.routes), self.fields.packed, Gates(grids)
        for number in range(len(fields.grids) * routes):
            if number not in self._followers:
                lower = self._columns.get(number - routes)
                column = RouteField(clear, packed.travel_time, packed.direction, number, gates, 0.0, lower)
                self._columns[number] = column

    def solve(self, levels: Set[int], share: FloatArray) -> int:
        """Solve all routes with new shares (nodes,) of the speed on some levels; return the number of levels that
        were solved.
        """
        is_first = bool((self.share == 1.0).all())
        solved = 0
        for level in levels:
            packed = self._grids.levels[level].packed
            self.share[packed] = np.maximum(share[packed], LEAST_SHARE)
        local: set[int] = set() if self._local is None else self._local.take_smoke(self.share)
        everywhere = set(range(len(self._grids.levels)))
        for number, column in (*self._columns.items(), *self._followers.items()):
            for level in levels:
                column.take_smoke(level, self.share)
            solved += column.solve(levels, everywhere, True)
            if is_first or number in local:
                column.write(everywhere)
        return solved

    @property
    def _smoke(self) -> FloatArray:
        """The share, which all columns take when it is restored."""
        return self.share

    @_smoke.setter
    def _smoke(self, share: FloatArray) -> None:
        self.share[:] = share
        for level in range(len(self._grids.levels)):
            for column in (*self._columns.values(), *self._followers.values()):
                column.take_smoke(level, self.share)
        if self._local is not None:
            self._local.take_smoke(self.share)
