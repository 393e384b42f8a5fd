"""People in closing links: whose body is on the line when a link closes is let through, and leaves the line.

For them the link is open until their body has left its line (`Crowd.passing`). They go through it if the way of their
route did so, also if others push them back first; otherwise they leave it to the side on which they are.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change
from evac.base.errors import counted
from evac.building.model.building import Building
from evac.directions.fields import Fields
from evac.physics.extent import extent
from evac.physics.state import Crowd

#: Distance from a door of one direction at which people before it are let through [m]: more than they walk in a tick.
REACH = 0.5

#: Greatest number of people whom a warning names.
MOST_NAMED = 20


def begin_to_leave(building: Building, fields: Fields, crowd: Crowd, links: Iterable[int]) -> list[int]:
    """Mark the people whose bodies are on the lines of links that close."""
    found: list[int] = []
    for link in sorted(links):
        levels, segments = line_of(building, link)
        _release(crowd, link)
        there = np.flatnonzero(np.isin(crowd.level, levels) & ~crowd.ahead.any(axis=1))
        nearest, distance, outward = _nearest_points(segments, crowd.position[there])
        is_on = distance < extent(crowd, there, *outward.T)
        rows, nearest, outward = there[is_on].astype(np.int32), nearest[is_on], outward[is_on]
        here, on_line = (
            fields.travel_time_at(crowd.level[rows], place, crowd.route[rows], crowd.contact_radius[rows])
            for place in (crowd.position[rows], nearest)
        )
        is_first = crowd.level[rows] == levels[0]
        if link >= building.n_links:  # a door between rooms of one level: the side is that of the position
            is_first = _side_of(crowd.position[rows], nearest, outward) == 0
        sense = np.where(is_first == (on_line < here), 1.0, -1.0)
        crowd.passing[rows] = link
        crowd.ahead[rows] = sense[:, None] * outward
        _aim(crowd, rows, segments)
        found += rows.tolist()
    return sorted(found)


def turn_round(building: Building, crowd: Crowd, links: Mapping[int, int]) -> None:
    """Let people leave the lines of links that get one direction, to their side, if they are behind these."""
    for link, origin in links.items():
        levels, segments = line_of(building, link)
        _release(crowd, link)
        rows = np.flatnonzero(np.isin(crowd.level, levels) & ~crowd.ahead.any(axis=1)).astype(np.int32)
        nearest, distance, outward = _nearest_points(segments, crowd.position[rows])
        is_door = link >= building.n_links
        where = _side_of(crowd.position[rows], nearest, outward) if is_door else crowd.level[rows]
        is_on = (distance < extent(crowd, rows, *outward.T)) & (where != origin)
        crowd.passing[rows[is_on]] = link
        crowd.ahead[rows[is_on]] = outward[is_on] * (1.0 if origin == (0 if is_door else levels[0]) else -1.0)
        _aim(crowd, rows[is_on], segments)


def let_pass(building: Building, crowd: Crowd) -> None:
    """Let people through doors of one direction who are before them, without directing them."""
    for link, side in sorted(building.directed.items()):
        if link >= building.n_links:
            levels, segments = line_of(building, link)
            rows = np.flatnonzero((crowd.level == levels[0]) & (crowd.passing < 0)).astype(np.int32)
            nearest, distance, outward = _nearest_points(segments, crowd.position[rows])
            is_before = _side_of(crowd.position[rows], nearest, outward) == side
            crowd.passing[rows[is_before & (distance < extent(crowd, rows, *outward.T) + REACH)]] = link


def clear_doorways(building: Building, crowd: Crowd) -> set[int]:
    """Direct the people whom links let through, and release those who have left the line; return the links in use."""
    used = set()
    for link in np.unique(crowd.passing[crowd.passing >= 0]).tolist():
        _, segments = line_of(building, link)
        rows = np.flatnonzero(crowd.passing == link).astype(np.int32)
        nearest, distance, outward = _nearest_points(segments, crowd.position[rows])
        is_before = np.einsum("ij,ij->i", crowd.ahead[rows], nearest - crowd.position[rows]) > 0.0
        goes_on = (crowd.level[rows] >= 0) & (is_before | (distance < extent(crowd, rows, *outward.T)))
        crowd.passing[rows[~goes_on]], crowd.ahead[rows[~goes_on]] = -1, 0.0
        if goes_on.any():
            used.add(link)
            _aim(crowd, rows[goes_on & crowd.ahead[rows].any(axis=1)], segments)
    return used


def doorway_warning(change: Change) -> str:
    """Return a warning that names the people who stood on the lines of links when they closed."""
    people = change.values["let_through"]
    names = ", ".join(map(str, people[:MOST_NAMED])) + (", ..." if len(people) > MOST_NAMED else "")
    return f"{change}: {counted(len(people), 'person', 'people')} on its line let through: {names}"


def line_of(building: Building, link: int) -> tuple[tuple[int, ...], FloatArray]:
    """Return the levels of a link and its segments (s, 4) [m], with the inside of the first level on their left."""
    if link < len(building.portals):
        return building.portals[link].levels, building.portals[link].segments
    if link >= building.n_links:
        door = building.doors[link - building.n_links]
        return (door.level,), door.segment.reshape(1, 4)
    way_out = building.exits[link - len(building.portals)]
    return (way_out.level,), way_out.segments


def _release(crowd: Crowd, link: int) -> None:
    """Take back that a link lets people through whom it does not direct."""
    crowd.passing[(crowd.passing == link) & ~crowd.ahead.any(axis=1)] = -1


def _side_of(position: FloatArray, nearest: FloatArray, outward: FloatArray) -> IntArray:
    """Return the sides (n,) of a line on which positions (n, 2) are: 0 for the inside of the first level, else 1."""
    sides: IntArray = (np.einsum("ij,ij->i", position - nearest, outward) >= 0.0).astype(np.int32)
    return sides


def _aim(crowd: Crowd, rows: IntArray, segments: FloatArray) -> None:
    """Turn people on a line towards a place behind it, on the side to which they are going."""
    position, radius = crowd.position[rows], crowd.contact_radius[rows]
    _, _, outward = _nearest_points(segments, position)
    sense = np.where(np.einsum("ij,ij->i", crowd.ahead[rows], outward) < 0.0, -1.0, 1.0)
    free, _, _ = _nearest_points(segments, position, radius)
    towards = free + (2.0 * radius * sense)[:, None] * outward - position
    crowd.ahead[rows] = towards / np.hypot(*towards.T)[:, None]


def _nearest_points(
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
