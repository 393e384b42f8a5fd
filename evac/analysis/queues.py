"""Queues, each with its cause: the exit, door, stair or person beyond which people walk on, or thick smoke."""

import math
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.analysis.lines import LineFlow
from evac.analysis.measures import Records, records
from evac.base.arrays import FloatArray
from evac.base.errors import counted
from evac.building.model.building import Building
from evac.conditions.law import SMOKE, SPEED, WAITING_SPEED
from evac.trajectory.trajectory import Trajectory

#: How long people are watched after a passage, and the spans for which it is asked whether they wait there [s].
BEYOND, SPAN = 4.0, 5.0

#: Share of this time for which they wait if the queue goes on beyond what they have passed.
GOES_ON = 0.25

#: Distance within which people who wait are before the place itself [m].
NEAR = 2.0

#: Distance at which somebody who stands in front of the first of a queue blocks it [m].
FRONT = 1.5

#: Waiting of all together, and of each on average, that is worth a sentence [s].
LEAST, LEAST_EACH = 30.0, 5.0


@dataclass(frozen=True)
class Queue:
    """The people who waited because of an exit, a door, or the stairs of a shaft.

    Waiting is that of `evac.analysis.measures.Measures`. People wait for what they pass next; if those who have just
    passed it wait as well, for what they pass after that, and so on to the place beyond which people walk on. Those
    who pass nothing any more wait for what is nearest to them. Whom smoke alone makes as slow waits because of smoke.
    """

    # "exit", "door", "stair", "shaft" of several stairs, "portal" between floors, "level" without any of these, or
    # "smoke" on a level, which may be irritants
    kind: str
    name: str
    level: str  # of its head at `time`
    x: float  # middle of what is passed there, x and y [m]; of a level and smoke the mean position of those who waited
    y: float
    tail: str  # floor or stair of the last in the queue at `time`
    most_on: str  # floor or stair on which most of the time was waited
    people: int  # number of different people who waited
    waited: float  # sum of the times for which they waited [s]
    share: float  # the same over all waiting of the run
    most: int  # greatest number who waited at once
    time: float  # when that was first [s]
    start: float  # first and last time at which a tenth of `most` waited [s]
    end: float
    # who stood before the first of the queue during most of the waiting, because of a response time or another reason
    # not to walk: "person 145, who has not started"; empty for nobody
    blocker: str
    at_once: NDArray[np.int64] = field(repr=False, compare=False)  # number who waited at each recorded time, (f,)
    # number of those who were within `NEAR` of the place, (f,)
    near: NDArray[np.int64] = field(repr=False, compare=False)

    @property
    def is_little(self) -> bool:
        """Whether so little was waited that it is not worth a sentence."""
        return is_little(self.waited, self.people)

    @property
    def place(self) -> str:
        """What is passed there, or the smoke, in words."""
        return f"{self.kind} {'on ' * (self.kind == 'smoke')}{self.name!r}"

    @property
    def cause(self) -> str:
        """What causes it, in words."""
        return f"{self.blocker}, before {self.place}" if self.blocker else self.place

    def brief(self) -> str:
        """Return the cause and its share, in words."""
        return f"{self.cause}: {100.0 * self.share:.0f} % of all waiting"

    def __str__(self) -> str:
        """Return a sentence without its end."""
        return (
            f"{self.brief()}; {counted(self.people, 'person', 'people')} waited "
            f"{self.waited / self.people:.1f} s on average, most on {self.most_on!r}, from {self.start:.1f} to "
            f"{self.end:.1f} s, at most {self.most} at once, at {self.time:.1f} s, back to {self.tail!r}"
        )


def is_little(waited: float, people: float) -> bool:
    """Return whether so little was waited by some people, in total [s], that it is not worth a sentence."""
    return waited < max(LEAST, LEAST_EACH * people)


def find_queues(trajectory: Trajectory, flows: Iterable[LineFlow], slow_from: float | None = None) -> tuple[Queue, ...]:
    """Return the queues of a run, sorted by the time for which people waited in total, the longest first.

    The passages of people are those of `flows`, of all links, doors and lines. From the extinction coefficient
    `slow_from` on [1/m], smoke alone makes people as slow as those who wait.
    """
    search = QueueSearch(trajectory, flows, slow_from)
    for part in records(trajectory):
        search.add(part)
    return search.found()


