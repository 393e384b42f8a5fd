"""What a straight line in plan meets: portals, which contacts pass through, exits, and walls near a place."""

from evac.jit import AddressCall, inner, kernel
from evac.physics.state import World

SEAM = 1e-9  #: Tolerance of positions on portal lines [m].


@inner
def side_of(x1, y1, x2, y2, px, py):
    """Return twice the signed area of (1, 2, p) [m2], positive if p is on the left, inside the level."""
    return (x2 - x1) * (py - y1) - (y2 - y1) * (px - x1)


@inner
def crossing(segment, s, ax, ay, bx, by, slack):
    """Return the fraction of a-b at which segment `s` is crossed outwards, or -1 if it is not crossed.

    A point on the line counts as inside, so that a crossing forth and back is counted once in each direction.
    With `slack` > 0 [m], an end on the line counts as crossed.
    """
    x1, y1, x2, y2 = segment[s, 0], segment[s, 1], segment[s, 2], segment[s, 3]
    length = ((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5
    start = side_of(x1, y1, x2, y2, ax, ay)
    end = side_of(x1, y1, x2, y2, bx, by)
    if start < -slack * length or end >= slack * length:
        return -1.0
    fall = start - end
    share = min(max(start / fall, 0.0), 1.0) if fall > 0.0 else 1.0
    px = ax + share * (bx - ax)
    py = ay + share * (by - ay)
    along = (px - x1) * (x2 - x1) + (py - y1) * (y2 - y1)
    if along < -SEAM * length or along > length * length + SEAM * length:
        return -1.0
    return share


@inner
def way_out(world, level, ax, ay, bx, by, slack):
    """Return the fraction of a-b at which the first open exit of a level is passed outwards, or -1 if there is none."""
    first = -1.0
    for s in range(world.link_start[level], world.link_start[level + 1]):
        if world.link_to[s] >= 0 or not world.link_open[world.link_id[s]]:
            continue
        share = crossing(world.link_segment, s, ax, ay, bx, by, slack)
        if share >= 0.0 and (first < 0.0 or share < first):
            first = share
    return first


@inner
def lets_through(world, bodies, link, i):
    """Return whether a link can be passed by body i."""
    state = world.link_open[link]
    return state == 1 or (state > 1 and (bodies.passing[i] == link or world.link_from[link] == bodies.level[i]))


@inner
def is_absent(world, bodies, w, i):
    """Return whether wall w does not act on body i, because its link is open for it."""
    if world.wall_open[w] < 2:
        return world.wall_open[w] == 1
    slot = w - world.wall.shape[0] + world.link_id.shape[0]  # of a door: negative
    link = world.link_id[slot] if slot >= 0 else world.link_open.shape[0] + slot
    return lets_through(world, bodies, link, i)


@kernel
def reaches(world: World, level_a: int, ax: float, ay: float, level_b: int, bx: float, by: float) -> bool:
    """Return whether the straight segment from a, continued through portals, ends on the level of b.

    At most two portals are followed, since levels are at least 1 m deep and contacts and forces do not reach farther.
    Points on one level reach each other unless the segment passes an exit, as to a balcony behind a door.
    """
    if level_a == level_b:
        if world.backed[level_a] == 0:
            return True
        return way_out(world, level_a, ax, ay, bx, by, 0.0) < 0.0 and way_out(world, level_a, bx, by, ax, ay, 0.0) < 0.0
    if world.linked[level_a, level_b] == 0:
        return False
    slack = max(SEAM, world.rounding)
    for s in range(world.link_start[level_a], world.link_start[level_a + 1]):
        middle = world.link_to[s]
        if middle < 0 or world.link_open[world.link_id[s]] == 0:
            continue
        share = crossing(world.link_segment, s, ax, ay, bx, by, slack)
        if share < 0.0:
            continue
        if middle == level_b:
            return True
        if world.linked[middle, level_b] == 0:
            continue
        for t in range(world.link_start[middle], world.link_start[middle + 1]):
            if world.link_to[t] != level_b or world.link_open[world.link_id[t]] == 0:
                continue
            if crossing(world.link_segment, t, ax, ay, bx, by, slack) >= share - slack:
                return True
    return False


#: Call `reaches` at its address; it is loaded only if there are portals, or walls behind an exit.
call_reaches = AddressCall([World, int, float, float, int, float, float], (int,))


@inner
def touches(state, level_a, ax, ay, level_b, bx, by):
    """Return whether bodies at a and b, or a body and the nearest point of a wall, can touch."""
    world = state.world
    if level_a == level_b and world.backed[level_a] == 0:
        return True
    return call_reaches(state.parts.seams, world, level_a, ax, ay, level_b, bx, by) != 0


@inner
def walls_near(world, level, x, y, reach):
    """Return the range (first, last + 1) in ``world.bucket_wall`` of walls of a level: those within `reach` and others.

    A reach beyond that of the buckets takes all walls of the level, which are those of its last bucket.
    """
    columns, rows = world.bucket_columns[level], world.bucket_rows[level]
    bucket = world.bucket_first[level] + columns * rows
    if reach <= world.bucket_reach:
        across = (x - world.bucket_x) / world.bucket_size - world.bucket_column[level]
        along = (y - world.bucket_y) / world.bucket_size - world.bucket_row[level]
        if not (0.0 <= across < columns and 0.0 <= along < rows):
            return 0, 0  # no wall is near
        bucket = world.bucket_first[level] + int(across) * rows + int(along)
    return world.bucket_start[bucket], world.bucket_start[bucket + 1]


@inner
def passes_through(wall, w, ax, ay, bx, by):
    """Return whether the line from a to b crosses row w of walls (w, 4)."""
    x1, y1, x2, y2 = wall[w, 0], wall[w, 1], wall[w, 2], wall[w, 3]
    if side_of(x1, y1, x2, y2, ax, ay) * side_of(x1, y1, x2, y2, bx, by) >= 0.0:
        return False
    return side_of(ax, ay, bx, by, x1, y1) * side_of(ax, ay, bx, by, x2, y2) <= 0.0
