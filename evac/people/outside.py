"""People who have left: they walk straight on behind their exit, seen by behaviours that keep distances."""

import numpy as np

from evac.base.arrays import IntArray
from evac.base.saved import Saved
from evac.building.model.building import FLAT, Building
from evac.jit import Floats, Ints, Pairs, Struct, kernel
from evac.physics.state import Crowd
from evac.physics.stepping import FASTEST

REACH = 2.0  #: Distance behind the line of an exit up to which people who have left are seen [m].


class Outside(Struct):
    """The people who have left and are at most `REACH` behind the line of their exit; row p is person p of the crowd.

    They walk along the outward normal of their exit on flat ground. Contact models and forces do not see them.
    """

    #: (n,) int32: level of the exit through which a person has left; -1 for all others, whose other values have no
    #: meaning
    level: Ints
    position: Pairs  #: (n, 2) in plan [m]
    velocity: Pairs  #: (n, 2) in plan [m/s]
    direction: Pairs  #: (n, 2): outward unit normal of the exit where it was crossed
    depth: Floats  #: (n,): distance behind the line of the exit [m]
    #: (n,): set to 1 before each tick's behaviours; those that keep distances multiply it. The desired speed is the
    #: flat speed of the person times this factor.
    speed_factor: Floats


class Walks(Struct):
    """How long people outside walk [s], and their share of the change to the desired speeds in this time."""

    seconds: Floats  # (n,) 0: stays
    share: Floats  # (n,)


def make_outside(n: int) -> Outside:
    """Return the arrays of `n` people, of whom nobody has left."""
    return Outside(
        level=np.full(n, -1, np.int32),
        position=np.zeros((n, 2)),
        velocity=np.zeros((n, 2)),
        direction=np.zeros((n, 2)),
        depth=np.zeros(n),
        speed_factor=np.ones(n),
    )


class PeopleOutside(Saved):
    """Owner of the arrays of the people who have left: `arrays`, of which others write the speed factors only."""

    saved = ("arrays",)

    def __init__(self, building: Building, crowd: Crowd) -> None:
        self._crowd = crowd
        n = len(crowd.level)
        self.arrays = make_outside(n)
        self._walks, self._tick, self._share = Walks(seconds=np.zeros(n), share=np.zeros(n)), 0.0, np.zeros(n)
        segments = [way.segments for way in building.exits]
        self._segment = np.concatenate([np.empty((0, 4)), *segments])
        self._exit = np.repeat(np.arange(len(segments)), [len(pieces) for pieces in segments])
        self._level = np.array([way.level for way in building.exits], np.int32)

    def advance(self, left: IntArray, time: float, tick: float) -> None:
        """Advance everybody outside by a tick [s], which ends at `time`, and add those who left during it.

        Speeds approach the desired ones exponentially, as those of people inside without contacts.
        """
        walks, crowd = self._walks, self._crowd
        if tick != self._tick:
            self._tick, self._share = tick, -np.expm1(-tick / crowd.tau)
        walks.seconds[:], walks.share[:] = tick, self._share
        walk_straight(self.arrays, crowd, walks, False)
        if len(left):
            self._add(left)
            walks.seconds[:] = 0.0
            walks.seconds[left] = seconds = time - crowd.exit_time[left]
            walks.share[left] = -np.expm1(-seconds / crowd.tau[left])
            walk_straight(self.arrays, crowd, walks, True)

    def _add(self, left: IntArray) -> None:
        """Put people who left on the line of their exit, with the part of their velocity that is normal to it."""
        outside, crowd = self.arrays, self._crowd
        for row in left.tolist():
            pieces = self._segment[self._exit == crowd.exit_used[row]]
            start, along = pieces[:, :2], pieces[:, 2:] - pieces[:, :2]
            share = np.einsum("nk,nk->n", crowd.position[row] - start, along) / np.einsum("nk,nk->n", along, along)
            nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
            crossed = int(np.argmin(np.hypot(*(nearest - crowd.position[row]).T)))
            dx, dy = along[crossed] / np.hypot(*along[crossed])  # the inside is on its left
            outside.level[row] = self._level[crowd.exit_used[row]]
            outside.direction[row] = normal = np.array([dy, -dx])
            outside.position[row] = nearest[crossed]
            outside.velocity[row] = np.clip(crowd.velocity[row] @ normal, 0.0, FASTEST) * normal
            outside.depth[row] = 0.0


@kernel
def walk_straight(outside: Outside, crowd: Crowd, walks: Walks, has_left: bool) -> None:
    """Move people along their directions, at their flat speeds times a factor, that inside if they have just left."""
    for p in range(len(outside.level)):
        seconds, share = walks.seconds[p], walks.share[p]
        if outside.level[p] < 0 or seconds == 0.0:
            continue
        ex, ey = outside.direction[p, 0], outside.direction[p, 1]
        speed = outside.velocity[p, 0] * ex + outside.velocity[p, 1] * ey
        desired = crowd.speed[p, FLAT] * (crowd.speed_factor[p] if has_left else outside.speed_factor[p])
        path = desired * seconds + (speed - desired) * crowd.tau[p] * share
        speed = speed + share * (desired - speed)
        outside.depth[p] += path
        outside.position[p, 0] += path * ex
        outside.position[p, 1] += path * ey
        outside.velocity[p, 0], outside.velocity[p, 1] = speed * ex, speed * ey
        if outside.depth[p] > REACH:
            outside.level[p] = -1
