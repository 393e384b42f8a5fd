"""Contact search: gaps and normals of bodies and walls in reach, and warm start percussions.

A wall contact is a disc against a segment, with one constraint per segment. A segment is dropped if a nearer one
implies its constraint, since keeping it would push people sideways at joints of walls.

What a law keeps of each contact from one sub-step to the next, as wide as `ContactModel.memory` declares, is kept
within a tick by body and key, in the order of contacts; between two ticks, in which bodies change places, and in
checkpoints by person. A contact that is open at the end of a sub-step is forgotten.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.jit import AddressCall, inlined, inner, kernel, row
from evac.physics.contact.neighbours import segment_distance, unit_normal
from evac.physics.extent import extent, greatest_extent
from evac.physics.seams import is_absent, touches
from evac.physics.state import State
from evac.physics.status import CONTACTS_FULL, NEAR_WALLS_FULL, OK

#: Call `recall` or `retain` at its address.
call_memory = AddressCall([State], (int,))


@inner
def mark_start(kept):
    """Note what is kept at the start of a step, so that the step can be undone."""
    kept.half_before = kept.half
    kept.number_before = kept.number


@inner
def slot_of(kept, slot, i, key):
    """Return the first slot from `slot` on, in the half in use, that is not before that of body i and key."""
    last = kept.half * kept.size + kept.number
    while slot < last and (kept.body[slot] < i or (kept.body[slot] == i and kept.key[slot] < key)):
        slot += 1
    return slot


@inner
def holds(kept, slot, i, key):
    """Return whether the slot that `slot_of` returned is that of body i and key."""
    return slot < kept.half * kept.size + kept.number and kept.body[slot] == i and kept.key[slot] == key


@kernel
def recall(state: State) -> int:
    """Set the memory of the contacts that were found; zero where bodies do not overlap, and for new contacts."""
    contacts, kept = state.contacts, state.memory
    slot = kept.half * kept.size
    for c in range(contacts.number):
        slot = slot_of(kept, slot, contacts.body[c], contacts.key[c])
        is_known = contacts.gap[c] < 0.0 and holds(kept, slot, contacts.body[c], contacts.key[c])
        for k in range(contacts.memory.shape[1]):
            contacts.memory[c, k] = kept.value[slot, k] if is_known else 0.0
    return OK


@kernel
def retain(state: State) -> int:
    """Keep the memory of the contacts of this sub-step, except zeros, in the half without that of the step's start."""
    contacts, kept = state.contacts, state.memory
    kept.half = 1 - kept.half_before
    slot = kept.half * kept.size
    for c in range(contacts.number):
        kept.body[slot] = contacts.body[c]
        kept.key[slot] = contacts.key[c]
        is_zero = True
        for k in range(contacts.memory.shape[1]):
            kept.value[slot, k] = contacts.memory[c, k]
            is_zero = is_zero and contacts.memory[c, k] == 0.0
        if not is_zero:
            slot += 1
    kept.number = slot - kept.half * kept.size
    return OK


@inner
def new_memory(contacts):
    """Return the memory of a contact that begins, for a trial, in the row behind those of contacts."""
    last = contacts.memory.shape[0] - 1
    for k in range(contacts.memory.shape[1]):
        contacts.memory[last, k] = 0.0
    return row(contacts.memory, last)


@inner
def tried_memory(contacts, c):
    """Return a copy of the memory of contact c for a trial, in the row behind those of contacts."""
    last = contacts.memory.shape[0] - 1
    for k in range(contacts.memory.shape[1]):
        contacts.memory[last, k] = contacts.memory[c, k]
    return row(contacts.memory, last)


def memory_by_person(state: State) -> dict[str, NDArray[Any]]:
    """Return the `pairs` (m, 2) whose contact is remembered, and their `numbers` (m, width), between two ticks.

    A pair is two persons, the lower one first, or a person and a wall less the number of walls; pairs are sorted.
    """
    kept = state.memory
    here = slice(kept.half * kept.size, kept.half * kept.size + kept.number)
    pairs = np.column_stack([kept.body[here], kept.key[here]]).astype(np.int64)
    return dict(zip(("pairs", "numbers"), _renumbered(pairs, kept.value[here], state.bodies.row), strict=True))


