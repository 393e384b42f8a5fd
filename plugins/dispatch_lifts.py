"""Dispatchers of lifts: which storey a car serves next."""

from collections.abc import Sequence
from typing import Any

from evac.base.parameters import Parameter
from evac.people.dispatcher import Car, Dispatcher, StopCall

evac_interface = 3


class TopDown(Dispatcher):
    """The highest storey first; without another dispatcher, cars go so."""

    name = "top_down"

    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        """Return the highest stop."""
        return calls[-1].stop


class NearestCall(Dispatcher):
    """The storey that is nearest to the car, of two the lower one."""

    name = "nearest_call"

    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        """Return the nearest stop."""
        return min(calls, key=lambda call: abs(car.heights[call.stop] - car.heights[car.stop])).stop


class Shuttle(Dispatcher):
    """One storey alone, between which and the discharge cars shuttle."""

    name = "shuttle"
    storey: Any = Parameter("", "the storey, by name")

    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        """Return the stop at the storey."""
        return next((call.stop for call in calls if car.storeys[call.stop] == self.storey), None)


class Priority(Dispatcher):
    """Some storeys in a given order, then the others from the top down."""

    name = "priority"
    storeys: Any = Parameter((), "the storeys, by name, the most urgent first")

    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        """Return the first stop in the order of the storeys."""
        order = list(self.storeys)
        return min(reversed(calls), key=lambda call: _place(order, car.storeys[call.stop])).stop


class FireFloorsFirst(Dispatcher):
    """The storey of the fire, then those above it and those below, then the others from the top down.

    So does the occupant evacuation operation of ASME A17.1 (2013), 2.27.11, with two storeys above and two below.
    """

    name = "fire_floors_first"
    fire: Any = Parameter("", "the storey of the fire, by name")
    beside: Any = Parameter(2, "number of storeys above and below it that are served next", minimum=0)

    def next_stop(self, car: Car, calls: Sequence[StopCall], time: float) -> int | None:
        """Return the stop that is nearest to the fire, if it is one of the storeys beside it."""
        order = []
        if self.fire in car.storeys:
            at, beside = car.storeys.index(self.fire), range(1, int(self.beside) + 1)
            stops = [at, *(at + number for number in beside), *(at - number for number in beside)]
            order = [car.storeys[stop] for stop in stops if 0 <= stop < len(car.storeys)]
        return min(reversed(calls), key=lambda call: _place(order, car.storeys[call.stop])).stop


def _place(order: Sequence[str], storey: str) -> int:
    """Return the place of a storey in an order; all others come last."""
    return order.index(storey) if storey in order else len(order)
