"""Occupancy: people on each level and stair over the run, from the log of crossings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from typing_extensions import TypedDict

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ResultError
from evac.building.model.building import Building
from evac.folder.textfiles import Amount, Count
from evac.trajectory.trajectory import Trajectory


class Occupancy(TypedDict):
    """How a place was used: the number of different people, and the greatest number at once.

    ``last_left`` is the time at which the last of them left [s]; None if people are still there, or nobody ever was.
    """

    people: Count
    greatest_number: Count
    last_left: Amount | None


@dataclass(frozen=True)
class Moves:
    """All changes of level in a run, in order of time."""

    start: IntArray  # (n,): level on which each person starts
    row: IntArray  # (m,): index of the person
    source: IntArray  # (m,): level that the person left, -1 outside
    target: IntArray  # (m,): level that it entered, -1 outside
    # (m,): portal or exit that the person crossed, numbered as in `Building.link_of`; -1 of those who came, and if it
    # is not known
    link: IntArray
    time: FloatArray  # (m,) [s]

    def occupancy(self, levels: Sequence[int]) -> Occupancy:
        """Return the occupancy of the place that consists of `levels`; moves within it do not count."""
        inside = np.isin(self.start, levels)
        entered = np.isin(self.target, levels)
        left = np.isin(self.source, levels)
        change = entered.astype(np.int64) - left.astype(np.int64)
        number = inside.sum() + np.concatenate([[0], np.cumsum(change)])
        leaving = self.time[change < 0]
        gone = number[-1] == 0 and leaving.size > 0
        return Occupancy(
            people=int(np.union1d(np.flatnonzero(inside), self.row[entered]).size),
            greatest_number=int(number.max()),
            last_left=float(leaving[-1]) if gone else None,
        )


def recorded_moves(trajectory: Trajectory) -> Moves:
    """Return the changes of level between recorded times, each at the later one, for runs without a log of crossings.

    People who have not come when the first frame was recorded start outside.
    """
    level = trajectory.level
    frame, row = np.nonzero(level[1:] != level[:-1])
    return Moves(
        start=level[0],
        row=row.astype(np.int32),
        source=level[frame, row],
        target=level[frame + 1, row],
        link=np.full(row.size, -1, np.int32),
        time=trajectory.time[frame + 1],
    )


def moves_of(
    building: Building,
    start_level: IntArray,
    crossings: tuple[IntArray, IntArray, FloatArray],
    exit_time: FloatArray,
    arrival_time: FloatArray | None = None,
    exit_used: IntArray | None = None,
) -> Moves:
    """Return all changes of level of a run.

    `start_level` (n,): at time zero, or at the time of arrival; -1 for people who have not come; `crossings`: person,
    link (as in `Building.link_of`) and time [s] in the order of the log, (m,) each; exits may be missing in it;
    `exit_time`, `arrival_time` (n,) [s]: NaN for people who are not out or have not come; by default all are there from
    time zero; `exit_used` (n,): exit of each person who is out.
    """
    level = np.array(start_level, dtype=np.int32)
    joins = np.array([len(link.levels) == 2 for link in building.links], dtype=bool)[crossings[1]]
    row, link, time = (column[joins] for column in crossings)
    source, target = np.empty(row.size, np.int32), np.empty(row.size, np.int32)
    for k, (person, crossed) in enumerate(zip(row.tolist(), link.tolist(), strict=True)):
        way = building.links[crossed]
        source[k] = level[person]
        if source[k] not in way.levels:
            raise ResultError(
                f"the crossings contradict each other: at {time[k]:.3f} s person {person} crosses {way.kind} "
                f"{way.name!r} but is on {building.levels[source[k]].name!r}"
            )
        target[k] = level[person] = next(one for one in way.levels if one != source[k])
    out = np.flatnonzero(np.isfinite(exit_time)).astype(np.int32)
    begin = np.array(start_level, dtype=np.int32)
    came = np.flatnonzero(arrival_time > 0.0) if arrival_time is not None else np.zeros(0, np.intp)
    came = came.astype(np.int32)
    row = np.concatenate([came, row, out])
    time = np.concatenate([np.zeros(0) if arrival_time is None else arrival_time[came], time, exit_time[out]])
    source = np.concatenate([np.full(came.size, -1, np.int32), source, level[out]])
    target = np.concatenate([begin[came], target, np.full(out.size, -1, np.int32)])
    left = np.full(out.size, -1, np.int32)
    if exit_used is not None:
        left = np.where(exit_used[out] < 0, left, len(building.portals) + exit_used[out])
    link = np.concatenate([np.full(came.size, -1, np.int32), link, left]).astype(np.int32)
    begin[came] = -1
    order = np.argsort(time, kind="stable")
    return Moves(begin, row[order], source[order], target[order], link[order], time[order])
