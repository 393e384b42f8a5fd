"""Response time: the delay between the alarm and the start of walking."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import IntArray
from evac.base.distributions import Distribution, parse
from evac.base.errors import PluginError, ScenarioError, naming
from evac.base.parameters import Parameter, did_you_mean
from evac.building.model.cells import LevelField
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd

BEGIN = ("start", "cue")  #: What response times count from.
WALKS = 0.3  #: Speed from which people are seen to walk [m/s].


class ResponseTime(Behaviour):
    """Draws the time at which each person starts to walk; before, the desired speed is zero.

    Times are drawn before the first step. The response time t_r of the paper (Tables 2, 4 and 5) is ``time`` with
    ``per = "person"``. The occupants of a room often react together (``"place"``), and so do families and classes
    (``"group"``).

    With ``begin = "cue"``, which a group may set for itself, the response time counts from the first cue that a person
    gets: an alarm at the place of the person (an event of kind "alarm"), people who walk within ``sees`` and are not
    hidden by walls, or a field, such as smoke, that has reached its threshold at the person.

    People who start in a place of a phase of the case (`[[phase]]`) wait for its alarm, whatever ``begin`` is.

    People who arrive through an exit or a portal walk on at once, so that they do not block it, unless their group has
    a ``time`` or ``begin`` of its own, which then counts from the arrival.

    Examples
    --------
    >>> ResponseTime(time={"uniform": [0.0, 10.0]}, per="group").per
    'group'
    """

    name = "response_time"
    saved = ("_response", "_heard")
    reads = ("position", "level", "group")
    writes = ("start_time",)
    group_keys = ("time", "begin")
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
        "(outside of areas: on the same level; of people who arrive: in the same group)",
        choices=("person", "group", "place"),
    )

    begin: Any = Parameter("start", "what response times count from: the start of the run, or a cue", choices=BEGIN)
    sees: Any = Parameter(0.0, "distance within which walking people are a cue; 0: they are none", "m", 0.0)
    fields: Any = Parameter({}, "fields that are a cue, with their thresholds, such as { smoke = 0.1 }")

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        is_table = isinstance(self.fields, Mapping) and all(isinstance(v, int | float) for v in self.fields.values())
        if not is_table:
            raise PluginError(f"response_time.fields: {self.fields!r:.100} is not a table of fields and values")

    def prepare(self, scene: BehaviourScene) -> None:
        """Draw the start times."""
        for key, distribution, rows in self._draws(scene):
            _, unit = np.unique(self._units(scene, rows), return_inverse=True)
            with naming(key):
                times = distribution.draw(scene.generator, int(unit.max()) + 1)
            scene.crowd.start_time[rows] = times[unit]
        self._scene, self._heard = scene, 0
        for group in scene.groups:
            if self._walks_on(group):
                scene.crowd.start_time[group.rows] = 0.0
        self._response = scene.crowd.start_time.copy()
        for group in scene.groups:
            if self._begin_of(group) == "cue":
                scene.crowd.start_time[group.rows] = np.inf
        for place in scene.alarmed:
            scene.crowd.start_time[scene.people_in(place)] = np.inf

    def act(self, crowd: Crowd, time: float) -> None:
        """Let people who get a cue start after their response time, and those who are alarmed earlier."""
        for change in self._scene.scene.changes[self._heard :]:
            if change.kind == "alarm":
                self._start(crowd, self._scene.people_in(change.what), time, change.values.get("value", 1.0))
        self._heard = len(self._scene.scene.changes)
        waits = np.isinf(crowd.start_time) & (crowd.level >= 0)
        if not waits.any():
            return
        for name, threshold in self.fields.items():
            field = self._field(name)
            rows = np.flatnonzero(waits)
            self._start(crowd, rows[field.at(crowd.level[rows], crowd.position[rows]) >= threshold], time)
        if self.sees > 0.0:
            from evac.people.sights import watch_walkers  # its kernel is compiled only for cases that need it

            speed = np.hypot(*self._scene.displacement_velocity.T)
            walks = (speed > WALKS) & (crowd.start_time <= time) & (crowd.level >= 0)
            goal, count = np.where(walks, 0, -1).astype(np.int32), np.zeros((len(waits), 1))
            place = np.ascontiguousarray(crowd.position), np.ascontiguousarray(crowd.level)
            watch_walkers(self._scene.world, *place, waits.view(np.uint8), goal, float(self.sees), count)
            self._start(crowd, np.flatnonzero(count), time)

    def _start(self, crowd: Crowd, rows: NDArray[Any], time: float, share: float = 1.0) -> None:
        """Let people start after a share of their response times."""
        crowd.start_time[rows] = np.minimum(crowd.start_time[rows], time + share * self._response[rows])

    def _field(self, name: str) -> LevelField:
        known = self._scene.scene.fields_of_behaviours
        if name not in known:
            hint = did_you_mean(name, list(known)) if known else "no behaviour of the case has a field"
            raise ScenarioError(f"behaviours.response_time.fields: there is no field {name!r}; {hint}")
        return known[name]

    def _walks_on(self, group: Any) -> bool:
        """Return whether people come in through a doorway, in which they do not stand unless their group says so."""
        return group.comes_in and not group.settings

    def _begin_of(self, group: Any) -> str:
        found: str = group.settings.get("begin", BEGIN[0] if self._walks_on(group) else self.begin)
        return found

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if everybody starts immediately."""
        has_cues = bool(scene.alarmed) or any(self._begin_of(group) == "cue" for group in scene.groups)
        return has_cues or any(distribution.support() != (0.0, 0.0) for _, distribution, _ in self._draws(scene))

    def acts_at_ticks(self) -> bool:
        """Return False if response times count from the start: `prepare` does all the work, but for alarms."""
        return bool(self._scene.alarmed) or any(self._begin_of(group) == "cue" for group in self._scene.groups)

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
        comes = level < 0  # during the run
        place[comes] = len(areas) + len(scene.building.levels) + scene.crowd.group[rows[comes]]
        return place
