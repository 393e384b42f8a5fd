"""The queues before exits, portals and doors, whose width limits how many people pass in a second.

A law of the density alone takes the crowd before a door for too fast, since people stand wherever there is room but
leave through the door one after another. The crowd on the way to each of these gates is therefore counted by its
walking time to it, and advances no faster than the gate is passed. Those who are still on their way are in the count,
so that people do not turn to an exit that others will have reached before them.
"""

import numpy as np

from evac.base.arrays import FloatArray, IntArray
from evac.base.saved import Bounds, Saved
from evac.directions.march.waves import find_queues
from evac.directions.raster.grids import BuildingGrids

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

    def bounds(self) -> dict[str, Bounds]:
        """Return that numbers of people are 0 or more."""
        return {"people": Bounds(0.0, np.inf)}

    def count(self, gate: IntArray, walk: FloatArray, gain: float) -> None:
        """Count people (n,) on the way to gates (-1: none), `walk` [s] away, with a weight beside those before."""
        step = (walk / STEP).astype(np.int64)
        queueing = (gate >= 0) & (step < BINS)
        now = np.bincount(gate[queueing] * BINS + step[queueing], minlength=self.people.size)
        self.people += gain * (now.reshape(self.people.shape) - self.people)
        find_queues(self.people, self._capacity, STEP, self.queues)
