"""Places too narrow for a body: portals, exits, and constrictions inside a level."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray
from evac.base.errors import counted
from evac.building.geometry import connected_components, place_of, segment_lengths
from evac.building.model.building import Building, Level
from evac.building.model.findings import Finding, item_of

#: Minimum area of ground behind a gap that a body's centre can reach [m2]; smaller ground is a niche.
LEAST_PART = 0.05
#: Gaps narrower than this are errors of the drawing: closed walls, of which nobody is told [m].
CLOSED = 0.02
#: Points closer along an outline than this many widths, or closer than the rounding length [m], do not form a gap.
FAR_ALONG, ROUNDING = 5.0, 1e-7
#: Cosine of the greatest angle to a right one at which two directions count as perpendicular.
PARALLEL = 1e-3
#: Share of a segment that is left out at each end.
INNER = 1e-3
JOINED = 1e-6  #: Distance within which points and lines are on a wall, a portal or an exit [m].


def narrow_places(building: Building, widths: ArrayLike) -> tuple[Finding, ...]:
    """Return a warning for each link or gap within a level too narrow for some of the diameters (n,) [m]."""
    bodies = np.atleast_1d(np.asarray(widths, dtype=np.float64))
    widest = float(bodies.max())
    notes = []
    for portal in building.portals:
        if portal.width < widest:
            one, other = (building.levels[index].title for index in portal.levels)
            what = f"portal {portal.name!r} between {one!r} and {other!r} is"
            item = item_of(min((building.levels[index] for index in portal.levels), key=lambda level: not level.stair))
            notes.append(_note(what, portal.width, one, place_of(portal.segments), bodies, item))
    for way in building.exits:
        if way.width < widest:
            what, on = f"exit {way.name!r} is", building.levels[way.level].title
            notes.append(_note(what, way.width, on, place_of(way.segments), bodies, f"exits.{way.name}"))
    for level in building.levels:
        gaps = gaps_at(building, level, widest, float(bodies.min()))
        notes += [_note("a gap that is", width, level.title, place, bodies, item_of(level)) for width, place in gaps]
    return tuple(notes)


def gaps_at(
    building: Building, level: Level, width: float, least: float = 0.0
) -> list[tuple[float, tuple[float, float]]]:
    """Return the width [m] and plan position of gaps between walls of a level that are narrower than `width` [m].

    Of gaps that are closer to each other than `width`, the narrowest counts. Those narrower than `least` [m] are left
    out, except where the ground falls apart at them: there, the widest one between two parts of the ground counts.
    """
    segments = gaps_between_walls(building, level, width - JOINED)  # a body as wide as the gap passes
    if not len(segments):
        return []
    lines, across = shapely.linestrings(segments.reshape(-1, 2, 2)), segment_lengths(segments)
    pairs = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=width).T
    cluster = connected_components(len(lines), pairs)
    order = np.lexsort((across, cluster))
    narrowest = order[np.unique(cluster[order], return_index=True)[1]]
    told: list[int] = narrowest[across[narrowest] >= least].tolist()
    parts = shapely.get_parts(level.polygon.difference(shapely.union_all(lines).buffer(JOINED)))
    gap, part = shapely.STRtree(parts).query(lines, "dwithin", distance=2.0 * JOINED)
    has_room = shapely.area(shapely.buffer(parts, -0.5 * width)) > LEAST_PART
    joined = np.arange(len(parts))
    for row in np.argsort(-across, kind="stable").tolist():
        beside = np.unique(joined[part[gap == row]])
        is_new = not shapely.dwithin(lines[told], lines[row], width).any()
        if is_new and across[row] > CLOSED and has_room[beside].sum() > 1:
            told.append(row)
        has_room[beside] = has_room[beside].any()
        joined[np.isin(joined, beside)] = beside.min(initial=len(parts))
    return [(float(across[row]), place_of(segments[row])) for row in told]


def gaps_below(polygon: BaseGeometry, width: float = CLOSED) -> FloatArray:
    """Return segments (g, 4) across gaps narrower than `width` [m], by default of walls that fail to meet."""
    pairs = _pairs(polygon, width)
    return pairs.across(polygon, pairs.arcs(pairs.length).min(axis=1) > FAR_ALONG * width, pairs.ends)


def gaps_between_walls(building: Building, level: Level, width: float) -> FloatArray:
    """Return segments (g, 4) across the gaps between walls of a level that are narrower than `width` [m].

    A disc of this diameter does not pass any of them. A gap is measured where it is narrowest: moving either end along
    its wall makes the segment longer. Closed portals and exits are walls. The mouth of a niche does not count: of
    ground with a short outline that contains neither a portal nor an exit.

    `width` [m].
    """
    pairs = _pairs(level.polygon, width)
    if not len(pairs.ends):
        return np.zeros((0, 4))
    links = building.links_of(level.index)
    walls = [building.walls[building.wall_level == level.index]]
    walls += [link.segments for link in links if not building.is_open(link)]
    openings = [np.zeros((0, 4)), *(link.segments for link in links if building.is_open(link))]
    wall, opening = (shapely.multilinestrings(np.concatenate(some).reshape(-1, 2, 2)) for some in (walls, openings))
    shapely.prepare(wall)
    between = shapely.dwithin(wall, shapely.points(pairs.ends), JOINED).all(axis=1)
    gap = np.hypot(*(pairs.ends[:, 1] - pairs.ends[:, 0]).T)
    along = pairs.arcs(pairs.length)
    ground = shapely.buffer(opening, JOINED, cap_style="flat")
    shapely.prepare(ground)
    open_length = np.zeros(len(pairs.lines))
    beside = shapely.intersects(ground, pairs.lines)
    open_length[beside] = shapely.length(shapely.intersection(pairs.lines[beside], ground))
    opened = pairs.arcs(open_length)
    is_niche = (along <= FAR_ALONG * gap[:, None]) & (opened <= JOINED)
    chosen = between & ~is_niche.any(axis=1) & pairs.are_shortest(open_length <= JOINED)
    # Without the ends, which rounding may put beyond a slanted wall.
    inner = pairs.ends + INNER * (pairs.ends[:, ::-1] - pairs.ends)
    return pairs.across(level.polygon, chosen, inner)


@dataclass(frozen=True)
class _Pairs:
    """Corners of an outline, each with a side within some distance."""

    lines: NDArray[Any]  # (s,) linestrings: the sides of all rings
    ring: NDArray[np.int64]  # (s,) int64: ring of each side
    length: FloatArray  # (s,) float64: length of each side [m]
    corner: NDArray[np.int64]  # (m,): for each pair, the side that starts at the corner
    side: NDArray[np.int64]  # (m,): for each pair, the side near it
    ends: FloatArray  # (m, 2, 2) float64: the corner, and the point of the side nearest to it [m]

    def arcs(self, amount: FloatArray) -> FloatArray:
        """Return what lies along both ways (m, 2) from the corner to the nearest point; inf on different rings.

        `amount` (s,): the amount on each side, spread over its length.
        """
        before = np.cumsum(amount) - amount
        start = shapely.get_coordinates(shapely.get_point(self.lines[self.side], 0))
        share = np.hypot(*(self.ends[:, 1] - start).T) / self.length[self.side]
        one = np.abs(before[self.side] + share * amount[self.side] - before[self.corner])
        arcs = np.stack([one, np.bincount(self.ring, amount)[self.ring[self.corner]] - one], axis=1)
        arcs[self.ring[self.corner] != self.ring[self.side]] = np.inf
        return arcs

    def are_shortest(self, is_wall: BoolArray) -> BoolArray:
        """Return whether the segments (m,) become longer if an end moves along one of the sides (s,) that are walls."""
        sides = shapely.get_coordinates(self.lines).reshape(-1, 2, 2)
        along = (sides[:, 1] - sides[:, 0]) / self.length[:, None]
        last = np.append(np.flatnonzero(np.diff(self.ring)), len(self.ring) - 1)
        behind, ahead = np.arange(len(self.ring)) - 1, np.arange(len(self.ring)) + 1
        first = np.append(0, last[:-1] + 1)
        behind[first], ahead[last] = last, first
        step = self.ends[:, 1] - self.ends[:, 0]
        size = np.hypot(*step.T)

        def leads_away(corner: NDArray[np.int64], towards: FloatArray) -> BoolArray:
            onwards = is_wall[corner] & ((along[corner] * towards).sum(axis=1) > PARALLEL * size)
            back = is_wall[behind[corner]] & ((along[behind[corner]] * towards).sum(axis=1) < -PARALLEL * size)
            is_shortest: BoolArray = ~onwards & ~back
            return is_shortest

        share = np.hypot(*(self.ends[:, 1] - sides[self.side, 0]).T)
        is_shortest = leads_away(self.corner, step)
        for corner, distance in ((self.side, share), (ahead[self.side], self.length[self.side] - share)):
            is_shortest &= (distance > JOINED) | leads_away(corner, -step)
        return is_shortest

    def across(self, polygon: BaseGeometry, chosen: BoolArray, within: FloatArray) -> FloatArray:
        """Return the segments (g, 4) of chosen pairs, each once, whose parts `within` (m, 2, 2) are in the level."""
        across = chosen.copy()
        shapely.prepare(polygon)
        across[across] = shapely.contains(polygon, shapely.linestrings(within[across]))
        # The smaller end first, so that a gap between two corners is found once.
        segments: FloatArray = np.unique([sorted(pair) for pair in self.ends[across].tolist()], axis=0).reshape(-1, 4)
        return segments


def _pairs(polygon: BaseGeometry, width: float) -> _Pairs:
    """Return the corners of a level with the sides at most `width` [m] from each that they are not on."""
    sides, rings = [], []
    for index, ring in enumerate(shapely.get_rings(shapely.get_parts(polygon))):
        ends = shapely.get_coordinates(ring)
        sides.append(np.stack([ends[:-1], ends[1:]], axis=1))
        rings.append(np.full(len(ends) - 1, index))
    side = np.concatenate(sides)
    lines, corners = shapely.linestrings(side), shapely.points(side[:, 0])
    one, other = shapely.STRtree(lines).query(corners, predicate="dwithin", distance=width)
    ends = shapely.get_coordinates(shapely.shortest_line(corners[one], lines[other])).reshape(-1, 2, 2)
    apart = np.hypot(*(ends[:, 1] - ends[:, 0]).T) > ROUNDING
    return _Pairs(lines, np.concatenate(rings), shapely.length(lines), one[apart], other[apart], ends[apart])


def _note(what: str, width: float, level: str, place: tuple[float, float], bodies: FloatArray, item: str) -> Finding:
    wider = np.count_nonzero(bodies > width)
    people = f"{wider} of {counted(len(bodies), 'person', 'people')} wider than it (up to {bodies.max():.2f} m)"
    text = f"{what} only {width:.2f} m wide, a wall for {people}: widen it if they should pass"
    return Finding("warning", text, level, place, item)
