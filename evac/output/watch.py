"""What is watched while a run goes on: velocities that nobody moves with, and contact forces that nobody survives."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray
from evac.physics.state import Crowd

#: Speeds of each person are averaged over so much time [s].
SPAN = 2.0

#: Contact forces, which vary from step to step, over so much [s]. They are known at the recorded times only, and their
#: mean is over at least so many of these.
FORCE_SPAN = 5.0
FEWEST_FRAMES = 10

#: Velocities of the contact model are noticed where their size is more than so many times the speed of the
#: displacement, and exceeds it by more than this [m/s].
CHATTER_RATIO = 2.0
CHATTER_EXCESS = 0.2

#: People are known to have been crushed at such forces: per person [N], and per metre of a body's width [N/m].
CRUSHING_FORCE = 6000.0
CRUSHING_LOAD = 4500.0


@dataclass(frozen=True)
class Finding:
    """People of whom the same was noticed, each counted once, and where and when it was greatest.

    Attributes
    ----------
    people : int
    since, until : float
        From the start of the first span of time to the end of the last in which it was noticed [s].
    begin, end : float
        The span of time in which it was greatest [s].
    person : int
        Of whom it was greatest.
    level : int
    x, y : float
        Where that person was at `end` [m].
    values : tuple of float
        Means over that span: of chatter the size of the contact model's velocity and of the displacement [m/s], of
        crushing the contact force through the body [N] and that per metre of its width [N/m].
    """

    people: int
    since: float
    until: float
    begin: float
    end: float
    person: int
    level: int
    x: float
    y: float
    values: tuple[float, float]


class Watch:
    """Averages speeds and contact forces of each person, and notes what a reader of the results should know.

    The force through a body is half the sum of its contact forces, since whoever is pressed from one side is held from
    the other; its width is its diameter. People who leave within a span of time are left out of that span.

    Parameters
    ----------
    radius : (n,) [m]
    tick : float
        Time between two looks at velocities [s].
    every : float
        Time between two looks at contact forces [s].
    """

    def __init__(self, radius: FloatArray, tick: float, every: float) -> None:
        self._width = 2.0 * radius
        self._speeds = _Means(len(radius), max(1, round(SPAN / tick)))
        self._forces = _Means(len(radius), max(FEWEST_FRAMES, round(FORCE_SPAN / every)))
        self._chatter = _Notes(len(radius))
        self._crushing = _Notes(len(radius))

    def look_at_velocities(self, time: float, crowd: Crowd, displacement_velocity: FloatArray) -> None:
        """Take in the velocities at the end of a tick.

        Parameters
        ----------
        time : float [s]
        crowd : Crowd
        displacement_velocity : (n, 2)
            Displacement over the tick, over its length [m/s].
        """
        velocity, displacement = np.hypot(*crowd.velocity.T), np.hypot(*displacement_velocity.T)
        if self._speeds.add(time, crowd.level >= 0, velocity, displacement):
            begin, inside, (velocity, displacement) = self._speeds.take()
            excess = velocity - displacement
            noticed = inside & (excess > CHATTER_EXCESS) & (velocity > CHATTER_RATIO * displacement)
            self._chatter.note(noticed, excess, (velocity, displacement), begin, time, crowd)

    def look_at_forces(self, time: float, crowd: Crowd) -> None:
        """Take in the contact forces at a recorded time [s]."""
        if self._forces.add(time, crowd.level >= 0, 0.5 * crowd.contact_force, 0.5 * crowd.contact_force / self._width):
            begin, inside, (force, load) = self._forces.take()
            noticed = inside & ((force > CRUSHING_FORCE) | (load > CRUSHING_LOAD))
            self._crushing.note(noticed, load, (force, load), begin, time, crowd)

    def chatter(self) -> Finding | None:
        """Return who moved much more slowly than the contact model's velocities say, if anybody did."""
        return self._chatter.finding()

    def crushing(self) -> Finding | None:
        """Return who was pressed with forces that nobody survives, if anybody was."""
        return self._crushing.finding()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that the findings depend on."""
        return {
            f"{name}.{key}": array.copy() for name, part in self._parts().items() for key, array in vars(part).items()
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state` returned."""
        for name, part in self._parts().items():
            for key, array in vars(part).items():
                array[...] = state[f"{name}.{key}"]

    def _parts(self) -> "dict[str, _Means | _Notes]":
        return {
            "speeds": self._speeds,
            "forces": self._forces,
            "chatter": self._chatter,
            "crushing": self._crushing,
        }


class _Means:
    """Means of two quantities of each person over spans of `length` looks; its attributes are arrays."""

    def __init__(self, people: int, length: int) -> None:
        self.sums = np.zeros((2, people))
        self.inside = np.ones(people, np.uint8)  # 1: at every look of the span so far
        self.looks = np.array([0, length])  # made in this span, and in a whole one
        self.times = np.zeros(2)  # of the last look of the span before and of this one [s]

    def add(self, time: float, inside: NDArray[np.bool_], first: FloatArray, second: FloatArray) -> bool:
        """Take in one look; return whether the span is complete."""
        self.sums[0] += first
        self.sums[1] += second
        self.inside[:] &= inside
        self.looks[0] += 1
        self.times[1] = time
        return bool(self.looks[0] == self.looks[1])

    def take(self) -> tuple[float, NDArray[np.bool_], FloatArray]:
        """Return when the complete span began [s], who was inside all along, and the means (2, n); start the next."""
        begin, inside, means = float(self.times[0]), self.inside.astype(bool), self.sums / self.looks[0]
        self.sums[:] = 0.0
        self.inside[:] = 1
        self.looks[0] = 0
        self.times[0] = self.times[1]
        return begin, inside, means


class _Notes:
    """What was noticed, span by span; its attributes are arrays."""

    def __init__(self, people: int) -> None:
        self.concerned = np.zeros(people, np.uint8)
        self.between = np.zeros(2)  # since, until [s]
        self.greatest = np.zeros(1)
        self.of_whom = np.zeros(2, np.int64)  # person, level
        self.values = np.zeros(6)  # begin, end [s], x, y [m], the two means

    def note(
        self,
        noticed: NDArray[np.bool_],
        measure: FloatArray,
        means: tuple[FloatArray, FloatArray],
        begin: float,
        end: float,
        crowd: Crowd,
    ) -> None:
        """Add who was `noticed` in the span from `begin` to `end` [s], and keep the greatest `measure`."""
        if not noticed.any():
            return
        if not self.concerned.any():
            self.between[0] = begin
        self.between[1] = end
        self.concerned[noticed] = 1
        p = int(np.argmax(np.where(noticed, measure, -np.inf)))
        if measure[p] > self.greatest[0]:
            self.greatest[0] = measure[p]
            self.of_whom[:] = p, crowd.level[p]
            self.values[:] = begin, end, *crowd.position[p], means[0][p], means[1][p]

    def finding(self) -> Finding | None:
        """Return what was noticed, None where nothing was."""
        people = int(self.concerned.sum())
        if not people:
            return None
        (since, until), (person, level) = self.between.tolist(), self.of_whom.tolist()
        begin, end, x, y, first, second = self.values.tolist()
        return Finding(people, since, until, begin, end, person, level, x, y, (first, second))
