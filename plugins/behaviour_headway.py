"""Headway: people slow down behind those who walk ahead of them, before bodies touch."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from evac.behaviour import Behaviour, BehaviourScene
from evac.directions.sampling import sample_travel_time
from evac.hookspecs import hookimpl
from evac.jit import inner, kernel
from evac.parameters import Parameter
from evac.physics.bundles import Crowd, FloatArray, IntArray
from evac.physics.cells import fill_cells
from evac.physics.drive import desired_direction, desired_speed
from evac.physics.seams import reaches, side_of
from evac.physics.world import make_world


class Sights(NamedTuple):
    """What everybody is about to do at a tick, and who stands in which cell of the plan."""

    direction: FloatArray  # (n, 2) unit desired direction
    wanted: FloatArray  # (n,) desired plan speed, 0 before the response time and once out [m/s]
    remaining: FloatArray  # (n,) travel time left [s]
    start: IntArray  # cells, as `fill_cells` leaves them
    cell_of: IntArray
    slots: IntArray


class Rule(NamedTuple):
    """The parameters of `Headway`."""

    time_gap: float
    length: float


class Headway(Behaviour):
    """Slows people down behind those ahead: the speed of Tordeux, Chraibi and Seyfried (2016).

    Without it people walk at full speed until bodies touch, and crowds pass doors and stairs several times
    faster than measured ones. The speed that a person wants becomes

        min(v, max(0, (s - l) / T))

    v being what it wanted before, T `time_gap`, l `length`, and s the distance of centres to the nearest of those whom
    it follows. It follows who

    - stands ahead, no farther than l beside the line on which it walks, in sight, also through portals;
    - has set off, and goes its way: the angle between their desired directions is below 90 degrees;
    - is farther on: has less travel time left on the same route, or, on another route, is ahead along the sum of both
      directions too. So of two side by side at a door one goes first, and nobody waits for whom it holds up.

    Bodies wider than l still touch, at (2 r - l) / T. People who come towards it, cross its way or wait are not
    followed: they are met as before, by forces and contact.

    References
    ----------
    Tordeux, Chraibi, Seyfried: Collision-free speed model for pedestrian dynamics. Traffic and Granular Flow '15
    (2016), 225-232, with T = 1 s and l = 0.3 m. Whom one follows is nearest ahead there; the last two rules are ours.
    """

    name = "headway"
    reads = ("position", "level", "speed", "start_time", "route", "speed_factor", "extra_direction")
    writes = ("speed_factor",)

    time_gap = Parameter(1.0, "time in which the distance beyond `length` is walked, T", unit="s", above=0.0)
    length = Parameter(0.3, "distance of centres at which one stands behind another, l", unit="m", minimum=0.0)

    def prepare(self, scene: BehaviourScene) -> None:
        """Make room for what is seen at a tick."""
        n = len(scene.crowd.level)
        self._world = make_world(scene.building, scene.fields)
        self._sights = Sights(
            direction=np.zeros((n, 2)),
            wanted=np.zeros(n),
            remaining=np.zeros(n),
            start=np.zeros(4 * n + 1025, np.int32),
            cell_of=np.zeros(n, np.int32),
            slots=np.zeros(n, np.int32),
        )

    def act(self, crowd: Crowd, time: float) -> None:
        """Slow down everybody who is too near to somebody ahead."""
        keep_gaps(self._world, crowd, self._sights, Rule(self.time_gap, self.length), time)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False for a single person."""
        return len(scene.crowd.level) > 1


@kernel
def keep_gaps(world, crowd, sights, rule, time):  # type: ignore[no-untyped-def]
    """Apply the rule of `Headway` to everybody inside who has set off."""
    fastest = look_around(world, crowd, sights, time)
    if fastest <= 0.0:
        return
    n = crowd.level.shape[0]
    size = rule.length + rule.time_gap * fastest
    nx, ny = fill_cells(n, crowd.position, crowd.level, size, sights.start, sights.cell_of, sights.slots)
    for i in range(n):
        full = rule.time_gap * sights.wanted[i]
        if full > 0.0:
            spare = spacing(world, crowd, sights, i, rule.length, rule.length + full, nx, ny) - rule.length
            if spare < full:
                crowd.speed_factor[i] *= max(spare / full, 0.0)


