"""Rest: people who rest on landings after a length of stairs."""

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd

ONWARDS = 0.6  #: Way on a landing or floor before people stop there, so that they leave the flight to others [m].


class Rest(Behaviour):
    """People of the groups with the key ``after`` rest on landings and floors between flights of stairs.

    Once they have walked the length `after` on flights since the last rest, they walk 0.6 m onto the next landing or
    floor and stand there for `pause`. With the behaviour `walking`, others walk around them. The defaults are
    assumptions, because measured lengths and times that are generally valid do not exist.
    """

    name = "rest"
    saved = ("_walked", "_climbed", "_onwards", "_until")
    reads = ("level", "distance")
    writes = ("speed_factor",)
    group_keys = ("after", "pause")

    after = Parameter(10.0, "length of flights, in plan, after which a person rests", unit="m", above=0.0)
    pause = Parameter(20.0, "duration of a rest", unit="s", minimum=0.0)

    def prepare(self, scene: BehaviourScene) -> None:
        """Find the people who rest."""
        groups = [group for group in scene.groups if "after" in group.settings]
        self._rows = np.concatenate([np.zeros(0, np.int32), *(group.rows for group in groups)])
        sizes = [len(group.rows) for group in groups]
        self._after = np.repeat([float(group.settings["after"]) for group in groups], sizes)
        self._pause = np.repeat([float(group.settings.get("pause", self.pause)) for group in groups], sizes)
        self._is_flight = np.array([level.kind == "flight" for level in scene.scene.building.levels])
        n = len(self._rows)
        self._walked, self._climbed, self._onwards = np.zeros(n), np.zeros(n), np.zeros(n)
        self._until: FloatArray = np.full(n, -np.inf)

    def act(self, crowd: Crowd, time: float) -> None:
        """Add up the ways on flights, and let those stand who rest."""
        level, walked = crowd.level[self._rows], crowd.distance[self._rows]
        step, self._walked = walked - self._walked, walked
        climbs = self._is_flight[level] & (level >= 0)
        self._climbed += np.where(climbs, step, 0.0)
        self._onwards = np.where(climbs, 0.0, self._onwards + step)
        tired = ~climbs & (self._climbed >= self._after) & (self._onwards >= ONWARDS)
        self._until[tired] = time + self._pause[tired]
        self._climbed[tired] = 0.0
        crowd.speed_factor[self._rows[time < self._until]] = 0.0

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if no group rests."""
        return any("after" in group.settings for group in scene.groups)
