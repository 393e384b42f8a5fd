"""Kinds of changes of the scene: what is checked before one is made, and what it does."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from evac.base.arrays import IntArray
from evac.base.change import ARRIVES, CLOSES, LEAVE, LIFT, OPENS, REMEDIES, Change, is_legal
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.building.model.links import changed
from evac.directions.routes import Route, changed_route

if TYPE_CHECKING:
    from evac.people.places import Places
    from evac.simulation.scene import Scene

#: Times that differ by less are the same [s]: a multiple of the tick is rounded.
AT_ONCE = 1e-9


class ChangeKind(NamedTuple):
    """A kind of change.

    `check` raises an error if it cannot be made. `act` returns values to be recorded with it, None if it has no effect.
    """

    check: Callable[["Scene", Change], Any]
    act: Callable[["Scene", Change], Mapping[str, Any] | None]


def check(scene: "Scene", change: Change) -> None:
    """Refuse a change that cannot be made."""
    if change.kind not in CHANGE_KINDS:
        hint = did_you_mean(change.kind, (*CHANGE_KINDS,))
        raise ScenarioError(f"change of {change.what!r}: there is no kind {change.kind!r}; {hint}")
    if unknown := change.values.keys() - {"value", "let_through"}:  # the latter in a change that was recorded
        raise ScenarioError(f"change of {change.what!r}: {change.kind!r} has no values {sorted(unknown)}")
    value = change.values.get("value")
    if not is_legal(change.kind, value):
        what = f"change {change.kind!r} of {change.what!r}"
        raise ScenarioError(f"{what}: its value is {value!r}; use {REMEDIES[change.kind]}")
    CHANGE_KINDS[change.kind].check(scene, change)


def _check_building(scene: "Scene", change: Change) -> None:
    changed(scene.building, change)


def _change_building(scene: "Scene", change: Change) -> Mapping[str, Any] | None:
    own = {}
    if change.kind == "close" and "value" not in change.values and scene.building.pieces_of(change.what):
        own = {"value": LEAVE} if len(scene.people.rows_in(scene.building, change.what)) else {}
    building = changed(scene.building, replace(change, values={**change.values, **own}))
    if building is scene.building:
        return None
    let_through = scene.set_building(building)
    return {**own, "let_through": tuple(let_through)} if let_through else own


def _group_of(scene: "Scene", change: Change) -> tuple[int, IntArray, "Places"]:
    """Return the index of the group that a change is about, its rows, and the places."""
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


_BUILDING = ChangeKind(_check_building, _change_building)

#: All kinds of change.
CHANGE_KINDS = {
    **dict.fromkeys(("open", "close", "no_entry", "control", "one_way", "move", "slow", "bar"), _BUILDING),
    "strategy": ChangeKind(_check_strategy, _change_strategy),
    # Behaviours act on alarms.
    "alarm": ChangeKind(lambda scene, change: scene.people_in(change.what), lambda scene, change: {}),
    LIFT: ChangeKind(_refuse_lift, _change_lift),
}
