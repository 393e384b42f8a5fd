"""The kinds of change of a scene: what each may say, and what it does."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from evac.base.change import REMEDIES, Change, is_legal
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean
from evac.building.model.links import changed
from evac.directions.routes import Route, changed_route

if TYPE_CHECKING:
    from evac.simulation.scene import Scene


class Kind(NamedTuple):
    """A kind of change.

    `check` raises an error if it cannot be made. `act` returns values to be recorded with it, None if it has no effect.
    """

    check: Callable[["Scene", Change], Any]
    act: Callable[["Scene", Change], Mapping[str, Any] | None]


def check(scene: "Scene", change: Change) -> None:
    """Refuse a change that cannot be made.

    Raises
    ------
    ScenarioError
        There is no such kind, its value is not one of the kind, or there is no such group or route.
    BuildingError
        The building has nothing of this name, or it cannot be changed in this way.
    """
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
    building = changed(scene.building, change)
    if building is scene.building:
        return None
    let_through = scene.become(building)
    return {"let_through": tuple(let_through)} if let_through else {}


def _routes_after(scene: "Scene", change: Change) -> dict[int, int]:
    """Return the route that the people of a group take after a change, for each of their routes before."""
    assert scene.people is not None
    groups, routes = {group.name: group for group in scene.people.groups}, scene.fields.routes
    if change.what not in groups:
        hint = did_you_mean(change.what, list(groups))
        raise ScenarioError(f"change of {change.what!r}: there is no such group; {hint}")
    found = {}
    for index in set(scene.people.crowd.route[groups[change.what].rows].tolist()):
        after: Route = changed_route(routes[index], change.values["value"])
        if after not in routes:
            raise ScenarioError(
                f"change of {change.what!r}: there are no directions for the route {after}; name the change in an "
                "[[event]] of the case, or return the route from Behaviour.routes"
            )
        found[index] = routes.index(after)
    return found


def _change_route(scene: "Scene", change: Change) -> Mapping[str, Any] | None:
    routes, people = _routes_after(scene, change), scene.people
    assert people is not None
    rows = next(group.rows for group in people.groups if group.name == change.what)
    after = [routes[index] for index in people.crowd.route[rows].tolist()]
    if (people.crowd.route[rows] == after).all():
        return None
    people.crowd.route[rows] = after
    return {}


def _find_people(scene: "Scene", change: Change) -> None:
    assert scene.people is not None
    scene.people.rows_in(scene.building, change.what)


def _sound(scene: "Scene", change: Change) -> Mapping[str, Any]:
    """Record an alarm, on which behaviours act."""
    return {}


_BUILDING = Kind(_check_building, _change_building)

#: All kinds of change.
KINDS = {
    **dict.fromkeys(("open", "close", "one_way", "slow", "bar"), _BUILDING),
    "strategy": Kind(_routes_after, _change_route),
    "alarm": Kind(_find_people, _sound),
}
