"""Walking: people keep a distance, take the heading with the most progress, and let others pass."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.directions.sampling import column_of, sample_direction
from evac.jit import Bytes, Floats, Ints, Pairs, Struct, inner, kernel
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.outside import Outside
from evac.people.sights import (
    Sights,
    free_of_walls,
    is_ahead,
    leads_back,
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

#: Angle between the headings that people compare, and their number on each side of the desired direction.
TURN, TURNS = math.pi / 12.0, 5
TURNED = tuple((math.cos(TURN * k), math.sin(TURN * k)) for k in range(TURNS + 1))

#: Gap to the bodies of others at which people stop [m]; it also keeps them from sliding along each other.
GAP = 0.05

#: Cosine of 45 degrees: people on other routes walk the same way, cross or oppose, by the angle of the directions.
DIAGONAL = math.sqrt(0.5)

#: Share of the distance from a body that counts as its radius at most, so that people slide past whom they touch.
SLIDES = 0.95

#: Relative speed below which two people do not approach [m/s].
FAINT = 0.03

#: Greatest component of a unit vector, with rounding errors.
LONGEST = 1.0 + 1e-9

#: Relations of people whom a person sees: ahead on the same way, on another way, standing, standing firm, and of no
#: effect but bodies.
LEADS, PASSES, STANDS, FIRM, BESIDE = 1, 2, 3, 4, 0

#: Whether walls hide somebody; it is found out when somebody would restrict a person.
HIDDEN, IN_SIGHT, UNKNOWN = 0, 1, 2


class Rule(Struct):
    """The parameters of `Walking`."""

    chest_depth: float
    breadth: float
    length: float
    stair_length: float
    headway: float
    anticipation: float
    foresight: float  # the headway of people as measured, also with regulation
    horizon: float
    stop_time: float
    right: float
    reaction_time: float
    creep: float
    push: float
    clearance: float


class Motion(Struct):
    """What people have decided, and how they have moved."""

    heading: Pairs  # (n, 2) unit heading of the last tick; (0, 0) before the first one
    next: Pairs  # (n, 2) that of this tick
    velocity: Pairs  # (n, 2) displacement velocity in the last tick [m/s]
    left: Floats  # (n,) speed that others left in the last tick, by which people decide how far they look [m/s]
    standing: int  # number of people who do not want to walk
    fastest: float  # greatest velocity [m/s]
    widest: float  # greatest contact radius [m]


class Seen(Struct):
    """The people near one person who may restrict it."""

    number: int
    who: Ints  # (n,)
    relation: Bytes  # (n,) LEADS, PASSES, STANDS or BESIDE
    sight: Bytes  # (n,) HIDDEN, IN_SIGHT or UNKNOWN
    place: Pairs  # (n, 2) from the person [m]
    velocity: Pairs  # (n, 2) [m/s]
    distance: Floats  # (n,) of centres [m]
    reach: Floats  # (n,) sum of the contact radii [m]
    bound: Floats  # (n,) speed below which the person does not restrict along any heading [m/s]
    order: Ints  # (n,) their rows, the lowest bound first


class Walking(Behaviour):
    """People keep distances, take the heading along which they get on best, let others pass, and do not push.

    At every tick, people choose a heading and a speed from what they see within the way of `horizon`, also through
    portals, but not behind walls. For a person i, e is the desired direction, h the heading and v0 the desired speed;
    for another person j, s is the distance of centres, h_j the heading and u_j the velocity.

    Speed that j leaves to i along h:

    - j walks the same way (with the same route and e.h_j > 0, or with directions less than 45 degrees apart) and is
      farther ahead: (s - w l + T_a max(0, u_j.h)) / (w (T + T_a)). The weight is w = min(1, 2 (1 - y / b)), where y is
      the distance of j beside the line of h, now or after the time T, whichever is less, and 0 if j changes sides.
      In single file at the speed u, distances are l + T u.
    - j walks another way: the free way along h at v0 until the bodies touch while j keeps its velocity, divided by
      t_h. Of two who cross, at directions 45 to 135 degrees apart, only the one behind heeds the other. Oncoming people
      count as if they were `right` farther to the left, so that people pass on the right.
    - j stands: as on another way. Ways lead round people who stand firm (`Crowd.firmness`), without the gap.

    Heading: among those up to 75 degrees from e, the one with the greatest product of the speed that people and walls
    leave along it and the cosine of its angle to e, and a step away from walls nearer than `clearance`. The step is
    that of the place where the person will be after the reaction time and the relaxation time, so that nobody swings
    from wall to wall. None but e leads over a portal from behind which the way leads back. The heading turns with
    the time constant `reaction_time`, at first to the side if it has to turn by more than 90 degrees from the heading
    before, or from the velocity of those who move faster than `creep`.

    Speed: the least that others leave along the heading, where those on other ways and those who stand count until
    t_s before the bodies touch. It is at least `creep`, but 0 behind people on the same route and before people who
    have not started, so that queues keep their distances and nobody pushes.

    Bodies: what leads into a body within t_s is removed from the velocity. On other ways, it is turned to the right of
    those who come and behind those who cross, and up to `push` of it remains, so that nobody waits for ever.

    Bodies that touch have half the depth of the chest as radius, because shoulders turn. For wider bodies, such as
    wheelchairs, the distances increase by the excess width of both. People who have left count until they are 2 m
    behind their exit; they keep distances, but do not turn aside. Before people start, forces between people do not
    move them.

    Notes
    -----
    `length` and `headway` are close to single file as measured by Seyfried et al., where distances are 0.36 m + 1.06
    s u. `chest_depth`, `breadth`, `anticipation`, `reaction_time` and `clearance` are fitted to flows through doors
    of 0.5 to 2.5 m and to speeds in a corridor, `stair_length` to the flow down a stair, `horizon`, `stop_time`,
    `right`, `push` and `creep` to people who come towards each other or cross, who must not block each other. The
    remaining numbers are the gap of 0.05 m to the bodies of others and, for ways round a crowd, its density of 1 per
    square metre.

    References
    ----------
    Tordeux, Chraibi, Seyfried: Collision-free speed model for pedestrian dynamics. Traffic and Granular Flow '15
    (2016), 225-232, and Xu, Chraibi, Seyfried: Anticipation in a velocity-based model for pedestrian dynamics.
    Transportation Research C 133 (2021) 103464, for the speed; Seyfried, Steffen, Klingsch, Boltes: The fundamental
    diagram of pedestrian movement revisited. Journal of Statistical Mechanics (2005) P10002, for distances in single
    file; Moussaid, Helbing, Theraulaz: How simple rules determine pedestrian behavior and crowd disasters. PNAS 108
    (2011) 6884-6888, for the comparison of headings.
    """

    name = "walking"
    saved = ("heading",)
    group_keys = ("chest_depth",)
    reads = ("position", "level", "contact_radius", "speed", "tau", "start_time", "route", "firmness")
    writes = ("speed_factor", "extra_direction")
    acts_last = True
    keeps_distance = True
    stands_firm = True

    preset = Parameter(
        "measured",
        "measured: as in experiments; regulation: without anticipation and with 3.2 times the headway, with the flows "
        "through doors that standard tests prescribe",
        choices=("measured", "regulation"),
    )
    chest_depth = Parameter(
        0.30, "depth of the chest, the diameter of bodies that touch", "m", minimum=0.02, maximum=2.0
    )
    breadth = Parameter(
        0.61,
        "breadth b of the shoulders: people beside the way restrict nobody from it on",
        "m",
        above=0.1,
        maximum=4.0,
    )
    length = Parameter(0.4, "distance of centres l at which people stop behind others", "m", minimum=0.0, maximum=2.0)
    stair_length = Parameter(0.6, "distance l on stairs", "m", minimum=0.0, maximum=2.0)
    headway = Parameter(
        0.8,
        "time T by which the distance in a file increases with the speed, and after which people ahead count where "
        "they will be",
        "s",
        above=0.0,
        maximum=60.0,
    )
    anticipation = Parameter(
        2.2, "time T_a for which the motion of the person ahead counts", "s", minimum=0.0, maximum=60.0
    )
    horizon = Parameter(
        1.5, "time t_h for which people look ahead when they compare headings", "s", minimum=0.1, maximum=10.0
    )
    stop_time = Parameter(
        0.5, "time t_s in which people stop before they touch others", "s", minimum=0.05, maximum=10.0
    )
    right = Parameter(
        0.1, "distance by which oncoming people seem to be farther to the left", "m", minimum=-5.0, maximum=5.0
    )
    reaction_time = Parameter(0.2, "time constant with which the heading turns", "s", minimum=0.0, maximum=10.0)
    creep = Parameter(0.2, "least speed of people who are blocked by others", "m/s", minimum=0.0, maximum=1.0)
    push = Parameter(
        1.0, "greatest speed at which people touch those who walk another way", "m/s", minimum=0.0, maximum=5.0
    )

    clearance = Parameter(
        0.2, "distance that people keep from walls where there is room", "m", minimum=0.0, maximum=BUCKET_REACH
    )

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
        self.heading, following, velocity = np.zeros((3, n, 2))
        self._motion = Motion(
            heading=self.heading,
            next=following,
            velocity=velocity,
            left=np.ones(n),
            standing=0,
            fastest=0.0,
            widest=float(scene.crowd.contact_radius.max(initial=0.0)),
        )
        self._seen = Seen(
            number=0,
            who=np.zeros(n, np.int32),
            relation=np.zeros(n, np.uint8),
            sight=np.zeros(n, np.uint8),
            place=np.zeros((n, 2)),
            velocity=np.zeros((n, 2)),
            distance=np.zeros(n),
            reach=np.zeros(n),
            bound=np.zeros(n),
            order=np.zeros(n, np.int32),
        )
        numbers = {name: getattr(self, name) for name in Rule.kinds if name != "foresight"}
        self._rule = Rule(foresight=self.headway, **numbers)
        if self.preset == "regulation":
            self._rule.anticipation = 0.0
            self._rule.headway = 3.2 * self.headway

    def act(self, crowd: Crowd, time: float) -> None:
        """Set the heading of everybody, and the speed with it."""
        self._motion.velocity[:] = self._displacement_velocity
        walk(self._world, crowd, self._outside, self._sights, self._seen, self._motion, self._rule, self._tick, time)


@kernel
def walk(
    world: World,
    crowd: Crowd,
    outside: Outside,
    sights: Sights,
    seen: Seen,
    motion: Motion,
    rule: Rule,
    tick: float,
    time: float,
) -> None:
    """Apply the rules of `Walking` to all people inside who have started, and to those outside."""
    if look_round(world, crowd, outside, sights) == 0:
        return
    set_desired_motion(world, crowd, outside, sights, time)
    n = crowd.level.shape[0]
    turn = 1.0
    if rule.reaction_time > 0.0:
        turn = 1.0 - math.exp(-tick / rule.reaction_time)
    motion.standing, motion.fastest = 0, 0.0
    for i in range(n):
        motion.next[i, 0], motion.next[i, 1] = sights.direction[i, 0], sights.direction[i, 1]
        if sights.level[i] >= sights.levels:
            motion.velocity[i, 0], motion.velocity[i, 1] = outside.velocity[i, 0], outside.velocity[i, 1]
        if sights.level[i] >= 0:
            motion.standing += sights.wanted[i] <= 0.0
            motion.fastest = max(motion.fastest, math.sqrt(motion.velocity[i, 0] ** 2 + motion.velocity[i, 1] ** 2))
        if motion.heading[i, 0] == 0.0 and motion.heading[i, 1] == 0.0:
            motion.heading[i, 0], motion.heading[i, 1] = sights.direction[i, 0], sights.direction[i, 1]
    for i in range(n):
        if sights.wanted[i] > 0.0:
            decide(world, crowd, outside, sights, seen, motion, rule, turn, time, i)
    for i in range(n):
        motion.heading[i, 0], motion.heading[i, 1] = motion.next[i, 0], motion.next[i, 1]


@inner
def decide(world, crowd, outside, sights, seen, motion, rule, turn, time, i):
    """Set heading, speed factor and extra direction of person i."""
    wanted = sights.wanted[i]
    is_inside = sights.level[i] < sights.levels
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    if ex == 0.0 and ey == 0.0:  # no way is open
        return
    length = rule.length
    if is_inside:
        climb = ex * world.uphill[sights.level[i], 0] + ey * world.uphill[sights.level[i], 1]
        length = rule.stair_length if climb != 0.0 else length
    # People so far away that they leave more than was left before are looked at only if those nearer leave more, too.
    most = min(motion.left[i] + FAINT, wanted)
    found, speed = get_on(world, crowd, sights, seen, motion, rule, length, turn, time, most, i)
    if found > most and most < wanted:
        found, speed = get_on(world, crowd, sights, seen, motion, rule, length, turn, time, wanted, i)
    motion.left[i] = found
    if not is_inside:
        outside.speed_factor[i] *= speed / wanted
        return
    vx, vy = keep_off(world, crowd, sights, seen, rule, i, speed * motion.next[i, 0], speed * motion.next[i, 1])
    speed = math.sqrt(vx * vx + vy * vy)
    crowd.speed_factor[i] *= speed / wanted
    dx, dy = ex, ey
    if speed > 1e-6:
        dx, dy = vx / speed, vy / speed
    if crowd.extra_direction[i, 0] != 0.0 or crowd.extra_direction[i, 1] != 0.0:
        column = column_of(world.fields, crowd.route[i], crowd.contact_radius[i])
        ex, ey = sample_direction(world.fields, crowd.position[i, 0], crowd.position[i, 1], crowd.level[i], column)
    crowd.extra_direction[i, 0], crowd.extra_direction[i, 1] = dx - ex, dy - ey


@inner
def get_on(world, crowd, sights, seen, motion, rule, length, turn, time, most, i):
    """Set the heading of person i; return the speed that people left along the best one at most, and its speed."""
    wanted = sights.wanted[i]
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    hx, hy = motion.heading[i, 0], motion.heading[i, 1]
    carried_x, carried_y = ground_velocity(world, sights, i)
    ux, uy = motion.velocity[i, 0] - carried_x, motion.velocity[i, 1] - carried_y
    moves, found = math.sqrt(ux * ux + uy * uy), 0.0
    look(world, crowd, sights, seen, motion, rule, length, most, i)
    if sights.level[i] < sights.levels:
        tx, ty, found = choose_heading(world, crowd, sights, seen, motion, rule, length, i)
        if sights.open_to[i] == 0.0:
            side = step_from_walls(world, crowd, sights, motion, rule, i)
            tx, ty = tx - side * ey, ty + side * ex
            norm = math.sqrt(tx * tx + ty * ty)
            tx, ty = tx / norm, ty / norm
        # They turn to the side first, always the same: the one to which the heading turns.
        side = 1.0 if hx * ty - hy * tx > 0.0 else -1.0
        if moves > rule.creep and ux * tx + uy * ty < 0.0:
            tx, ty = -side * uy / moves, side * ux / moves
        if hx * tx + hy * ty < 0.0:
            tx, ty = -side * hy, side * hx
        hx, hy = hx + turn * (tx - hx), hy + turn * (ty - hy)
        norm = math.sqrt(hx * hx + hy * hy)
        hx, hy = hx / norm, hy / norm
        motion.next[i, 0], motion.next[i, 1] = hx, hy
    best, least = wanted, min(rule.creep, wanted)
    for rank in range(seen.number):
        k = seen.order[rank]
        if seen.bound[k] >= best:
            break
        if seen.relation[k] == LEADS:
            left = speed_behind(seen, rule, k, hx, hy, length)
        else:
            left = free_way(crowd, seen, motion, rule, k, wanted, i, hx, hy, GAP)
            if seen.relation[k] >= STANDS:  # a way of tau u is left to the present velocity u
                left -= crowd.tau[i] * moves
            left = max(left, 0.0) / rule.stop_time
        if left < best and is_seen(world, sights, seen, i, k):
            best, least = left, min(rule.creep, wanted)
            start = crowd.start_time[seen.who[k]]
            if seen.relation[k] == LEADS or (seen.relation[k] == STANDS and time < start < math.inf):
                least = 0.0
    return max(found, best), max(best, least)


@inner
def look(world, crowd, sights, seen, motion, rule, length, most, i):
    """List the people near person i who may leave it less than the speed `most`, or touch it."""
    wanted, is_inside = sights.wanted[i], sights.level[i] < sights.levels
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    hx, hy = motion.heading[i, 0], motion.heading[i, 1]
    wide = crowd.contact_radius[i] + motion.widest
    stop = max(wide - rule.chest_depth, 0.0) + length
    reach = stop + rule.horizon * wanted
    if motion.standing == 0:  # nobody farther away leaves less
        behind = stop + most * (rule.headway + rule.anticipation)
        aside = abs(rule.right) + most * max(rule.horizon, rule.stop_time) * (1.0 + motion.fastest / wanted)
        reach = min(reach, LONGEST * max(behind, wide + GAP + max(aside, rule.stop_time * wanted)))
    list_near(world, sights, i, reach, ex, ey, hx, hy)
    seen.number = 0
    carried_x, carried_y = ground_velocity(world, sights, i)
    for k in range(sights.number):
        j = sights.near[k]
        dx, dy = sights.position[j, 0] - sights.position[i, 0], sights.position[j, 1] - sights.position[i, 1]
        s = math.sqrt(dx * dx + dy * dy)
        if j == i or s == 0.0:
            continue
        ux, uy = motion.velocity[j, 0] - carried_x, motion.velocity[j, 1] - carried_y
        reach = crowd.contact_radius[i] + crowd.contact_radius[j]
        relation, bound = relation_of(crowd, sights, motion, i, j, dx, dy), math.inf
        if relation == LEADS:
            bound = (s - max(reach - rule.chest_depth, 0.0) - length) / (rule.headway + rule.anticipation)
        elif not is_inside or sights.level[j] >= sights.levels:
            relation = BESIDE
        elif relation == PASSES:
            way = max(s - reach - GAP - abs(rule.right), 0.0) * wanted / (wanted + math.sqrt(ux * ux + uy * uy))
            bound = way / max(rule.horizon, rule.stop_time)
        elif relation >= STANDS:
            bound = -math.inf
        if bound >= most and (s > reach + GAP + rule.stop_time * wanted or not is_inside):
            continue
        m = place = seen.number
        is_clear = not is_inside or (s <= sights.open_to[i] and sights.level[j] == sights.level[i])
        seen.sight[m] = IN_SIGHT if is_clear else UNKNOWN
        seen.who[m], seen.relation[m], seen.distance[m], seen.reach[m] = j, relation, s, reach
        seen.place[m, 0], seen.place[m, 1] = dx, dy
        seen.velocity[m, 0], seen.velocity[m, 1], seen.bound[m] = ux, uy, bound
        while place > 0 and seen.bound[seen.order[place - 1]] > bound:
            seen.order[place] = seen.order[place - 1]
            place -= 1
        seen.order[place] = m
        seen.number = m + 1


@inner
def ground_velocity(world, sights, i):
    """Return the velocity of the ground under person i, which moves on escalators; to it, all others are relative."""
    level = sights.level[i]
    if 0 <= level < sights.levels:
        return world.carry[level, 0], world.carry[level, 1]
    return 0.0, 0.0


@inner
def is_seen(world, sights, seen, i, k):
    """Return whether person i sees the k-th person near it."""
    if seen.sight[k] == UNKNOWN:
        seen.sight[k] = IN_SIGHT if sees(world, sights, i, seen.who[k]) else HIDDEN
    return seen.sight[k] == IN_SIGHT


@inner
def relation_of(crowd, sights, motion, i, j, dx, dy):
    """Return what person j, at (dx, dy) from i, is to it."""
    if sights.wanted[j] <= 0.0:
        return FIRM if crowd.firmness[j] > 1.0 else STANDS
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    cosine = ex * motion.heading[j, 0] + ey * motion.heading[j, 1]
    is_same = crowd.route[i] == crowd.route[j] or sights.level[i] >= sights.levels
    if (is_same or cosine > -DIAGONAL) and not is_ahead(crowd, sights, i, j, dx, dy):
        return BESIDE
    return LEADS if cosine > (0.0 if is_same else DIAGONAL) else PASSES


@inner
def speed_behind(seen, rule, k, hx, hy, length):
    """Return the speed along h that the k-th person, who walks ahead, leaves."""
    dx, dy = seen.place[k, 0], seen.place[k, 1]
    if hx * dx + hy * dy <= 0.0:
        return math.inf
    wide = max(seen.reach[k] - rule.chest_depth, 0.0)
    beside = hx * dy - hy * dx
    later = beside + rule.foresight * (hx * seen.velocity[k, 1] - hy * seen.velocity[k, 0])
    near = 0.0 if beside * later <= 0.0 else min(abs(beside), abs(later))
    share = min(2.0 * (1.0 - (near - wide) / rule.breadth), 1.0)
    if share <= 0.0:
        return math.inf
    leads = max(seen.velocity[k, 0] * hx + seen.velocity[k, 1] * hy, 0.0)
    left = seen.distance[k] - wide - share * length + rule.anticipation * leads
    return left / (share * (rule.headway + rule.anticipation))


@inner
def free_way(crowd, seen, motion, rule, k, wanted, i, hx, hy, gap):
    """Return how far person i can walk along h until it touches the k-th person, who keeps its velocity [m]."""
    dx, dy, s = seen.place[k, 0], seen.place[k, 1], seen.distance[k]
    rx, ry = wanted * hx - seen.velocity[k, 0], wanted * hy - seen.velocity[k, 1]
    norm = math.sqrt(rx * rx + ry * ry)
    if norm < FAINT:
        return math.inf
    ahead, across = (rx * dx + ry * dy) / norm, (rx * dy - ry * dx) / norm
    reach = min(seen.reach[k] + gap, SLIDES * s)
    j = seen.who[k]
    if seen.relation[k] == PASSES and hx * motion.heading[j, 0] + hy * motion.heading[j, 1] < 0.0:
        across += rule.right
    if ahead <= 0.0 or abs(across) >= reach:
        return math.inf
    return max(ahead - math.sqrt(reach * reach - across * across), 0.0) * wanted / norm


@inner
def choose_heading(world, crowd, sights, seen, motion, rule, length, i):
    """Return the heading along which person i gets on best; of two alike, the one nearer to its way or to the right."""
    ex, ey, wanted = sights.direction[i, 0], sights.direction[i, 1], sights.wanted[i]
    best, fastest, bx, by, last = -math.inf, 0.0, ex, ey, -1
    for turned in range(TURNS + 1):
        cosine, sine = TURNED[turned]
        if best >= wanted * cosine:
            break
        for side in range(-1, 2 if turned else 0, 2):
            cx, cy = cosine * ex - side * sine * ey, side * sine * ex + cosine * ey
            speed = wanted
            for rank in range(
                -1 if last >= 0 else 0, seen.number
            ):  # first of all, who left least along the heading before
                k = last if rank < 0 else seen.order[rank]
                if seen.bound[k] >= speed:
                    break
                if seen.relation[k] == LEADS:
                    left = speed_behind(seen, rule, k, cx, cy, length)
                else:
                    # Ways lead round those who stand firm, also through gaps into which bodies just fit.
                    gap = 0.0 if seen.relation[k] == FIRM and not turned else GAP
                    left = free_way(crowd, seen, motion, rule, k, wanted, i, cx, cy, gap) / rule.horizon
                if left < speed and is_seen(world, sights, seen, i, k):
                    speed, last = left, k
                    if speed * cosine <= best:
                        break
            if turned and speed * cosine > max(best, 0.0):
                way = speed * rule.horizon + crowd.contact_radius[i]
                x, y = sights.position[i, 0], sights.position[i, 1]
                way = free_of_walls(world, sights.level[i], x, y, cx, cy, way)
                speed = min(speed, max(way - crowd.contact_radius[i], 0.0) / rule.horizon)
                if leads_back(world, crowd, sights.level[i], x, y, cx, cy, way, i):
                    continue
            if max(speed, 0.0) * cosine > best:
                best, fastest, bx, by = max(speed, 0.0) * cosine, speed, cx, cy
    return bx, by, fastest


@inner
def step_from_walls(world, crowd, sights, motion, rule, i):
    """Return the step aside, to the left and relative to the way ahead, by which person i clears walls.

    Its distance from a wall is the one after the time in which heading and velocity follow.
    """
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    x, y = sights.position[i, 0], sights.position[i, 1]
    drift = (ex * motion.velocity[i, 1] - ey * motion.velocity[i, 0]) * (rule.reaction_time + crowd.tau[i])
    clearance = rule.clearance + max(crowd.contact_radius[i] - 0.5 * rule.chest_depth, 0.0)
    left = right = 0.0
    first, last = walls_near(world, sights.level[i], x, y, 0.0)
    for slot in range(first, last):
        w = world.bucket_wall[slot]
        if world.wall_open[w]:
            continue
        distance, wx, wy = segment_distance(world.wall, w, x, y)
        if ex * (wx - x) + ey * (wy - y) < -GAP:  # behind
            continue
        if ex * (wy - y) - ey * (wx - x) > 0.0:
            left = max(left, clearance - distance + drift)
        else:
            right = max(right, clearance - distance - drift)
    return 2.0 * (right - left) / rule.breadth


@inner
def keep_off(world, crowd, sights, seen, rule, i, vx, vy):
    """Return a velocity without the part that leads into bodies within `stop_time`."""
    for _ in range(2):
        for k in range(seen.number):
            j, s = seen.who[k], seen.distance[k]
            if s > seen.reach[k] + GAP + rule.stop_time * sights.wanted[i] or sights.level[j] >= sights.levels:
                continue
            floor, passes, cosine = 0.0, False, 0.0
            if sights.wanted[j] > 0.0:
                floor = rule.creep
                cosine = (
                    sights.direction[i, 0] * sights.direction[j, 0] + sights.direction[i, 1] * sights.direction[j, 1]
                )
                if crowd.route[i] != crowd.route[j] and cosine <= DIAGONAL:
                    floor, passes = rule.push, True
                    if cosine > -DIAGONAL and not is_ahead(crowd, sights, i, j, seen.place[k, 0], seen.place[k, 1]):
                        continue
            nx, ny = seen.place[k, 0] / s, seen.place[k, 1] / s
            toward = vx * nx + vy * ny
            gap = max(s - seen.reach[k] - (0.0 if seen.relation[k] == FIRM else GAP), 0.0)
            most = max(gap / rule.stop_time + seen.velocity[k, 0] * nx + seen.velocity[k, 1] * ny, floor)
            if toward > most and is_seen(world, sights, seen, i, k):
                turned = toward - most
                vx, vy = vx - turned * nx, vy - turned * ny
                if passes:  # to the right of those who come, and behind those who cross
                    if cosine > -DIAGONAL and seen.velocity[k, 0] * ny - seen.velocity[k, 1] * nx > 0.0:
                        turned = -turned
                    vx, vy = vx + turned * ny, vy - turned * nx
    if sights.open_to[i] == 0.0:
        vx, vy = squeeze_nobody(world, crowd, sights, seen, rule, i, vx, vy)
    return vx, vy


@inner
def squeeze_nobody(world, crowd, sights, seen, rule, i, vx, vy):
    """Return a velocity that does not lead into those who stand where a wall holds the body back."""
    px, py = vx, vy
    x, y = sights.position[i, 0], sights.position[i, 1]
    first, last = walls_near(world, sights.level[i], x, y, 0.0)
    for slot in range(first, last):
        w = world.bucket_wall[slot]
        if world.wall_open[w]:
            continue
        distance, wx, wy = segment_distance(world.wall, w, x, y)
        if distance == 0.0:
            continue
        nx, ny = (wx - x) / distance, (wy - y) / distance
        toward = px * nx + py * ny - max(distance - crowd.contact_radius[i], 0.0) / rule.stop_time
        if toward > 0.0:
            px, py = px - toward * nx, py - toward * ny
    share = 1.0
    for k in range(seen.number):
        if seen.relation[k] >= STANDS:
            s = seen.distance[k]
            toward = (px * seen.place[k, 0] + py * seen.place[k, 1]) / s
            most = max(s - seen.reach[k] - (0.0 if seen.relation[k] == FIRM else GAP), 0.0) / rule.stop_time
            if toward > most and is_seen(world, sights, seen, i, k):
                share = min(share, most / toward)
    return share * vx, share * vy
