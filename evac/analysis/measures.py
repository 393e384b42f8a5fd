"""Speed, waiting and contact force of people at recorded times, for maps, pictures, the replay and reports."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray, pairs_of
from evac.base.progress import track
from evac.building.model.elevation import gradients, in_space
from evac.conditions.law import WAITING_SPEED
from evac.trajectory.trajectory import Rows, Trajectory

#: Contact forces, which vary from step to step, are means over the recorded times of this interval [s].
FORCE_SPAN = 1.0

#: Number of rows of `Records` above which they are passed on.
MOST_ROWS = 25_000


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
        for level, start, end in zip(levels.tolist(), first, np.append(first, len(ordered.level))[1:], strict=True):
            yield level, ordered.chosen(slice(start, end))


def records(
    trajectory: Trajectory, frames: IntArray | None = None, waiting_speed: float = WAITING_SPEED
) -> Iterator[Records]:
    """Yield all that is measured of people at recorded times, at some of them together.

    `frames` (f,): numbers of the recorded times to choose, ascending; by default all.
    """
    measuring = Measuring(trajectory.number_of_people, waiting_speed)
    chosen = trajectory.rows if frames is None else [trajectory.rows[k] for k in frames.tolist()]
    first, count = 0, 0
    for number, now in enumerate(track("measuring", chosen, len(chosen))):
        count += len(now.person)
        if count > MOST_ROWS or number + 1 == len(chosen):
            yield _measured(trajectory, measuring, chosen[first : number + 2], range(first, number + 1))
            first, count = number + 1, 0


def _measured(trajectory: Trajectory, measuring: Measuring, rows: Sequence[Rows], frames: range) -> Records:
    """Return the records of the people at some times, which come first in the rows of these times and the next one."""
    person, level = (
        np.concatenate([getattr(now, name) for now in rows]).astype(np.int32) for name in ("person", "level")
    )
    motion, started = (
        np.concatenate([now.motion for now in rows]).astype(np.float64),
        np.concatenate([now.started for now in rows]),
    )
    speed = np.linalg.norm(in_space(gradients(trajectory.building), level, motion[:, 2:4]), axis=1)
    position, ends = motion[:, :2] + trajectory.origin, np.cumsum([0, *(len(now.person) for now in rows), 0])
    row_of, next_row, measures = np.full(trajectory.number_of_people, -1), np.full(len(person), -1), list[Measures]()
    for k in reversed(range(len(rows))):
        here = slice(ends[k], ends[k + 1])
        later = row_of[person[here]]
        next_row[here] = np.where(later < ends[k + 2], later, -1)
        row_of[person[here]] = np.arange(here.start, here.stop)
    for k in range(len(frames)):
        here = slice(ends[k], ends[k + 1])
        measures.append(measuring.add(rows[k].time, person[here], speed[here], started[here], motion[here, 4]))
    now = slice(ends[len(frames)])
    after, target, stays = (
        np.full((now.stop, 2), np.nan),
        np.full(now.stop, -1, np.int32),
        np.flatnonzero(next_row[now] >= 0),
    )
    pairs_of(after)[stays] = pairs_of(position)[next_row[stays]]
    target[stays] = level[next_row[stays]]
    frame = np.repeat(frames, np.diff(ends)[: len(frames)])
    columns = map(np.concatenate, zip(*measures, strict=True))
    return Records(frame, person[now], level[now], position[now], after, target, motion[now, 2:4], *columns)
