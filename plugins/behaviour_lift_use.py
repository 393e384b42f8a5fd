"""Who takes a lift: a share of each group by storey; those who have waited too long take the stairs."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from evac.base.arrays import BoolArray
from evac.base.parameters import Parameter
from evac.directions.routes import PREFERRED, Route
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd

evac_interface = 3

STANDS = 0.2  #: Speed below which people wait [m/s].


class LiftUse(Behaviour):
    """A share of the people of each group take a lift, until their patience ends.

    The share of people who start n storeys above the discharge of the lifts is ``share + share_per_storey * n``: 0.053
    and 0.0114 after Heyes, 0.0105 and 0.0084 after Jonsson et al., for 5 to 60 storeys. Groups with `steepest`, who do
    not use all stairs, take lifts in any case, and wait as long as it takes.
    """

    name = "lift_use"
    reads = ("level", "start_time", "passing")
    writes = ("route",)
    group_keys = ("share", "share_per_storey", "patience")
    saved = ("_own", "_waited")

    share: Any = Parameter(0.0, "share of people who take a lift", minimum=0.0, maximum=1.0)
    share_per_storey: Any = Parameter(0.0, "what each storey above the discharge adds to it", minimum=0.0, maximum=1.0)
    patience: Any = Parameter(
        math.inf, "time of waiting after which they take the stairs", "s", minimum=0.0, infinite=True
    )

    def routes(self) -> tuple[Route, ...]:
        """Return the route by lift, and that of those who have waited too long."""
        return Route(lifts=PREFERRED), Route()

    def prepare(self, scene: BehaviourScene) -> None:
        """Draw who takes a lift."""
        self._scene, people = scene, len(scene.crowd.level)
        self._own, self._waited = scene.crowd.route.copy(), np.zeros(people)
        self._cars = np.array([level.kind == "car" for level in scene.building.levels])
        self._patience = np.full(people, np.inf)
        above, routes = self._storeys_above_discharge(), scene.fields.routes
        for group in scene.groups:
            share, more, patience = (float(group.settings.get(key, getattr(self, key))) for key in self.group_keys)
            of_level = np.clip(share + more * above[scene.crowd.level[group.rows]], 0.0, 1.0)
            takes = scene.generator.random(len(group.rows)) < of_level
            for index in np.unique(self._own[group.rows]).tolist():
                if routes[index].steepest is None:
                    rows = group.rows[takes & (self._own[group.rows] == index)]
                    scene.crowd.route[rows] = self._found(
                        replace(routes[index], lifts=PREFERRED), Route(lifts=PREFERRED)
                    )
                    self._patience[rows] = patience

    def act(self, crowd: Crowd, time: float) -> None:
        """Let those take the stairs who have waited too long."""
        routes = self._scene.fields.routes
        rides: BoolArray = np.array([route.lifts == PREFERRED for route in routes])[crowd.route]
        rides &= (crowd.level >= 0) & (crowd.start_time <= time) & np.isfinite(self._patience)
        rides &= ~self._cars[np.maximum(crowd.level, 0)] & (crowd.passing < 0)
        stands = np.hypot(*self._scene.displacement_velocity.T) < STANDS
        self._waited[rides & stands] += self._scene.tick
        for row in np.flatnonzero(rides & (self._waited >= self._patience)).tolist():
            crowd.route[row] = self._found(replace(routes[self._own[row]], lifts=""), Route())

    def acts_at_ticks(self) -> bool:
        """Return whether somebody's patience may end."""
        return bool(np.isfinite(self._patience).any())

    def notes(self) -> tuple[str, ...]:
        """Return how many people take a lift, and how many have waited too long."""
        takes = int(np.isfinite(self._patience).sum())
        gave_up = int((self._waited >= self._patience).sum())
        return (f"{gave_up} of {takes} people have taken the stairs after waiting",) if takes else ()

    def _found(self, route: Route, other: Route) -> int:
        """Return the index of a route, or of another one if it has no field."""
        routes = self._scene.fields.routes
        return routes.index(route if route in routes else other)

    def _storeys_above_discharge(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Return how many storeys each level is above the lowest discharge of a lift, (levels,)."""
        building = self._scene.building
        storey = np.zeros(len(building.levels), np.int64)
        for number, (_, levels) in enumerate(building.storeys):
            storey[[level.index for level in levels]] = number
        discharges = [storey[lift.rooms[lift.discharge]] for lift in building.lifts]
        return np.maximum(storey - min(discharges, default=0), 0)
