"""Familiarity: people take the exits that they know, and those that signs and others show them."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IndexArray
from evac.base.errors import ScenarioError
from evac.base.parameters import Parameter
from evac.directions.routes import Route
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.sights import notice_signs, watch_walkers
from evac.physics.state import Crowd

INSTANT = 1e-9  #: Tolerance of times, which are multiples of the step [s].
BEFORE = 0.1  #: Distance of the point in front of an exit that is seen if the exit is [m].
WALKS = 0.3  #: Speed from which people are seen to walk [m/s].


class Familiarity(Behaviour):
    """People know some exits, learn of others from signs and by sight, and prefer the main entrance.

    Everybody knows the exits in `main`, and each of the others with the probability in `knows`, which a group may set
    for itself. People take the known exit of least cost. The cost is the travel time, multiplied by `trust` if the exit
    is in sight or a sign shows it, and otherwise by `preference` unless the exit is in `main`, because people tend to
    leave by the way they came (Sime, 1985). They decide at the start and after every interval `every`, and learn of

    - the exit of a sign (`[[place]]` of kind "sign") that is in sight within its range. A person notices each sign with
      the probability `notices`;
    - exits that are in sight within `sees`;
    - with `influence` > 0, exits to which people in sight within `sees` walk. The cost of such an exit is multiplied by
      1 - `influence` times the share of these people, including the person who decides, who go to it.

    People whose group has ``exits`` use these only, and people on their way to a refuge or an assembly area do not
    change it. People whose known exits are all closed take any exit.

    The default of `notices` is the share of people who saw a conventional sign in an experiment by Xie et al., from the
    abstract of Galea, Xie and Lawrence (2014); most of them followed it. `preference` and `trust` are assumptions.

    References
    ----------
    Sime: Movement toward the familiar. Environment and Behavior 17 (1985), 697-724. Xie, Filippidis, Galea,
    Blackshields, Lawrence: Experimental analysis of the effectiveness of emergency signage and its implementation in
    evacuation simulation. Fire and Materials 36 (2012), 367-382. Galea, Xie, Lawrence: Experimental and survey studies
    on the effectiveness of dynamic signage systems. Fire Safety Science 11 (2014), 1129-1143.
    """

    name = "familiarity"
    saved = ("_known", "_seen", "_next", "_version")
    reads = ("position", "level", "contact_radius", "route", "start_time")
    writes = ("route",)
    group_keys = ("knows",)
    follows_signs = True

    main: Any = Parameter((), "exits that everybody knows and prefers, such as the main entrance")
    knows: Any = Parameter({}, "shares of people who know other exits, such as { back = 0.3 }")
    preference: Any = Parameter(2.0, "factor of travel times to other known exits", minimum=1.0)
    trust: Any = Parameter(0.5, "factor of travel times to exits in sight or shown by signs", minimum=0.0, maximum=1.0)
    sees: Any = Parameter(10.0, "distance within which exits and people are seen", "m", minimum=0.0)
    notices: Any = Parameter(0.38, "share of signs in sight that people notice", minimum=0.0, maximum=1.0)
    influence: Any = Parameter(0.0, "weight of the choices of others", minimum=0.0, maximum=1.0)
    every: Any = Parameter(1.0, "time between two decisions", "s", above=0.0)

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        self._shares("behaviours.familiarity.knows", self.knows)

    @staticmethod
    def _shares(key: str, value: Any) -> Mapping[str, float]:
        """Return a table of shares after checking it."""
        is_table = isinstance(value, Mapping)
        if not is_table or not all(type(share) in (int, float) and 0.0 <= share <= 1.0 for share in value.values()):
            raise ScenarioError(f"{key}: must be a table of exits and shares from 0 to 1, not {value!r:.100}")
        return value  # type: ignore[no-any-return]

    @property
    def _names(self) -> list[str]:
        return list(dict.fromkeys((*self.main, *self.knows)))

    def routes(self) -> tuple[Route, ...]:
        """Return a route to each exit."""
        return tuple(Route((name,)) for name in self._names)

    def prepare(self, scene: BehaviourScene) -> None:
        """Draw what people know, find what they can see, and let them choose."""
        self._scene = scene
        crowd, routes, names = scene.crowd, scene.fields.routes, self._names
        people = len(crowd.level)
        self._is_main = np.array([name in self.main for name in names], dtype=np.bool_)
        self._may_use = np.ones((people, len(names)), dtype=np.bool_)
        self._known = np.zeros((people, len(names)), dtype=np.uint8)
        for group in scene.groups:
            shares = self._shares_of(group)
            drawn = scene.generator.random((len(group.rows), len(names))) < [shares[name] for name in names]
            self._known[group.rows] = drawn
            for index in np.unique(crowd.route[group.rows]).tolist():
                own = group.rows[crowd.route[group.rows] == index]
                self._may_use[own] = [routes[index].leads_to(name) or bool(routes[index].area) for name in names]
        self._routes = np.zeros((people, len(names)), dtype=np.int32)
        for index in np.unique(crowd.route).tolist():
            own_routes = [routes.index(Route((name,), steepest=routes[index].steepest)) for name in names]
            self._routes[crowd.route == index] = own_routes
        self._find_signs(names)
        is_noticed = scene.generator.random((people, len(self._sign_exit))) < self.notices
        is_noticed[:, self._is_exit] = True
        self._overlooked = (~is_noticed).astype(np.uint8)
        self._seen = np.zeros_like(self._known)
        self._next, self._version = 0.0, scene.version
        self.act(crowd, 0.0)

    def _shares_of(self, group: Any) -> dict[str, float]:
        """Return the share of a group that knows each exit."""
        key = f"people.{group.name}.behaviours.familiarity.knows"
        own = self._shares(key, group.settings.get("knows", {}))
        for name in own:
            if name not in self._names:
                raise ScenarioError(f"{key}: {name!r} is not in behaviours.familiarity.knows; add it there")
        shares = dict.fromkeys(self.main, 1.0) | dict(self.knows) | dict(own)
        if shares and 1.0 not in shares.values():
            raise ScenarioError(
                f"{key}: people of the group may know no exit; name one in behaviours.familiarity.main, or give it the "
                "share 1"
            )
        return shares

    def _find_signs(self, names: list[str]) -> None:
        """List the places of signs, and of exits as their own signs, with the exits that they show."""
        building = self._scene.building
        found: list[tuple[int, int, float, float, float]] = []
        for place in building.places:
            if place.kind == "sign":
                if place.exit not in names:
                    raise ScenarioError(
                        f"place.{place.name}.exit: {place.exit!r} is not in behaviours.familiarity.knows; add it "
                        "there, with the share 0 if nobody knows it without the sign"
                    )
                found.append((names.index(place.exit), place.level, place.range, *place.shape.coords[0]))
        signs = len(found)
        for exit_ in building.exits:
            if exit_.name in names:
                x1, y1, x2, y2 = exit_.segments[len(exit_.segments) // 2].tolist()
                share = BEFORE / math.hypot(x2 - x1, y2 - y1)
                x, y = 0.5 * (x1 + x2) - share * (y2 - y1), 0.5 * (y1 + y2) + share * (x2 - x1)
                found.append((names.index(exit_.name), exit_.level, self.sees, x, y))
        self._is_exit = np.arange(len(found)) >= signs
        table = np.array(found, dtype=np.float64).reshape(-1, 5)
        self._sign_exit, self._sign_level = table[:, 0].astype(np.int64), table[:, 1].astype(np.int32)
        self._sign_range, self._sign_at = table[:, 2].copy(), table[:, 3:].copy()

    def act(self, crowd: Crowd, time: float) -> None:
        """Let people look round and choose, once per period and when the scene changes."""
        if not self._names or (time < self._next - INSTANT and self._scene.version == self._version):
            return
        self._version = self._scene.version
        self._next = self.every * (math.floor(time / self.every + INSTANT) + 1)
        to_area = np.array([bool(route.area) for route in self._scene.fields.routes])
        asks = (crowd.level >= 0) & ~to_area[crowd.route]
        self._look_at_signs(crowd, asks)
        share = self._look_at_people(crowd, asks, time) if self.influence > 0.0 else np.zeros(self._known.shape)
        rows = np.flatnonzero(asks)
        cost = self._costs(crowd, rows) * (1.0 - self.influence * share[rows])
        best = np.argmin(cost, axis=1)
        has_way = np.isfinite(cost[np.arange(len(rows)), best])
        crowd.route[rows[has_way]] = self._routes[rows, best][has_way]

    def _look_at_signs(self, crowd: Crowd, asks: NDArray[np.bool_]) -> None:
        """Let people learn of the exits of signs in sight."""
        notices = self._overlooked.copy()  # those which are overlooked need no look
        place = np.ascontiguousarray(crowd.position), np.ascontiguousarray(crowd.level)
        signs = self._sign_at, self._sign_level, self._sign_range
        notice_signs(self._scene.world, *place, asks.view(np.uint8), *signs, notices)
        person, sign = np.nonzero(notices > self._overlooked)
        self._known[person, self._sign_exit[sign]] = 1
        self._seen[person, self._sign_exit[sign]] = 1

    def _look_at_people(self, crowd: Crowd, asks: NDArray[np.bool_], time: float) -> FloatArray:
        """Return the share of the people in sight who go to each exit, and let people learn of these exits."""
        goal = np.full(len(crowd.level), -1, np.int32)
        person, exit_ = np.nonzero(self._routes == crowd.route[:, None])
        goal[person] = exit_
        speed = np.hypot(*self._scene.displacement_velocity.T)
        goal[(speed <= WALKS) | (crowd.start_time > time) | (crowd.level < 0)] = -1
        count = np.zeros(self._known.shape)
        place = np.ascontiguousarray(crowd.position), np.ascontiguousarray(crowd.level)
        watch_walkers(self._scene.world, *place, asks.view(np.uint8), goal, float(self.sees), count)
        self._known[count > 0.0] = 1
        walks = np.flatnonzero(goal >= 0)
        count[walks, goal[walks]] += 1.0  # itself, so that two people do not follow each other in turn
        share: FloatArray = count / np.maximum(count.sum(axis=1), 1.0)[:, None]
        return share

    def _costs(self, crowd: Crowd, rows: IndexArray) -> FloatArray:
        """Return the cost (rows, exits) of exits [s], inf of those that people do not know, or that are closed."""
        building, fields = self._scene.building, self._scene.fields
        is_open = {exit_.name for exit_ in building.exits if building.is_open(exit_)}
        cost = np.full((len(rows), len(self._names)), math.inf)
        for column, name in enumerate(self._names):
            uses = (self._known[rows, column] == 1) & self._may_use[rows, column] & (name in is_open)
            own = rows[uses]
            time = fields.travel_time_at(*crowd.ways(own, self._routes[own, column]))
            unseen = 1.0 if self._is_main[column] else self.preference
            cost[uses, column] = time * np.where(self._seen[own, column] == 1, self.trust, unseen)
        return cost

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False if no exit is named."""
        return bool(self._names)
