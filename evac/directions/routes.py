"""Routes that people follow: a destination and a strategy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, get_args

from pydantic import Field

from evac.base.arrays import IntArray

#: Strategies, which minimise the length along the slope, the time at the reference speeds, or the time with stairs
#: weighted by the comfort factor of the case, or the time at the speeds that the density of the crowd permits.
Strategy = Literal["shortest", "fastest", "comfortable", "quickest"]
STRATEGIES: tuple[str, ...] = get_args(Strategy)

#: The strategy whose travel times are solved again during a run, see `evac.directions.quickest`.
QUICKEST: Strategy = "quickest"

#: How routes use lifts: where they are quicker, or, with times on stairs so much longer, wherever there are some.
WEIGHED, PREFERRED = "weighed", "preferred"
RELUCTANCE = 10.0

#: By how much longer people wait for lifts than is always expected [s], by the rooms of their cars, if so many people
#: are on the way to each room (levels,).
WaitsForLifts = Callable[[IntArray], Mapping[int, float]]


def no_waits(on_way: IntArray) -> Mapping[int, float]:
    """Return how much longer people wait where there are no lifts."""
    return {}


@dataclass(frozen=True)
class Route:
    """A destination and a strategy; people carry the index of one."""

    exits: tuple[str, ...] = ()  #: names of the permitted exits; empty means any exit
    strategy: str = "fastest"  #: one of `STRATEGIES`
    steepest: float | None = None  #: steepest stair or ramp that it uses, as rise over run; None bars none
    #: name of the area in which it ends, instead of at an exit; ``refuge`` in summary.json
    area: Annotated[str, Field(alias="refuge")] = ""
    #: how it uses lifts, not at all if empty, `WEIGHED` where they are quicker than stairs, or `PREFERRED`
    lifts: str = ""

    @property
    def follows_crowd(self) -> bool:
        """Whether its travel times follow the crowd, or at least the queues for lifts beside which it has stairs."""
        return self.strategy == QUICKEST or (self.lifts == WEIGHED and self.steepest is None)

    @property
    def goes_round_crowd(self) -> bool:
        """Whether its ways lead round the crowd where people keep distances: not shortest ones, nor those above."""
        return self.strategy in ("fastest", "comfortable") and not self.follows_crowd

    @property
    def destination(self) -> str:
        """The exits as text, such as ``"north|south"``."""
        return self.area or "|".join(self.exits) or "any exit"

    def leads_to(self, name: str) -> bool:
        """Return whether the route may end at the exit of this name."""
        return not self.area and (not self.exits or name in self.exits)

    def __str__(self) -> str:
        """Return strategy and destination, such as ``"fastest to north|south"``."""
        gentle = "" if self.steepest is None else f" without slopes above {self.steepest:g}"
        lifts = " by lift" if self.lifts == PREFERRED else " also by lift" if self.lifts else ""
        return f"{self.strategy} to {self.destination}{gentle}{lifts}"


def changed_route(route: Route, value: str | Sequence[str]) -> Route:
    """Return a route with another strategy, if the value is its name, or with other exits; those to refuges stay."""
    if route.area:
        return route
    return replace(route, strategy=value) if isinstance(value, str) else replace(route, exits=tuple(value))
