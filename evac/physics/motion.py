"""Motion of people: desired velocities and relaxation (eq. 33), new positions, crossings, walls, energy balance."""

import math

from evac.building.model.building import DOWN, FLAT, UP
from evac.directions.sampling import column_of, direction_in_cell, node_at, sample_direction
from evac.jit import inner
from evac.physics import tallies as at
from evac.physics.contact.contacts import normal_velocity, tangential_velocity
from evac.physics.contact.neighbours import CROSSED, NEAR, segment_distance
from evac.physics.extent import greatest_extent
from evac.physics.seams import crossing, is_absent, lets_through, passes_through, touches
from evac.physics.status import EVENTS_FULL, NOT_FINITE, OK, TOO_FAST, WALL_CROSSED


@inner
def desired_speed(world, bodies, i, ex, ey):
    """Return the desired plan speed of body i [m/s]: its speed for the slope class times the cosine of the slope."""
    level = bodies.level[i]
    climb = ex * world.uphill[level, 0] + ey * world.uphill[level, 1]
    use = FLAT
    if climb > 0.0:
        use = UP
    elif climb < 0.0:
        use = DOWN
    return bodies.speed[i, use] * bodies.speed_factor[i] * world.cosine[level]


@inner
def desired_direction(world, people, i):
    """Return the unit desired direction of person i, (0, 0) where the destination cannot be reached."""
    x, y = people.position[i, 0], people.position[i, 1]
    column = column_of(world.fields, people.route[i], people.contact_radius[i])
    ex, ey = sample_direction(world.fields, x, y, people.level[i], column)
    return _with_extra_direction(people, i, ex, ey)


@inner
def _with_extra_direction(people, i, ex, ey):
    """Return the unit vector of a direction plus the extra one of person i, who leaves the line of a closing link."""
    if people.passing[i] >= 0 and (people.ahead[i, 0] != 0.0 or people.ahead[i, 1] != 0.0):
        return people.ahead[i, 0], people.ahead[i, 1]
    if people.extra_direction[i, 0] != 0.0 or people.extra_direction[i, 1] != 0.0:
        ex += people.extra_direction[i, 0]
        ey += people.extra_direction[i, 1]
        norm = math.sqrt(ex * ex + ey * ey)
        if norm > 0.0:
            ex /= norm
            ey /= norm
    return ex, ey


@inner
def _read_directions(fields, bodies):
    """Read the directions at the nodes around the bodies that have moved to another cell."""
    # Most are not in the caches. No branch depends on the values, so that the processor can read many at a time.
    arrived = 0
    for i in range(bodies.inside):
        level = bodies.level[i]
        if level >= 0:
            node, _, _, _, _ = node_at(fields, bodies.position[i, 0], bodies.position[i, 1], level, bodies.column[i])
            bodies.picked[arrived] = i
            arrived += (node != bodies.node[i]) & (node >= 0)
            bodies.node[i] = node
    for k in range(arrived):
        i = bodies.picked[k]
        low = bodies.node[i]
        high = low + fields.shape[bodies.level[i], 1]
        for axis in range(2):
            bodies.around[4 * i, axis] = fields.direction[low, axis]
            bodies.around[4 * i + 1, axis] = fields.direction[low + 1, axis]
            bodies.around[4 * i + 2, axis] = fields.direction[high, axis]
            bodies.around[4 * i + 3, axis] = fields.direction[high + 1, axis]


@inner
def set_desired(world, bodies):
    """Set the unit desired directions of the bodies from their positions, and set the forces to zero."""
    fields = world.fields
    _read_directions(fields, bodies)
    for i in range(bodies.inside):
        bodies.push[i, 0] = 0.0
        bodies.push[i, 1] = 0.0
        level = bodies.level[i]
        if level < 0:
            continue
        node, ix, iy, fx, fy = node_at(fields, bodies.position[i, 0], bodies.position[i, 1], level, bodies.column[i])
        ex, ey = 0.0, 0.0
        if node >= 0:
            ex, ey = direction_in_cell(
                fields, level, bodies.column[i], node, ix, iy, fx, fy, bodies.around, 4 * i, 4 * i + 2
            )
        ex, ey = _with_extra_direction(bodies, i, ex, ey)
        bodies.desired[i, 0] = ex
        bodies.desired[i, 1] = ey


