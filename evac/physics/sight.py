"""Walls across a straight line in plan, found through the buckets of the world."""

from evac.jit import inner
from evac.physics.seams import side_of


@inner
def bucket_at(world, x, y):
    """Return where the walls of the bucket at a place are in the list of all buckets, as first and last + 1."""
    frame, nx, ny = world.bucket_frame, world.bucket_shape[0], world.bucket_shape[1]
    across, along = (x - frame[0]) / frame[2], (y - frame[1]) / frame[2]
    if not (0.0 <= across < nx and 0.0 <= along < ny):
        return 0, 0  # no wall is near
    bucket = int(across) * ny + int(along)
    return world.bucket_start[bucket], world.bucket_start[bucket + 1]


@inner
def passes_through(wall, ax, ay, bx, by):
    """Say whether the line from a to b passes through a wall (4,)."""
    x1, y1, x2, y2 = wall[0], wall[1], wall[2], wall[3]
    if side_of(x1, y1, x2, y2, ax, ay) * side_of(x1, y1, x2, y2, bx, by) >= 0.0:
        return False
    return side_of(ax, ay, bx, by, x1, y1) * side_of(ax, ay, bx, by, x2, y2) <= 0.0
