"""Passages of people through the lines of portals and exits, from a recorded run."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from evac.analysis.flows import FEWEST, steady_flow
from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building, Exit, Portal
from evac.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class LineFlow:
    """The passages through the line of a portal or an exit.

    Attributes
    ----------
    link : Portal or Exit
    person : (m,) int32
        Index of the person of each passage, in order of time.
    time : (m,) float64 [s]
        Middle of the interval between the recorded times before and after, with an error of up to half of
        ``output.every``.
    forward : (m,) bool
        Whether the passage is out through an exit, or from the first to the second level of a portal.
    """

    link: Portal | Exit
    person: IntArray = field(repr=False)
    time: FloatArray = field(repr=False)
    forward: IntArray = field(repr=False)

    @property
    def people(self) -> int:
        """Number of passages in both directions together."""
        return len(self.person)

    @property
    def flow(self) -> float | None:
        """People per second between the first and the last fifth of those who passed [1/s].

        None for fewer people than `evac.analysis.flows.FEWEST`, and for people who all passed at the same time.
        """
        flow = steady_flow(self.time) if self.people >= FEWEST else float("nan")
        return None if np.isnan(flow) else flow

    @property
    def flow_per_metre(self) -> float | None:
        """`flow` per metre of width [1/(m s)]."""
        return None if self.flow is None else self.flow / self.link.width


def line_flows(trajectory: Trajectory) -> Mapping[str, LineFlow]:
    """Return the passages through each portal and exit, by its name.

    Between two recorded times, people are assumed to have taken the path over the fewest levels, and the nearest of
    several portals or exits between two levels; those that were closed at both times are not considered.

    Examples
    --------
    >>> door = line_flows(trajectory)["main_door"]  # doctest: +SKIP
    >>> door.people, door.flow_per_metre  # doctest: +SKIP
    """
    building = trajectory.building
    links: list[Portal | Exit] = [*building.portals, *building.exits]
    passages: list[list[tuple[float, int, bool]]] = [[] for _ in links]
    lines = [shapely.multilinestrings([s.reshape(2, 2) for s in link.segments]) for link in links]
    level, ways = trajectory.level, {}
    for k in range(1, len(trajectory)):
        closed = frozenset.intersection(*(trajectory.building_at(trajectory.time[j]).closed for j in (k - 1, k)))
        if closed not in ways:
            ways[closed] = _Ways(replace(building, closed=closed))
        open_ways = ways[closed]
        time = 0.5 * float(trajectory.time[k - 1] + trajectory.time[k])
        for person in np.flatnonzero((level[k] != level[k - 1]) & (level[k - 1] >= 0)).tolist():
            place = shapely.Point(trajectory.position[k - 1, person])
            source = int(level[k - 1, person])
            for target in open_ways.between(source, int(level[k, person])):
                parallel = open_ways.links(source, target)
                link = min(parallel, key=lambda row: float(lines[row].distance(place)))
                forward = target < 0 or links[link].levels[0] == source  # type: ignore[union-attr]
                passages[link].append((time, person, forward))
                source = target
    return {
        link.name: LineFlow(
            link=link,
            person=np.array([person for _, person, _ in passed], np.int32),
            time=np.array([time for time, _, _ in passed], np.float64),
            forward=np.array([forward for _, _, forward in passed], bool),
        )
        for link, passed in zip(links, passages, strict=True)
    }


class _Ways:
    """Levels as a graph whose edges are open portals and exits; -1 is outside."""

    def __init__(self, building: Building) -> None:
        self._rows: dict[tuple[int, int], list[int]] = {}
        for portal in filter(building.is_open, building.portals):
            for pair in (portal.levels, portal.levels[::-1]):
                self._rows.setdefault(pair, []).append(portal.index)
        for exit_ in filter(building.is_open, building.exits):
            self._rows.setdefault((exit_.level, -1), []).append(building.link_of(exit_))
        self._known: dict[tuple[int, int], list[int]] = {}

    def links(self, source: int, target: int) -> list[int]:
        """Return the links between two neighbours."""
        return self._rows[source, target]

    def between(self, source: int, target: int) -> list[int]:
        """Return the levels after `source` on the path over the fewest levels to `target`; empty if there is none."""
        if (source, target) not in self._known:
            paths, seen = deque([[source]]), {source}
            while paths and target not in seen:
                path = paths.popleft()
                for first, second in self._rows:
                    if first == path[-1] and second not in seen:
                        seen.add(second)
                        paths.append([*path, second])
            self._known[source, target] = next((path[1:] for path in paths if path[-1] == target), [])
        return self._known[source, target]
