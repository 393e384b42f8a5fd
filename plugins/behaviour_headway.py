"""Headway: people steer clear of others and slow down behind those ahead, before bodies touch."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.behaviour import Behaviour, BehaviourScene
from evac.directions.sampling import sample_travel_time
from evac.hookspecs import hookimpl
from evac.jit import Floats, Ints, Pairs, Struct, inner, kernel
from evac.parameters import Parameter
from evac.physics.cells import fill_cells
from evac.physics.drive import desired_direction, desired_speed
from evac.physics.seams import reaches
from evac.physics.sight import bucket_at, passes_through
from evac.physics.state import Crowd, World

#: A repulsion below this share of the desired direction is left out.
FAINT = 0.01

#: Size of the cells in which people are looked for [m].
CELL = 1.0


class Rule(Struct):
    """The parameters of `Headway`, and the distance from which on a repulsion is faint [m]."""

    time_gap: float
    length: float
    repulsion: float
    range: float
    cutoff: float


class Sights(Struct):
    """What everybody is about to do at a tick, and who stands in which cell of the plan."""

    direction: Pairs  # (n, 2) unit desired direction
    wanted: Floats  # (n,) desired plan speed, 0 before the response time and once out [m/s]
    remaining: Floats  # (n,) travel time left [s]
    start: Ints  # cells, as `fill_cells` leaves them
    cell_of: Ints
    slots: Ints
    cells_x: int  # numbers of cells along x and y
    cells_y: int
    open_to: Floats  # (n,) distance to which no wall hides anybody on the own level [m]


class Headway(Behaviour):
    """Decides as the collision-free speed model does (Tordeux, Chraibi and Seyfried, 2016).

    Without it, people walk at their full desired speed until bodies touch; flows through doors are then higher than
    measured ones, and flows on stairs several times higher. To the desired direction is added, for each person in
    sight at a distance s,

        a exp((l - s) / D)    away from that person,

    and the speed that a person wants becomes

        min(v, max(0, (s - l) / T))

    with the previous desired speed v, and s the distance of centres to the nearest person who

    - is ahead, at most l away from the line of motion, and in sight, also through portals;
    - has started and wants to walk;
    - if the angle between the desired directions is below 90 degrees, is farther along: has a smaller remaining travel
      time on the same route, or, on another route, is also ahead along the sum of both directions. Therefore, of two
      people side by side at a door one goes first, and nobody waits for a person who is waiting for it.

    Bodies wider than l still come into contact, with a speed of (2 r - l) / T. The behaviour modifies the speeds and
    directions set by the other behaviours.

    References
    ----------
    Tordeux, Chraibi, Seyfried: Collision-free speed model for pedestrian dynamics. Traffic and Granular Flow '15
    (2016), 225-232, with T = 1 s and l = 0.3 m; a and D are the defaults of the same model in JuPedSim. There, people
    slow down for the nearest person ahead in all cases; the last two rules, sight and contact are additions of evac.
    """

    name = "headway"
    reads = ("position", "level", "speed", "start_time", "route", "speed_factor", "extra_direction")
    writes = ("speed_factor", "extra_direction")
    acts_last = True

    time_gap = Parameter(1.0, "time in which the distance beyond `length` is walked, T", "s", above=0.0, maximum=60.0)
    length = Parameter(0.3, "distance of centres at which the speed is zero, l", "m", minimum=0.0, maximum=2.0)
    repulsion = Parameter(
        8.0, "strength of the repulsion of people at the distance `length`, a", minimum=0.0, maximum=1000.0
    )
    range = Parameter(0.1, "range of the repulsion, D", "m", minimum=0.01, maximum=10.0)

    def prepare(self, scene: BehaviourScene) -> None:
        """Make room for what is seen at a tick."""
        n = len(scene.crowd.level)
        self._world = scene.world
        self._sights = Sights(
            direction=np.zeros((n, 2)),
            wanted=np.zeros(n),
            remaining=np.zeros(n),
            start=np.zeros(4 * n + 1025, np.int32),
            cell_of=np.zeros(n, np.int32),
            slots=np.zeros(n, np.int32),
            cells_x=0,
            cells_y=0,
            open_to=np.zeros(n),
        )
        share = self.repulsion / FAINT
        cutoff = max(self.length + self.range * math.log(share), 0.0) if share > 0.0 else 0.0
        self._rule = Rule(
            time_gap=self.time_gap, length=self.length, repulsion=self.repulsion, range=self.range, cutoff=cutoff
        )

    def act(self, crowd: Crowd, time: float) -> None:
        """Turn everybody from who is near, and slow down who is too near to somebody ahead."""
        keep_clear(self._world, crowd, self._sights, self._rule, time)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False for a single person."""
        return len(scene.crowd.level) > 1

    def state(self) -> dict[str, NDArray[Any]]:
        """Return nothing: what it has seen is written anew at every tick."""
        return {}


@kernel
def keep_clear(world: World, crowd: Crowd, sights: Sights, rule: Rule, time: float) -> None:
    """Apply the rules of `Headway` to everybody inside who has set off."""
    n = crowd.level.shape[0]
    inside = 0
    for i in range(n):
        if crowd.level[i] >= 0:
            inside += 1
    if inside == 0:
        return
    nx, ny = fill_cells(n, crowd.position, crowd.level, CELL, sights.start, sights.cell_of, sights.slots)
    sights.cells_x = nx
    sights.cells_y = ny
    look_for_walls(world, crowd, sights)
    turn_away(world, crowd, sights, rule)
    look_around(world, crowd, sights, time)
    slow_down(world, crowd, sights, rule)


