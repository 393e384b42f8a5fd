"""Headway: people avoid others and slow down behind people ahead, before bodies touch."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.parameters import Parameter
from evac.building.model.building import FLAT
from evac.directions.sampling import column_of, sample_travel_time
from evac.jit import Floats, Ints, Pairs, Struct, inner, kernel
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.people.outside import Outside
from evac.physics.contact.cells import Cells, line_at, make_cells, sort_by_level
from evac.physics.contact.neighbours import levels_in_reach
from evac.physics.drive import desired_direction, desired_speed
from evac.physics.seams import SEAM, reaches, way_out
from evac.physics.sight import passes_through, walls_near
from evac.physics.state import Crowd, World

#: Repulsions below this share of the desired direction are neglected.
FAINT = 0.01

#: Size of the cells of the neighbour search [m].
CELL = 1.0


class Rule(Struct):
    """The parameters of `Headway`, and the distance beyond which repulsions are neglected [m]."""

    time_gap: float
    length: float
    repulsion: float
    range: float
    cutoff: float


class Sights(Struct):
    """Places and desired motion of all people at a tick, and the cells that they are in.

    People outside are on levels of their own, one behind the exits of each level of the building.
    """

    levels: int  # of the building
    level: Ints  # (n,) level, for people outside plus `levels`; -1 for those who are no longer seen
    position: Pairs  # (n, 2)
    direction: Pairs  # (n, 2) unit desired direction
    wanted: Floats  # (n,) desired plan speed, 0 before the response time [m/s]
    remaining: Floats  # (n,) remaining travel time; for people outside the time since leaving, negative [s]
    cells: Cells  # of each level, and of the people outside of each level
    near: Ints  # (n,) people in the cells around one person, and their number
    number: int
    open_to: Floats  # (n,) distance within which no wall hides people on the same level [m]


class Headway(Behaviour):
    """Directions and speeds of the collision-free speed model (Tordeux, Chraibi and Seyfried, 2016).

    Without this behaviour, people walk at full speed until bodies touch, so that flows through doors are larger than
    measured ones, and flows on stairs several times larger. For each visible person at a distance s, a repulsion

        a exp((l - s) / D)    away from that person

    is added to the desired direction. The desired speed becomes

        min(v, max(0, (s - l) / T))

    with the previous desired speed v and the distance s of centres to the nearest person who

    - is ahead, at most l beside the line of walking, and visible, also through portals;
    - has started and wants to walk;
    - is farther ahead on the way, if the angle between both desired directions is below 90 degrees: has a smaller
      remaining travel time on the same route, or, on another route, is also ahead along the sum of both directions.
      Therefore, of two people side by side at a door one goes first, and nobody waits for a person who waits for it.

    People who have left count until they are 2 m behind their exit, seen through open exits. They walk straight on and
    slow down for those ahead of them outside who walk in a similar direction.

    Bodies wider than l still touch, at a speed of (2 r - l) / T. The behaviour is applied to the speeds and directions
    that other behaviours have set.

    References
    ----------
    Tordeux, Chraibi, Seyfried: Collision-free speed model for pedestrian dynamics. Traffic and Granular Flow '15
    (2016), 225-232, with T = 1 s and l = 0.3 m; a and D are the defaults of this model in JuPedSim. In the published
    model, people slow down for the nearest person ahead; the last two rules, visibility and contacts are additions.
    """

    name = "headway"
    reads = ("position", "level", "radius", "speed", "start_time", "route", "speed_factor", "extra_direction")
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
        self._sights = Sights(
            levels=levels,
            level=np.zeros(n, np.int32),
            position=np.zeros((n, 2)),
            direction=np.zeros((n, 2)),
            wanted=np.zeros(n),
            remaining=np.zeros(n),
            cells=make_cells(n, 2 * levels),
            near=np.zeros(n, np.int32),
            number=0,
            open_to=np.zeros(n),
        )
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
    if set_places(crowd, outside, sights) == 0:
        return
    sort_by_level(sights.cells, sights.level.shape[0], sights.position, sights.level, CELL)
    set_open_distances(world, sights)
    add_repulsions(world, crowd, sights, rule)
    set_desired_motion(world, crowd, outside, sights, time)
    reduce_speeds(world, crowd, outside, sights, rule)


@inner
def set_places(crowd, outside, sights):  # type: ignore[no-untyped-def]
    """Set levels and positions of all people inside and outside; return the number of people inside."""
    inside = 0
    for i in range(crowd.level.shape[0]):
        sights.level[i] = crowd.level[i]
        sights.position[i, 0], sights.position[i, 1] = crowd.position[i, 0], crowd.position[i, 1]
        if crowd.level[i] >= 0:
            inside += 1
        elif outside.level[i] >= 0:
            sights.level[i] = sights.levels + outside.level[i]
            sights.position[i, 0], sights.position[i, 1] = outside.position[i, 0], outside.position[i, 1]
    return inside


@inner
def list_near(world, sights, i, reach):  # type: ignore[no-untyped-def]
    """List all people whom person i can see within `reach` [m], and others, in `sights.near`.

    People on other levels are seen through portals only, and people outside from the level that they have left, or
    through portals; these see only others outside of the same level.
    """
    sights.number = 0
    own = sights.level[i]
    if own >= sights.levels:
        list_level(sights, i, own, reach)
        return
    slack = 2.0 * max(SEAM, world.rounding)
    for k in range(levels_in_reach(world, own, sights.position[i, 0], sights.position[i, 1], reach + slack)):
        level = world.linked_level[world.linked_start[own] + k]
        list_level(sights, i, level, reach)
        list_level(sights, i, level + sights.levels, reach)


@inner
def list_level(sights, i, level, reach):  # type: ignore[no-untyped-def]
    """Add the people of a level in all cells within `reach` [m] of person i to `sights.near`."""
    cells = sights.cells
    columns, rows, wraps = cells.columns[level], cells.rows[level], cells.wraps[level]
    ring = int(reach / cells.size) + 1
    left = line_at(sights.position[i, 0], cells.size) - ring - cells.low_column[level]
    low = line_at(sights.position[i, 1], cells.size) - ring - cells.low_row[level]
    right, high = left + 2 * ring + 1, low + 2 * ring + 1
    if wraps:  # each column and row once
        right, high = min(right, left + columns), min(high, low + rows)
    else:
        left, right, low, high = max(left, 0), min(right, columns), max(low, 0), min(high, rows)
    for column in range(left, right):
        # The rows of a column follow one another, unless they begin again.
        for row in range(low, high if wraps else min(high, low + 1)):
            first = cells.first[level] + column * rows + row
            last = first + high - low
            if wraps:
                first = cells.first[level] + column % columns * rows + row % rows
                last = first + 1
            for slot in range(cells.start[first], cells.start[last]):
                sights.near[sights.number] = cells.slots[slot]
                sights.number += 1


@inner
def add_repulsions(world, crowd, sights, rule):  # type: ignore[no-untyped-def]
    """Add the repulsions a exp((l - s) / D) from people nearby to the directions of all people inside.

    The loops are not divided into functions, since a call with structs costs as much as processing ten people.
    """
    for i in range(crowd.level.shape[0]):
        if crowd.level[i] < 0:
            continue
        px, py = 0.0, 0.0
        list_near(world, sights, i, rule.cutoff)
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
def set_desired_motion(world, crowd, outside, sights, time):  # type: ignore[no-untyped-def]
    """Set the desired directions and speeds and remaining travel times of all people."""
    for i in range(crowd.level.shape[0]):
        sights.wanted[i] = 0.0
        level = sights.level[i]
        if level >= sights.levels:
            sights.direction[i, 0] = outside.direction[i, 0]
            sights.direction[i, 1] = outside.direction[i, 1]
            sights.wanted[i] = crowd.speed[i, FLAT] * outside.speed_factor[i]
            sights.remaining[i] = -outside.depth[i]
        if level < 0 or level >= sights.levels or time < crowd.start_time[i]:
            continue
        ex, ey = desired_direction(world, crowd, i)
        sights.direction[i, 0] = ex
        sights.direction[i, 1] = ey
        sights.wanted[i] = desired_speed(world, crowd, i, ex, ey)
        x, y = sights.position[i, 0], sights.position[i, 1]
        column = column_of(world.fields, crowd.route[i], crowd.radius[i])
        sights.remaining[i] = sample_travel_time(world.fields, x, y, level, column)


@inner
def reduce_speeds(world, crowd, outside, sights, rule):  # type: ignore[no-untyped-def]
    """Reduce the speed factors of people close to the nearest person for whom they slow down."""
    for i in range(crowd.level.shape[0]):
        full = rule.time_gap * sights.wanted[i]
        if full <= 0.0:
            continue
        ex, ey = sights.direction[i, 0], sights.direction[i, 1]
        nearest = rule.length + full
        list_near(world, sights, i, nearest)
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
def brakes_for(crowd, sights, i, j, dx, dy):  # type: ignore[no-untyped-def]
    """Return whether person i slows down for j, who is ahead at (dx, dy): not if j is behind on the same way.

    Of two people outside only the one who is nearer to its exit may slow down, so that nobody waits there for ever.
    """
    if sights.wanted[j] <= 0.0:
        return False
    ex, ey = sights.direction[i, 0], sights.direction[i, 1]
    fx, fy = sights.direction[j, 0], sights.direction[j, 1]
    is_outside = sights.level[i] >= sights.levels
    if ex * fx + ey * fy <= 0.0:
        return not is_outside
    if crowd.route[i] == crowd.route[j] or is_outside:
        return sights.remaining[j] < sights.remaining[i]
    return (ex + fx) * dx + (ey + fy) * dy > 0.0


@inner
def set_open_distances(world, sights):  # type: ignore[no-untyped-def]
    """Set the distance within which visibility need not be tested: 0 for people with walls nearby."""
    for i in range(sights.level.shape[0]):
        if sights.level[i] >= sights.levels:
            sights.open_to[i] = math.inf
        elif sights.level[i] >= 0:
            sights.open_to[i] = world.bucket_reach
            first, last = walls_near(world, sights.level[i], sights.position[i, 0], sights.position[i, 1], 0.0)
            for slot in range(first, last):
                if not world.wall_open[world.bucket_wall[slot]]:
                    sights.open_to[i] = 0.0


@inner
def sees(world, sights, i, j):  # type: ignore[no-untyped-def]
    """Return whether the straight line from person i to j ends on the level of j and crosses no wall of either level.

    The line follows at most two portals, as in `reaches`; walls of a level between two portals are ignored. A person
    outside is seen up to an open exit of the level that it has left.
    """
    a, b = sights.level[i], sights.level[j]
    ax, ay, bx, by = sights.position[i, 0], sights.position[i, 1], sights.position[j, 0], sights.position[j, 1]
    if a >= sights.levels:
        return False
    if b >= sights.levels:
        b -= sights.levels
        share = way_out(world, b, ax, ay, bx, by, max(SEAM, world.rounding))
        if share < 0.0:
            return False
        bx, by = ax + share * (bx - ax), ay + share * (by - ay)
        if a != b and not reaches(world, a, ax, ay, b, bx, by):
            return False
    elif not reaches(world, a, ax, ay, b, bx, by):
        return False
    return not is_hidden(world, a, ax, ay, b, bx, by)


@inner
def is_hidden(world, a, ax, ay, b, bx, by):  # type: ignore[no-untyped-def]
    """Return whether the straight line from one place to another crosses a wall of level a or b."""
    # A bucket lists the walls within its reach, so this number of buckets along the line covers all crossing walls.
    pieces = int(math.sqrt((bx - ax) ** 2 + (by - ay) ** 2) / (2.0 * world.bucket_reach)) + 1
    for k in range(pieces):
        share = (k + 0.5) / pieces
        x, y = ax + share * (bx - ax), ay + share * (by - ay)
        for end in range(1 if a == b else 2):
            first, last = walls_near(world, b if end else a, x, y, 0.0)
            for slot in range(first, last):
                w = world.bucket_wall[slot]
                if not world.wall_open[w] and passes_through(world.wall, w, ax, ay, bx, by):
                    return True
    return False


evac_interface = 3
