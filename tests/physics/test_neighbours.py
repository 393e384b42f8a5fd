"""Neighbour lists against looking at everybody."""

import numpy as np
import pytest

from evac.jit import kernel
from evac.physics.allocation import SKIN, grown, make_room_for_contacts
from evac.physics.contacts import find_contacts
from evac.physics.driver import gather
from evac.physics.neighbours import build_lists
from evac.physics.state import Bodies, Lists, State, World
from evac.physics.status import OK
from evac_plugins.contact_dem import Dem
from tests.physics.scenes import make_building, make_engine, random_crowd


@kernel
def build(world: World, bodies: Bodies, lists: Lists) -> int:
    return build_lists(world, bodies, lists)


@kernel
def find(state: State) -> int:
    return find_contacts(state, 0, state.bodies.inside)


def scene(seed, number=80):
    random = np.random.default_rng(seed)
    ends = random.uniform(-6.0, 6.0, (30, 2))
    walls = np.hstack([ends, ends + random.uniform(-3.0, 3.0, (30, 2))])
    crowd = random_crowd(number, (-6, -6), (6, 6), seed=seed)
    state = make_engine(crowd, make_building(walls=walls)).state
    state.bodies.row[:] = np.arange(number)
    gather(state, crowd, number)
    return state


def build_with_room(state):
    """Build the lists, in arrays that are made longer until they fit."""
    lists = state.lists
    while build(state.world, state.bodies, lists) != OK:
        lists.pair_body, lists.wall_item = grown(lists.pair_body), grown(lists.wall_item)


def distance_to_walls(point, walls):
    along = walls[:, 2:] - walls[:, :2]
    share = np.clip(((point - walls[:, :2]) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return np.hypot(*(point - walls[:, :2] - share[:, None] * along).T)


@pytest.mark.parametrize("reach", [0.0, 0.3, 1.7])
@pytest.mark.parametrize("seed", range(4))
def test_lists_are_those_of_brute_force(seed, reach):
    state = scene(seed)
    bodies, lists = state.bodies, state.lists
    lists.pair_reach = lists.wall_reach = reach
    build_with_room(state)
    n = bodies.inside
    for i in range(n):
        gap = np.hypot(*(bodies.position[:n] - bodies.position[i]).T) - bodies.radius[:n] - bodies.radius[i]
        expected = [j for j in np.flatnonzero(gap < reach + SKIN) if j > i]
        assert lists.pair_body[lists.pair_start[i] : lists.pair_start[i + 1]].tolist() == expected
        gap = distance_to_walls(bodies.position[i], state.world.wall) - bodies.radius[i]
        expected = np.flatnonzero(gap < reach + SKIN).tolist()
        assert lists.wall_item[lists.wall_start[i] : lists.wall_start[i + 1]].tolist() == expected


@pytest.mark.parametrize("seed", range(4))
def test_contacts_of_bodies_are_those_of_brute_force(seed):
    state = scene(seed)
    bodies, contacts = state.bodies, state.contacts
    n = bodies.inside
    bodies.reach[:n] = np.random.default_rng(seed).uniform(0.0, 0.1, n)
    state.lists.pair_reach = 0.2
    build_with_room(state)
    assert find(state) == OK
    found = [
        (int(contacts.body[c]), int(contacts.other[c]), contacts.gap[c])
        for c in range(contacts.number)
        if contacts.other[c] >= 0
    ]
    expected = []
    for i in range(n):
        for j in range(i + 1, n):
            gap = np.hypot(*(bodies.position[i] - bodies.position[j])) - bodies.radius[i] - bodies.radius[j]
            if gap <= bodies.reach[i] + bodies.reach[j]:
                expected.append((i, j, gap))
    assert [pair[:2] for pair in found] == [pair[:2] for pair in expected]
    np.testing.assert_allclose([pair[2] for pair in found], [pair[2] for pair in expected], rtol=0, atol=1e-14)


def test_full_lists_grow_and_change_nothing():
    """Room for one pair, one wall and one contact is enough to start with."""
    outcomes = []
    for small in (False, True):
        crowd = random_crowd(40, (0, 0), (4, 4), seed=2)
        engine = make_engine(crowd, make_building(walls=[(4, 0, 4, 4), (0, 0, 4, 0), (4, 4, 0, 4)]))
        if small:
            engine.state.lists.pair_body, engine.state.lists.wall_item = np.zeros((2, 1), np.int32)
            make_room_for_contacts(engine.state, 1)
        for first in range(0, 200, 10):
            engine.advance(Dem(), crowd, first, 10, 0.01, True, False)
        outcomes.append(crowd.position)
        report = engine.report()
        assert report["contacts"] > 100
        assert report["list_builds"] < report["steps"]
    np.testing.assert_array_equal(outcomes[0], outcomes[1])


def test_the_same_people_in_another_order_move_alike():
    crowd = random_crowd(30, (0, 0), (4, 4), seed=2)
    shuffle = np.random.default_rng(1).permutation(30)
    other = crowd.replace(**{name: array[shuffle] for name, array in crowd.values().items()})
    building = make_building(walls=[(4, 0, 4, 4)])
    for people in (crowd, other):
        engine = make_engine(people, building)
        for first in range(0, 100, 10):
            engine.advance(Dem(), people, first, 10, 0.01, True, False)
    np.testing.assert_array_equal(other.position, crowd.position[shuffle])
