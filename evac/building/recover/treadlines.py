"""Stairs that are drawn in plan: treads as parallel lines, and the arrow that points upwards."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.geometry.components import connected_components
from evac.building.recover.linework import ahead

#: Spacing of treads, their length, and how far their middles are beside each other at most [m].
GOING, WIDTH, BESIDE = (0.2, 0.42), (0.7, 4.0), 0.15
#: Least number of lines of a flight, and the share by which their spacings may differ.
LEAST_LINES, REGULAR = 5, 0.12
#: Longest line of an arrowhead, and greatest distance of its lines from the tip [m].
HEAD, TIP = 0.6, 0.05
#: Widest gap between the two flights of a U-shaped stair [m].
BETWEEN = 0.6


@dataclass(frozen=True)
class DrawnFlight:
    """A flight: its first and its last line (2, 2) [m], their number, and whether an arrow says which is which."""

    foot: FloatArray
    head: FloatArray
    lines: int
    is_directed: bool

    @property
    def way(self) -> FloatArray:
        """The vector (2,) from its foot to its head [m]."""
        way: FloatArray = (self.head - self.foot).mean(axis=0)
        return way

    def turned(self) -> "DrawnFlight":
        """Return the flight that ascends the other way."""
        return replace(self, foot=self.head, head=self.foot)


def flights_of(lines: Sequence[BaseGeometry]) -> list[DrawnFlight]:
    """Return the flights in a drawing: rows of parallel lines of equal length at the spacing of treads.

    Parameters
    ----------
    lines : sequence of LineString of two points [m]
    """
    ends = shapely.get_coordinates([*lines]).reshape(-1, 4)
    ends = np.unique(np.round(np.sort(ends.view("f8,f8"), axis=1).view(np.float64), 2), axis=0)
    step = ends[:, 2:] - ends[:, :2]
    length = np.hypot(*step.T)
    is_tread = (length > WIDTH[0]) & (length < WIDTH[1])
    treads, way, wide = ends[is_tread], step[is_tread] / length[is_tread, None], length[is_tread]
    middle = (treads[:, :2] + treads[:, 2:]) / 2
    near = shapely.STRtree(shapely.points(middle)).query(shapely.points(middle), "dwithin", distance=2.0 * GOING[1])
    one, other = near[:, near[0] < near[1]]
    off = middle[other] - middle[one]
    apart = np.abs(way[one, 0] * off[:, 1] - way[one, 1] * off[:, 0])
    is_next = (np.abs((way[one] * way[other]).sum(axis=1)) > 0.999) & (np.abs((way[one] * off).sum(axis=1)) < BESIDE)
    is_next &= (apart > GOING[0]) & (apart < GOING[1]) & (np.abs(wide[one] - wide[other]) < 0.1 * wide[one])
    group = connected_components(len(treads), np.column_stack([one, other])[is_next])
    found = []
    for index in np.flatnonzero(np.bincount(group, minlength=1) >= LEAST_LINES).tolist():
        own = np.flatnonzero(group == index)
        along = way[own[0]] * np.sign(way[own] @ way[own[0]])[:, None].mean()
        across = np.array([-along[1], along[0]])
        place = np.sort(middle[own] @ across)
        place = place[np.append(True, np.diff(place) > GOING[0] / 2)]
        spacing = np.diff(place)
        if len(place) < LEAST_LINES or np.ptp(spacing) > 2.0 * REGULAR * spacing.mean():
            continue
        half, at = float(np.median(wide[own])) / 2, float(np.median(middle[own] @ along))
        foot, head = (
            np.round(np.stack([(at + side * half) * along + far * across for side in (-1, 1)]), 3)
            for far in place[[0, -1]].tolist()
        )
        arrow = _arrow(foot, head, ends)
        found.append(DrawnFlight(*((head, foot) if arrow < 0 else (foot, head)), len(place), arrow != 0))
    return found


def stairs_of(flights: Sequence[DrawnFlight], walls: Sequence[BaseGeometry]) -> list[dict[str, Any]]:
    """Return drawn stairs as arguments of `evac.building.plan.plan.Plan.stair`: two flights side by side are one.

    Parameters
    ----------
    flights : sequence of DrawnFlight
    walls : sequence of LineString [m]
        Its half landing is at the end of two flights that is nearer to a wall, unless an arrow says where.
    """
    left, found = [*flights], list[dict[str, Any]]()
    tree = shapely.STRtree([*walls])
    while left:
        one = left.pop(0)
        beside = next((other for other in left if _are_beside(one, other)), None)
        if beside is None:
            found.append({"lower_edge": one.foot, "upper_edge": one.head})
            continue
        left.remove(beside)
        first, second = (beside, one) if one.is_directed and not beside.is_directed else (one, beside)
        if first.way @ second.way > 0.0:
            first, second = (first, second.turned()) if not second.is_directed else (first.turned(), second)
        far = [_room_ahead(first, second, tree), _room_ahead(first.turned(), second.turned(), tree)]
        if not (first.is_directed or second.is_directed) and far[1] < far[0]:
            first, second = first.turned(), second.turned()
            far.reverse()
        way = first.way
        stair = {"lower_edge": first.foot, "upper_edge": second.head, "length": round(float(np.hypot(*way)), 3)}
        stair["direction"] = np.round(way / np.hypot(*way), 4)
        found.append(stair | ({"landing": round(far[0], 2)} if far[0] < WIDTH[1] else {}))
    return found


def _are_beside(one: DrawnFlight, other: DrawnFlight) -> bool:
    """Return whether two flights are those of a U-shaped stair."""
    hulls = [shapely.convex_hull(shapely.MultiPoint([*flight.foot, *flight.head])) for flight in (one, other)]
    length = [float(np.hypot(*flight.way)) for flight in (one, other)]
    off = (other.foot + other.head - one.foot - one.head).mean(axis=0) / 2
    is_along = abs(float(one.way @ other.way)) > 0.99 * length[0] * length[1]
    is_level = abs(float(off @ one.way)) < 0.5 * length[0] * min(length)
    return is_along and is_level and hulls[0].distance(hulls[1]) < BETWEEN and min(length) > 0.5 * max(length)


def _room_ahead(first: DrawnFlight, second: DrawnFlight, walls: shapely.STRtree) -> float:
    """Return how far the next wall is from the end of a first flight, ahead of it [m]; infinite if it is far away."""
    way = first.way / np.hypot(*first.way)
    ends = np.concatenate([first.head, second.foot])
    middle = ends.mean(axis=0)
    start = middle + (((ends - middle) @ way).max() + TIP) * way
    far = ahead(walls.geometries, walls, start, way, WIDTH[1])
    return math.inf if far is None else TIP + far


def _arrow(foot: FloatArray, head: FloatArray, ends: FloatArray) -> int:
    """Return 1 for an arrow that points from the foot of a flight to its head, -1 for one that points back."""
    run = (head - foot).mean(axis=0)
    body = shapely.convex_hull(shapely.MultiPoint([*foot, *head]))
    lines = shapely.linestrings(ends.reshape(-1, 2, 2))
    is_near = shapely.dwithin(lines, body, HEAD)
    ends, lines = ends[is_near], lines[is_near]
    step = ends[:, 2:] - ends[:, :2]
    length = np.hypot(*step.T)
    inside = shapely.length(shapely.intersection(lines, body))
    is_shaft = (np.abs(step @ run) > 0.95 * length * np.hypot(*run)) & (inside > 0.4 * np.hypot(*run))
    is_shaft &= (
        shapely.distance(shapely.boundary(body), shapely.line_interpolate_point(lines, 0.5, normalized=True)) > TIP
    )
    short = ends[length < HEAD]
    for shaft in ends[is_shaft]:
        for tip, tail in ((shaft[:2], shaft[2:]), (shaft[2:], shaft[:2])):
            barbs = 0
            for near, far in ((short[:, :2], short[:, 2:]), (short[:, 2:], short[:, :2])):
                is_at = np.hypot(*(near - tip).T) < TIP
                barbs += int((is_at & ((far - near) @ (tail - tip) > 0.0)).sum())
            if barbs >= 2:
                return 1 if (tip - tail) @ run > 0.0 else -1
    return 0