@inner
def drive(state):
    """Set ``bodies.free``, the velocity after the sub-step without contacts; return the largest speed [m/s].

    Integrates eq. 33 by explicit Euler as in the paper, or by the exact solution of its linear term with constant
    forces during the step; without inertia, the velocity is the steady one, v e_d + tau f / m. Before its response
    time, a person wants to stand. Desired velocities are relative to the ground, which moves on escalators.
    """
    world, bodies = state.world, state.bodies
    time, h, explicit, overdamped = state.clock.time, state.clock.h, state.clock.explicit, state.traits.overdamped
    if not explicit and not overdamped and bodies.relaxation_step != h:
        for i in range(bodies.inside):
            bodies.relaxation[i] = -math.expm1(-h / bodies.tau[i])
    fastest = 0.0
    for i in range(bodies.inside):
        if bodies.level[i] < 0:
            continue
        vx = world.carry[bodies.level[i], 0]
        vy = world.carry[bodies.level[i], 1]
        if time >= bodies.start_time[i]:
            ex, ey = bodies.desired[i, 0], bodies.desired[i, 1]
            speed = desired_speed(world, bodies, i, ex, ey)
            vx += speed * ex
            vy += speed * ey
        ux, uy = bodies.velocity[i, 0], bodies.velocity[i, 1]
        tau = bodies.tau[i]
        if overdamped:
            ux, uy = 0.0, 0.0
            fx = tau / bodies.mass[i] * bodies.push[i, 0] + vx
            fy = tau / bodies.mass[i] * bodies.push[i, 1] + vy
        else:
            if explicit:
                share = h / tau
                weight = h * bodies.inverse_mass[i]
            else:
                share = bodies.relaxation[i]
                weight = tau * share * bodies.inverse_mass[i]
            fx = ux + share * (vx - ux) + weight * bodies.push[i, 0]
            fy = uy + share * (vy - uy) + weight * bodies.push[i, 1]
        bodies.free[i, 0] = fx
        bodies.free[i, 1] = fy
        fastest = max(fastest, fx * fx + fy * fy, ux * ux + uy * uy)
    return math.sqrt(fastest)


PORTAL = 0
EXIT = 1

#: Depth of the shallowest levels [m]: who has crossed a portal is farther than this from what is behind two more.
LEAST_DEPTH = 1.0


@inner
def save_bodies(bodies):
    """Save the bodies as they are at the start of a step."""
    for i in range(bodies.inside):
        for k in range(2):
            bodies.old_position[i, k] = bodies.position[i, k]
            bodies.old_velocity[i, k] = bodies.velocity[i, k]
        bodies.old_level[i] = bodies.level[i]
        bodies.old_distance[i] = bodies.distance[i]


@inner
def _crosses_wall(state, i, ax, ay, bx, by):
    """Return whether the path a-b of body i passes through a wall that acts on it."""
    world, bodies, lists = state.world, state.bodies, state.lists
    for slot in range(lists.wall_start[i], lists.wall_start[i + 1]):
        w = lists.wall_item[slot]
        if is_absent(world, bodies, w, i) or not passes_through(world.wall, w, ax, ay, bx, by):
            continue
        _, px, py = segment_distance(world.wall, w, ax, ay)
        if touches(state, bodies.level[i], ax, ay, world.wall_level[w], px, py):
            return True
    return False


@inner
def _cross_links(state, i, ax, ay, bx, by, time, h):
    """Move body i through the portals and exits on its path a-b; return OK or EVENTS_FULL."""
    world, bodies, lists, events = state.world, state.bodies, state.lists, state.events
    passed = 0.0
    for _ in range(4):
        level = bodies.level[i]
        best = 2.0
        link = -1
        for s in range(world.link_start[level], world.link_start[level + 1]):
            if not lets_through(world, bodies, world.link_id[s], i):
                continue
            share = crossing(world.link_segment, s, ax, ay, bx, by, 0.0)
            if passed <= share < best:
                best = share
                link = s
        if link < 0:
            return OK
        n = events.number
        if n == events.row.shape[0]:
            return EVENTS_FULL
        leaves = world.link_to[link] < 0
        events.row[n] = bodies.row[i]
        events.kind[n] = EXIT if leaves else PORTAL
        events.link[n] = world.link_id[link]
        events.time[n] = time + best * h
        events.number = n + 1
        if world.link_open[world.link_id[link]] > 1:
            bodies.passing[i] = world.link_id[link]
        bodies.level[i] = world.link_to[link]
        if leaves:
            return OK
        # The lists also have what is near behind the first link, unless they reach across the level there.
        if bodies.near_link[i] != NEAR or max(lists.pair_reach, lists.wall_reach) > LEAST_DEPTH:
            lists.stale = 1
        bodies.near_link[i] = CROSSED
        passed = best
    return OK


