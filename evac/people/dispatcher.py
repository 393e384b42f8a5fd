"""Base class of dispatchers, which choose where the cars of lifts go next."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from evac.base.parameters import Configurable


class Car(NamedTuple):
    """A car with closed doors and nobody inside, which asks for its next stop."""

    name: str
    storeys: tuple[str, ...]  #: names of its stops, from bottom to top
    heights: tuple[float, ...]  #: of the stops [m]
    stop: int  #: where it is
    discharge: int  #: the stop at which people get out
    capacity: int  #: greatest number of people


class StopCall(NamedTuple):
    """A stop of a car at which more people wait than other cars of its bank come for."""

    stop: int
    people: int  #: how many more
    since: float  #: since when the first of those who wait there has waited [s]


class Dispatcher(Configurable, ABC):
    """Chooses the next stop of a car of a lift.

    A dispatcher depends on what it is given alone, so that a resumed run goes on with the same bits.
    """

    @abstractmethod
    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        """Return the stop of one of the calls to which a car goes next; None if it stays where it is.

        Parameters
        ----------
        car : Car
        calls : sequence of StopCall
            At least one, from bottom to top.
        time : float [s]
        """
