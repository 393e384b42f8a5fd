"""Passages of people through exits, portals, doors and lines of the case, their flows, and occupancy of levels."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from typing_extensions import TypedDict

from evac.analysis.measures import Records, records
from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ResultError
from evac.building.model.building import Building, Exit, Portal
from evac.folder.textfiles import Amount, Count
from evac.trajectory.trajectory import Trajectory


class Occupancy(TypedDict):
    """How a place was used: the number of different people, and the greatest number at once.

    ``last_left`` is the time at which the last of them left [s]; None if people are still there, or nobody ever was.
    """

    people: Count
    greatest_number: Count
    last_left: Amount | None


class StairUse(Occupancy):
    """Use of a stair, and the indices of its pieces among all levels and of the portals within it."""

    pieces: Mapping[str, Count]
    portals: Mapping[str, Count]


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


#: Share of the people who pass before, and of those who pass after, the interval in which a flow counts as steady.
MARGIN = 0.2

#: Least number of people for a steady flow.
FEWEST = 20


def steady_flow(times: FloatArray) -> float:
    """Return the flow between the first and the last fifth of those who pass at ascending `times` [s], in 1/s.

    NaN for a single person, and for people who all pass at the same time.
    """
    first, last = int(MARGIN * len(times)), int((1.0 - MARGIN) * len(times))
    if last == first or times[last] == times[first]:
        return float("nan")
    return float((last - first) / (times[last] - times[first]))


class ExitUse(TypedDict):
    """Use of an exit [s], [m], [1/s], [1/(m s)]; flows of fewer than `FEWEST` people, or all at one time, are None."""

    people: Count
    last_out: Amount | None
    width: Amount
    flow: Amount | None
    flow_per_metre: Amount | None


def use_of_levels(building: Building, moves: Moves) -> tuple[dict[str, Occupancy], dict[str, StairUse]]:
    """Return the use of the levels that are no pieces of stairs, and of the stairs, by name."""
    levels = {level.name: moves.occupancy([level.index]) for level in building.levels if level.stair is None}
    stairs = {
        name: StairUse(
            **moves.occupancy(own),
            pieces={level.name: level.index for level in building.levels if level.index in own},
            portals={one.name: one.index for one in building.portals if set(one.levels) <= set(own)},
        )
        for name, own in building.stairs.items()
    }
    return levels, stairs


def exit_table(building: Building, exit_used: IntArray, exit_time: FloatArray) -> Mapping[str, ExitUse]:
    """Return the use of each exit, by name; exits (n,) are -1 and times (n,) [s] NaN of people inside."""
    table = {}
    for exit_ in building.exits:
        times = np.sort(exit_time[exit_used == exit_.index])
        table[exit_.name] = ExitUse(
            people=times.size,
            last_out=float(times[-1]) if times.size else None,
            width=exit_.width,
            flow=(flow := _flow_of(times)),
            flow_per_metre=None if flow is None else flow / exit_.width,
        )
    return table


#: Time between two rows of a table of flows, over which each flow is a mean [s].
SPAN = 5.0

#: Person, time and whether it is forward, of passages.
Passages = tuple[IntArray, FloatArray, NDArray[np.bool_]]


@dataclass(frozen=True)
class LineFlow:
    """The m passages through a line, in order of time."""

    kind: str  # "exit", "portal", "door" or "line"
    name: str
    levels: tuple[int, ...]  # level of the line, or both levels of a portal
    segments: FloatArray = field(repr=False)  # (s, 4) [m]
    width: float  # [m]
    # names of forward and back: forward is out through an exit, from the first to the second level of a portal, and to
    # the left of a door or a line, seen from its first end to its second one
    directions: tuple[str, str]
    person: IntArray = field(repr=False)  # (m,): index of the person
    # (m,) [s]: of exits and portals exact, of doors and lines as `line_flows` gives it
    time: FloatArray = field(repr=False)
    forward: NDArray[np.bool_] = field(repr=False)  # (m,)

    @property
    def people(self) -> int:
        """Number of passages in both directions together."""
        return len(self.person)

    @property
    def flow(self) -> float | None:
        """People per second between the first and the last fifth of those who passed [1/s].

        None for fewer people than `evac.analysis.lines.FEWEST`, and for people who all passed at the same time.
        """
        return _flow_of(self.time)

    @property
    def flow_per_metre(self) -> float | None:
        """`flow` per metre of width [1/(m s)]."""
        return None if self.flow is None else self.flow / self.width

    def flow_of(self, passed: NDArray[np.bool_]) -> float | None:
        """Return `flow` of some of the passages, (m,) bool."""
        return _flow_of(self.time[passed])

    def by_direction(self) -> Iterator[tuple[str, FloatArray]]:
        """Yield each direction in which people passed, and their times; of exits, the way out in any case."""
        for name, passed in zip(self.directions, (self.forward, ~self.forward), strict=True):
            if passed.any() or name == "out":
                yield name, self.time[passed]


def _flow_of(times: FloatArray) -> float | None:
    flow = steady_flow(times) if len(times) >= FEWEST else float("nan")
    return None if np.isnan(flow) else flow


def link_flows(building: Building, moves: Moves) -> list[LineFlow]:
    """Return the passages through each portal and exit, from the moves of a run."""
    links: list[Portal | Exit] = [*building.portals, *building.exits]
    flows = []
    for number, link in enumerate(links):
        passed = moves.link == number
        forward = np.ones(passed.sum(), bool) if isinstance(link, Exit) else moves.source[passed] == link.levels[0]
        flows.append(_of_link(building, link, moves.row[passed], moves.time[passed], forward))
    return flows


def flow_rows(flows: Iterable[LineFlow], end: float) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of flows.csv: time, kind, name, direction, count, flow and specific flow, every `SPAN`.

    The last row is at the time `end` [s]; its flows are those since the row before.
    """
    times = np.append(np.arange(SPAN, end, SPAN), end) if end > 0.0 else np.zeros(0)
    for line in flows:
        for direction, passed in line.by_direction():
            counts = np.searchsorted(passed, times, side="right")
            flow = np.diff(counts, prepend=0) / np.diff(times, prepend=0.0)
            for row in zip(times.tolist(), counts.tolist(), flow.tolist(), (flow / line.width).tolist(), strict=True):
                yield row[0], line.kind, line.name, direction, *row[1:]


