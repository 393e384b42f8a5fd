"""Shapes that show the state of a building on its floors: slow and barred areas, arrows and strips at links."""

from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Door, Level, Portal

#: Outline of an arrow of 1 m that points along x from the origin [m].
ARROW = np.array([[0.0, -0.06], [0.62, -0.06], [0.62, -0.2], [1.0, 0.0], [0.62, 0.2], [0.62, 0.06], [0.0, 0.06]])

STRIP = 0.2  #: Width of the strip at a controlled link, on each side [m].
FURNITURE = 4.0  #: Holes of a floor up to this area are drawn as furniture [m2].


class Mark(NamedTuple):
    """A shape on a level: a ``slow`` or ``barred`` area, the arrow of a ``one_way`` link, the strip of ``control``."""

    kind: str
    level: int
    shape: BaseGeometry


def furniture_of(level: Level) -> list[shapely.Polygon]:
    """Return the holes of a level that are drawn as furniture."""
    holes = [shapely.Polygon(ring) for part in shapely.get_parts(level.polygon) for ring in part.interiors]
    return [hole for hole in holes if hole.area <= FURNITURE]


def marks_of(building: Building) -> list[Mark]:
    """Return the slow and barred areas of a building as it is at a time, then the arrows of its links."""
    kinds = {name: "slow" for name, _ in building.slowed} | dict.fromkeys(building.barred, "barred")
    marks = [Mark(kinds[name], one.level, one.polygon) for name in sorted(kinds) for one in building.parts_named(name)]
    ways = [way for way in sorted(building.one_way) if way[0] not in building.lift_doors]
    marks += [_arrow(building, link, origin) for link, origin in ways]
    return marks + [_strip(building, link) for link in building.controlled]


def _strip(building: Building, link: int) -> Mark:
    """Return the strip of floor at the line of a controlled link, on its flattest level."""
    way = building.links[link]
    level = min(way.levels, key=lambda index: building.levels[index].slope)
    line = shapely.multilinestrings(way.segments.reshape(-1, 2, 2))
    return Mark("control", level, line.buffer(STRIP, cap_style="flat").intersection(building.levels[level].polygon))


def _arrow(building: Building, link: int, origin: int) -> Mark:
    """Return the arrow of a link: across a door, or up to or from the line of others, on their flattest level."""
    way = building.links[link]
    level = min(way.levels, key=lambda index: building.levels[index].slope)
    segments = way.segments_from(level) if isinstance(way, Portal) else way.segments
    leads_out = origin == (0 if isinstance(way, Door) else level)
    segment = segments[len(segments) // 2][[0, 1, 2, 3] if leads_out else [2, 3, 0, 1]]
    begin = -0.5 if isinstance(way, Door) else -1.0 if leads_out else 0.0
    return Mark("one_way", level, _pointing(segment, begin))


def _pointing(segment: FloatArray, begin: float) -> BaseGeometry:
    """Return an arrow to the right of a segment (4,) through its middle, which begins at a distance from it [m]."""
    x1, y1, x2, y2 = segment.tolist()
    along = np.array([y2 - y1, x1 - x2]) / np.hypot(x2 - x1, y2 - y1)
    turned = np.stack([along, [-along[1], along[0]]])
    return shapely.Polygon(np.array([0.5 * (x1 + x2), 0.5 * (y1 + y2)]) + (ARROW + np.array([begin, 0.0])) @ turned)
