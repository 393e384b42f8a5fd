"""A behaviour with a route that nobody takes, to measure the cost of a field for an unused strategy."""

from typing import Any

from evac.base.parameters import Parameter
from evac.directions.routes import STRATEGIES, Route
from evac.people.behaviour import Behaviour, BehaviourScene


class UnusedRoute(Behaviour):
    """Names a route to any exit by one strategy, for which a field is computed; nobody ever takes it."""

    name = "unused_route"

    strategy: Any = Parameter(STRATEGIES[0], "strategy of the route", choices=STRATEGIES)

    def routes(self) -> tuple[Route, ...]:
        """Return the route."""
        return (Route((), self.strategy),)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False."""
        return False


evac_interface = 3
