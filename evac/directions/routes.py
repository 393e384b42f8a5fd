"""What a person can follow: a destination and a strategy."""

from dataclasses import dataclass
from typing import Literal, get_args

#: What the way out is the least of: length along the slope, time at the reference speeds, or time with that on
#: stairs weighted by the case's comfort factor.
Strategy = Literal["shortest", "fastest", "comfortable"]
STRATEGIES: tuple[str, ...] = get_args(Strategy)


@dataclass(frozen=True)
class Route:
    """A destination and a strategy; people carry the index of one.

    Attributes
    ----------
    exits : tuple of str
        Names of the exits it may end at; empty means any.
    strategy : str
        One of `STRATEGIES`.
    """

    exits: tuple[str, ...] = ()
    strategy: str = "fastest"

    @property
    def destination(self) -> str:
        """The exits in words, such as ``"north|south"``."""
        return "|".join(self.exits) or "any exit"

    def leads_to(self, name: str) -> bool:
        """Say whether the route may end at the exit of this name."""
        return not self.exits or name in self.exits

    def __str__(self) -> str:
        """Return strategy and destination, such as ``"fastest to north|south"``."""
        return f"{self.strategy} to {self.destination}"
