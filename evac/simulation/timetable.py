"""The events of a case: changes of the scene at given times, or when something happens."""

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.base.change import Change
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Bounds, Saved
from evac.simulation.kinds import check
from evac.simulation.scene import AT_ONCE, Scene

if TYPE_CHECKING:
    from evac.case.events import EventSettings, WhenSettings


class Timetable(Saved):
    """Applies the events of a case to a scene."""

    saved = ("_happens",)

    def __init__(self, events: "tuple[EventSettings, ...]", scene: Scene) -> None:
        self._events, self._scene = events, scene
        self._places = {one.name: k for k, one in enumerate(events) if one.name is not None}
        # the time at which each event happens, infinite if it is not known yet [s]
        self._happens = np.array([math.inf if one.time is None else one.time for one in events])
        for one in events:
            change = Change(one.time or 0.0, one.kind, one.target, one.values)
            check(scene, change)
            if one.when is None:
                scene.apply(change)
            elif one.when.area is not None:
                self._area(one.when.area)

    @property
    def is_waiting(self) -> bool:
        """Whether a condition is left that has not come true."""
        return bool(np.isinf(self._happens).any())

    @property
    def groups_to_send(self) -> set[str]:
        """The groups of which events still to come change the strategy or the destinations."""
        is_ahead = self._happens > self._scene.time
        return {
            one.target for one, ahead in zip(self._events, is_ahead, strict=True) if ahead and one.kind == "strategy"
        }

    def act(self) -> None:
        """Apply the events whose conditions have come true, now or when their delay is over."""
        before = -1
        while before < (before := int(np.isfinite(self._happens).sum())):  # one may be the condition of another
            for k in np.flatnonzero(np.isinf(self._happens)).tolist():
                one, when = self._events[k], self._events[k].when
                if when is not None and self._is_true(when):
                    self._happens[k] = self._scene.time + when.after
                    self._scene.apply(Change(self._happens[k], one.kind, one.target, one.values))

    def bounds(self) -> dict[str, Bounds]:
        """Return that times are 0 s or more."""
        return {"_happens": Bounds(0.0, np.inf)}

    def _is_true(self, when: "WhenSettings") -> bool:
        """Return whether a condition is true now."""
        people = self._scene.people
        assert people is not None
        if when.event is not None:
            return bool(self._happens[self._places[when.event]] <= self._scene.time + AT_ONCE)
        if when.out is not None:
            return int(np.isfinite(people.crowd.exit_time).sum()) >= when.out
        assert when.area is not None
        count = len(people.rows_in(self._scene.building, when.area))
        if when.density is not None:
            return count >= when.density * self._area(when.area)
        return count >= when.count if when.count is not None else count <= (when.at_most or 0)

    def _area(self, name: str) -> float:
        """Return the area of an area or level [m2]."""
        building = self._scene.building
        area = building.area_named(name)
        if area is None:
            known = [one.name for one in building.areas] + [one.name for one in building.levels]
            raise ScenarioError(f"event.when.area: no area or level is named {name!r}; {did_you_mean(name, known)}")
        return float(shapely.area(area.polygon))
