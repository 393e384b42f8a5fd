"""Neighbour lists: bodies and walls that a body can touch until the lists are rebuilt.

The lists contain everything within the reach of a body plus a skin. They are rebuilt when a body has moved by half
the skin or has changed its level. Kernels select entries by current distances, so results do not depend on when the
lists were built.
"""

from evac.jit import inner
from evac.physics.cells import fill_cells
from evac.physics.status import OK, PAIRS_FULL, WALLS_FULL


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
    n = bodies.inside
    sort_into_cells(bodies, lists)
    if list_pairs(world, bodies, lists, lists.pair_body, 0, n)[0] < 0:
        return PAIRS_FULL
    if list_walls(world, bodies, lists, lists.wall_item, 0, n) < 0:
        return WALLS_FULL
    lists.stale = 0
    return OK


@inner
def sort_into_cells(bodies, lists):
    """Sort the bodies into cells, and begin both lists."""
    n = bodies.inside
    greatest = 0.0
    inside = 0
    for i in range(n):
        if bodies.level[i] >= 0:
            inside += 1
            greatest = max(greatest, bodies.radius[i])
    lists.pair_start[0] = 0
    lists.wall_start[0] = 0
    if inside == 0:
        for i in range(n):
            lists.cell_of[i] = -1
        return
    size = 2.0 * greatest + lists.pair_reach + lists.skin
    nx, ny = fill_cells(n, bodies.position, bodies.level, size, lists.cell_start, lists.cell_of, lists.cell_body)
    lists.cells_x = nx
    lists.cells_y = ny


@inner
def list_pairs(world, bodies, lists, pair_body, low_body, high_body):
    """List the pairs of some bodies in `pair_body`; return their number, -1 if too many, and the room it takes."""
    span = lists.pair_reach + lists.skin
    nx, ny = lists.cells_x, lists.cells_y
    capacity = pair_body.shape[0]
    used, room = 0, 0
    for i in range(low_body, high_body):
        first = used
        cell = lists.cell_of[i]
        if cell >= 0:
            level = bodies.level[i]
            x, y, r = bodies.position[i, 0], bodies.position[i, 1], bodies.radius[i] + span
            column = cell // ny
            row = cell - column * ny
            for cx in range(max(column - 1, 0), min(column + 2, nx)):
                low = lists.cell_start[cx * ny + max(row - 1, 0)]
                high = lists.cell_start[cx * ny + min(row + 2, ny)]
                room = max(room, used + high - low)
                if room > capacity:
                    return -1, room
                for slot in range(low, high):
                    j = lists.cell_body[slot]
                    dx = bodies.position[j, 0] - x
                    dy = bodies.position[j, 1] - y
                    limit = r + bodies.radius[j]
                    is_linked = world.linked[level, bodies.level[j]] != 0
                    # Written in any case, and kept by counting it: no processor foresees a branch that depends on this.
                    pair_body[used] = j
                    used += (dx * dx + dy * dy < limit * limit) & (j > i) & is_linked
            _sort(pair_body, first, used)
        lists.pair_start[i + 1] = used
    return used, room


@inner
def _sort(numbers, first, last):
    """Sort a few numbers in place, by insertion."""
    for k in range(first + 1, last):
        number = numbers[k]
        place = k
        while place > first and numbers[place - 1] > number:
            numbers[place] = numbers[place - 1]
            place -= 1
        numbers[place] = number


@inner
def list_walls(world, bodies, lists, wall_item, first, last):
    """List the walls of some bodies in `wall_item`; return their number, -1 if too many.

    Note also where they are, and which can reach a portal or exit before the lists are built again.
    """
    capacity = wall_item.shape[0]
    span, near = lists.wall_reach + lists.skin, 1.5 * lists.skin
    nx, ny = world.buckets_x, world.buckets_y
    used = 0
    for i in range(first, last):
        level = bodies.level[i]
        bodies.near_link[i] = 0
        if level >= 0:
            x, y, limit = bodies.position[i, 0], bodies.position[i, 1], bodies.radius[i] + span
            across, along = (x - world.bucket_x) / world.bucket_size, (y - world.bucket_y) / world.bucket_size
            in_buckets = limit <= world.bucket_reach and 0.0 <= across < nx and 0.0 <= along < ny
            low, high = 0, world.wall.shape[0]
            if in_buckets:
                bucket = int(across) * ny + int(along)
                low, high = world.bucket_start[bucket], world.bucket_start[bucket + 1]
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
                        return -1
                    wall_item[used] = w
                    used += 1
            for s in range(world.link_start[level], world.link_start[level + 1]):
                x1, y1 = world.link_segment[s, 0], world.link_segment[s, 1]
                x2, y2 = world.link_segment[s, 2], world.link_segment[s, 3]
                if min(x1, x2) - x > near or x - max(x1, x2) > near:
                    continue
                if min(y1, y2) - y > near or y - max(y1, y2) > near:
                    continue
                bodies.near_link[i] = 1
                break
        lists.wall_start[i + 1] = used
        bodies.built_position[i, 0] = bodies.position[i, 0]
        bodies.built_position[i, 1] = bodies.position[i, 1]
    return used
