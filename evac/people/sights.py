"""What people see at a tick: those within a distance whom no wall hides, through portals too, and those outside."""

import math

import numpy as np

from evac.building.model.building import FLAT
from evac.directions.sampling import column_of, sample_direction, sample_travel_time
from evac.jit import ByteGrid, Bytes, FloatGrid, Floats, Ints, Pairs, Struct, inner, kernel
from evac.physics.contact.neighbours import levels_in_reach, line_at, sort_by_level
from evac.physics.motion import desired_direction, desired_speed
from evac.physics.seams import SEAM, crossing, passes_through, reaches, side_of, walls_near, way_out
from evac.physics.state import Cells, World, make_cells

#: Size of the cells of the neighbour search [m].
CELL = 1.0


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


def make_sights(people: int, levels: int) -> Sights:
    """Return the arrays for a number of people and levels of the building."""
    return Sights(
        levels=levels,
        level=np.zeros(people, np.int32),
        position=np.zeros((people, 2)),
        direction=np.zeros((people, 2)),
        wanted=np.zeros(people),
        remaining=np.zeros(people),
        cells=make_cells(people, 2 * levels),
        near=np.zeros(people, np.int32),
        number=0,
        open_to=np.zeros(people),
    )


@inner
def look_round(world, crowd, outside, sights):
    """Set the places of all people, for `list_near` and `sees`; return the number of people inside."""
    inside = 0
    for i in range(crowd.level.shape[0]):
        sights.level[i] = crowd.level[i]
        sights.position[i, 0], sights.position[i, 1] = crowd.position[i, 0], crowd.position[i, 1]
        if crowd.level[i] >= 0:
            inside += 1
        elif outside.level[i] >= 0:
            sights.level[i] = sights.levels + outside.level[i]
            sights.position[i, 0], sights.position[i, 1] = outside.position[i, 0], outside.position[i, 1]
    if inside:
        sort_by_level(sights.cells, sights.level.shape[0], sights.position, sights.level, CELL)
        set_open_distances(world, sights)
    return inside


@inner
def set_desired_motion(world, crowd, outside, sights, time):
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
        column = column_of(world.fields, crowd.route[i], crowd.contact_radius[i])
        sights.remaining[i] = sample_travel_time(world.fields, x, y, level, column)


@inner
def set_open_distances(world, sights):
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
def list_near(world, sights, i, reach, ex, ey, hx, hy):
    """List all people within `reach` [m] whom person i may see in `sights.near`: those ahead of e or of h.

    Of two directions that are zero, everybody is ahead.

    People on other levels are seen through portals only, and people outside from the level that they have left, or
    through portals; these see only others outside of the same level.
    """
    sights.number = 0
    own = sights.level[i]
    if own >= sights.levels:
        list_level(sights, i, own, reach, ex, ey, hx, hy)
        return
    slack = 2.0 * max(SEAM, world.rounding)
    for k in range(levels_in_reach(world, own, sights.position[i, 0], sights.position[i, 1], reach + slack)):
        level = world.linked_level[world.linked_start[own] + k]
        list_level(sights, i, level, reach, ex, ey, hx, hy)
        list_level(sights, i, level + sights.levels, reach, ex, ey, hx, hy)


@inner
def list_level(sights, i, level, reach, ex, ey, hx, hy):
    """Add the people of a level within `reach` [m] of person i, and ahead of e or h, to `sights.near`."""
    cells = sights.cells
    columns, rows, wraps = cells.columns[level], cells.rows[level], cells.wraps[level]
    if columns == 0:  # nobody is there
        return
    x, y, number = sights.position[i, 0], sights.position[i, 1], sights.number
    west, east = max(extent(-ex, ey), extent(-hx, hy)), max(extent(ex, ey), extent(hx, hy))
    south, north = max(extent(-ey, ex), extent(-hy, hx)), max(extent(ey, ex), extent(hy, hx))
    left = line_at(x - reach * west, cells.size) - cells.low_column[level]
    right = line_at(x + reach * east, cells.size) - cells.low_column[level] + 1
    low = line_at(y - reach * south, cells.size) - cells.low_row[level]
    high = line_at(y + reach * north, cells.size) - cells.low_row[level] + 1
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
                j = cells.slots[slot]
                dx, dy = sights.position[j, 0] - x, sights.position[j, 1] - y
                sights.near[number] = j  # without a branch, which the processor could not predict
                is_ahead = (ex * dx + ey * dy >= 0.0) | (hx * dx + hy * dy >= 0.0)
                number += is_ahead & (dx * dx + dy * dy <= reach * reach)
    sights.number = number


