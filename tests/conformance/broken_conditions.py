"""Broken laws of the speed in smoke and sources of conditions, with the failures that they must cause."""

import numpy as np

from evac.conditions.law import SmokeLaw
from evac.conditions.source import ConditionSource
from tests.conformance.broken import Broken, odd, raising


class Halved(SmokeLaw):
    """Half the desired speed in any smoke."""

    name = "halved"

    def speed(self, desired, extinction):
        """Return half the desired speeds where there is smoke."""
        return np.where(extinction > 0.0, 0.5, 1.0) * desired


class Haze(ConditionSource):
    """The same smoke everywhere."""

    name = "haze"

    def open(self, scene):
        """Provide the extinction coefficient."""
        return ("extinction",)

    def at(self, quantities, time, level, position, height):
        """Return 0.5 1/m."""
        return np.full((len(quantities), len(level)), 0.5)


def averaged(self, desired, extinction):
    """Return speeds for the mean of all extinction coefficients."""
    return np.where(extinction > 0.0, 1.0 / (1.0 + extinction.mean()), 1.0) * desired


def consumed(self, desired, extinction):
    """Change the array that was given."""
    desired *= 1.0 / (1.0 + extinction)
    return desired


def negative(self, quantities, time, level, position, height):
    """Return a value that no air has."""
    return np.full((len(quantities), len(level)), -1.0)


def drifting(self, quantities, time, level, position, height):
    """Return more at each call."""
    self.calls = getattr(self, "calls", 0) + 1
    return np.full((len(quantities), len(level)), 0.1 * self.calls)


BROKEN = [
    Broken(odd(Halved, speed=raising), "check_speeds", r"its speed\(\)", "partner", KeyError),
    Broken(odd(Halved, speed=lambda self, desired, extinction: desired[:1]), "check_speeds", "its speed", "for each"),
    Broken(
        odd(Halved, speed=lambda self, desired, extinction: desired * np.nan), "check_speeds", "its speed", "finite"
    ),
    Broken(
        odd(Halved, speed=lambda self, desired, extinction: 0.5 * desired), "check_speeds", "its speed", "clear air"
    ),
    Broken(odd(Halved, speed=consumed), "check_speeds", "its speed", "arguments; return a new array"),
    Broken(odd(Halved, speed=averaged), "check_speeds", "its speed", "others are there"),
    Broken(odd(Haze, at=negative), "check_source", "its at", "-1 for extinction; return values from 0"),
    Broken(odd(Haze, at=drifting), "check_source", "its at", "asked again"),
]
