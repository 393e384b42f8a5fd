"""Forces on one person, which may depend on the nearest wall."""

import math

from evac.jit import call_body_force, inner, kernel, row
from evac.physics.contact.contacts import wall_normal
from evac.physics.contact.neighbours import segment_distance
from evac.physics.extent import extent, greatest_extent
from evac.physics.seams import touches
from evac.physics.state import State
from evac.physics.status import OK


@kernel
def add_body_forces(state: State) -> int:
    """Add the forces on single people to ``bodies.push``; return a status, OK."""
    bodies, forces = state.bodies, state.body_forces
    for i in range(bodies.inside):
        if bodies.level[i] < 0:
            continue
        x, y = bodies.position[i, 0], bodies.position[i, 1]
        vx, vy = bodies.velocity[i, 0], bodies.velocity[i, 1]
        ex, ey = bodies.desired[i, 0], bodies.desired[i, 1]
        nearest, nx, ny = _nearest_wall(state, i, forces.farthest)
        for f in range(forces.number):
            gap, ux, uy = math.inf, 0.0, 0.0
            if nearest < forces.cutoff[f]:
                gap, ux, uy = nearest, nx, ny
            given = row(forces.parameters, f)
            fx, fy = call_body_force(forces.address[f], x, y, vx, vy, ex, ey, gap, ux, uy, given)
            bodies.push[i, 0] += fx
            bodies.push[i, 1] += fy
    return OK


@inner
def _nearest_wall(state, i, reach):
    """Return the gap to the nearest wall of body i and the unit vector towards the body; infinity from `reach` on.

    Walls of other levels are reached through portals, as in contacts.
    """
    world, bodies, lists = state.world, state.bodies, state.lists
    x, y = bodies.position[i, 0], bodies.position[i, 1]
    nearest, nx, ny = greatest_extent(bodies, i) + reach, 0.0, 0.0
    is_found = False
    for slot in range(lists.wall_start[i], lists.wall_start[i + 1]):
        w = lists.wall_item[slot]
        distance, px, py = segment_distance(
            world.wall[w, 0], world.wall[w, 1], world.wall[w, 2], world.wall[w, 3], x, y
        )
        if distance >= nearest or world.wall_open[w]:
            continue
        if touches(state, bodies.level[i], x, y, world.wall_level[w], px, py):
            nx, ny = wall_normal(world, bodies, i, w, x - px, y - py, distance)
            nearest = distance
            is_found = True
    if is_found:
        return nearest - extent(bodies, i, -nx, -ny), nx, ny
    return math.inf, 0.0, 0.0