@inner
def look_around(world, crowd, sights, time):  # type: ignore[no-untyped-def]
    """Set what everybody is about to do; return the greatest desired speed [m/s]."""
    fastest = 0.0
    for i in range(crowd.level.shape[0]):
        sights.wanted[i] = 0.0
        level = crowd.level[i]
        if level < 0 or time < crowd.start_time[i]:
            continue
        ex, ey = desired_direction(world, crowd, i)
        sights.direction[i, 0] = ex
        sights.direction[i, 1] = ey
        sights.wanted[i] = desired_speed(world, crowd, i, ex, ey)
        x, y = crowd.position[i, 0], crowd.position[i, 1]
        sights.remaining[i] = sample_travel_time(world.fields, x, y, level, crowd.route[i])
        fastest = max(fastest, sights.wanted[i])
    return fastest


@inner
def spacing(world, crowd, sights, i, length, farthest, nx, ny):  # type: ignore[no-untyped-def]
    """Return the distance of person i to the nearest of those whom it follows, inf from `farthest` on [m]."""
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    nearest = farthest
    column = sights.cell_of[i] // ny
    row = sights.cell_of[i] - column * ny
    for cx in range(max(column - 1, 0), min(column + 2, nx)):
        low = cx * ny + max(row - 1, 0)
        high = cx * ny + min(row + 2, ny)
        for slot in range(sights.start[low], sights.start[high]):
            j = sights.slots[slot]
            dx = crowd.position[j, 0] - crowd.position[i, 0]
            dy = crowd.position[j, 1] - crowd.position[i, 1]
            if ex * dx + ey * dy <= 0.0 or abs(ex * dy - ey * dx) > length:
                continue
            distance = math.sqrt(dx * dx + dy * dy)
            if distance < nearest and follows(crowd, sights, i, j, dx, dy) and sees(world, crowd, i, j):
                nearest = distance
    return nearest if nearest < farthest else math.inf


@inner
def follows(crowd, sights, i, j, dx, dy):  # type: ignore[no-untyped-def]
    """Say whether person j, at (dx, dy) from i, goes the way of i and is ahead of it."""
    if sights.wanted[j] <= 0.0:
        return False
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    fx, fy = sights.direction[j, 0], sights.direction[j, 1]
    if ex * fx + ey * fy <= 0.0:
        return False
    if crowd.route[i] == crowd.route[j]:
        return sights.remaining[j] < sights.remaining[i]
    return (ex + fx) * dx + (ey + fy) * dy > 0.0


@inner
def sees(world, crowd, i, j):  # type: ignore[no-untyped-def]
    """Say whether the straight line from person i to j passes no wall and ends on the level of j."""
    a, b = crowd.level[i], crowd.level[j]
    ax, ay, bx, by = crowd.position[i, 0], crowd.position[i, 1], crowd.position[j, 0], crowd.position[j, 1]
    if not reaches(world, a, ax, ay, b, bx, by):
        return False
    frame, nx, ny = world.bucket_frame, world.bucket_shape[0], world.bucket_shape[1]
    # A bucket lists the walls within a reach of it: so many buckets along the line list all that can cross it.
    pieces = int(math.hypot(bx - ax, by - ay) / (2.0 * frame[3])) + 1
    for k in range(pieces):
        share = (k + 0.5) / pieces
        cx = int((ax + share * (bx - ax) - frame[0]) // frame[2])
        cy = int((ay + share * (by - ay) - frame[1]) // frame[2])
        if not (0 <= cx < nx and 0 <= cy < ny):
            continue  # no wall is near
        for slot in range(world.bucket_start[cx * ny + cy], world.bucket_start[cx * ny + cy + 1]):
            w = world.bucket_wall[slot]
            if world.wall_open[w] or (world.wall_level[w] != a and world.wall_level[w] != b):
                continue
            if cross(world.wall[w], ax, ay, bx, by):
                return False
    return True


@inner
def cross(wall, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Say whether the line from a to b passes through a wall (4,)."""
    x1, y1, x2, y2 = wall[0], wall[1], wall[2], wall[3]
    if side_of(x1, y1, x2, y2, ax, ay) * side_of(x1, y1, x2, y2, bx, by) >= 0.0:
        return False
    return side_of(ax, ay, bx, by, x1, y1) * side_of(ax, ay, bx, by, x2, y2) <= 0.0


@hookimpl
def evac_behaviours() -> Sequence[type[Behaviour]]:
    """Return the behaviour of this module."""
    return [Headway]
