"""Changes of the scene: their kinds, and the events of the case, which happen at times or on conditions."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely

from evac.base.arrays import IntArray
from evac.base.change import ARRIVES, CLOSES, LEAVE, LIFT, OPENS, REMEDIES, Change, is_legal
from evac.base.errors import EvacError, ScenarioError
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.building.model.links import changed
from evac.directions.routes import Route, changed_route

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.case.schema import EventSettings, WhenSettings
    from evac.people.places import Places
    from evac.simulation.scene import Scene

#: Times that differ by less are the same [s]: a multiple of the tick is rounded.
AT_ONCE = 1e-9


class Kind(NamedTuple):
    """A kind of change.

    `check` raises an error if it cannot be made. `act` returns values to be recorded with it, None if it has no effect.
    """

    check: Callable[["Scene", Change], Any]
    act: Callable[["Scene", Change], Mapping[str, Any] | None]


def check(scene: "Scene", change: Change) -> None:
    """Refuse a change that cannot be made."""
    if change.kind not in KINDS:
        hint = did_you_mean(change.kind, (*KINDS,))
        raise ScenarioError(f"change of {change.what!r}: there is no kind {change.kind!r}; {hint}")
    if unknown := change.values.keys() - {"value", "let_through"}:  # the latter in a change that was recorded
        raise ScenarioError(f"change of {change.what!r}: {change.kind!r} has no values {sorted(unknown)}")
    value = change.values.get("value")
    if not is_legal(change.kind, value):
        what = f"change {change.kind!r} of {change.what!r}"
        raise ScenarioError(f"{what}: its value is {value!r}; use {REMEDIES[change.kind]}")
    KINDS[change.kind].check(scene, change)


def _check_building(scene: "Scene", change: Change) -> None:
    changed(scene.building, change)


def _change_building(scene: "Scene", change: Change) -> Mapping[str, Any] | None:
    own = {}
    if change.kind == "close" and "value" not in change.values and scene.building.pieces_of(change.what):
        assert scene.people is not None
        own = {"value": LEAVE} if len(scene.people.rows_in(scene.building, change.what)) else {}
    building = changed(scene.building, replace(change, values={**change.values, **own}))
    if building is scene.building:
        return None
    let_through = scene.set_building(building)
    return {**own, "let_through": tuple(let_through)} if let_through else own


def _group_of(scene: "Scene", change: Change) -> tuple[int, IntArray, "Places"]:
    """Return the index of the group that a change is about, its rows, and the places."""
    assert scene.people is not None
    assert scene.places is not None
    names = [group.name for group in scene.people.groups]
    if change.what not in names:
        hint = did_you_mean(change.what, names)
        raise ScenarioError(f"change of {change.what!r}: there is no such group; {hint}")
    index = names.index(change.what)
    return index, scene.people.groups[index].rows, scene.places


def _check_strategy(scene: "Scene", change: Change) -> None:
    """Check that there are directions for the routes after a change."""
    group, rows, places = _group_of(scene, change)
    value = change.values["value"]
    of_group = places.of_groups[rows].tolist()
    after: set[Route | str] = {changed_route(scene.fields.routes[index], value) for index in of_group}
    if isinstance(value, tuple) and places.has_assembly_areas(value):
        after = set() if places.can_be_sent(group, value) else {" or ".join(value)}
    for route in after - {*scene.fields.routes}:
        raise ScenarioError(
            f"change of {change.what!r}: there are no directions for the route {route}; name the change in an "
            "[[event]] of the case, or return the route from Behaviour.routes"
        )


def _change_strategy(scene: "Scene", change: Change) -> Mapping[str, Any] | None:
    """Change the strategy of a group, or send it to exits or assembly areas, where there are directions for it."""
    group, rows, places = _group_of(scene, change)
    value, routes = change.values["value"], scene.fields.routes
    if isinstance(value, tuple) and places.has_assembly_areas(value):
        return {} if places.send(group, value) else None
    before = places.exit_routes(rows)
    changed_to = {index: changed_route(routes[index], value) for index in before.tolist()}
    known = {index: routes.index(route) if route in routes else index for index, route in changed_to.items()}
    after = np.array([known[index] for index in before.tolist()], np.int32)
    is_sent = isinstance(value, tuple) and places.send(group, ())
    if not is_sent and (before == after).all():
        return None
    places.set_exit_routes(rows, after)
    return {}


def _find_people(scene: "Scene", change: Change) -> None:
    assert scene.people is not None
    scene.people.rows_in(scene.building, change.what)


def _refuse_lift(scene: "Scene", change: Change) -> None:
    """Refuse what only cars do."""
    raise ScenarioError(
        f"change of {change.what!r}: the kind 'lift' is what cars do by themselves; 'close' and 'open' take a lift out "
        "of service and put it back"
    )


def _change_lift(scene: "Scene", change: Change) -> Mapping[str, Any] | None:
    """Open or close the doors of a car, or let it leave, or let its people arrive."""
    what, *storeys = change.values["value"]
    if what in (OPENS, CLOSES):
        return _change_building(scene, change)
    if what == ARRIVES:
        from evac.simulation.lifts import carry

        lift = next(lift for lift in scene.building.lifts if lift.name == change.what)
        carry(scene, lift, *map(lift.storeys.index, storeys))
    return {}


_BUILDING = Kind(_check_building, _change_building)

#: All kinds of change.
KINDS = {
    **dict.fromkeys(("open", "close", "no_entry", "control", "one_way", "move", "slow", "bar"), _BUILDING),
    "strategy": Kind(_check_strategy, _change_strategy),
    "alarm": Kind(_find_people, lambda scene, change: {}),  # on which behaviours act
    LIFT: Kind(_refuse_lift, _change_lift),
}


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
        assert people is not None
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
