"""What a person can follow: a destination and a strategy."""

from dataclasses import dataclass

#: Strategies and what they minimise.
STRATEGIES = ("shortest", "fastest", "comfortable")


@dataclass(frozen=True)
class Route:
    """A destination and a strategy; people carry the index of one.

    Attributes
    ----------
    exits : tuple of str
        Names of the exits it may end at; empty means any.
    strategy : str
        ``"shortest"`` (length along the slope), ``"fastest"`` (time at the reference speeds) or
        ``"comfortable"`` (time, with time on stairs weighted by the case's comfort factor).
    """

    exits: tuple[str, ...] = ()
    strategy: str = "fastest"

    @property
    def destination(self) -> str:
        """The exits in words, such as ``"north|south"``."""
        return "|".join(self.exits) or "any exit"

    def __str__(self) -> str:
        """Return strategy and destination, such as ``"fastest to north|south"``."""
        return f"{self.strategy} to {self.destination}"
