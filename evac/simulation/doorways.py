"""People who may pass links that are not open for everybody: closing, one-way and controlled links.

People whose body is on the line of a link when it closes are let through: for them it is open until their body has left
the line (`Crowd.passing`). They go through it if the way of their route did so, also if others push them back first;
otherwise they leave it to the side on which they are.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Control
from evac.base.saved import Saved
from evac.building.model.building import Building, Door, Exit, Link
from evac.directions.fields import Fields
from evac.physics.extent import extent
from evac.physics.state import Crowd

#: Distance from a door at which people before it are let through [m]: more than they walk in a tick.
REACH = 0.5

#: Times that differ by less are the same [s].
ROUNDING = 1e-9


class Controls(Saved):
    """Lets people through controlled links, one after the other, so many, or while their leaves are open.

    Who has come before a link, and whose way leads through it, is admitted if there is room, the nearest first. Where
    one person passes in a given time, the next one is admitted when it cannot reach the line before.
    """

    saved = ("_admitted", "_side", "_passed", "_next", "_opens", "_asked")

    def __init__(self, people: int, links: int) -> None:
        self._admitted: IntArray = np.full(people, -1, np.int32)  # the link to which each person is admitted
        self._side: IntArray = np.zeros(people, np.int32)  # where it comes from: 0 for the first level or the inside
        self._passed: IntArray = np.zeros(links, np.int32)  # people who have passed each link
        self._next = np.zeros(links)  # time from which the next one may pass [s]
        self._opens = np.full(links, np.inf)  # time at which the leaf opens [s]
        self._asked = np.zeros(links)  # last time at which somebody was before it [s]

    def reset(self, links: Iterable[int]) -> None:
        """Begin anew at links that are closed or opened, or get another control."""
        rows = np.array([*links], np.int32)
        self._passed[rows], self._next[rows], self._opens[rows] = 0, 0.0, np.inf
        self._admitted[np.isin(self._admitted, rows)] = -1

    def is_waiting(self, time: float) -> bool:
        """Return whether a link lets somebody through later only because of its control."""
        return bool((self._next > time).any() or ((self._opens > time) & np.isfinite(self._opens)).any())

    def act(self, time: float, building: Building, fields: Fields, crowd: Crowd) -> list[int]:
        """Admit people at the beginning of a tick; return the links that enough have passed."""
        full = list[int]()
        if not building.controlled:
            return full
        approaches = {link: _approach(link, building, fields, crowd, time) for link in building.controlled}
        least = np.full(len(crowd.level), np.inf)
        for rows, gap, _ in approaches.values():
            least[rows] = np.minimum(least[rows], gap)
        for link, control in building.controlled.items():
            way = building.links[link]
            self._count(link, control, crowd, way, time)
            if control.most is not None and self._passed[link] >= control.most:
                full.append(link)
                continue
            rows, gap, on_line = approaches[link]
            # Of links side by side, the nearest one alone lets a person through.
            is_free = np.isin(crowd.passing, (-1, link)) & np.isin(self._admitted, (-1, link))
            before, on_line = rows[is_free[rows] & (gap <= least[rows])], on_line[is_free[on_line]]
            own = np.flatnonzero(self._admitted == link)
            self._admitted[np.setdiff1d(own, on_line)] = -1  # others may be nearer now
            self._move_leaf(link, control, len(before), len(on_line), time)
            admitted = int(np.count_nonzero(self._admitted == link))
            room = len(before) if control.most is None else control.most - int(self._passed[link]) - admitted
            if control.every is not None:
                room = min(room, 1 - admitted)
            is_open = time >= self._opens[link] - ROUNDING
            new = before[self._admitted[before] < 0][: max(room, 0) if is_open else 0]
            off = nearest_points(way.segments, crowd.position[new])[1]
            new = new[_free_paths(crowd, new, self._next[link] - time) <= off]
            self._admitted[new], self._side[new] = link, _sides_at(way, crowd, new)
            rows = np.flatnonzero((self._admitted == link) & (crowd.passing < 0))
            crowd.passing[rows] = link
        return full

    def _move_leaf(self, link: int, control: Control, before: int, on_line: int, time: float) -> None:
        """Open the leaf of a link some time after somebody has come before it, and close it behind the last one."""
        if before:
            self._opens[link] = min(self._opens[link], time + (control.delay or 0.0))
        if before or on_line:
            self._asked[link] = time
        elif control.hold is not None and time >= self._asked[link] + control.hold - ROUNDING:
            self._opens[link] = np.inf

    def _count(self, link: int, control: Control, crowd: Crowd, way: Link, time: float) -> None:
        """Count those who have passed a link since they were admitted to it, and forget those who are elsewhere."""
        rows = np.flatnonzero(self._admitted == link)
        side = _sides_at(way, crowd, rows)
        through = rows[(side >= 0) & (side != self._side[rows])]
        self._passed[link] += len(through)
        if len(through) and control.every is not None:
            self._next[link] = np.fmin(crowd.exit_time[through], time).max() + control.every
        self._admitted[rows[side != self._side[rows]]] = -1


def _approach(
    link: int, building: Building, fields: Fields, crowd: Crowd, time: float
) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.intp]]:
    """Return who goes through a link, the nearest first, how far bodies are [m], and whose bodies are on its line."""
    way = building.links[link]
    rows = np.flatnonzero(np.isin(crowd.level, way.levels) & (crowd.start_time <= time))
    nearest, distance, outward = nearest_points(way.segments, crowd.position[rows])
    gap = distance - extent(crowd, rows, *outward.T)
    near = np.flatnonzero(gap < REACH)
    rows, nearest, gap = rows[near], nearest[near], gap[near]
    here, on_line = (
        fields.travel_time_at(crowd.level[rows], place, crowd.route[rows], crowd.contact_radius[rows])
        for place in (crowd.position[rows], nearest)
    )
    goes = on_line < here
    if link in building.directed:
        origin = building.directed[link]
        goes &= (_sides_at(way, crowd, rows) if isinstance(way, Door) else crowd.level[rows]) == origin
    _, room, _ = nearest_points(way.segments, crowd.position[rows], crowd.contact_radius[rows])
    order = np.argsort(room, kind="stable")  # by the way to where there is room for the body
    order = order[goes[order]]
    return rows[order], gap[order], rows[gap < 0.0]


def _free_paths(crowd: Crowd, rows: NDArray[np.intp], seconds: float) -> FloatArray:
    """Return how far people can walk in a time at most, if nobody is in their way [m]."""
    span, tau, speed = max(seconds, 0.0), crowd.tau[rows], crowd.speed[rows].max(axis=1)
    now = np.hypot(*crowd.velocity[rows].T)
    paths: FloatArray = speed * span + (now - speed) * tau * -np.expm1(-span / tau)
    return paths


def _sides_at(way: Link, crowd: Crowd, rows: NDArray[np.intp]) -> IntArray:
    """Return on which side of a link people are: 0 for its first level, 1 behind it, -1 elsewhere."""
    level = crowd.level[rows]
    if isinstance(way, Door):
        nearest, _, outward = nearest_points(way.segments, crowd.position[rows])
        there, behind = level == way.level, _side_of(crowd.position[rows], nearest, outward) == 1
    elif isinstance(way, Exit):
        there, behind = (level == way.level) | (crowd.exit_used[rows] == way.index), level < 0
    else:
        there, behind = np.isin(level, way.levels), level == way.levels[1]
    return np.where(there, behind, -1).astype(np.int32)


def begin_to_leave(building: Building, fields: Fields, crowd: Crowd, links: Iterable[int]) -> list[int]:
    """Mark the people whose bodies are on the lines of links that close."""
    found: list[int] = []
    for link in sorted(links):
        levels, segments = building.links[link].levels, building.links[link].segments
        is_free = ~crowd.ahead.any(axis=1)
        if link in building.controlled:  # it has been open for some people only
            is_free &= crowd.passing == link
        elif link in building.lift_doors:  # for those who were not let in it has been closed already
            is_free &= (crowd.passing == link) | (crowd.level == building.lift_doors[link])
        _release(crowd, link)
        there = np.flatnonzero(np.isin(crowd.level, levels) & is_free)
        nearest, distance, outward = nearest_points(segments, crowd.position[there])
        is_on = distance < extent(crowd, there, *outward.T)
        rows, nearest, outward = there[is_on].astype(np.int32), nearest[is_on], outward[is_on]
        here, on_line = (
            fields.travel_time_at(crowd.level[rows], place, crowd.route[rows], crowd.contact_radius[rows])
            for place in (crowd.position[rows], nearest)
        )
        is_first = crowd.level[rows] == levels[0]
        first = levels[0]
        if len(levels) == 1:  # the side is that of the position
            is_first, first = _side_of(crowd.position[rows], nearest, outward) == 0, 0
        goes_through = on_line < here
        if link in building.directed:  # nobody goes through against its direction
            goes_through &= is_first == (building.directed[link] == first)
        sense = np.where(is_first == goes_through, 1.0, -1.0)
        crowd.passing[rows] = link
        crowd.ahead[rows] = sense[:, None] * outward
        _aim(crowd, rows, segments)
        found += rows.tolist()
    return sorted(found)


def turn_round(building: Building, crowd: Crowd, links: Mapping[int, int]) -> None:
    """Let people leave the lines of links that get one direction, to their side, if they are behind these."""
    for link, origin in links.items():
        levels, segments = building.links[link].levels, building.links[link].segments
        was_let = crowd.passing == link  # also who was turned round by the other direction
        crowd.passing[was_let], crowd.ahead[was_let] = -1, 0.0
        rows = np.flatnonzero(np.isin(crowd.level, levels) & ~crowd.ahead.any(axis=1)).astype(np.int32)
        nearest, distance, outward = nearest_points(segments, crowd.position[rows])
        is_door = len(levels) == 1
        where = _side_of(crowd.position[rows], nearest, outward) if is_door else crowd.level[rows]
        is_on = (distance < extent(crowd, rows, *outward.T)) & (where != origin)
        crowd.passing[rows[is_on]] = link
        crowd.ahead[rows[is_on]] = outward[is_on] * (1.0 if origin == (0 if is_door else levels[0]) else -1.0)
        _aim(crowd, rows[is_on], segments)


def let_pass(building: Building, crowd: Crowd) -> None:
    """Let people through doors of one direction who are before them, without directing them."""
    for link, side in sorted(building.directed.items()):
        if len(building.links[link].levels) == 1 and link not in building.controlled:
            levels, segments = building.links[link].levels, building.links[link].segments
            rows = np.flatnonzero((crowd.level == levels[0]) & (crowd.passing < 0)).astype(np.int32)
            nearest, distance, outward = nearest_points(segments, crowd.position[rows])
            is_before = _side_of(crowd.position[rows], nearest, outward) == side
            crowd.passing[rows[is_before & (distance < extent(crowd, rows, *outward.T) + REACH)]] = link


def clear_doorways(building: Building, crowd: Crowd) -> set[int]:
    """Direct the people whom links let through, and release those who have left the line; return the links in use."""
    used = set()
    for link in np.unique(crowd.passing[crowd.passing >= 0]).tolist():
        segments = building.links[link].segments
        rows = np.flatnonzero(crowd.passing == link).astype(np.int32)
        nearest, distance, outward = nearest_points(segments, crowd.position[rows])
        is_before = np.einsum("ij,ij->i", crowd.ahead[rows], nearest - crowd.position[rows]) > 0.0
        goes_on = (crowd.level[rows] >= 0) & (is_before | (distance < extent(crowd, rows, *outward.T)))
        crowd.passing[rows[~goes_on]], crowd.ahead[rows[~goes_on]] = -1, 0.0
        if goes_on.any():
            used.add(link)
            _aim(crowd, rows[goes_on & crowd.ahead[rows].any(axis=1)], segments)
    return used


def _release(crowd: Crowd, link: int) -> None:
    """Withdraw the permission to pass a link from people who are not directed through it."""
    crowd.passing[(crowd.passing == link) & ~crowd.ahead.any(axis=1)] = -1


def _side_of(position: FloatArray, nearest: FloatArray, outward: FloatArray) -> IntArray:
    """Return the sides (n,) of a line on which positions (n, 2) are: 0 for the inside of the first level, else 1."""
    sides: IntArray = (np.einsum("ij,ij->i", position - nearest, outward) >= 0.0).astype(np.int32)
    return sides


def _aim(crowd: Crowd, rows: IntArray, segments: FloatArray) -> None:
    """Turn people on a line towards a place behind it, on the side to which they are going."""
    position, radius = crowd.position[rows], crowd.contact_radius[rows]
    _, _, outward = nearest_points(segments, position)
    sense = np.where(np.einsum("ij,ij->i", crowd.ahead[rows], outward) < 0.0, -1.0, 1.0)
    free, _, _ = nearest_points(segments, position, radius)
    towards = free + (2.0 * radius * sense)[:, None] * outward - position
    crowd.ahead[rows] = towards / np.hypot(*towards.T)[:, None]


def nearest_points(
    segments: FloatArray, points: FloatArray, off_ends: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the nearest point of a line to each of (n, 2), its distance, and the unit normal out of the first level.

    `off_ends` is the distance that is kept from the ends of segments, at most half of their length; all in metres.
    """
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length = np.hypot(*along.T)
    share = np.einsum("nsj,sj->ns", points[:, None] - start, along) / length**2
    off = np.minimum(np.reshape(off_ends, (-1, 1)) / length, 0.5)
    nearest = start + np.clip(share, off, 1.0 - off)[:, :, None] * along
    distance = np.linalg.norm(points[:, None] - nearest, axis=2)
    best = np.arange(len(points)), distance.argmin(axis=1)
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    return nearest[best], distance[best], outward[best[1]]
