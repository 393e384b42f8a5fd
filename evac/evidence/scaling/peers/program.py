"""What every program that is compared provides."""

from typing import Protocol


class Program(Protocol):
    """A program that walks a copy of the crowd of a hall."""

    @property
    def inside(self) -> int:
        """Number of people for whom a step is made."""

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
