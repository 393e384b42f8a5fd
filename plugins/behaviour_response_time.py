"""Response time: the delay between the alarm and the start of walking."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import IntArray
from evac.base.distributions import Distribution, parse
from evac.base.errors import naming
from evac.base.parameters import Parameter
from evac.base.saved import taken
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd


class ResponseTime(Behaviour):
    """Draws the time at which each person starts to walk; before, the desired speed is zero.

    Times are drawn before the first step. The response time t_r of the paper (Tables 2, 4 and 5)
    is ``time`` with ``per = "person"``. Occupants of one room often react together (``"place"``), and
    so do families and classes (``"group"``).

    Raises
    ------
    PluginError
        `time` is not a distribution of times of at least 0 s.
    ScenarioError
        From `prepare`: the ``time`` of a group is not such a distribution.

    Examples
    --------
    >>> ResponseTime(time={"uniform": [0.0, 10.0]}, per="group").per
    'group'
    """

    name = "response_time"
    reads = ("position", "level", "group")
    writes = ("start_time",)
    group_keys = ("time",)
    hears_alarms = True

    time: Any = Parameter(
        {"constant": 0.0},
        "distribution of the response time t_r; `time` of a group overrides it",
        "s",
        minimum=0.0,
        distribution=True,
    )
    per: Any = Parameter(
        "person",
        "people who share one value: each person, a group, or all people who start in the same area "
        "(outside of areas: on the same level)",
        choices=("person", "group", "place"),
    )

    def prepare(self, scene: BehaviourScene) -> None:
        """Draw the start times."""
        for key, distribution, rows in self._draws(scene):
            _, unit = np.unique(self._units(scene, rows), return_inverse=True)
            with naming(key):
                times = distribution.draw(scene.generator, int(unit.max()) + 1)
            scene.crowd.start_time[rows] = times[unit]
        self._scene, self._heard = scene, 0
        self._response = scene.crowd.start_time.copy()

    def act(self, crowd: Crowd, time: float) -> None:
        """Let people who are alarmed start earlier; called at the tick after a change of the scene."""
        for change in self._scene.scene.changes[self._heard :]:
            if change.kind == "alarm":
                rows = self._scene.people_in(change.what)
                share = change.values.get("value", 1.0)
                crowd.start_time[rows] = np.minimum(crowd.start_time[rows], time + share * self._response[rows])
        self._heard = len(self._scene.scene.changes)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the response times, and the number of changes of the scene that were looked at."""
        return {"response": self._response, "heard": np.array([self._heard])}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        self._response[:] = taken(state, "response", np.float64, self._response.shape, 0.0, np.inf)
        self._heard = int(taken(state, "heard", np.int64, (1,), 0, np.iinfo(np.int64).max)[0])

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if everybody starts immediately."""
        return any(distribution.support() != (0.0, 0.0) for _, distribution, _ in self._draws(scene))

    def acts_at_ticks(self) -> bool:
        """Return False, since all work is done in `prepare`."""
        return False

    def _draws(self, scene: BehaviourScene) -> Iterator[tuple[str, Distribution, IntArray]]:
        """Yield the key, the distribution and the people of the common distribution and of those of groups."""
        own = [group for group in scene.groups if "time" in group.settings]
        shared = [group.rows for group in scene.groups if "time" not in group.settings and len(group.rows)]
        if shared:
            yield "behaviours.response_time.time", self.time, np.concatenate(shared)
        for group in own:
            key = f"people.{group.name}.behaviours.response_time.time"
            distribution = parse(group.settings["time"], key, minimum=0.0)
            if len(group.rows):
                yield key, distribution, group.rows

    def _units(self, scene: BehaviourScene, rows: IntArray) -> IntArray:
        """Return an index for each person, equal for people who share one value."""
        if self.per == "person":
            return np.arange(len(rows), dtype=np.int32)
        if self.per == "group":
            return scene.crowd.group[rows]
        areas = scene.building.areas
        level = scene.crowd.level[rows]
        x, y = scene.crowd.position[rows].T
        place = (len(areas) + level).astype(np.int32)
        for index, area in enumerate(areas):
            place[shapely.contains_xy(area.polygon, x, y) & (level == area.level) & (place >= len(areas))] = index
        return place


evac_interface = 3
