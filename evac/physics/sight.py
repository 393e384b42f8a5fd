"""Walls near a place, and those that cross a straight line in plan, found with the wall buckets of the world."""

from evac.jit import inner
from evac.physics.seams import side_of


@inner
def bucket_at(world, x, y):
    """Return the range (first, last + 1) in ``world.bucket_wall`` of the walls of the bucket at a position."""
    ny = world.buckets_y
    across, along = (x - world.bucket_x) / world.bucket_size, (y - world.bucket_y) / world.bucket_size
    if not (0.0 <= across < world.buckets_x and 0.0 <= along < ny):
        return 0, 0  # no wall is near
    bucket = int(across) * ny + int(along)
    return world.bucket_start[bucket], world.bucket_start[bucket + 1]


@inner
def walls_near(world, level, x, y, reach):
    """Return the range (first, last + 1) in ``world.bucket_wall`` of walls of a level: those within `reach` and others.

    A reach beyond that of the buckets takes all walls of the level, which are those of the bucket behind the last one.
    """
    first, last = bucket_at(world, x, y)
    if reach > world.bucket_reach:
        first, last = world.bucket_start[world.bucket_start.shape[0] - 2], world.bucket_wall.shape[0]
    return _first_above(world, level - 1, first, last), _first_above(world, level, first, last)


@inner
def _first_above(world, level, first, last):
    """Return where walls of levels above `level` begin in a bucket, whose walls are sorted by level."""
    while first < last:
        middle = (first + last) // 2
        if world.wall_level[world.bucket_wall[middle]] <= level:
            first = middle + 1
        else:
            last = middle
    return first


@inner
def passes_through(wall, w, ax, ay, bx, by):
    """Return whether the line from a to b crosses row w of walls (w, 4)."""
    x1, y1, x2, y2 = wall[w, 0], wall[w, 1], wall[w, 2], wall[w, 3]
    if side_of(x1, y1, x2, y2, ax, ay) * side_of(x1, y1, x2, y2, bx, by) >= 0.0:
        return False
    return side_of(ax, ay, bx, by, x1, y1) * side_of(ax, ay, bx, by, x2, y2) <= 0.0
