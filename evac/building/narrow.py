"""Places too narrow for a body: portals, exits, and constrictions inside a level."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.arrays import FloatArray
from evac.building.findings import Finding
from evac.building.model import Building, Exit, Level, Portal

#: Minimum area of ground behind a constriction that a body's centre can reach [m2]; smaller ground is a niche.
LEAST_PART = 0.05
#: A constriction that is impassable even for a body of this width is a closed wall, not a narrow place [m].
CLOSED = 0.02
#: Points closer along an outline than this many widths, or closer than the rounding length [m], do not form a gap.
FAR_ALONG, ROUNDING = 5.0, 1e-7
#: Accuracy of the width of a constriction [m].
PRECISION = 1e-3


def narrow_places(building: Building, width: float) -> tuple[Finding, ...]:
    """Return a warning for each place that is too narrow for a body.

    Inside a level, the centre of a body can reach the polygon minus all points nearer to a wall than half the
    width. Where this set is disconnected, there is a constriction.

    Parameters
    ----------
    width : float [m]
        Diameter of the widest body.
    """
    notes = []
    for portal in building.portals:
        if portal.width < width:
            one, other = (building.levels[index].name for index in portal.levels)
            what = f"portal {portal.name!r} between {one!r} and {other!r}"
            notes.append(_note(what, one, portal, width))
    for way in building.exits:
        if way.width < width:
            notes.append(_note(f"exit {way.name!r}", building.levels[way.level].name, way, width))
    for level in building.levels:
        for neck, place in necks(building, level, width):
            text = f"only {neck:.2f} m wide, less than the widest person ({width:.2f} m): widen this place"
            notes.append(Finding("warning", text, level.name, place))
    return tuple(notes)


def gaps_below(polygon: BaseGeometry, width: float = CLOSED) -> FloatArray:
    """Return segments (g, 4) across gaps of a level that are narrower than `width` [m].

    By default, these are gaps between walls that fail to meet. Each segment leads through the level from a corner of
    the outline to the nearest point of a side within that distance. Consecutive sides do not form a gap.
    """
    rings = shapely.get_rings(shapely.get_parts(polygon))
    sides, ring_of = [], []
    for index, ring in enumerate(rings):
        ends = shapely.get_coordinates(ring)
        sides.append(np.stack([ends[:-1], ends[1:]], axis=1))
        ring_of.append(np.full(len(ends) - 1, index))
    side, of = np.concatenate(sides), np.concatenate(ring_of)
    lines, corners = shapely.linestrings(side), shapely.points(side[:, 0])
    one, other = shapely.STRtree(lines).query(corners, predicate="dwithin", distance=width)
    gap = shapely.shortest_line(corners[one], lines[other])
    ends = shapely.get_coordinates(gap).reshape(-1, 2, 2)
    along = np.full(len(one), np.inf)
    same = of[one] == of[other]
    # Arc length on the ring: the sides before, plus the distance along the side itself.
    length = shapely.length(lines)
    before = np.cumsum(length) - length
    at = before[other] + np.hypot(*(ends[:, 1] - side[other, 0]).T)
    along[same] = np.abs(at - before[one])[same]
    along[same] = np.minimum(along[same], shapely.length(rings)[of[one[same]]] - along[same])
    across = (shapely.length(gap) > ROUNDING) & (along > FAR_ALONG * width)
    shapely.prepare(polygon)
    across[across] = shapely.contains(polygon, gap[across])
    # The smaller end first, so that a gap between two corners is found once.
    found: FloatArray = np.unique([sorted(pair) for pair in ends[across].tolist()], axis=0).reshape(-1, 4)
    return found


def necks(building: Building, level: Level, width: float) -> list[tuple[float, tuple[float, float]]]:
    """Return the width [m] and plan position of each constriction that a body `width` wide cannot pass."""
    width -= PRECISION  # a body as wide as the neck passes
    walls = shapely.multilinestrings(building.walls[building.wall_level == level.index].reshape(-1, 2, 2))
    walls = shapely.line_merge(walls)  # buffering merged chains of walls is many times faster
    parts = _reachable(level, walls, width)
    parts = sorted((part for part in parts if part.area > LEAST_PART), key=lambda part: part.area)
    found: dict[tuple[float, float], tuple[float, tuple[float, float]]] = {}
    for index in range(len(parts) - 1):
        neck = _neck_of(level, walls, width, parts[index], shapely.union_all(parts[:index] + parts[index + 1 :]))
        if neck is not None:  # found from both sides, it counts once
            found.setdefault((round(neck[1][0], 1), round(neck[1][1], 1)), neck)
    return list(found.values())


def _neck_of(
    level: Level, walls: BaseGeometry, width: float, part: BaseGeometry, others: BaseGeometry
) -> tuple[float, tuple[float, float]] | None:
    """Find, by bisection, the largest width at which `part` is connected to `others`, and the place."""
    passes, stops = CLOSED, width
    joined = _around(level, walls, passes, part)
    if not joined.intersects(others):
        return None
    while stops - passes > PRECISION:
        middle = 0.5 * (passes + stops)
        wider = _around(level, walls, middle, part)
        if wider.intersects(others):
            passes, joined = middle, wider
        else:
            stops = middle
    one = _around(level, walls, stops, part)
    rest = [piece for piece in _reachable(level, walls, stops) if piece.intersects(others)]
    other = shapely.union_all(rest)
    reach = 2.0 * PRECISION
    links = shapely.get_parts(joined.difference(one.buffer(reach)).difference(other.buffer(reach)))
    between = [link for link in links if link.dwithin(one, 2.0 * reach) and link.dwithin(other, 2.0 * reach)]
    place = min(between, key=lambda link: link.area) if between else shapely.shortest_line(one, other)
    x, y = place.centroid.coords[0]
    return passes, (x, y)


def _around(level: Level, walls: BaseGeometry, width: float, part: BaseGeometry) -> BaseGeometry:
    """Return the ground that a body `width` wide can reach from `part`, which a wider body can reach."""
    return shapely.union_all([piece for piece in _reachable(level, walls, width) if piece.intersects(part)])


def _reachable(level: Level, walls: BaseGeometry, width: float) -> list[BaseGeometry]:
    """Return the connected parts of a level in which the centre of a body `width` wide can be."""
    free = level.polygon.difference(walls.buffer(0.5 * width))
    return [part for part in shapely.get_parts(free) if part.geom_type == "Polygon"]


def _note(what: str, level: str, way: Portal | Exit, width: float) -> Finding:
    x, y = way.segments.reshape(-1, 2).mean(axis=0).tolist()
    text = f"{what} is only {way.width:.2f} m wide, less than the widest person ({width:.2f} m): widen it"
    return Finding("warning", text, level, (x, y))