class QueueSearch:
    """The search of `find_queues` in a pass over the records that others make as well."""

    def __init__(self, trajectory: Trajectory, flows: Iterable[LineFlow], slow_from: float | None = None) -> None:
        self._trajectory, self._slow_from = trajectory, math.inf if slow_from is None else slow_from
        self._ways = ways = _Ways(trajectory, flows)
        causes = [_cause(trajectory.building, line) for line in ways.lines]
        causes += [(kind, level.title) for kind in ("level", "smoke") for level in trajectory.building.levels]
        numbers = {cause: number for number, cause in enumerate(dict.fromkeys(causes))}
        self._number = np.array([numbers[cause] for cause in causes], np.int64)
        self._queues = [_Waiting(trajectory, ways, *cause) for cause in numbers]
        self._standing, self._kept = _Standing(trajectory), list[Records]()

    def add(self, part: Records) -> None:
        """Add the records of all people at the next times; those of the last span are kept until it is over."""
        self._ways.watch(part)
        span = self._trajectory.time[part.frame] // SPAN
        later = int(np.searchsorted(span, span[-1])) if len(span) else 0
        if later:
            self._add_whole([*self._kept, part.chosen(slice(later))])
            self._kept = []
        self._kept.append(part.chosen(slice(later, None)))

    def _add_whole(self, parts: list[Records]) -> None:
        """Add records, once it is known how long people waited until the end of their spans."""
        part = Records._make(map(np.concatenate, zip(*parts, strict=True)))
        still, rows, ways = self._standing.add(part), part.chosen(part.waits > 0.0), self._ways
        line, passes = ways.causes(rows)
        in_smoke = _are_slow(self._trajectory, rows, self._slow_from)
        line[in_smoke] = len(ways.lines) + len(self._trajectory.building.levels) + rows.level[in_smoke]
        cause, away = self._number[line], ways.distances(rows, line)
        for k in np.unique(cause).tolist():
            own = np.flatnonzero(cause == k)
            self._queues[k].add(rows.chosen(own), line[own], passes[own], away[own], still)

    def found(self) -> tuple[Queue, ...]:
        """Return the queues after all records have been added."""
        if self._kept:
            self._add_whole(self._kept)
        waited = sum(queue.waited for queue in self._queues)
        queues = (queue.queue(waited, self._standing) for queue in self._queues if queue.waited)
        return tuple(sorted(queues, key=lambda queue: -queue.waited))


def _are_slow(trajectory: Trajectory, rows: Records, slow_from: float) -> NDArray[np.bool_]:
    """Return whether people (s,) are where the smoke or irritants that were recorded alone make them slow."""
    slow = np.zeros(len(rows.frame), np.bool_)
    for number, field_of in enumerate(trajectory.level_fields):
        for frame in np.unique(rows.frame).tolist() if field_of.name in (SMOKE, SPEED) else ():
            air, own = copy(field_of), rows.frame == frame
            air.values = trajectory.rows[frame].fields[number]
            there = air.at(rows.level[own], rows.position[own])
            slow[own] |= there < WAITING_SPEED if field_of.name == SPEED else there >= slow_from
    return slow


def _cause(building: Building, line: LineFlow) -> tuple[str, str]:
    """Return kind and name of what people wait for before a line: a shaft for its stairs, a bank for its lifts."""
    for lift in building.lifts if line.kind == "portal" else ():
        if not {*lift.rooms}.isdisjoint(line.levels):
            return "lift", lift.operation.bank or lift.name
    for name, stairs in building.shafts.items() if line.kind == "portal" else ():
        if not {building.levels[level].stair for level in line.levels}.isdisjoint(stairs):
            return "shaft" if len(stairs) > 1 else "stair", name
    return line.kind, line.name


