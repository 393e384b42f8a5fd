"""Driving of pedestrians (eq. 33): desired velocity from the fields and relaxation."""

import math

from evac.building.model.building import DOWN, FLAT, UP
from evac.directions.sampling import column_of, direction_in_cell, node_at, sample_direction
from evac.jit import inner


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
    """Return the unit vector of the sum of a direction and the extra direction of person i.

    Who is let through a closing link leaves its line.
    """
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
    """Read the directions at the nodes around the bodies that have moved to another cell.

    Most are not in the caches. No branch depends on the values, so that the processor can read many at a time.
    """
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