class FlowUse(TypedDict):
    """People and flow through a line in one direction [m], [s], [1/s], [1/(m s)]."""

    kind: str
    name: str
    direction: str
    width: Amount
    people: Count
    first: Amount | None
    last: Amount | None
    flow: Amount | None
    flow_per_metre: Amount | None


def totals(flows: Iterable[LineFlow]) -> list[FlowUse]:
    """Return a row for each line and direction."""
    return [
        FlowUse(
            kind=line.kind,
            name=line.name,
            direction=direction,
            width=line.width,
            people=len(times),
            first=float(times[0]) if len(times) else None,
            last=float(times[-1]) if len(times) else None,
            flow=(flow := _flow_of(times)),
            flow_per_metre=None if flow is None else flow / line.width,
        )
        for line in flows
        for direction, times in line.by_direction()
    ]


def _of_link(
    building: Building, link: Portal | Exit, person: IntArray, time: FloatArray, forward: NDArray[np.bool_]
) -> LineFlow:
    if isinstance(link, Exit):
        return LineFlow(
            link.kind, link.name, link.levels, link.segments, link.width, ("out", "in"), person, time, forward
        )
    one, other = (building.levels[index] for index in link.levels)
    names = [one.name, other.name] if one.title == other.title else [one.title, other.title]
    what = link.kind, link.name, link.levels, link.segments, link.width, (f"to {names[1]}", f"to {names[0]}")
    return LineFlow(*what, person, time, forward)


def line_flows(trajectory: Trajectory) -> list[LineFlow]:
    """Return the passages through the doors of the building and the lines of the case, from recorded positions.

    People move straight between recorded positions, at a constant speed, and from the last one to the exit that is
    nearest to it.
    """
    building = trajectory.building
    lines = [(door.kind, door.name, door.level, door.segment, door.width) for door in building.doors]
    for place in building.places:
        if place.kind == "line":
            ends = shapely.get_coordinates(place.shape).ravel()
            lines.append(("line", place.name, place.level, ends, place.shape.length))
    if not lines:
        return []
    passed: list[list[Passages]] = [[] for _ in lines]
    for moved in _moved(trajectory):
        there = {
            level: np.flatnonzero((moved.level == level) | (moved.target == level))
            for level in {level for _, _, level, _, _ in lines}
        }
        for parts, (_, _, level, segment, _) in zip(passed, lines, strict=True):
            parts.append(_through(moved, there[level], segment, trajectory.time))
    flows = []
    for parts, (kind, name, level, segment, width) in zip(passed, lines, strict=True):
        person, time, forward = (np.concatenate(column) for column in zip(*parts, strict=True))
        order, directions = np.argsort(time, kind="stable"), ("to the left", "to the right")
        what = kind, name, (level,), segment.reshape(1, 4), width, directions
        flows.append(LineFlow(*what, person[order], time[order], forward[order]))
    return flows


def _moved(trajectory: Trajectory) -> Iterator[Records]:
    """Yield the records of everybody who moved; those who have left go to the nearest exit of their level."""
    building = trajectory.building
    for part in records(trajectory):
        start, end = part.position, part.after
        gone = (part.target < 0) & (part.frame < len(trajectory) - 1)
        for index in np.unique(part.level[gone]).tolist():
            left = gone & (part.level == index)
            segments = [segment.reshape(2, 2) for exit_ in building.exits_of(index) for segment in exit_.segments]
            if segments:
                nearest = shapely.shortest_line(shapely.MultiLineString(segments), shapely.points(start[left]))
                end[left] = shapely.get_coordinates(nearest).reshape(-1, 2, 2)[:, 0]
        target = np.where(part.target < 0, part.level, part.target)
        yield part._replace(target=target).chosen(np.isfinite(end[:, 0]) & (start != end).any(axis=1))


def _through(moved: Records, here: NDArray[np.intp], segment: FloatArray, time: FloatArray) -> Passages:
    """Return person, time and whether it is to the left, of each passage of some rows through a segment."""
    # Whoever stands on the line is at the left of the direction in which x, then y, grows, and of the ends the one from
    # which they grow belongs to the segment: so a line and its reverse count the same, and lines that share an end
    # count a passage through it once.
    is_reversed = tuple(segment[:2]) > tuple(segment[2:])
    first, last = (segment[2:], segment[:2]) if is_reversed else (segment[:2], segment[2:])
    along = last - first
    start, end = moved.position.take(here, 0) - first, moved.after.take(here, 0) - first
    before = along[0] * start[:, 1] - along[1] * start[:, 0]  # positive to the left
    after = along[0] * end[:, 1] - along[1] * end[:, 0]
    turns = np.flatnonzero((before < 0.0) != (after < 0.0))
    share = before[turns] / (before[turns] - after[turns])
    place = (start[turns] + share[:, None] * (end[turns] - start[turns])) @ along / (along @ along)
    hits = (place >= 0.0) & (place < 1.0)
    turns, share = turns[hits], share[hits]
    rows = here[turns]
    begin, then = time[moved.frame[rows]], time[moved.frame[rows] + 1]
    return moved.person[rows], begin + share * (then - begin), (after[turns] >= 0.0) != is_reversed
