"""What is measured of people at recorded times; maps, pictures, the replay and reports have it from here."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray, pairs_of
from evac.base.phases import told
from evac.building.model.elevation import gradients, in_space
from evac.conditions.law import WAITING_SPEED
from evac.trajectory.trajectory import Trajectory

#: Contact forces, which vary from step to step, are means over the recorded times of this interval [s].
FORCE_SPAN = 1.0

#: Number of rows of `Records` above which they are passed on.
MOST_ROWS = 50_000


class Measures(NamedTuple):
    """What is measured of the c people inside at a recorded time, in the order in which they were given."""

    speed: FloatArray  # (c,): displacement in the last tick over its length, on stairs along the slope [m/s]
    started: NDArray[np.bool_]  # (c,): whether the response time is over
    # (c,): time since the recorded time before, of people who are now slower than the waiting speed and who had started
    # by then; 0 of all others [s]
    waits: FloatArray
    waited: FloatArray  # (c,): sum of `waits` until now [s]
    contact_force: FloatArray  # (c,): mean of the contact forces at the recorded times of the last `FORCE_SPAN` [N]


class Measuring:
    """Measures people at one recorded time after the other; `waited` (people,) [s] is how long each has waited."""

    def __init__(self, people: int, waiting_speed: float = WAITING_SPEED) -> None:
        self.waited: FloatArray = np.zeros(people)
        self._waiting_speed = waiting_speed
        self._had_started = np.zeros(people, np.bool_)  # at the recorded time before
        self._forces: deque[tuple[float, FloatArray]] = deque()  # -1 of people who are not inside
        self._last = math.inf

    def add(
        self, time: float, person: IntArray, speed: FloatArray, started: NDArray[np.bool_], contact_force: FloatArray
    ) -> Measures:
        """Return the measures of the people inside at a time [s], given by their rows (c,)."""
        waits = np.where((speed < self._waiting_speed) & started & self._had_started[person], time - self._last, 0.0)
        self.waited[person] += waits
        self._had_started[:] = False
        self._had_started[person] = started
        self._last = time
        forces = np.full(len(self.waited), -1.0)
        forces[person] = contact_force
        self._forces.append((time, forces))
        while self._forces[0][0] <= time - FORCE_SPAN + 1e-9:
            self._forces.popleft()
        recent = np.array([forces[person] for _, forces in self._forces])
        mean = np.maximum(recent, 0.0).sum(axis=0) / (recent >= 0.0).sum(axis=0)
        return Measures(speed, started, waits, self.waited[person], mean)


class Records(NamedTuple):
    """The people inside at consecutive recorded times, a row for each of them and each time."""

    frame: NDArray[np.int64]  # (s,): number of the time among the chosen ones, ascending
    person: IntArray  # (s,)
    level: IntArray  # (s,)
    position: FloatArray  # (s, 2) [m]
    after: FloatArray  # (s, 2): position at the next one of the chosen times; NaN of those who are not inside then [m]
    target: IntArray  # (s,): level then; -1 of those who are not inside
    velocity: FloatArray  # (s, 2): in plan [m/s]
    speed: FloatArray  # this and the following as in `Measures`
    started: NDArray[np.bool_]
    waits: FloatArray
    waited: FloatArray
    contact_force: FloatArray

    def chosen(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice) -> "Records":
        """Return some of the rows, (s,) bool, or their numbers."""
        if isinstance(rows, slice):
            return Records._make(column[rows] for column in self)
        numbers = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        return Records._make(column.take(numbers, 0) for column in self)

    def by_level(self) -> "Iterator[tuple[int, Records]]":
        """Yield each level on which somebody is, with the rows of the people there."""
        ordered = self.chosen(np.argsort(self.level, kind="stable"))
        levels, first = np.unique(ordered.level, return_index=True)
        for level, start, end in zip(levels.tolist(), first, [*first[1:], len(ordered.level)], strict=True):
            yield level, ordered.chosen(slice(start, end))


def joined(parts: Iterable[Records]) -> Records:
    """Return the rows of all parts, of which there is one at least."""
    return Records._make(map(np.concatenate, zip(*parts, strict=True)))


def records(
    trajectory: Trajectory, frames: IntArray | None = None, waiting_speed: float = WAITING_SPEED
) -> Iterator[Records]:
    """Yield all that is measured of people at recorded times, at some of them together.

    `frames` (f,): numbers of the recorded times to choose, ascending; by default all.
    """
    measuring = Measuring(trajectory.number_of_people, waiting_speed)
    chosen = trajectory.rows if frames is None else [trajectory.rows[k] for k in frames.tolist()]
    gradient, parts, count = gradients(trajectory.building), list[Records](), 0
    for number, now in enumerate(told("measuring", chosen, len(chosen))):
        person, level, motion = now.person.astype(np.int32), now.level.astype(np.int32), now.motion.astype(np.float64)
        speed = np.linalg.norm(in_space(gradient, level, motion[:, 2:4]), axis=1)
        after, target = np.full((len(person), 2), np.nan), np.full(len(person), -1, np.int32)
        if number + 1 < len(chosen):
            later = chosen[number + 1]
            _, here, there = np.intersect1d(person, later.person, assume_unique=True, return_indices=True)
            place = later.motion.take(there, 0)[:, :2].astype(np.float64) + trajectory.origin
            pairs_of(after)[here] = pairs_of(place)
            target[here] = later.level[there]
        measures = measuring.add(now.time, person, speed, now.started, motion[:, 4])
        frame, place = np.full(len(person), number), motion[:, :2] + trajectory.origin
        parts.append(Records(frame, person, level, place, after, target, motion[:, 2:4], *measures))
        count += len(person)
        if count > MOST_ROWS:
            yield joined(parts)
            parts, count = [], 0
    if parts:
        yield joined(parts)
