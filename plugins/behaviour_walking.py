"""Walking: people keep a distance, anticipate those ahead, and step aside, before bodies touch."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.base.saved import taken
from evac.directions.sampling import column_of, sample_direction
from evac.jit import Floats, Pairs, Struct, inner, kernel
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.outside import Outside
from evac.people.sights import (
    Sights,
    is_ahead,
    is_hidden,
    list_near,
    look_round,
    make_sights,
    sees,
    set_desired_motion,
)
from evac.physics.contact.neighbours import segment_distance
from evac.physics.seams import walls_near
from evac.physics.state import Crowd, World
from evac.physics.world import BUCKET_REACH

#: Side steps below this share of the desired direction are neglected.
FAINT = 0.03

#: Greatest component of a unit vector, with rounding errors.
LONGEST = 1.0 + 1e-9

#: Distance beside the line of walking below which a person is on it, and the side is the person's own [m].
ON_LINE = 1e-6

#: Gap to the bodies of those who stand at which people stop [m].
TOUCHING = 0.02

#: Gap that people leave to the bodies of those who stand when they walk around them [m].
CLEARANCE = 0.05

#: Angle between the directions that they try for this, and number of these directions on each side: up to 90 degrees.
TURN, TURNS = math.pi / 24.0, 12
TURNED = tuple((math.cos(TURN * k), math.sin(TURN * k)) for k in range(-TURNS, TURNS + 1))

#: Value of a way of 1 m across the desired direction, in metres along it; and of a way along the present heading.
ASIDE, STEADY = 0.3, 0.1

#: Length of the way within which people beside those who stand heed walls, and speed from which on they do [m, m/s].
NEAR_WALL, SLOW = 0.5, 0.05

#: How far behind a person the nearest place of a wall may be from which it steps away [m].
BEHIND = 0.05

#: Share of a wanted change of velocity that is made by the time a person comes near those who stand.
SOON = 0.5


class Rule(Struct):
    """The parameters of `Walking`."""

    chest_depth: float
    time_gap: float
    length: float
    anticipation: float
    width: float
    edge: float
    stair_time_gap: float
    stair_length: float
    oncoming_time_gap: float
    oncoming_length: float
    oncoming_width: float
    side_step: float
    side_range: float
    side_time: float
    side_limit: float
    right: float
    wall_step: float
    wall_distance: float
    reaction_time: float
    creep: float
    sight: float


class Motion(Struct):
    """What people have decided, and how they have moved."""

    heading: Pairs  # (n, 2) unit heading of the last tick; (0, 0) before the first one
    next: Pairs  # (n, 2) that of this tick
    velocity: Pairs  # (n, 2) displacement velocity in the last tick [m/s]
    factor: Floats  # (n,) share of the desired speed
    side: Floats  # (n,) side to which a person steps for somebody exactly ahead, 1 or -1


class Walking(Behaviour):
    """People keep distances, anticipate the motion of others, step aside, and do not push.

    At every tick, people choose a heading and a speed from what they see within `sight`, also through portals, but not
    behind walls. For a person i and another person j, e is the desired direction of i, h and h_j are the headings, u_j
    is the velocity of j, s is the distance of centres, and r are contact radii.

    Heading: A person steps aside for everybody who walks ahead of e or of the present heading, by

        k (1 + (1 - e.h_j) / 2) exp(-max(0, s - r_i - r_j - c t_s) / D)

    away from the side on which j will be after the time t_s. Here c is the speed at which the two approach each other.
    Oncoming people (e.h_j < 0) are taken to be `right` farther to the left, so that people pass on the right. A person
    also steps away from the nearest wall on either side, by k_w (1 - d / d_w) at the distance d. The sum S of all side
    steps is at most `side_limit`. The heading turns towards e + S n, with n normal to e, with the time constant
    `reaction_time`.

    Speed: With the previous desired speed v, the speed becomes

        min(v, max(V, (s - g l + T_a max(0, u_j.h)) / (g T)))

    for that j for whom it is least, among all people who are

    - seen ahead of h, and of e or the previous heading. The weight g is 1 up to the distance `width` beside the line of
      the heading and decreases to 0 over the distance `edge`, so that people follow those in their own lane;
    - farther ahead on the way: with a smaller remaining travel time on the same route or, on another route, ahead along
      the sum of both desired directions. Oncoming people count with the parameters for them, and g = 1.

    The least speed V is `creep`, so that nobody waits for ever. Behind people on the same route it is 0, so that queues
    keep their distances and nobody pushes. If all people in a file have the speed u, their distance is l + (T - T_a) u.

    Standing people, who have not started yet or wait for others, are walked around. If one of them is in the way, the
    heading turns towards the direction in which the person gets farthest, up to 90 degrees from e + S n, with a gap of
    0.05 m to bodies and walls. If there is none, the person waits for those who have not started, and creeps past those
    who wait for others or never start. Near standing people, everybody also slows down for people who walk beside them.
    Before people start, forces between people do not move them.

    Bodies that touch have half the depth of the chest as radius, because shoulders turn. For wider bodies, such as
    wheelchairs, the distances and widths increase by the excess width of both. Of two wide bodies that meet on the same
    route, the one behind waits. They keep their sides away from walls, and do not step towards a wall that they touch.
    People who have left count until they are 2 m behind their exit; they keep distances, but do not step aside.

    Notes
    -----
    In single file, the distance is 0.43 m + 0.73 s u. Seyfried et al. measured 0.36 m + 1.06 s u, which agrees at the
    speeds of queues. `length`, `time_gap`, `anticipation`, side steps, steps away from walls, `width`, `edge` and
    `chest_depth` are fitted to measured flows through doors of 0.6, 0.8, 1.2 and 2.5 m, to speeds below 2 people per
    square metre in a corridor and in a corridor with two directions ([people](evidence/people/README.md)), and to
    Weidmann's diagram from 2 to 3.5 per square metre in a corridor of 2.4 m with narrow ends. `stair_time_gap` and
    `stair_length` are fitted to the flow down a stair.

    References
    ----------
    Tordeux, Chraibi, Seyfried: Collision-free speed model for pedestrian dynamics. Traffic and Granular Flow '15
    (2016), 225-232, for the speed; Seyfried, Steffen, Klingsch, Boltes: The fundamental diagram of pedestrian movement
    revisited. Journal of Statistical Mechanics (2005) P10002, for distances in single file; Xu, Chraibi, Seyfried:
    Anticipation in a velocity-based model for pedestrian dynamics. Transportation Research C 133 (2021) 103464, for
    side steps; Moussaid, Helbing, Theraulaz: How simple rules determine pedestrian behavior and crowd disasters. PNAS
    108 (2011) 6884-6888, for ways around standing people; Weidmann: Transporttechnik der Fussgaenger, ETH Zurich
    (1993). Lanes, steps away from walls, the reaction time and creeping are additions.
    """

    name = "walking"
    group_keys = ("chest_depth",)
    reads = ("position", "level", "contact_radius", "speed", "tau", "start_time", "route")
    writes = ("speed_factor", "extra_direction")
    acts_last = True
    keeps_distance = True
    stands_firm = True

    preset = Parameter(
        "measured",
        "measured: as in experiments; regulation: without anticipation, with the flows through doors that standard "
        "tests prescribe",
        choices=("measured", "regulation"),
    )
    chest_depth = Parameter(
        0.30, "depth of the chest, the diameter of bodies that touch", "m", minimum=0.02, maximum=2.0
    )
    time_gap = Parameter(1.95, "time gap T to a standing person ahead", "s", above=0.0, maximum=60.0)
    length = Parameter(0.43, "distance of centres l at which people stop behind others", "m", minimum=0.0, maximum=2.0)
    anticipation = Parameter(
        1.22, "time T_a for which the motion of the person ahead counts", "s", minimum=0.0, maximum=5.0
    )
    width = Parameter(0.25, "distance beside the heading up to which people are ahead", "m", minimum=0.0, maximum=4.0)
    edge = Parameter(
        0.15, "distance beyond `width` over which the weight of people decreases to zero", "m", above=0.0, maximum=4.0
    )
    stair_time_gap = Parameter(1.92, "time gap on stairs", "s", above=0.0, maximum=60.0)
    stair_length = Parameter(0.5, "distance l on stairs", "m", minimum=0.0, maximum=2.0)
    oncoming_time_gap = Parameter(0.5, "time gap to oncoming people", "s", above=0.0, maximum=60.0)
    oncoming_length = Parameter(0.25, "distance l to oncoming people", "m", minimum=0.0, maximum=2.0)
    oncoming_width = Parameter(
        0.2, "greatest distance of oncoming people beside the heading", "m", minimum=0.0, maximum=2.0
    )
    side_step = Parameter(3.0, "strength of side steps", minimum=0.0, maximum=100.0)
    side_range = Parameter(0.26, "range of side steps", "m", minimum=0.01, maximum=10.0)
    side_time = Parameter(0.6, "time for which motion is anticipated in side steps", "s", minimum=0.0, maximum=10.0)
    side_limit = Parameter(2.0, "greatest side step", minimum=0.0, maximum=100.0)
    right = Parameter(
        0.3, "distance by which oncoming people are taken to be farther to the left", "m", minimum=-5.0, maximum=5.0
    )
    wall_step = Parameter(10.0, "strength k_w of steps away from walls", minimum=0.0, maximum=100.0)
    wall_distance = Parameter(
        0.31, "distance d_w below which people step away from walls", "m", above=0.0, maximum=BUCKET_REACH
    )
    reaction_time = Parameter(0.3, "time constant with which the heading turns", "s", minimum=0.0, maximum=10.0)
    creep = Parameter(0.1, "least speed of people who are blocked by others", "m/s", minimum=0.0, maximum=1.0)
    sight = Parameter(2.0, "distance within which people react to others", "m", minimum=0.1, maximum=20.0)

    def contact_radius(self, radius: FloatArray, settings: Mapping[str, Any]) -> FloatArray:
        """Return half the depth of the chest, since shoulders turn; at most the radius."""
        depth: float = settings.get("chest_depth", self.chest_depth)
        return np.minimum(radius, 0.5 * depth)

    def prepare(self, scene: BehaviourScene) -> None:
        """Allocate the arrays of a tick."""
        n, levels = len(scene.crowd.level), len(scene.world.cosine)
        self._world, self._outside, self._tick = scene.world, scene.outside, scene.tick
        self._displacement_velocity = scene.displacement_velocity
        self._sights = make_sights(n, levels)
        side = np.where(scene.generator.random(n) < 0.5, -1.0, 1.0)
        self._motion = Motion(
            heading=np.zeros((n, 2)), next=np.zeros((n, 2)), velocity=np.zeros((n, 2)), factor=np.ones(n), side=side
        )
        self._rule = Rule(**{name: getattr(self, name) for name in Rule.kinds})
        if self.preset == "regulation":
            self._rule.anticipation = 0.0

    def act(self, crowd: Crowd, time: float) -> None:
        """Set the heading of everybody, and the speed with it."""
        self._motion.velocity[:] = self._displacement_velocity
        walk(self._world, crowd, self._outside, self._sights, self._motion, self._rule, self._tick, time)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the headings of the last tick."""
        return {"heading": self._motion.heading}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the headings."""
        heading = self._motion.heading
        heading[:] = taken(state, "heading", np.float64, heading.shape, -LONGEST, LONGEST)


@kernel
def walk(
    world: World, crowd: Crowd, outside: Outside, sights: Sights, motion: Motion, rule: Rule, tick: float, time: float
) -> None:
    """Apply the rules of `Walking` to all people inside who have started, and to those outside."""
    if look_round(world, crowd, outside, sights) == 0:
        return
    set_desired_motion(world, crowd, outside, sights, time)
    n = crowd.level.shape[0]
    turn = 1.0
    if rule.reaction_time > 0.0:
        turn = 1.0 - math.exp(-tick / rule.reaction_time)
    someone_stands = False
    for i in range(n):
        someone_stands = someone_stands or (0 <= sights.level[i] < sights.levels and sights.wanted[i] <= 0.0)
        motion.next[i, 0], motion.next[i, 1] = sights.direction[i, 0], sights.direction[i, 1]
        if sights.level[i] >= sights.levels:
            motion.velocity[i, 0], motion.velocity[i, 1] = outside.velocity[i, 0], outside.velocity[i, 1]
        if motion.heading[i, 0] == 0.0 and motion.heading[i, 1] == 0.0:
            motion.heading[i, 0], motion.heading[i, 1] = sights.direction[i, 0], sights.direction[i, 1]
    for i in range(n):
        motion.factor[i] = 1.0
        if sights.wanted[i] > 0.0:
            decide(world, crowd, sights, motion, rule, turn, time, someone_stands, i)
    for i in range(n):
        motion.heading[i, 0], motion.heading[i, 1] = motion.next[i, 0], motion.next[i, 1]
        if sights.wanted[i] <= 0.0:
            continue
        if sights.level[i] >= sights.levels:
            outside.speed_factor[i] *= motion.factor[i]
            continue
        crowd.speed_factor[i] *= motion.factor[i]
        ex, ey = sights.direction[i, 0], sights.direction[i, 1]
        if crowd.extra_direction[i, 0] != 0.0 or crowd.extra_direction[i, 1] != 0.0:
            column = column_of(world.fields, crowd.route[i], crowd.contact_radius[i])
            ex, ey = sample_direction(world.fields, crowd.position[i, 0], crowd.position[i, 1], crowd.level[i], column)
        crowd.extra_direction[i, 0] = motion.next[i, 0] - ex
        crowd.extra_direction[i, 1] = motion.next[i, 1] - ey


@inner
def decide(world, crowd, sights, motion, rule, turn, time, someone_stands, i):  # type: ignore[no-untyped-def]
    """Set heading and speed of person i."""
    wanted = sights.wanted[i]
    is_inside = sights.level[i] < sights.levels
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    if ex == 0.0 and ey == 0.0:  # no way is open
        return
    hx, hy = motion.heading[i, 0], motion.heading[i, 1]
    length, gap = rule.length, rule.time_gap
    if is_inside:
        climb = ex * world.uphill[sights.level[i], 0] + ey * world.uphill[sights.level[i], 1]
        if climb != 0.0:
            length, gap = rule.stair_length, rule.stair_time_gap
    if someone_stands:
        list_near(world, sights, i, rule.sight, 0.0, 0.0, 0.0, 0.0)
    else:
        list_near(world, sights, i, rule.sight, ex, ey, hx, hy)
    first, free = sights.number, rule.sight
    if is_inside:
        if someone_stands:
            first = list_standing(world, sights, rule, i)
        side = side_step(world, crowd, sights, motion, rule, first, i) if rule.side_step > 0.0 else 0.0
        if rule.wall_step > 0.0 and sights.open_to[i] == 0.0:
            step, lowest, highest = wall_step(world, crowd, sights, rule, i)
            side = min(max(side + step, lowest), highest)
        side = min(max(side, -rule.side_limit), rule.side_limit)
        tx, ty = ex - side * ey, ey + side * ex
        norm = math.sqrt(tx * tx + ty * ty)
        tx, ty = tx / norm, ty / norm
        if first < sights.number:
            tx, ty, free = way_round(world, crowd, sights, motion, rule, first, i, tx, ty)
        share = 1.0 if (ex * tx + ey * ty) * (ex * hx + ey * hy) < 0.0 else turn
        gx, gy = hx + share * (tx - hx), hy + share * (ty - hy)
        norm = math.sqrt(gx * gx + gy * gy)
        if norm < 1e-6:
            gx, gy, norm = tx, ty, 1.0
        hx, hy = gx / norm, gy / norm
        motion.next[i, 0], motion.next[i, 1] = hx, hy
    best, least = speed_behind(world, crowd, sights, motion, rule, i, hx, hy, length, gap)
    if first < sights.number:
        free = min(free, free_way(crowd, sights, motion, rule, first, sights.number, i, hx, hy, SOON, TOUCHING))
        free = min(free, free_way(crowd, sights, motion, rule, first, sights.number, i, hx, hy, 0.0, TOUCHING))
        free = free_of_walls(world, crowd, sights, motion, i, free)
        walkers = free_way(crowd, sights, motion, rule, 0, first, i, hx, hy, SOON, TOUCHING)
        # A way of tau u is left to the present velocity u after the desired one is zero.
        stop = crowd.tau[i] * math.sqrt(motion.velocity[i, 0] ** 2 + motion.velocity[i, 1] ** 2)
        if min(free, walkers) < rule.sight:
            best = max(min(best, (min(free, walkers) - stop) / rule.oncoming_time_gap), 0.0)
        if free < rule.sight and will_start(crowd, sights, first, time):
            least = min(max((free - stop) / rule.oncoming_time_gap, 0.0), least)
    motion.factor[i] = max(best, least) / wanted


@inner
def speed_behind(world, crowd, sights, motion, rule, i, hx, hy, length, gap):  # type: ignore[no-untyped-def]
    """Return the speed at which person i keeps its distances along h, and the one below which it does not fall."""
    wanted, is_inside = sights.wanted[i], sights.level[i] < sights.levels
    best, least = wanted, min(rule.creep, wanted)
    for k in range(sights.number):
        j = sights.near[k]
        if sights.wanted[j] <= 0.0 or j == i:
            continue
        dx = sights.position[j, 0] - sights.position[i, 0]
        dy = sights.position[j, 1] - sights.position[i, 1]
        square = dx * dx + dy * dy
        beside = abs(hx * dy - hy * dx)
        wide = max(crowd.contact_radius[i] + crowd.contact_radius[j] - rule.chest_depth, 0.0)
        share = min((rule.width + rule.edge + wide - beside) / rule.edge, 1.0)
        nearest = share * (length + gap * best) + wide
        if beside <= rule.oncoming_width + wide:
            nearest = max(nearest, rule.oncoming_length + wide + rule.oncoming_time_gap * best)
        # In one branch, which is rarely taken: is this person ahead, and near enough to restrict the speed even more?
        if not ((hx * dx + hy * dy > 0.0) & (share > 0.0) & (square < nearest * nearest)):
            continue
        distance, within, leads_on = share * length + wide, share * gap, crowd.route[i] == crowd.route[j]
        is_oncoming = hx * motion.heading[j, 0] + hy * motion.heading[j, 1] <= 0.0
        if is_oncoming and not (wide > 0.0 and leads_on):
            if beside > rule.oncoming_width + wide or not is_inside:
                continue
            distance, within, leads_on = rule.oncoming_length + wide, rule.oncoming_time_gap, False
        elif not is_ahead(crowd, sights, i, j, dx, dy):
            continue
        s = math.sqrt(square)
        leads = motion.velocity[j, 0] * hx + motion.velocity[j, 1] * hy
        speed = (s - distance + rule.anticipation * max(leads, 0.0)) / within
        if speed >= best:
            continue
        if (s <= sights.open_to[i] and sights.level[j] == sights.level[i]) or sees(world, sights, i, j):
            best, least = speed, 0.0 if leads_on else min(rule.creep, wanted)
    return best, least


@inner
def list_standing(world, sights, rule, i):  # type: ignore[no-untyped-def]
    """Move the people inside whom person i sees standing to the end of `sights.near`; return the place of the first."""
    first, k = sights.number, 0
    while k < first:
        j = sights.near[k]
        k += 1
        if sights.wanted[j] > 0.0 or sights.level[j] >= sights.levels:
            continue
        dx, dy = sights.position[j, 0] - sights.position[i, 0], sights.position[j, 1] - sights.position[i, 1]
        s = math.sqrt(dx * dx + dy * dy)
        if not 0.0 < s <= rule.sight:
            continue
        if (s <= sights.open_to[i] and sights.level[j] == sights.level[i]) or sees(world, sights, i, j):
            k, first = k - 1, first - 1
            sights.near[k], sights.near[first] = sights.near[first], j
    return first


@inner
def will_start(crowd, sights, first, time):  # type: ignore[no-untyped-def]
    """Return whether one of those who stand starts later."""
    latest = -math.inf
    for k in range(first, sights.number):
        start = crowd.start_time[sights.near[k]]
        latest = max(latest, start) if start < math.inf else latest
    return time < latest


@inner
def free_way(crowd, sights, motion, rule, first, last, i, hx, hy, soon, clearance):  # type: ignore[no-untyped-def]
    """Return how far person i can walk towards h before it is at a distance `clearance` from some of those near.

    The way leads along the present velocity plus a share `soon` of the change to the desired one; others keep theirs.
    """
    ux, uy = motion.velocity[i, 0], motion.velocity[i, 1]
    x, y = ux + soon * (sights.wanted[i] * hx - ux), uy + soon * (sights.wanted[i] * hy - uy)
    speed, free = math.sqrt(x * x + y * y), rule.sight
    for k in range(first, last):
        j = sights.near[k]
        dx, dy = sights.position[j, 0] - sights.position[i, 0], sights.position[j, 1] - sights.position[i, 1]
        rx, ry = x - motion.velocity[j, 0], y - motion.velocity[j, 1]
        norm = math.sqrt(rx * rx + ry * ry)
        if j == i or norm < FAINT or x * dx + y * dy <= 0.0:
            continue
        along, beside = (rx * dx + ry * dy) / norm, (rx * dy - ry * dx) / norm
        reach = crowd.contact_radius[i] + crowd.contact_radius[j] + clearance
        if along > 0.0 and abs(beside) < reach:
            free = min(free, max(along - math.sqrt(reach * reach - beside * beside), 0.0) * speed / norm)
    return free


@inner
def way_round(world, crowd, sights, motion, rule, first, i, tx, ty):  # type: ignore[no-untyped-def]
    """Return the direction near (tx, ty) that leads person i past those who stand, and the free distance [m]."""
    free = free_way(crowd, sights, motion, rule, first, sights.number, i, tx, ty, SOON, CLEARANCE)
    if free == rule.sight:
        return tx, ty, free
    level, x, y = sights.level[i], sights.position[i, 0], sights.position[i, 1]
    bx, by, most, farthest = tx, ty, -math.inf, free
    for k in range(-TURNS, TURNS + 1):
        cosine, sine = TURNED[k + TURNS]
        cx, cy = cosine * tx - sine * ty, sine * tx + cosine * ty
        free = free_way(crowd, sights, motion, rule, first, sights.number, i, cx, cy, SOON, CLEARANCE)
        if k != 0:
            free = way_to_wall(world, level, x, y, cx, cy, free, crowd.contact_radius[i])
        value = free * (cosine + ASIDE) + STEADY * (cx * motion.heading[i, 0] + cy * motion.heading[i, 1])
        if value > most:
            bx, by, most, farthest = cx, cy, value, free
    return bx, by, farthest


@inner
def free_of_walls(world, crowd, sights, motion, i, free):  # type: ignore[no-untyped-def]
    """Return the free distance of person i, or a shorter one if its velocity leads into a wall within `NEAR_WALL`."""
    ux, uy = motion.velocity[i, 0], motion.velocity[i, 1]
    u = math.sqrt(ux * ux + uy * uy)
    if u < SLOW:
        return free
    near, radius = min(free, NEAR_WALL), crowd.contact_radius[i] - TOUCHING
    x, y = sights.position[i, 0], sights.position[i, 1]
    found = way_to_wall(world, sights.level[i], x, y, ux / u, uy / u, near, radius)
    return found if found < near else free


@inner
def way_to_wall(world, level, x, y, cx, cy, free, radius):  # type: ignore[no-untyped-def]
    """Return a way of at most `free` towards c that leads neither side of a body into a wall, by halving it [m]."""
    for side in (-radius, radius):
        ax, ay = x - side * cy, y + side * cx
        while free > 0.0 and is_hidden(
            world, level, ax, ay, level, ax + (free + radius) * cx, ay + (free + radius) * cy
        ):
            free = 0.5 * free if free > 2.0 * TOUCHING else 0.0
    return free


@inner
def side_step(world, crowd, sights, motion, rule, first, i):  # type: ignore[no-untyped-def]
    """Return the side step of person i, relative to the desired direction, positive to the left."""
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    hx, hy = motion.heading[i, 0], motion.heading[i, 1]
    vx, vy = motion.velocity[i, 0], motion.velocity[i, 1]
    total = 0.0
    farthest = rule.side_range * math.log(2.0 * rule.side_step / FAINT)  # gap at which the greatest weight is faint
    for k in range(first):
        j = sights.near[k]
        dx = sights.position[j, 0] - sights.position[i, 0]
        dy = sights.position[j, 1] - sights.position[i, 1]
        square = dx * dx + dy * dy
        s = math.sqrt(square)
        wx, wy = motion.velocity[j, 0], motion.velocity[j, 1]
        closing = ((vx - wx) * dx + (vy - wy) * dy) / max(s, ON_LINE)
        gap = s - crowd.contact_radius[i] - crowd.contact_radius[j] - closing * rule.side_time
        in_front = (ex * dx + ey * dy >= 0.0) | (hx * dx + hy * dy >= 0.0)
        if not (in_front & (gap <= farthest) & (s <= rule.sight) & (square > 0.0)):
            continue
        cosine = ex * motion.heading[j, 0] + ey * motion.heading[j, 1]
        weight = rule.side_step * (1.0 + 0.5 * (1.0 - cosine)) * math.exp(-max(gap, 0.0) / rule.side_range)
        if weight < FAINT:
            continue
        if not ((s <= sights.open_to[i] and sights.level[j] == sights.level[i]) or sees(world, sights, i, j)):
            continue
        # Where j will be, to the left of the way.
        across = ex * (dy + wy * rule.side_time) - ey * (dx + wx * rule.side_time)
        if cosine < 0.0:
            across += rule.right
        if abs(across) < ON_LINE:
            across = motion.side[i]
        total += -weight if across > 0.0 else weight
    return total


@inner
def wall_step(world, crowd, sights, rule, i):  # type: ignore[no-untyped-def]
    """Return the step of person i away from walls, and the lowest and highest side step that walls leave.

    Side steps are relative to the desired direction, positive to the left. Walls leave no step towards a wall to a wide
    body that touches it.
    """
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    x, y = sights.position[i, 0], sights.position[i, 1]
    left = right = 0.0
    lowest, highest = -math.inf, math.inf
    wide = max(crowd.contact_radius[i] - 0.5 * rule.chest_depth, 0.0)
    first, last = walls_near(world, sights.level[i], x, y, 0.0)
    for slot in range(first, last):
        w = world.bucket_wall[slot]
        if world.wall_open[w]:
            continue
        distance, wx, wy = segment_distance(
            world.wall[w, 0], world.wall[w, 1], world.wall[w, 2], world.wall[w, 3], x, y
        )
        dx, dy = wx - x, wy - y
        weight = rule.wall_step * (1.0 - (distance - wide) / rule.wall_distance)
        if weight > 0.0 and ex * dx + ey * dy >= -BEHIND:
            touches = wide > 0.0 and distance < crowd.contact_radius[i] + TOUCHING
            if ex * dy - ey * dx > 0.0:
                left = max(left, weight)
                highest = 0.0 if touches else highest
            else:
                right = max(right, weight)
                lowest = 0.0 if touches else lowest
    return right - left, lowest, highest
