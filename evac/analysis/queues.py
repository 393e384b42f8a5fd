"""Queues: where people waited, for how long, and how many of them at once."""

from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.analysis.measures import joined, records
from evac.base.arrays import FloatArray
from evac.base.errors import counted
from evac.building.model.building import Building, Level, Portal
from evac.trajectory.trajectory import Trajectory

#: Distance within which people who wait are before the place itself [m].
NEAR = 2.0


@dataclass(frozen=True)
class Queue:
    """The people who waited before a door, a portal or an exit, or on a stair.

    Waiting is that of `evac.analysis.measures.Measures`. People wait before the door, portal or exit of their level
    that is nearest to them; on the levels of a stair, they wait on the stair.

    Attributes
    ----------
    place : str
        What they waited for or on, in words.
    level : str
        Level with most of them at `time`.
    x, y : float [m]
        Mean position of those who waited there at `time`.
    people : int
        Number of different people who waited.
    waited : float [s]
        Sum of the times for which they waited.
    most : int
        Greatest number who waited at once.
    time : float [s]
        When that was first.
    at_once : (f,) int64
        Number who waited at each recorded time.
    near : (f,) int64
        Number of those who were within `NEAR` of the door, portal or exit; all of them on a stair.
    """

    place: str
    level: str
    x: float
    y: float
    people: int
    waited: float
    most: int
    time: float
    at_once: NDArray[np.int64] = field(repr=False, compare=False)
    near: NDArray[np.int64] = field(repr=False, compare=False)

    def __str__(self) -> str:
        """Return a sentence without its end."""
        who = counted(self.people, "person", "people")
        return (
            f"{self.place}: {who} waited {self.waited / self.people:.1f} s on average, at most {self.most} at once, at "
            f"{self.time:.1f} s around ({self.x:.1f}, {self.y:.1f}) on {self.level!r}"
        )


def find_queues(trajectory: Trajectory) -> tuple[Queue, ...]:
    """Return the queues of a run, sorted by the time for which people waited in total, the longest first."""
    building = trajectory.building
    parts = [part.chosen(part.waits > 0.0) for part in records(trajectory)]
    if not parts:
        return ()
    waiting = joined(parts)
    numbers: dict[tuple[str, int], int] = {}
    place, away = np.zeros(len(waiting.frame), np.int64), np.zeros(len(waiting.frame))
    for level in building.levels:
        here = np.flatnonzero(waiting.level == level.index)
        words, nearest, away[here] = _places(building, level, waiting.position[here])
        keys = [(word, -1 if word.startswith("on stair") else level.index) for word in words]
        place[here] = np.array([numbers.setdefault(key, len(numbers)) for key in keys])[nearest]
    queues = []
    for (name, _), number in numbers.items():
        rows_of = np.flatnonzero(place == number)
        if not rows_of.size:
            continue
        at_once, near = (
            np.bincount(waiting.frame[rows], minlength=len(trajectory))
            for rows in (rows_of, rows_of[away[rows_of] <= NEAR])
        )
        peak = int(at_once.argmax())
        then = rows_of[waiting.frame[rows_of] == peak]
        x, y = waiting.position[then].mean(axis=0).tolist()
        queues.append(
            Queue(
                place=name,
                level=building.levels[int(np.bincount(waiting.level[then]).argmax())].name,
                x=x,
                y=y,
                people=len(np.unique(waiting.person[rows_of])),
                waited=float(waiting.waits[rows_of].sum()),
                most=int(at_once[peak]),
                time=float(trajectory.time[peak]),
                at_once=at_once,
                near=near,
            )
        )
    return tuple(sorted(queues, key=lambda queue: -queue.waited))


def _places(
    building: Building, level: Level, position: FloatArray
) -> tuple[list[str], NDArray[np.int64], FloatArray | float]:
    """Return what people on a level wait for or on, in words, which of these each of them does, and how far from it."""
    stair_of = {index: name for name, levels in building.stairs.items() for index in levels}
    if level.index in stair_of:
        return [f"on stair {stair_of[level.index]!r}"], np.zeros(len(position), np.int64), 0.0

    def beyond(portal: Portal) -> str:
        other = portal.other(level.index)
        return f"stair {stair_of[other]!r}" if other in stair_of else f"level {building.levels[other].name!r}"

    links = [(f"before exit {exit_.name!r}", exit_.segments) for exit_ in building.exits_of(level.index)]
    links += [(f"before {beyond(portal)}", portal.segments) for portal in building.portals_of(level.index)]
    doors = [door for door in building.doors if door.level == level.index]
    links += [(f"before door {door.name!r}", door.segment.reshape(1, 4)) for door in doors]
    if not links:
        return [f"on level {level.name!r}"], np.zeros(len(position), np.int64), 0.0
    points = shapely.points(position)
    distances = [
        shapely.distance(shapely.multilinestrings([s.reshape(2, 2) for s in segments]), points) for _, segments in links
    ]
    return [word for word, _ in links], np.argmin(distances, axis=0), np.min(distances, axis=0)
