"""People who come during a run: their times, and the places at which they come in."""

from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.base.arrays import FloatArray, IntArray
from evac.base.distributions import generator_for
from evac.base.errors import ScenarioError
from evac.base.saved import Bounds, Saved
from evac.building.model.building import Building, Exit, Portal
from evac.building.model.links import ways_onto
from evac.people.placement import clearance
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.schema import GroupSettings

#: Places that are tried at random for each person at each tick.
TRIES = 64

#: Gap between people, and from people to walls, at the place where somebody comes in [m].
GAP = 0.01


def times_of_arrival(people: "GroupSettings", seed: int) -> FloatArray:
    """Return the times at which the people of a group come [s], in ascending order.

    At a rate, they are those of a Poisson process, from a generator of this group alone; infinite for those who come
    only if they are added.
    """
    arrive = people.arrive
    assert arrive is not None
    if arrive.reserve is not None:
        return np.full(arrive.reserve, np.inf)
    if arrive.times is not None:
        return np.sort(np.array(arrive.times, dtype=np.float64))
    begin, end = arrive.from_ or 0.0, arrive.to or 0.0
    generator = generator_for(seed, "people", people.name, "arrival")
    number = int(generator.poisson((arrive.rate or 0.0) * (end - begin)))
    return np.sort(generator.uniform(begin, end, number))


class Source(Saved):
    """The place at which the people of a group come in, and the times at which they come, ascending (k,) [s].

    `place` (k, 2) are the places of people who were added at one, NaN for others [m].
    """

    saved = ("due", "place")

    def __init__(self, people: "GroupSettings", rows: IntArray, due: FloatArray, seed: int) -> None:
        assert people.arrive is not None
        self.rows, self.due, self.place = rows, due, np.full((len(rows), 2), np.nan)
        self.name, self._seed = people.name, seed
        self._exit, self._portal = people.arrive.exit, people.arrive.portal
        self._is_at_edge = people.arrive.exit is not None or people.arrive.portal is not None
        self._place = people.area or people.level or ""

    def waiting(self, crowd: Crowd, time: float) -> IntArray:
        """Return the people whose time has come, but who are not inside."""
        due: IntArray = self.rows[np.isnan(crowd.arrival_time[self.rows]) & (self.due <= time + 1e-9)]
        return due

    def add(self, building: Building, crowd: Crowd, time: float, place: tuple[float, float] | None) -> int:
        """Let the next person of the reserve come at a time, at a place on the level [m] or where the group enters."""
        left = np.flatnonzero(np.isinf(self.due))
        if not len(left):
            raise ScenarioError(f"people.{self.name}: all {len(self.due)} people of arrive.reserve have come; raise it")
        if place is not None:
            level = building.levels[self._ways(building)[0]]
            if not level.polygon.covers(shapely.Point(place)):
                raise ScenarioError(f"people.{self.name}: ({place[0]:g}, {place[1]:g}) is not on level {level.name!r}")
            self.place[left[0]] = place
        self.due[left[0]] = time
        return int(self.rows[left[0]])

    def bounds(self) -> dict[str, Bounds]:
        """Return that times are not negative."""
        return {"due": Bounds(0.0, np.inf), "place": Bounds(nan=True)}

    def let_in(self, building: Building, crowd: Crowd, time: float) -> IntArray:
        """Put people who wait to free places, in the order of their times, and return those who have come in.

        Ways that are closed or lead out only let nobody in. The response times of people begin when they have come.
        """
        waiting, came = self.waiting(crowd, time), list[int]()
        if not len(waiting):
            return waiting
        level, ways = self._ways(building)
        area = None if self._is_at_edge else building.area_named(self._place)
        walls = [building.walls[building.wall_level == level]]
        walls += [link.segments for link in building.links_of(level) if all(link is not way for way in ways)]
        edges = np.concatenate([np.zeros((0, 4)), *(_seen_from(way, level) for way in ways)])
        near = [level, *(way.other(level) for way in ways if isinstance(way, Portal))]
        for row in waiting.tolist():
            generator = generator_for(self._seed, "people", self.name, "place", str(row), f"{time:.6f}")
            radius = float(crowd.radius[row])
            if not np.isnan(own := self.place[self.rows == row]).any():
                tries = own
            elif area is not None:
                tries = _in_area(area.polygon, generator)
            elif len(edges):
                tries = _behind(edges, radius, generator)
            else:
                break  # all ways are closed
            there = np.flatnonzero(np.isin(crowd.level, near))
            away = np.hypot(*(tries[:, None] - crowd.position[there]).transpose(2, 0, 1))
            is_free = (away >= radius + crowd.radius[there] + GAP).all(axis=1)
            is_free &= clearance(tries, np.concatenate(walls)) >= radius + GAP
            if not is_free.any():
                if np.isnan(own).any():
                    break  # who comes later waits behind
                continue
            crowd.position[row], crowd.level[row] = tries[np.argmax(is_free)], level
            crowd.velocity[row], crowd.arrival_time[row] = 0.0, time
            crowd.start_time[row] += time
            came.append(row)
        return np.array(came, dtype=np.int32)

    def _ways(self, building: Building) -> tuple[int, list[Portal | Exit]]:
        """Return the level onto which people come, and the open exits or portals through which they do."""
        if self._exit is not None:
            exits = [way for way in building.exits if way.name == self._exit]
            return exits[0].level, [way for way in exits if building.lets_in(way)]
        area = building.area_named(self._place)
        assert area is not None
        portals = ways_onto(building, area.level).get(self._portal or "", [])
        return area.level, [way for way in portals if building.leads_from(way, way.other(area.level))]


def _seen_from(way: Portal | Exit, level: int) -> FloatArray:
    """Return the segments (s, 4) of a portal or an exit with a level on their left [m]."""
    return way.segments_from(level) if isinstance(way, Portal) else way.segments


def _in_area(polygon: shapely.Geometry, generator: np.random.Generator) -> FloatArray:
    """Return random places in a polygon [m]."""
    left, bottom, right, top = polygon.bounds
    places = generator.uniform((left, bottom), (right, top), (TRIES, 2))
    inside: FloatArray = places[shapely.contains_xy(polygon, *places.T)]
    return inside


def _behind(segments: FloatArray, radius: float, generator: np.random.Generator) -> FloatArray:
    """Return random places inside an exit or a portal whose bodies touch its line from the inside [m]."""
    x1, y1, x2, y2 = segments[generator.integers(len(segments), size=TRIES)].T
    share = generator.uniform(0.0, 1.0, TRIES)
    length = np.hypot(x2 - x1, y2 - y1)
    inward = np.stack([y1 - y2, x2 - x1], axis=1) / length[:, None]
    on_line = np.stack([x1 + share * (x2 - x1), y1 + share * (y2 - y1)], axis=1)
    found: FloatArray = on_line + (radius + GAP) * inward
    return found