class _Ways:
    """The passages of people in order, and where a queue goes on beyond what they pass."""

    def __init__(self, trajectory: Trajectory, flows: Iterable[LineFlow]) -> None:
        self.building, self._time = trajectory.building, trajectory.time
        stair = [level.stair for level in self.building.levels]
        self.lines = [
            line
            for line in flows
            if line.kind != "line" and (len(line.levels) == 1 or len({stair[k] or k for k in line.levels}) == 2)
        ]
        number = np.repeat(np.arange(len(self.lines)), [line.people for line in self.lines])
        person, time, forward = (
            np.concatenate([np.zeros(0), *(getattr(line, name) for line in self.lines)])
            for name in ("person", "time", "forward")
        )
        order = np.lexsort([time, person])
        self._person, self._passed, self._line = person[order], time[order], number[order]
        self._way = 2 * self._line + forward[order].astype(np.int64)  # a line in one direction
        self._end = float(self._time[-1]) + 1.0 if len(self._time) else 1.0
        self._key = self._person * self._end + np.minimum(self._passed, self._time[-1])
        bins = int(self._end // SPAN) + 1
        self._watched, self._waited = np.zeros((2, 2 * len(self.lines), bins))  # [s]
        self._shapes = [shapely.multilinestrings(line.segments.reshape(-1, 2, 2)) for line in self.lines]
        levels = range(len(self.building.levels))
        self._is_on = np.array([[level in line.levels for level in levels] for line in self.lines], np.bool_)
        cars = {room for lift in self.building.lifts for room in lift.rooms}
        self._into_cars = np.repeat([not cars.isdisjoint(line.levels) for line in self.lines], 2).astype(np.bool_)

    def _next(self, rows: Records) -> NDArray[np.int64]:
        """Return the place among all passages of the next one of each row, which may be one of somebody else."""
        place: NDArray[np.int64] = np.searchsorted(
            self._key, rows.person * self._end + self._time[rows.frame], side="right"
        )
        return place

    def watch(self, rows: Records) -> None:
        """Add up how long people are watched, and wait, after what they have passed."""
        before = self._next(rows) - 1
        if not len(self._person):
            return
        is_own = (before >= 0) & (self._person[before] == rows.person)
        is_own &= self._time[rows.frame] - self._passed[before] <= BEYOND
        where = self._way[before[is_own]], (self._time[rows.frame[is_own]] // SPAN).astype(np.int64)
        np.add.at(self._watched, where, np.diff(self._time, prepend=self._time[0])[rows.frame[is_own]])
        np.add.at(self._waited, where, rows.waits[is_own])

    def causes(self, rows: Records) -> tuple[NDArray[np.int64], FloatArray]:
        """Return the line at the head of the queue of each row, or the number of lines plus a level; and its time."""
        there = np.append(self._person, -1)
        place = self._next(rows)
        passes = there[place] == rows.person
        seen, goes_on = self._watched > 0.0, self._waited > GOES_ON * self._watched
        goes_on[self._into_cars] = False  # in which people stand
        last = np.maximum.accumulate(np.where(seen, np.arange(seen.shape[1]), 0), axis=1)
        goes_on = np.take_along_axis(goes_on, last, axis=1)  # until somebody passes again
        span = (self._time[rows.frame] // SPAN).astype(np.int64)
        moves = passes.copy()
        while moves.any():
            at = np.flatnonzero(moves)
            goes = goes_on[self._way[place[at]], span[at]] & (there[place[at] + 1] == rows.person[at])
            place[at] += goes
            moves[at] = goes
        line = np.append(self._line, -1)[np.where(passes, place, -1)]
        for level in np.unique(rows.level[~passes]).tolist():
            own = ~passes & (rows.level == level)
            line[own] = self._nearest(level, rows.position[own])
        return line, np.where(passes, np.append(self._passed, np.inf)[np.where(passes, place, -1)], np.inf)

    def _nearest(self, level: int, position: FloatArray) -> NDArray[np.int64]:
        here = [k for k, line in enumerate(self.lines) if level in line.levels]
        if not here:
            return np.full(len(position), len(self.lines) + level)
        distances = [shapely.distance(self._shapes[k], shapely.points(position)) for k in here]
        nearest: NDArray[np.int64] = np.array(here)[np.argmin(distances, axis=0)]
        return nearest

    def distances(self, rows: Records, line: NDArray[np.int64]) -> FloatArray:
        """Return how far each row is from its line [m]; inf on other levels, 0 without a line."""
        away = np.where(line < len(self.lines), np.inf, 0.0)
        for k in np.unique(line[line < len(self.lines)]).tolist():
            own = np.flatnonzero((line == k) & self._is_on[k].take(rows.level))
            away[own] = shapely.distance(self._shapes[k], shapely.points(rows.position.take(own, 0)))
        return away

    def middle(self, line: int) -> FloatArray:
        """Return the middle of a line (2,) [m]."""
        segments = self.lines[line].segments
        middle: FloatArray = segments[len(segments) // 2].reshape(2, 2).mean(axis=0)
        return middle


class _Standing:
    """The people who have not started, or stay where they are, and when each of them was first and last seen so."""

    def __init__(self, trajectory: Trajectory) -> None:
        self._started = np.full(trajectory.number_of_people, len(trajectory))
        self._last = np.zeros(trajectory.number_of_people, np.int64)

    def add(self, part: Records) -> Records:
        """Return the rows of those who stand still."""
        walks, still = part.chosen(part.started), part.chosen(~part.started)
        np.minimum.at(self._started, walks.person, walks.frame)
        np.maximum.at(self._last, still.person, still.frame)
        return still

    def words(self, person: int) -> str:
        """Return a person with the reason why it stood."""
        has_walked = self._started[person] < self._last[person]
        return f"person {person}, who {'stands still' if has_walked else 'has not started'}"


class _Waiting:
    """The people who wait in one queue, added up over the recorded times."""

    def __init__(self, trajectory: Trajectory, ways: _Ways, kind: str, name: str) -> None:
        self._time, self._levels, self._ways = trajectory.time, trajectory.building.levels, ways
        self._kind, self._name = kind, name
        self._at_once, self._near = np.zeros((2, len(trajectory)), np.int64)
        self._people = np.zeros(trajectory.number_of_people, np.bool_)
        self._blocked = np.zeros(trajectory.number_of_people)  # waiting behind each person [s]
        self._on = {level.title: 0.0 for level in self._levels}  # waiting on each floor and stair [s]
        self._peak: dict[str, Any] = {}
        self.waited = 0.0  # [s]

    def add(self, rows: Records, line: NDArray[np.int64], passes: FloatArray, away: FloatArray, still: Records) -> None:
        """Add the rows of the queue with the lines at their heads, when they pass them, and how far they are away.

        `still` are those who stand still at the same times.
        """
        self.waited += float(rows.waits.sum())
        self._people[rows.person] = True
        for level in np.unique(rows.level).tolist():
            self._on[self._levels[level].title] += float(rows.waits[rows.level == level].sum())
        before = self._at_once.max()
        self._at_once += np.bincount(rows.frame, minlength=len(self._time))
        self._near += np.bincount(rows.frame[away <= NEAR], minlength=len(self._time))
        order = np.lexsort([away, passes, rows.frame])
        if self._at_once.max() > before:
            then = np.flatnonzero(rows.frame == self._at_once.argmax())
            head = then[line[then] == np.bincount(line[then]).argmax()]
            first = head[np.argmin(away[head])]
            last = then[np.lexsort([away[then], passes[then]])[-1]]
            is_place = self._kind not in ("level", "smoke")
            at = self._ways.middle(line[first]) if is_place else rows.position[then].mean(axis=0)
            self._peak = {
                "level": self._levels[rows.level[first]].name,
                "x": float(at[0]),
                "y": float(at[1]),
                "tail": self._levels[rows.level[last]].title,
            }
        frames, starts = np.unique(rows.frame[order], return_index=True)
        waits = np.bincount(rows.frame, rows.waits)
        low, high = np.searchsorted(still.frame, [frames, frames + 1])
        some = np.flatnonzero(high > low)
        for frame, first, *ends in np.column_stack([frames, order[starts], low, high])[some].tolist():
            there = slice(*ends)
            is_near = np.hypot(*(still.position[there] - rows.position[first]).T) <= FRONT
            near = np.flatnonzero(is_near & (still.level[there] == rows.level[first])) + there.start
            if len(near):
                beyond = self._ways.distances(still.chosen(near), np.full(len(near), line[first]))
                if beyond.min() < away[first]:
                    self._blocked[still.person[near[beyond.argmin()]]] += waits[frame]

    def queue(self, all_waited: float, standing: _Standing) -> Queue:
        """Return the queue; its blocker stood before the first of it during more than half of the waiting."""
        peak, most = int(self._at_once.argmax()), int(self._at_once.max())
        many, person = np.flatnonzero(self._at_once >= max(1.0, 0.1 * most)), int(self._blocked.argmax())
        return Queue(
            kind=self._kind,
            name=self._name,
            **self._peak,
            most_on=max(self._on, key=self._on.__getitem__),
            people=int(self._people.sum()),
            waited=self.waited,
            share=self.waited / all_waited,
            most=most,
            time=float(self._time[peak]),
            start=float(self._time[many[0]]),
            end=float(self._time[many[-1]]),
            blocker=standing.words(person) if self._blocked[person] > 0.5 * self.waited else "",
            at_once=self._at_once,
            near=self._near,
        )