@inner
def move(state, time, h, old_share, is_walk):
    """Move the bodies by h times the velocity ``bodies.solved``; return a status.

    The velocity includes the share `old_share` of the old one. If `is_walk`, the path is added to the distance, up to
    an exit, and the driving work m (V - u).(u + u+)/2 with the free velocity V is added to the tally, unless
    bodies have no inertia. Lists become stale when a body has moved by half their skin.
    """
    bodies, lists, events, full = state.bodies, state.lists, state.events, state.clock.full
    works = is_walk and not state.traits.overdamped
    work = 0.0
    stale_beyond = (0.5 * lists.skin) ** 2
    for i in range(bodies.inside):
        if bodies.level[i] < 0:
            continue
        ux, uy = bodies.solved[i, 0], bodies.solved[i, 1]
        vx, vy = bodies.velocity[i, 0], bodies.velocity[i, 1]
        if works:
            x = (bodies.free[i, 0] - vx) * (vx + ux)
            y = (bodies.free[i, 1] - vy) * (vy + uy)
            work += 0.5 * bodies.mass[i] * (x + y)
        mx = (1.0 - old_share) * ux + old_share * vx
        my = (1.0 - old_share) * uy + old_share * vy
        ax, ay = bodies.position[i, 0], bodies.position[i, 1]
        bx = ax + h * mx
        by = ay + h * my
        if not (math.isfinite(bx) and math.isfinite(by)):
            bodies.failed = i
            return NOT_FINITE
        path = h * math.sqrt(mx * mx + my * my)
        if path > greatest_extent(bodies, i) + lists.wall_reach + 0.5 * lists.skin:
            bodies.failed = i  # beyond the walls in the lists
            return TOO_FAST
        if (full or path >= bodies.wall_distance[i]) and _crosses_wall(state, i, ax, ay, bx, by):
            bodies.failed = i
            return WALL_CROSSED
        bodies.position[i, 0] = bx
        bodies.position[i, 1] = by
        bodies.velocity[i, 0] = ux
        bodies.velocity[i, 1] = uy
        if full or bodies.near_link[i] or path > lists.skin:
            status = _cross_links(state, i, ax, ay, bx, by, time, h)
            if status != OK:
                return status
            if bodies.level[i] < 0:
                path *= (events.time[events.number - 1] - time) / h
        if is_walk:
            bodies.distance[i] += path
        dx, dy = bx - bodies.built_position[i, 0], by - bodies.built_position[i, 1]
        if dx * dx + dy * dy > stale_beyond and bodies.level[i] >= 0:
            lists.stale = 1
    state.tally[at.DRIVING_WORK] += work
    return OK


@inner
def add_contact_work(bodies, contacts, tally):
    """Add the kinetic energy lost and gained in contacts [J] to the tally."""
    dissipated, created = tally[at.CONTACT_DISSIPATION], tally[at.CONTACT_CREATION]
    for c in range(contacts.number):
        before_and_after = contacts.velocity_before[c] + normal_velocity(bodies.solved, contacts, c)
        work = 0.5 * contacts.percussion[c] * before_and_after
        if contacts.sticky[c]:
            slide = contacts.slide_before[c] + tangential_velocity(bodies.solved, contacts, c)
            work += 0.5 * contacts.friction[c] * slide
        dissipated -= min(work, 0.0)
        created += max(work, 0.0)
    tally[at.CONTACT_DISSIPATION] = dissipated
    tally[at.CONTACT_CREATION] = created