@inner
def extent(along, across):
    """Return how far the half of a unit disc ahead of a direction with these components reaches along the first one."""
    return 1.0 if along >= 0.0 else abs(across)


@inner
def is_ahead(crowd, sights, i, j, dx, dy):
    """Return whether person j, at (dx, dy) from i and with a similar heading, is farther ahead on the way."""
    if crowd.route[i] == crowd.route[j] or sights.level[i] >= sights.levels:
        return sights.remaining[j] < sights.remaining[i]
    fx = sights.direction[i, 0] + sights.direction[j, 0]
    fy = sights.direction[i, 1] + sights.direction[j, 1]
    return fx * dx + fy * dy > 0.0


@inner
def sees(world, sights, i, j):
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
def is_hidden(world, a, ax, ay, b, bx, by):
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


@inner
def free_of_walls(world, level, x, y, cx, cy, way):
    """Return how far the straight line from a place towards the unit vector c leads until it meets a wall, or `way`."""
    pieces = int(way / (2.0 * world.bucket_reach)) + 1
    free = way
    for k in range(pieces):
        middle = (k + 0.5) / pieces * way
        if middle - world.bucket_reach > free:
            break
        first, last = walls_near(world, level, x + middle * cx, y + middle * cy, 0.0)
        for slot in range(first, last):
            w = world.bucket_wall[slot]
            if world.wall_open[w]:
                continue
            ax, ay = world.wall[w, 0] - x, world.wall[w, 1] - y
            wx, wy = world.wall[w, 2] - world.wall[w, 0], world.wall[w, 3] - world.wall[w, 1]
            cross = cx * wy - cy * wx
            if cross != 0.0:
                along, share = (ax * wy - ay * wx) / cross, (ax * cy - ay * cx) / cross
                if along > 0.0 and 0.0 <= share <= 1.0:
                    free = min(free, along)
    return free


@inner
def leads_back(world, crowd, level, x, y, cx, cy, way, i):
    """Return whether the line of a length passes a portal from behind which the way of person i leads back."""
    segment = world.link_segment
    for s in range(world.link_start[level], world.link_start[level + 1]):
        share = crossing(segment, s, x, y, x + way * cx, y + way * cy, 0.0)
        if share < 0.0 or world.link_to[s] < 0:
            continue
        px, py = x + share * way * cx, y + share * way * cy
        column = column_of(world.fields, crowd.route[i], crowd.contact_radius[i])
        ex, ey = sample_direction(world.fields, px, py, world.link_to[s], column)
        if side_of(segment[s, 0], segment[s, 1], segment[s, 2], segment[s, 3], px + ex, py + ey) > 0.0:
            return True
    return False


@kernel
def notice_signs(
    world: World,
    position: Pairs,
    level: Ints,
    asks: Bytes,
    sign_at: Pairs,
    sign_level: Ints,
    sign_range: Floats,
    notices: ByteGrid,
) -> None:
    """Mark in `notices` (people, signs) the signs in sight of the people who ask, within the range of each sign [m]."""
    for i in range(level.shape[0]):
        if not asks[i]:
            continue
        x, y = position[i, 0], position[i, 1]
        for j in range(sign_level.shape[0]):
            if not notices[i, j] and is_in_sight(
                world, level[i], x, y, sign_level[j], sign_at[j, 0], sign_at[j, 1], sign_range[j]
            ):
                notices[i, j] = 1


@kernel
def watch_walkers(
    world: World, position: Pairs, level: Ints, asks: Bytes, goal: Ints, reach: float, count: FloatGrid
) -> None:
    """Count in `count` (people, goals) the people in sight within `reach` [m] who walk to each goal; -1 is none."""
    for i in range(level.shape[0]):
        if not asks[i]:
            continue
        x, y = position[i, 0], position[i, 1]
        for j in range(level.shape[0]):
            if (
                goal[j] >= 0
                and j != i
                and is_in_sight(world, level[i], x, y, level[j], position[j, 0], position[j, 1], reach)
            ):
                count[i, goal[j]] += 1.0


@inner
def is_in_sight(world, a, ax, ay, b, bx, by, reach):
    """Return whether a place b is within `reach` [m] of a, and no wall hides it, also through portals."""
    if (bx - ax) ** 2 + (by - ay) ** 2 > reach * reach:
        return False
    return reaches(world, a, ax, ay, b, bx, by) and not is_hidden(world, a, ax, ay, b, bx, by)