def remember_by_person(state: State, pairs: NDArray[np.int64], numbers: FloatArray) -> None:
    """Set the memory at the start of a tick from what `memory_by_person` returned; who has left is forgotten."""
    bodies, kept = state.bodies, state.memory
    body = np.full(len(bodies.row), -1)
    body[bodies.row[: bodies.inside]] = np.arange(bodies.inside)
    pairs, numbers = _renumbered(pairs, numbers, body)
    kept.half, kept.number = 0, len(pairs)
    kept.body[: len(pairs)], kept.key[: len(pairs)] = pairs.T
    kept.value[: len(pairs)] = numbers


def _renumbered(
    pairs: NDArray[np.int64], value: FloatArray, number: NDArray[np.integer]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return sorted pairs with other numbers of people, the lower first, without those whose number is -1."""
    first, is_wall = number[pairs[:, 0]], pairs[:, 1] < 0
    second = np.where(is_wall, pairs[:, 1], number[np.maximum(pairs[:, 1], 0)])
    here = (first >= 0) & (is_wall | (second >= 0))
    pair, value = np.column_stack([first, second])[here].astype(np.int64), value[here]
    turned = (pair[:, 1] >= 0) & (pair[:, 1] < pair[:, 0])
    pair[turned] = pair[turned, ::-1]
    order = np.lexsort((pair[:, 1], pair[:, 0]))
    return pair[order], value[order]


#: A wall end may lie this far beyond a nearer wall's tangent line and still be implied by it [m].
IMPLIED = 1e-9


@inner
def set_reach(bodies, h, share):
    """Set the search distance of the bodies for contacts, at least ``bodies.reach_floor``."""
    floor = bodies.reach_floor
    for i in range(bodies.inside):
        if share == 0.0:
            bodies.reach[i] = floor
        elif bodies.level[i] >= 0:
            free = bodies.free[i, 0] ** 2 + bodies.free[i, 1] ** 2
            before = bodies.velocity[i, 0] ** 2 + bodies.velocity[i, 1] ** 2
            bodies.reach[i] = max(share * h * math.sqrt(max(free, before)), floor)


@inner
def _near_walls(state, i):
    """Collect the walls within the reach of body i, nearest first; return their number, -1 if there are too many.

    Columns are distance, nx, ny, wall, px and py, with the normal from the nearest point p of the wall to the body.
    """
    world, bodies, lists, near = state.world, state.bodies, state.lists, state.contacts.near
    number = 0
    level = bodies.level[i]
    x, y = bodies.position[i, 0], bodies.position[i, 1]
    limit = greatest_extent(bodies, i) + bodies.reach[i]
    nearest = 1e300
    for slot in range(lists.wall_start[i], lists.wall_start[i + 1]):
        w = lists.wall_item[slot]
        distance, px, py = segment_distance(world.wall, w, x, y)
        if distance >= nearest and distance > limit:
            continue
        if is_absent(world, bodies, w, i) or not touches(state, level, x, y, world.wall_level[w], px, py):
            continue
        nearest = min(nearest, distance)
        if distance > limit:
            continue
        if number == near.shape[0]:
            return -1
        place = number
        while place > 0 and near[place - 1, 0] > distance:
            for k in range(6):
                near[place, k] = near[place - 1, k]
            place -= 1
        nx, ny = wall_normal(world, bodies, i, w, x - px, y - py, distance)
        near[place, 0] = distance
        near[place, 1] = nx
        near[place, 2] = ny
        near[place, 3] = w
        near[place, 4] = px
        near[place, 5] = py
        number += 1
    bodies.wall_distance[i] = nearest
    return number


@inner
def wall_normal(world, bodies, i, w, dx, dy, distance):
    """Return the unit vector from the wall to body i; for a body on the wall, towards the side that it came from."""
    if distance > 0.0:
        return dx / distance, dy / distance
    nx = world.wall[w, 1] - world.wall[w, 3]
    ny = world.wall[w, 2] - world.wall[w, 0]
    length = math.sqrt(nx * nx + ny * ny)
    if nx * bodies.velocity[i, 0] + ny * bodies.velocity[i, 1] > 0.0:
        return -nx / length, -ny / length
    return nx / length, ny / length


@inner
def _is_implied(world, near, k, kept):
    """Return whether wall k of `near` lies entirely behind the tangent line of a nearer wall that is kept."""
    w = int(near[k, 3])
    for q in range(k):
        if not kept & (1 << q):
            continue
        first = near[q, 1] * (world.wall[w, 0] - near[q, 4]) + near[q, 2] * (world.wall[w, 1] - near[q, 5])
        second = near[q, 1] * (world.wall[w, 2] - near[q, 4]) + near[q, 2] * (world.wall[w, 3] - near[q, 5])
        if first <= IMPLIED and second <= IMPLIED:
            return True
    return False


@inner
def _first_kept(near, kept, number):
    """Return the row of `near` with the smallest index of a wall among those whose bits are set in `kept`."""
    best = -1
    for q in range(number):
        if kept & (1 << q) and (best < 0 or near[q, 3] < near[best, 3]):
            best = q
    return best


@inner
def find_contacts(state):
    """Find all pairs and walls whose gap is below the reach; return a status.

    The reach of a pair is the sum of both reaches. Contacts are sorted by body, walls (by index) before bodies.
    """
    world, bodies, lists, contacts = state.world, state.bodies, state.lists, state.contacts
    capacity = contacts.body.shape[0]
    walls = world.wall.shape[0]
    near = contacts.near
    used, slot = 0, state.warm_start.half * state.warm_start.size
    for i in range(bodies.inside):
        level = bodies.level[i]
        if level < 0:
            continue
        x, y = bodies.position[i, 0], bodies.position[i, 1]
        bodies.wall_distance[i] = 1e300
        if lists.wall_start[i + 1] > lists.wall_start[i]:
            number = _near_walls(state, i)
            if number < 0:
                return NEAR_WALLS_FULL
            kept = 0
            for k in range(number):
                if not _is_implied(world, near, k, kept):
                    kept |= 1 << k
            while kept:
                k = _first_kept(near, kept, number)
                kept &= ~(1 << k)
                if used == capacity:
                    return CONTACTS_FULL
                key, omega = int(near[k, 3]) - walls, bodies.inverse_mass[i]
                nx, ny = near[k, 1], near[k, 2]
                gap = near[k, 0] - extent(bodies, i, -nx, -ny)
                slot = _append(state, used, slot, i, -1, key, nx, ny, gap, omega)
                used += 1
        for k in range(_pick_near(bodies, lists, contacts.picked, i)):
            j = contacts.picked[k]
            if not touches(state, level, x, y, bodies.level[j], bodies.position[j, 0], bodies.position[j, 1]):
                continue
            if used == capacity:
                return CONTACTS_FULL
            nx, ny = x - bodies.position[j, 0], y - bodies.position[j, 1]
            nx, ny, distance = unit_normal(nx, ny, nx * nx + ny * ny)
            gap = distance - extent(bodies, i, -nx, -ny) - extent(bodies, j, nx, ny)
            omega = bodies.inverse_mass[i] + bodies.inverse_mass[j]
            slot = _append(state, used, slot, i, j, j, nx, ny, gap, omega)
            used += 1
    contacts.number = used
    return OK


@inner
def _pick_near(bodies, lists, near, i):
    """Pick the bodies listed for body i that are within both reaches; return their number."""
    # Each body is written, and counted only if it is near: a branch that depends on positions is often mispredicted.
    x, y, r = bodies.position[i, 0], bodies.position[i, 1], greatest_extent(bodies, i) + bodies.reach[i]
    picked = 0
    for slot in range(lists.pair_start[i], lists.pair_start[i + 1]):
        j = lists.pair_body[slot]
        dx, dy = x - bodies.position[j, 0], y - bodies.position[j, 1]
        limit = r + greatest_extent(bodies, j) + bodies.reach[j]
        near[picked] = j
        picked += (dx * dx + dy * dy <= limit * limit) & (bodies.level[j] >= 0)
    return picked


@inlined
def _append(state, c, slot, i, other, key, nx, ny, gap, omega):
    """Set contact c and its warm start percussion; return the slot from which the next one is looked for."""
    contacts, before = state.contacts, state.warm_start
    contacts.body[c] = i
    contacts.other[c] = other
    contacts.key[c] = key
    contacts.normal[c, 0] = nx
    contacts.normal[c, 1] = ny
    contacts.gap[c] = gap
    contacts.omega[c] = omega
    contacts.velocity_before[c] = normal_velocity(state.bodies.velocity, contacts, c)
    contacts.bias[c] = 0.0
    contacts.friction[c] = 0.0
    contacts.sticky[c] = 0
    contacts.percussion[c] = 0.0
    slot = slot_of(before, slot, i, key)
    if holds(before, slot, i, key):
        contacts.percussion[c] = before.value[slot, 0]
    return slot


@inner
def normal_velocity(velocity, contacts, c):
    """Return the normal velocity of contact c [m/s], positive if the contact opens."""
    return _velocity_along(velocity, contacts, c, contacts.normal[c, 0], contacts.normal[c, 1])


@inner
def tangential_velocity(velocity, contacts, c):
    """Return the velocity of contact c along (-ny, nx) [m/s]."""
    return _velocity_along(velocity, contacts, c, -contacts.normal[c, 1], contacts.normal[c, 0])


@inner
def _velocity_along(velocity, contacts, c, x, y):
    """Return the velocity of the body of contact c, relative to the other one or the wall, along (x, y) [m/s]."""
    i, j = contacts.body[c], contacts.other[c]
    w = x * velocity[i, 0] + y * velocity[i, 1]
    if j >= 0:
        w -= x * velocity[j, 0] + y * velocity[j, 1]
    return w


@inner
def ground_along(world, bodies, contacts, c):
    """Return the velocity of the ground along (-ny, nx) [m/s], with which walls move beside contact c; else 0."""
    if contacts.other[c] >= 0:
        return 0.0
    level = bodies.level[contacts.body[c]]
    return contacts.normal[c, 0] * world.carry[level, 1] - contacts.normal[c, 1] * world.carry[level, 0]


@inner
def use_free_velocity(state):
    """Set the velocities after the sub-step to the free velocities, as without contacts."""
    bodies = state.bodies
    for i in range(bodies.inside):
        bodies.solved[i, 0] = bodies.free[i, 0]
        bodies.solved[i, 1] = bodies.free[i, 1]


@inner
def push(velocity, inverse_mass, contacts, c, percussion):
    """Apply a normal percussion [N s] to the bodies of contact c."""
    _apply(velocity, inverse_mass, contacts, c, percussion * contacts.normal[c, 0], percussion * contacts.normal[c, 1])


@inner
def rub(velocity, inverse_mass, contacts, c, friction):
    """Apply a percussion [N s] along the tangent (-ny, nx) to the bodies of contact c."""
    _apply(velocity, inverse_mass, contacts, c, -friction * contacts.normal[c, 1], friction * contacts.normal[c, 0])


@inner
def _apply(velocity, inverse_mass, contacts, c, px, py):
    i = contacts.body[c]
    j = contacts.other[c]
    velocity[i, 0] += inverse_mass[i] * px
    velocity[i, 1] += inverse_mass[i] * py
    if j >= 0:
        velocity[j, 0] -= inverse_mass[j] * px
        velocity[j, 1] -= inverse_mass[j] * py


@inner
def keep_percussions(contacts, kept):
    """Store the percussions of this sub-step for a warm start, in the half that does not hold the start of the step."""
    kept.half = 1 - kept.half_before
    kept.number = contacts.number
    first = kept.half * kept.size
    for c in range(contacts.number):
        kept.body[first + c] = contacts.body[c]
        kept.key[first + c] = contacts.key[c]
        kept.value[first + c, 0] = contacts.percussion[c]


@inner
def keep_only_meeting(world, bodies, contacts, h, margin):
    """Drop the contacts whose gap stays above `margin` [m] within the step at the free velocity.

    These are the contacts with D + h G.V > `margin`, which is 0 in the paper.
    """
    used = 0
    for c in range(contacts.number):
        if contacts.gap[c] + h * normal_velocity(bodies.free, contacts, c) <= margin + world.rounding:
            if used != c:
                copy_contact(contacts, c, contacts, used)
            used += 1
    contacts.number = used


@inner
def copy_contact(given, k, contacts, c):
    """Copy contact k of `given`, as the search has left it, to contact c."""
    contacts.body[c] = given.body[k]
    contacts.other[c] = given.other[k]
    contacts.key[c] = given.key[k]
    contacts.normal[c, 0] = given.normal[k, 0]
    contacts.normal[c, 1] = given.normal[k, 1]
    contacts.gap[c] = given.gap[k]
    contacts.omega[c] = given.omega[k]
    contacts.velocity_before[c] = given.velocity_before[k]
    contacts.percussion[c] = given.percussion[k]
    contacts.bias[c] = given.bias[k]
    contacts.friction[c] = given.friction[k]
    contacts.sticky[c] = given.sticky[k]
    for number in range(given.memory.shape[1]):
        contacts.memory[c, number] = given.memory[k, number]


@inner
def report_contact_force(bodies, contacts, weight):
    """Sum the contact forces [N] on each body: `weight` [1/s] times the percussions."""
    for i in range(bodies.inside):
        bodies.contact_force[i] = 0.0
    for c in range(contacts.number):
        force = weight * contacts.percussion[c]
        bodies.contact_force[contacts.body[c]] += force
        if contacts.other[c] >= 0:
            bodies.contact_force[contacts.other[c]] += force