@inner
def block_of(sights, i, reach):  # type: ignore[no-untyped-def]
    """Return columns and rows of the cells within a reach [m] of person i, as first and last + 1."""
    nx, ny = sights.cells_x, sights.cells_y
    column = sights.cell_of[i] // ny
    row = sights.cell_of[i] - column * ny
    ring = int(min(reach / CELL, nx + ny)) + 1
    return max(column - ring, 0), min(column + ring + 1, nx), max(row - ring, 0), min(row + ring + 1, ny)


@inner
def turn_away(world, crowd, sights, rule):  # type: ignore[no-untyped-def]
    """Add to the direction of everybody inside the sum of a exp((l - s) / D) away from who is near.

    The loops are in one piece, for a call that takes whole bundles costs as much as looking at ten people.
    """
    for i in range(crowd.level.shape[0]):
        if crowd.level[i] < 0:
            continue
        px, py = 0.0, 0.0
        left, right, low, high = block_of(sights, i, rule.cutoff)
        for cx in range(left, right):
            for slot in range(sights.start[cx * sights.cells_y + low], sights.start[cx * sights.cells_y + high]):
                j = sights.slots[slot]
                dx = crowd.position[j, 0] - crowd.position[i, 0]
                dy = crowd.position[j, 1] - crowd.position[i, 1]
                s = math.sqrt(dx * dx + dy * dy)
                if not 0.0 < s < rule.cutoff:
                    continue
                if (s <= sights.open_to[i] and crowd.level[j] == crowd.level[i]) or sees(world, crowd, i, j):
                    push = rule.repulsion * math.exp((rule.length - s) / rule.range)
                    px -= push * dx / s
                    py -= push * dy / s
        crowd.extra_direction[i, 0] += px
        crowd.extra_direction[i, 1] += py


@inner
def look_around(world, crowd, sights, time):  # type: ignore[no-untyped-def]
    """Set what everybody is about to do."""
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


@inner
def slow_down(world, crowd, sights, rule):  # type: ignore[no-untyped-def]
    """Lower the speed factors of those who are too near to the nearest of those for whom they brake."""
    for i in range(crowd.level.shape[0]):
        full = rule.time_gap * sights.wanted[i]
        if full <= 0.0:
            continue
        ex, ey = sights.direction[i, 0], sights.direction[i, 1]
        nearest = rule.length + full
        left, right, low, high = block_of(sights, i, nearest)
        for cx in range(left, right):
            for slot in range(sights.start[cx * sights.cells_y + low], sights.start[cx * sights.cells_y + high]):
                j = sights.slots[slot]
                dx = crowd.position[j, 0] - crowd.position[i, 0]
                dy = crowd.position[j, 1] - crowd.position[i, 1]
                if ex * dx + ey * dy <= 0.0 or abs(ex * dy - ey * dx) > rule.length:
                    continue
                s = math.sqrt(dx * dx + dy * dy)
                if s >= nearest or not brakes_for(crowd, sights, i, j, dx, dy):
                    continue
                if (s <= sights.open_to[i] and crowd.level[j] == crowd.level[i]) or sees(world, crowd, i, j):
                    nearest = s
        if nearest < rule.length + full:
            crowd.speed_factor[i] *= max((nearest - rule.length) / full, 0.0)


@inner
def brakes_for(crowd, sights, i, j, dx, dy):  # type: ignore[no-untyped-def]
    """Say whether person i brakes for j, who is ahead at (dx, dy): not if j goes its way and is less far on."""
    if sights.wanted[j] <= 0.0:
        return False
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    fx, fy = sights.direction[j, 0], sights.direction[j, 1]
    if ex * fx + ey * fy <= 0.0:
        return True
    if crowd.route[i] == crowd.route[j]:
        return sights.remaining[j] < sights.remaining[i]
    return (ex + fx) * dx + (ey + fy) * dy > 0.0


@inner
def look_for_walls(world, crowd, sights):  # type: ignore[no-untyped-def]
    """Set how far everybody inside sees without asking for walls: not at all where one is around."""
    for i in range(crowd.level.shape[0]):
        if crowd.level[i] >= 0:
            sights.open_to[i] = world.bucket_reach
            first, last = bucket_at(world, crowd.position[i, 0], crowd.position[i, 1])
            for slot in range(first, last):
                w = world.bucket_wall[slot]
                if world.wall_level[w] == crowd.level[i] and not world.wall_open[w]:
                    sights.open_to[i] = 0.0


@inner
def sees(world, crowd, i, j):  # type: ignore[no-untyped-def]
    """Say whether the straight line from person i to j ends on the level of j and passes no wall of either level.

    It follows at most two portals, as `reaches` does; of a level between them the walls do not count.
    """
    a, b = crowd.level[i], crowd.level[j]
    ax, ay, bx, by = crowd.position[i, 0], crowd.position[i, 1], crowd.position[j, 0], crowd.position[j, 1]
    if not reaches(world, a, ax, ay, b, bx, by):
        return False
    # A bucket lists the walls within a reach of it: so many buckets along the line list all that can cross it.
    pieces = int(math.sqrt((bx - ax) ** 2 + (by - ay) ** 2) / (2.0 * world.bucket_reach)) + 1
    for k in range(pieces):
        share = (k + 0.5) / pieces
        first, last = bucket_at(world, ax + share * (bx - ax), ay + share * (by - ay))
        for slot in range(first, last):
            w = world.bucket_wall[slot]
            if world.wall_open[w] or (world.wall_level[w] != a and world.wall_level[w] != b):
                continue
            if passes_through(world.wall, w, ax, ay, bx, by):
                return False
    return True


evac_interface = 2


@hookimpl
def evac_behaviours() -> Sequence[type[Behaviour]]:
    """Return the behaviour of this module."""
    return [Headway]
