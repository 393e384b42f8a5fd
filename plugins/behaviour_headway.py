"""Headway: people avoid others and slow down behind people ahead, before bodies touch."""

import math
from typing import Any

from numpy.typing import NDArray

from evac.base.parameters import Parameter
from evac.jit import Struct, inner, kernel
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.outside import Outside
from evac.people.sights import Sights, is_ahead, list_near, look_round, make_sights, sees, set_desired_motion
from evac.physics.state import Crowd, World

FAINT = 0.01  #: Repulsions below this share of the desired direction are neglected.


class Rule(Struct):
    """The parameters of `Headway`, and the distance beyond which repulsions are neglected [m]."""

    time_gap: float
    length: float
    repulsion: float
    range: float
    cutoff: float


class Headway(Behaviour):
    """Directions and speeds of the collision-free speed model (Tordeux, Chraibi and Seyfried, 2016).

    For each visible person at a distance s, a repulsion away from that person is added to the desired direction:

        a exp((l - s) / D)

    The desired speed becomes

        min(v, max(0, (s - l) / T))

    with the previous desired speed v and the distance s of centres to the nearest person who

    - is ahead, at most l beside the line of walking, and visible, also through portals;
    - has started and wants to walk;
    - is farther ahead on the way, if the angle between both desired directions is below 90 degrees: has a smaller
      remaining travel time on the same route or, on another route, is also ahead along the sum of both directions.
      Therefore one of two people side by side at a door goes first, and two people never wait for each other.

    People who have left count until they are 2 m behind their exit. They walk straight on and slow down for those ahead
    of them outside who walk in a similar direction. Bodies wider than l still touch, at a speed of (2 r - l) / T.

    References
    ----------
    Tordeux, Chraibi, Seyfried: Collision-free speed model for pedestrian dynamics. Traffic and Granular Flow '15
    (2016), 225-232, with T = 1 s and l = 0.3 m; a and D are the defaults of this model in JuPedSim. In the published
    model, people slow down for the nearest person ahead; the last two rules, visibility and contacts are additions.
    """

    name = "headway"
    reads = ("position", "level", "contact_radius", "speed", "start_time", "route", "speed_factor", "extra_direction")
    writes = ("speed_factor", "extra_direction")
    acts_last = True
    keeps_distance = True

    time_gap = Parameter(1.0, "time gap T to the person ahead", "s", above=0.0, maximum=60.0)
    length = Parameter(0.3, "distance of centres l at which people stop behind others", "m", minimum=0.0, maximum=2.0)
    repulsion = Parameter(8.0, "strength a of the repulsion at a distance of `length`", minimum=0.0, maximum=1000.0)
    range = Parameter(0.1, "range D of the repulsion", "m", minimum=0.01, maximum=10.0)

    def prepare(self, scene: BehaviourScene) -> None:
        """Allocate the arrays of a tick."""
        n, levels = len(scene.crowd.level), len(scene.world.cosine)
        self._world, self._outside = scene.world, scene.outside
        self._sights = make_sights(n, levels)
        share = self.repulsion / FAINT
        cutoff = max(self.length + self.range * math.log(share), 0.0) if share > 0.0 else 0.0
        self._rule = Rule(
            time_gap=self.time_gap, length=self.length, repulsion=self.repulsion, range=self.range, cutoff=cutoff
        )

    def act(self, crowd: Crowd, time: float) -> None:
        """Add repulsions to the directions, and reduce the speeds of people close to a person ahead."""
        apply_rules(self._world, crowd, self._outside, self._sights, self._rule, time)

    def is_needed(self, scene: BehaviourScene) -> bool:
        """Return False for a single person."""
        return len(scene.crowd.level) > 1

    def state(self) -> dict[str, NDArray[Any]]:
        """Return nothing, since all arrays are overwritten at every tick."""
        return {}


@kernel
def apply_rules(world: World, crowd: Crowd, outside: Outside, sights: Sights, rule: Rule, time: float) -> None:
    """Apply the rules of `Headway` to all people inside who have started, and to those outside."""
    if look_round(world, crowd, outside, sights) == 0:
        return
    add_repulsions(world, crowd, sights, rule)
    set_desired_motion(world, crowd, outside, sights, time)
    reduce_speeds(world, crowd, outside, sights, rule)


@inner
def add_repulsions(world, crowd, sights, rule):
    """Add the repulsions a exp((l - s) / D) from people nearby to the directions of all people inside.

    The loops are not divided into functions, since a call with structs costs as much as processing ten people.
    """
    for i in range(crowd.level.shape[0]):
        if crowd.level[i] < 0:
            continue
        px, py = 0.0, 0.0
        list_near(world, sights, i, rule.cutoff, 0.0, 0.0, 0.0, 0.0)
        for k in range(sights.number):
            j = sights.near[k]
            dx = sights.position[j, 0] - sights.position[i, 0]
            dy = sights.position[j, 1] - sights.position[i, 1]
            s = math.sqrt(dx * dx + dy * dy)
            if not 0.0 < s < rule.cutoff:
                continue
            if (s <= sights.open_to[i] and sights.level[j] == sights.level[i]) or sees(world, sights, i, j):
                push = rule.repulsion * math.exp((rule.length - s) / rule.range)
                px -= push * dx / s
                py -= push * dy / s
        crowd.extra_direction[i, 0] += px
        crowd.extra_direction[i, 1] += py


@inner
def reduce_speeds(world, crowd, outside, sights, rule):
    """Reduce the speed factors of people close to the nearest person for whom they slow down."""
    for i in range(crowd.level.shape[0]):
        full = rule.time_gap * sights.wanted[i]
        if full <= 0.0:
            continue
        ex, ey = sights.direction[i, 0], sights.direction[i, 1]
        nearest = rule.length + full
        list_near(world, sights, i, nearest, 0.0, 0.0, 0.0, 0.0)
        for k in range(sights.number):
            j = sights.near[k]
            dx = sights.position[j, 0] - sights.position[i, 0]
            dy = sights.position[j, 1] - sights.position[i, 1]
            if ex * dx + ey * dy <= 0.0 or abs(ex * dy - ey * dx) > rule.length:
                continue
            s = math.sqrt(dx * dx + dy * dy)
            if s >= nearest or not brakes_for(crowd, sights, i, j, dx, dy):
                continue
            if (s <= sights.open_to[i] and sights.level[j] == sights.level[i]) or sees(world, sights, i, j):
                nearest = s
        if nearest < rule.length + full:
            share = max((nearest - rule.length) / full, 0.0)
            if crowd.level[i] >= 0:
                crowd.speed_factor[i] *= share
            else:
                outside.speed_factor[i] *= share


@inner
def brakes_for(crowd, sights, i, j, dx, dy):
    """Return whether person i slows down for j, who is ahead at (dx, dy): not if j is behind on the same way.

    Of two people outside only the one who is nearer to its exit may slow down, so that nobody waits there for ever.
    """
    if sights.wanted[j] <= 0.0:
        return False
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    fx, fy = sights.direction[j, 0], sights.direction[j, 1]
    if ex * fx + ey * fy <= 0.0:
        return sights.level[i] < sights.levels
    return is_ahead(crowd, sights, i, j, dx, dy)
