"""Packing of a building and its fields to the `World` that kernels read."""

import math
from typing import Any

import numpy as np
import shapely

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building
from evac.directions.fields import Fields
from evac.jit import Bytes
from evac.physics.state import World

#: Distance around each bucket within which walls are listed; the usual maximum reach of neighbour lists [m].
BUCKET_REACH = 1.0
BUCKET_SIZE = 0.5

ROUNDING = 1e-6  #: Walls at most this far behind an exit are beside it [m].


def make_world(building: Building, fields: Fields) -> World:
    """Pack a building and its fields."""
    count = len(building.levels)
    segment, start, to, link = _links(building)
    # Every link is also a wall, which is absent while the link is open: closed doors are walls.
    link_level = np.repeat(np.arange(count), np.diff(start))
    doors = np.concatenate([np.zeros((0, 4)), *(door.segments for door in building.doors)])
    door_level = np.array([door.level for door in building.doors], dtype=np.int32)
    walls = np.concatenate([building.walls.reshape(-1, 4), doors, segment])
    links = building.n_links + len(building.doors)  # without rides, which nobody crosses in plan
    link_open = np.ones(links, np.uint8)
    link_open[list(building.shut)], link_open[[*building.controlled, *building.directed]] = 0, 2
    link_from = np.full(links, -1, np.int32)
    for number, origin in building.directed.items():
        if len(building.links[number].levels) == 2 and number not in building.controlled:
            link_from[number] = origin
    wall_level = np.concatenate([building.wall_level, door_level, link_level]).astype(np.int32)
    # Only people on levels at most two portals apart can touch each other.
    neighbours = np.eye(len(building.levels), dtype=np.float32)  # products of floats take much less time
    for portal in building.portals:
        neighbours[portal.levels, portal.levels[::-1]] = 1
    linked = (neighbours @ neighbours > 0).astype(np.uint8)
    own, other = np.nonzero(linked)
    return World(
        wall=np.ascontiguousarray(walls, dtype=np.float64),
        wall_level=wall_level,
        wall_open=np.concatenate(
            [np.zeros(len(building.walls), np.uint8), link_open[building.n_links :], link_open[link]]
        ),
        **_buckets(walls, wall_level, count),
        link_segment=segment,
        link_start=start,
        link_to=to,
        link_id=link,
        link_open=link_open,
        link_from=link_from,
        doors=len(doors),
        uphill=np.array([level.climb for level in building.levels], dtype=np.float64).reshape(count, 2),
        cosine=np.cos([level.slope for level in building.levels]),
        carry=building.ground_velocity,
        backed=walls_behind_exits(building),
        linked=linked,
        linked_start=np.concatenate([[0], np.cumsum(linked.sum(axis=1, dtype=np.int32))]).astype(np.int32),
        linked_level=other[np.lexsort((other, other != own, own))].astype(np.int32),
        rounding=max(1e-12, 16.0 * np.finfo(float).eps * float(np.abs(fields.packed.origin).max())),
        fields=fields.packed,
    )


def set_open(world: World, link: int, state: int) -> None:
    """Open or close a portal, an exit or a door: a closed one is a wall on both sides."""
    world.link_open[link] = state
    first, links = len(world.wall) - len(world.link_segment), len(world.link_open) - world.doors
    walls = first + np.flatnonzero(world.link_id == link)
    if link >= links:
        walls = np.array([first - world.doors + link - links])
    world.wall_open[walls] = state


def _links(building: Building) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Return link segments sorted by level, the first one of each level, and their levels behind and link indices."""
    rows: list[tuple[int, int, int, tuple[float, ...]]] = []
    for portal in building.portals:
        for level in portal.levels:
            for piece in portal.segments_from(level):
                rows.append((level, portal.other(level), portal.index, tuple(piece)))
    for way_out in building.exits:
        for piece in way_out.segments:
            rows.append((way_out.level, -1, building.link_of(way_out), tuple(piece)))
    rows.sort(key=lambda row: row[0])
    levels = np.array([row[0] for row in rows], dtype=np.int32)
    start = np.searchsorted(levels, np.arange(len(building.levels) + 1)).astype(np.int32)
    return (
        np.array([row[3] for row in rows], dtype=np.float64).reshape(-1, 4),
        start,
        np.array([row[1] for row in rows], dtype=np.int32),
        np.array([row[2] for row in rows], dtype=np.int32),
    )


def have_seams(backed: Bytes) -> bool:
    """Return whether bodies can touch across portals, or there are walls behind an exit; see `walls_behind_exits`."""
    return len(backed) > 1 or bool(backed.any())


def walls_behind_exits(building: Building) -> Bytes:
    """Mark the levels with walls within `BUCKET_REACH` behind one of their exits, such as those of a balcony."""
    backed = np.zeros(len(building.levels), np.uint8)
    for way in building.exits:
        x1, y1, x2, y2 = way.segments.T
        out = BUCKET_REACH * np.stack([y2 - y1, x1 - x2], axis=1) / np.hypot(x2 - x1, y2 - y1)[:, None]
        start, end = way.segments[:, :2], way.segments[:, 2:]
        behind = shapely.polygons(np.stack([start, end, end + out, start + out], axis=1)).tolist()
        own = shapely.linestrings(building.walls[building.wall_level == way.level].reshape(-1, 2, 2))
        # The posts of an exit are beside it, not behind it.
        if shapely.intersects(shapely.union_all(behind).buffer(-ROUNDING), own).any():
            backed[way.level] = 1
    return backed


def _buckets(walls: FloatArray, level: IntArray, levels: int) -> dict[str, Any]:
    """Return the walls of each level in square buckets of the plan: those within `BUCKET_REACH` of each."""
    ends = walls.reshape(-1, 2) if len(walls) else np.zeros((1, 2))
    low, high = ends.min(axis=0) - BUCKET_REACH, ends.max(axis=0) + BUCKET_REACH
    size = max(BUCKET_SIZE, math.sqrt(np.prod(high - low) / 1e6))
    shape = np.ceil((high - low) / size).astype(int)
    centre = low + size * (np.indices(shape).reshape(2, -1).T + 0.5)
    lines, reach = shapely.linestrings(walls.reshape(-1, 2, 2)), BUCKET_REACH + size * math.sqrt(0.5)
    near, item = shapely.STRtree(lines).query(shapely.points(centre), predicate="dwithin", distance=reach)
    place, own = np.stack(np.unravel_index(near, shape), axis=1), level[item]
    corner, opposite = np.full((levels, 2), shape.max()), np.full((levels, 2), -1)
    np.minimum.at(corner, own, place)
    np.maximum.at(opposite, own, place)
    number = np.maximum(opposite - corner + 1, 0)
    last = np.cumsum(number.prod(axis=1) + 1) - 1
    first = last - number.prod(axis=1)
    column, row = (place - corner[own]).T
    bucket = np.concatenate([first[own] + column * number[own, 1] + row, last[level]])
    item = np.concatenate([item, np.arange(len(walls))])
    order = np.lexsort((item, bucket))
    return {
        "bucket_wall": item[order].astype(np.int32),
        "bucket_start": np.searchsorted(bucket[order], np.arange(last[-1] + 2)).astype(np.int32),
        "bucket_first": first.astype(np.int32),
        "bucket_column": corner[:, 0].astype(np.int32),
        "bucket_row": corner[:, 1].astype(np.int32),
        "bucket_columns": number[:, 0].astype(np.int32),
        "bucket_rows": number[:, 1].astype(np.int32),
        "bucket_x": float(low[0]),
        "bucket_y": float(low[1]),
        "bucket_size": size,
        "bucket_reach": BUCKET_REACH,
    }
