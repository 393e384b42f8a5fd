"""Neighbour lists: bodies and walls that a body can touch until the lists are rebuilt.

The lists contain everything within the reach of a body plus a skin. They are rebuilt when a body has moved by half
the skin or has changed its level. Kernels select entries by current distances, so results do not depend on when the
lists were built.
"""

from evac.jit import inner
from evac.physics.cells import fill_cells
from evac.physics.status import OK, PAIRS_FULL, WALLS_FULL


@inner
def lists_are_stale(bodies, lists):
    """Return whether the lists must be rebuilt before they are used."""
    if lists.stale:
        return True
    limit = (0.5 * lists.skin) ** 2
    for i in range(bodies.inside):
        dx = bodies.position[i, 0] - bodies.built_position[i, 0]
        dy = bodies.position[i, 1] - bodies.built_position[i, 1]
        if dx * dx + dy * dy > limit and bodies.level[i] >= 0:
            return True
    return False


@inner
def segment_distance(x1, y1, x2, y2, px, py):
    """Return the distance of p from a segment [m], and the nearest point."""
    dx = x2 - x1
    dy = y2 - y1
    length2 = dx * dx + dy * dy
    share = 0.0
    if length2 > 0.0:
        share = min(max(((px - x1) * dx + (py - y1) * dy) / length2, 0.0), 1.0)
    nx = x1 + share * dx
    ny = y1 + share * dy
    return ((px - nx) ** 2 + (py - ny) ** 2) ** 0.5, nx, ny


@inner
def build_lists(world, bodies, lists):
    """Build the lists of bodies and walls; return OK, PAIRS_FULL or WALLS_FULL."""
    status = _build_pairs(world, bodies, lists)
    if status == OK:
        status = _build_walls(world, bodies, lists)
    if status != OK:
        return status
    _flag_links(world, bodies, lists)
    for i in range(bodies.inside):
        bodies.built_position[i, 0] = bodies.position[i, 0]
        bodies.built_position[i, 1] = bodies.position[i, 1]
    lists.stale = 0
    return OK


@inner
def _build_pairs(world, bodies, lists):
    n = bodies.inside
    greatest = 0.0
    inside = 0
    for i in range(n):
        if bodies.level[i] >= 0:
            inside += 1
            greatest = max(greatest, bodies.radius[i])
    lists.pair_start[0] = 0
    if inside == 0:
        for i in range(n):
            lists.pair_start[i + 1] = 0
        return OK
    span = lists.pair_reach + lists.skin
    size = 2.0 * greatest + span
    nx, ny = fill_cells(n, bodies.position, bodies.level, size, lists.cell_start, lists.cell_of, lists.cell_body)
    capacity = lists.pair_body.shape[0]
    used = 0
    for i in range(n):
        first = used
        cell = lists.cell_of[i]
        if cell >= 0:
            level = bodies.level[i]
            x, y, r = bodies.position[i, 0], bodies.position[i, 1], bodies.radius[i] + span
            column = cell // ny
            row = cell - column * ny
            for cx in range(max(column - 1, 0), min(column + 2, nx)):
                low = cx * ny + max(row - 1, 0)
                high = cx * ny + min(row + 2, ny)
                for slot in range(lists.cell_start[low], lists.cell_start[high]):
                    j = lists.cell_body[slot]
                    if j <= i:
                        continue
                    dx = bodies.position[j, 0] - x
                    dy = bodies.position[j, 1] - y
                    limit = r + bodies.radius[j]
                    if dx * dx + dy * dy < limit * limit and world.linked[level, bodies.level[j]]:
                        if used == capacity:
                            return PAIRS_FULL
                        place = used
                        while place > first and lists.pair_body[place - 1] > j:
                            lists.pair_body[place] = lists.pair_body[place - 1]
                            place -= 1
                        lists.pair_body[place] = j
                        used += 1
        lists.pair_start[i + 1] = used
    return OK


@inner
def _build_walls(world, bodies, lists):
    capacity = lists.wall_item.shape[0]
    span = lists.wall_reach + lists.skin
    nx, ny = world.buckets_x, world.buckets_y
    used = 0
    lists.wall_start[0] = 0
    for i in range(bodies.inside):
        level = bodies.level[i]
        if level >= 0:
            x, y, limit = bodies.position[i, 0], bodies.position[i, 1], bodies.radius[i] + span
            cx = int((x - world.bucket_x) // world.bucket_size)
            cy = int((y - world.bucket_y) // world.bucket_size)
            in_buckets = limit <= world.bucket_reach and 0 <= cx < nx and 0 <= cy < ny
            low, high = 0, world.wall.shape[0]
            if in_buckets:
                low, high = world.bucket_start[cx * ny + cy], world.bucket_start[cx * ny + cy + 1]
            for slot in range(low, high):
                w = world.bucket_wall[slot] if in_buckets else slot
                if world.linked[level, world.wall_level[w]] == 0:
                    continue
                x1, y1, x2, y2 = world.wall[w, 0], world.wall[w, 1], world.wall[w, 2], world.wall[w, 3]
                if min(x1, x2) - x > limit or x - max(x1, x2) > limit:
                    continue
                if min(y1, y2) - y > limit or y - max(y1, y2) > limit:
                    continue
                if segment_distance(x1, y1, x2, y2, x, y)[0] < limit:
                    if used == capacity:
                        return WALLS_FULL
                    lists.wall_item[used] = w
                    used += 1
        lists.wall_start[i + 1] = used
    return OK


@inner
def _flag_links(world, bodies, lists):
    """Mark the bodies that can reach a portal or exit before the lists are rebuilt."""
    limit = 1.5 * lists.skin
    for i in range(bodies.inside):
        level = bodies.level[i]
        near = 0
        if level >= 0:
            x, y = bodies.position[i, 0], bodies.position[i, 1]
            for s in range(world.link_start[level], world.link_start[level + 1]):
                x1, y1 = world.link_segment[s, 0], world.link_segment[s, 1]
                x2, y2 = world.link_segment[s, 2], world.link_segment[s, 3]
                if min(x1, x2) - x > limit or x - max(x1, x2) > limit:
                    continue
                if min(y1, y2) - y > limit or y - max(y1, y2) > limit:
                    continue
                near = 1
                break
        bodies.near_link[i] = near
