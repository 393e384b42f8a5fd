"""Route choice: each person takes the route of minimum cost for its own speeds, and may change it later."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import PluginError, ScenarioError
from evac.base.parameters import Parameter, did_you_mean
from evac.directions.fields import Fields
from evac.directions.routes import STRATEGIES, Route
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd

INSTANT = 1e-9  #: Tolerance of times, which are multiples of the step [s].


@dataclass(frozen=True)
class _Choosers:
    """People who choose between the same routes.

    ``strategies`` and ``changed_to`` are their strategies before and after ``change_at`` [s];
    ``exits`` are the permitted destinations, each a tuple of names; ``steepest`` is that of their route in the case.
    """

    rows: IntArray
    exits: tuple[tuple[str, ...], ...]
    strategies: tuple[str, ...]
    change_at: float
    changed_to: tuple[str, ...]
    steepest: float | None

    def offered(self, changed: bool) -> list[Route]:
        """Return the routes that they choose between."""
        strategies = self.changed_to if changed else self.strategies
        return [Route(exits, strategy, self.steepest) for strategy in strategies for exits in self.exits]


class RouteChoice(Behaviour):
    """People choose routes by their own speeds on the flat and up and down stairs.

    Directions are computed with reference speeds, which are the same for all people. With this behaviour, people who
    are slow on stairs can prefer another exit or a path without stairs. The cost of a route follows from the lengths of
    its path on the flat, up and down stairs:

    - flat + up + down, if "shortest" is the only strategy;
    - flat / v_flat + c (up / v_up + down / v_down), if "comfortable" is the only strategy, with the
      comfort factor c of the case;
    - flat / v_flat + up / v_up + down / v_down, if "fastest" or "quickest" is the only strategy, or if there are
      several.

    The choice does not depend on the crowd. People whose group has ``exits`` choose among these only.

    Examples
    --------
    >>> RouteChoice(exits=["north", "south"], strategies=["fastest"]).routes()
    (Route(exits=('north',), strategy='fastest'), Route(exits=('south',), strategy='fastest'))
    """

    name = "route_choice"
    saved = ("_changed", "_next", "_version")
    reads = ("position", "level", "contact_radius", "speed", "route")
    writes = ("route",)
    group_keys = ("exits", "strategies", "change_at")

    exits: Any = Parameter((), "exits to choose between; empty: all exits")
    strategies: Any = Parameter(("fastest",), "strategies to choose between", choices=STRATEGIES)
    every: Any = Parameter(0.0, "time between two choices; 0: only at the start", "s", minimum=0.0)
    change_at: Any = Parameter(math.inf, "time at which `change_to` replaces the strategies", "s", 0.0, infinite=True)
    change_to: Any = Parameter("", "strategy after `change_at`; empty: no change", choices=("", *STRATEGIES))

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        if not self.strategies:
            raise PluginError("route_choice.strategies: give at least one of " + ", ".join(STRATEGIES))
        if math.isfinite(self.change_at) and not self.change_to:
            raise PluginError("route_choice.change_at: requires change_to; set change_to to a strategy")
        self._groups: tuple[_Choosers, ...] = ()
        self._changed = np.zeros(0, dtype=np.uint8)
        self._next = np.array([math.inf])

    def routes(self) -> tuple[Route, ...]:
        """Return the routes to each of `exits` with each strategy."""
        strategies = dict.fromkeys((*self.strategies, *([self.change_to] if self.change_to else [])))
        single = tuple((name,) for name in self.exits) or ((),)
        return tuple(Route(exits, strategy) for strategy in strategies for exits in single)

    def prepare(self, scene: BehaviourScene) -> None:
        """Choose the initial routes."""
        self._scene = scene
        self._version = scene.version
        self._index = {route: index for index, route in reversed(list(enumerate(scene.fields.routes)))}
        self._groups = tuple(
            choosers for group in scene.groups for choosers in self._choosers_of(group, scene.crowd.route)
        )
        self._changed = np.zeros(len(self._groups), dtype=np.uint8)
        self._next = np.array([self.every if self.every > 0.0 else math.inf])
        for choosers in self._groups:
            self._choose(scene.crowd, choosers, False)

    def act(self, crowd: Crowd, time: float) -> None:
        """Choose again when a strategy changes, once per period, and when the scene changes."""
        again = time >= self._next[0] - INSTANT or self._scene.version != self._version
        self._version = self._scene.version
        if time >= self._next[0] - INSTANT:
            self._next[0] = self.every * (math.floor(time / self.every + INSTANT) + 1)
        for index, choosers in enumerate(self._groups):
            changes = not self._changed[index] and time >= choosers.change_at - INSTANT
            self._changed[index] |= changes
            if again or changes:
                self._choose(crowd, choosers, bool(self._changed[index]))

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if there is only one route in the scene."""
        return len(scene.fields.routes) > 1

    def acts_at_ticks(self) -> bool:
        """Return False if routes are only chosen at the start."""
        return self.every > 0.0 or any(math.isfinite(choosers.change_at) for choosers in self._groups)

    def _choosers_of(self, group: Any, route: IntArray) -> list[_Choosers]:
        """Return the people of a group, by the exits that their route in the case permits."""
        settings: Mapping[str, Any] = group.settings
        where = f"people.{group.name}.behaviours.route_choice"
        strategies = self._among(f"{where}.strategies", settings, "strategies", self.strategies)
        exits = self._among(f"{where}.exits", settings, "exits", self.exits)
        change_at = RouteChoice.declared()["change_at"].check(
            f"{where}.change_at", settings.get("change_at", self.change_at)
        )
        if math.isfinite(change_at) and not self.change_to:
            raise ScenarioError(f"{where}.change_at: set behaviours.route_choice.change_to to a strategy")
        choosers = []
        for index in np.unique(route[group.rows]):
            allowed = self._scene.fields.routes[index].exits
            possible: tuple[tuple[str, ...], ...] = tuple((name,) for name in exits if not allowed or name in allowed)
            if not exits and not allowed:
                possible = ((),)
            if not possible:
                raise ScenarioError(
                    f"people.{group.name}.exits: none of {', '.join(allowed)} is among behaviours.route_choice.exits "
                    f"({', '.join(exits) or 'none'}); add them there"
                )
            rows = group.rows[route[group.rows] == index]
            changed_to = (self.change_to,) if self.change_to else strategies
            steepest = self._scene.fields.routes[index].steepest
            choosers.append(_Choosers(rows, possible, strategies, change_at, changed_to, steepest))
        return choosers

    @staticmethod
    def _among(key: str, settings: Mapping[str, Any], name: str, offered: tuple[str, ...]) -> tuple[str, ...]:
        """Return the list of a group, which must be a subset of the list of the behaviour."""
        chosen: tuple[str, ...] = RouteChoice.declared()[name].check(key, settings.get(name, offered))
        for word in chosen:
            if word not in offered:
                raise ScenarioError(
                    f"{key}: {word!r} is not among behaviours.route_choice.{name}; {did_you_mean(word, offered)}"
                )
        return chosen or offered

    def _choose(self, crowd: Crowd, choosers: _Choosers, changed: bool) -> None:
        """Set the routes of people inside, but for those on their way to an area, to those of minimum cost."""
        to_area = np.array([bool(route.area) for route in self._scene.fields.routes])
        rows = choosers.rows[crowd.level[choosers.rows] >= 0]
        rows = rows[~to_area[crowd.route[rows]]]
        if not len(rows):
            return
        routes = choosers.offered(changed)
        strategies = {route.strategy for route in routes}
        measure = strategies.pop() if len(strategies) == 1 else "fastest"
        cost = route_costs(self._scene.fields, crowd, rows, [self._index[route] for route in routes], measure)
        best = np.argmin(cost, axis=1)
        reached = np.isfinite(cost[np.arange(len(rows)), best])
        chosen = np.array([self._index[route] for route in routes], dtype=np.int32)[best]
        crowd.route[rows[reached]] = chosen[reached]


def route_costs(fields: Fields, crowd: Crowd, rows: IntArray, routes: Sequence[int], measure: str) -> FloatArray:
    """Return the cost (rows, routes) of routes for people inside, by their own speeds; inf where there is no way.

    It is in metres if the measure is "shortest", otherwise in seconds.
    """
    with np.errstate(divide="ignore"):
        weight = np.ones((len(rows), 3)) if measure == "shortest" else 1.0 / crowd.speed[rows]
    if measure == "comfortable":
        weight[:, 1:] *= fields.comfort
    level = crowd.level[rows]
    position = crowd.position[rows]
    cost = np.full((len(rows), len(routes)), math.inf)
    for column, route in enumerate(routes):
        lengths = fields.lengths_at(level, position, route, crowd.contact_radius[rows])
        reached = np.isfinite(lengths[:, 0])
        with np.errstate(invalid="ignore"):  # 0 m at 0 m/s counts as 0 s
            own = np.where(lengths[reached] > 0.0, lengths[reached] * weight[reached], 0.0)
        cost[reached, column] = own.sum(axis=1)
    return cost
