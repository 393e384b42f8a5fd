"""People who come during a run: their times, and the places at which they come in."""

from typing import TYPE_CHECKING

import numpy as np
import shapely

from evac.base.arrays import FloatArray, IntArray
from evac.base.distributions import generator_for
from evac.building.model.building import Building
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

    At a rate, they are those of a Poisson process, from a generator of this group alone.
    """
    arrive = people.arrive
    assert arrive is not None
    if arrive.times is not None:
        return np.sort(np.array(arrive.times, dtype=np.float64))
    begin, end = arrive.from_ or 0.0, arrive.to or 0.0
    generator = generator_for(seed, "people", people.name, "arrival")
    number = int(generator.poisson((arrive.rate or 0.0) * (end - begin)))
    return np.sort(generator.uniform(begin, end, number))


class Source:
    """The place at which the people of a group come in, and their times.

    Parameters
    ----------
    people : GroupSettings
    rows : (k,) int32
    due : (k,) float64
        Times at which they come [s], ascending.
    seed : int
    """

    def __init__(self, people: "GroupSettings", rows: IntArray, due: FloatArray, seed: int) -> None:
        assert people.arrive is not None
        self.rows, self.due = rows, due
        self._name, self._seed = people.name, seed
        self._exit, self._place = people.arrive.exit, people.area or people.level or ""

    def waiting(self, crowd: Crowd, time: float) -> IntArray:
        """Return the people whose time has come, but who are not inside."""
        found: IntArray = self.rows[np.isnan(crowd.arrival_time[self.rows]) & (self.due <= time + 1e-9)]
        return found

    def let_in(self, building: Building, crowd: Crowd, time: float) -> IntArray:
        """Put people who wait to free places, in the order of their times, and return those who have come in.

        An exit that is closed or leads out only lets nobody in.
        """
        waiting, came = self.waiting(crowd, time), list[int]()
        area = building.area_named(self._place)
        way = next((one for one in building.exits if one.name == self._exit and building.lets_in(one)), None)
        level = area.level if area is not None else way.level if way is not None else -1
        lines = [building.walls[building.wall_level == level]]
        lines += [link.segments for link in building.links_of(level) if link is not way]
        walls = np.concatenate(lines)
        for row in waiting.tolist():
            generator = generator_for(self._seed, "people", self._name, "place", str(row), f"{time:.6f}")
            radius = float(crowd.radius[row])
            if area is not None:
                tries = _in_area(area.polygon, generator)
            elif way is not None:
                tries = _behind(way.segments, radius, generator)
            else:
                break  # the exit is closed
            there = np.flatnonzero(crowd.level == level)
            away = np.hypot(*(tries[:, None] - crowd.position[there]).transpose(2, 0, 1))
            is_free = (away >= radius + crowd.radius[there] + GAP).all(axis=1)
            is_free &= clearance(tries, walls) >= radius + GAP
            if not is_free.any():
                break  # who comes later waits behind
            crowd.position[row], crowd.level[row] = tries[np.argmax(is_free)], level
            crowd.velocity[row], crowd.arrival_time[row] = 0.0, time
            came.append(row)
        return np.array(came, dtype=np.int32)


def _in_area(polygon: shapely.Geometry, generator: np.random.Generator) -> FloatArray:
    """Return random places in a polygon [m]."""
    left, bottom, right, top = polygon.bounds
    places = generator.uniform((left, bottom), (right, top), (TRIES, 2))
    found: FloatArray = places[shapely.contains_xy(polygon, *places.T)]
    return found


def _behind(segments: FloatArray, radius: float, generator: np.random.Generator) -> FloatArray:
    """Return random places inside an exit whose bodies touch its line from the inside [m]."""
    x1, y1, x2, y2 = segments[generator.integers(len(segments), size=TRIES)].T
    share = generator.uniform(0.0, 1.0, TRIES)
    length = np.hypot(x2 - x1, y2 - y1)
    inward = np.stack([y1 - y2, x2 - x1], axis=1) / length[:, None]
    on_line = np.stack([x1 + share * (x2 - x1), y1 + share * (y2 - y1)], axis=1)
    found: FloatArray = on_line + (radius + GAP) * inward
    return found
