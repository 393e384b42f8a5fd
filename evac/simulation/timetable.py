"""The events of a case, which happen at times or on conditions."""

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.base.change import Change
from evac.base.errors import EvacError, ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.simulation.changes import AT_ONCE, check

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import EventSettings, WhenSettings
    from evac.simulation.scene import Scene


class Timetable(Saved):
    """Applies the events of a case to a scene."""

    saved = ("_happens",)

    def __init__(self, case: "Case", scene: "Scene") -> None:
        events = case.events
        self._events, self._scene = events, scene
        self._places = {event.name: k for k, event in enumerate(events) if event.name is not None}
        # the time at which each event happens, infinite if it is not known yet [s]
        self._happens = np.array([math.inf if event.time is None else event.time for event in events])
        problems: list[str] = []
        keys = [f"event.{number}" for number in range(len(case.event))]
        keys += [f"phase.{phase.name}.of" for phase in case.phase for _ in phase.of]
        for key, event in zip(keys, events, strict=True):
            try:
                self._take(event, bool(case.conditions))
            except EvacError as error:
                text = str(error).removeprefix(f"{scene.building.source}: ")
                problems.append(f"{case.source}: {key}: {text}")
        if problems:
            raise ScenarioError("\n".join(problems))

    def _take(self, event: "EventSettings", has_air: bool) -> None:
        """Check an event, and apply its change if its time is known."""
        change = Change(event.time or 0.0, event.kind, event.target, event.values)
        check(self._scene, change)
        if event.when is None:
            self._scene.apply(change)
        elif event.when.area is not None:
            self._area(event.when.area)
            if event.when.smoke is not None and not has_air:
                raise ScenarioError("when.smoke: the case has no [[conditions]], from which smoke comes")

    @property
    def is_waiting(self) -> bool:
        """Whether a condition is left that has not come true."""
        return bool(np.isinf(self._happens).any())

    @property
    def groups_to_send(self) -> set[str]:
        """The groups of which events still to come change the strategy or the destinations."""
        is_ahead = self._happens > self._scene.time
        return {
            event.target
            for event, ahead in zip(self._events, is_ahead, strict=True)
            if ahead and event.kind == "strategy"
        }

    def act(self) -> None:
        """Apply the events whose conditions have come true, now or when their delay is over."""
        if not self._events:
            return
        before = -1
        while before < (before := int(np.isfinite(self._happens).sum())):  # one may be the condition of another
            for k in np.flatnonzero(np.isinf(self._happens)).tolist():
                event, when = self._events[k], self._events[k].when
                if when is not None and self._is_true(when):
                    self._happens[k] = self._scene.time + when.after
                    self._scene.apply(Change(self._happens[k], event.kind, event.target, event.values))

    def _is_true(self, when: "WhenSettings") -> bool:
        """Return whether a condition is true now."""
        people = self._scene.people
        if when.event is not None:
            return bool(self._happens[self._places[when.event]] <= self._scene.time + AT_ONCE)
        if when.out is not None:
            return int(np.isfinite(people.crowd.exit_time).sum()) >= when.out
        assert when.area is not None
        if when.smoke is not None:
            return self._smoke_in(when.area) >= when.smoke
        count = len(people.rows_in(self._scene.building, when.area))
        if when.density is not None:
            return count >= when.density * self._area(when.area)
        return count >= when.count if when.count is not None else count <= (when.at_most or 0)

    def _smoke_in(self, name: str) -> float:
        """Return the greatest extinction coefficient in an area or level, at the heads of people [1/m]."""
        field, most = self._scene.fields_of_behaviours["extinction"], 0.0
        for part in self._scene.building.parts_named(name):
            points = np.column_stack([values.ravel() for values in field.cells[part.level].centres()])
            own = np.vstack(
                [points[shapely.intersects_xy(part.polygon, *points.T)], *part.polygon.representative_point().coords]
            )
            most = max(most, float(field.at(np.full(len(own), part.level), own).max()))
        return most

    def _area(self, name: str) -> float:
        """Return the area of an area or level [m2]."""
        building = self._scene.building
        parts = building.parts_named(name)
        if not parts:
            known = [area.name for area in building.areas] + [level.title for level in building.levels]
            raise ScenarioError(f"when.area: no area, level or stair is named {name!r}; {did_you_mean(name, known)}")
        return float(sum(part.polygon.area for part in parts))
