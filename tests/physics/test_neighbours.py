"""Neighbour lists against looking at everybody."""

import numpy as np
import pytest

from evac.jit import Ints, Pairs, kernel
from evac.physics.contact.contacts import find_contacts
from evac.physics.contact.neighbours import build_lists, sort_by_level
from evac.physics.engine import gather
from evac.physics.seams import reaches
from evac.physics.state import (
    CELLS_PER_LEVEL,
    CELLS_PER_PERSON,
    SKIN,
    Bodies,
    Cells,
    Lists,
    State,
    World,
    grown,
    make_cells,
    make_crowd,
)
from evac.physics.status import OK
from evac_plugins.contact_dem import Dem
from tests.physics.scenes import make_building, make_engine, random_crowd


@kernel
def build(world: World, bodies: Bodies, lists: Lists) -> int:
    return build_lists(world, bodies, lists)


@kernel
def find(state: State) -> int:
    return find_contacts(state)


def scene(seed, number=80):
    random = np.random.default_rng(seed)
    ends = random.uniform(-6.0, 6.0, (30, 2))
    walls = np.hstack([ends, ends + random.uniform(-3.0, 3.0, (30, 2))])
    crowd = random_crowd(number, (-6, -6), (6, 6), seed=seed)
    state = make_engine(crowd, make_building(walls=walls)).data
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
        gap = (
            np.hypot(*(bodies.position[:n] - bodies.position[i]).T)
            - bodies.contact_radius[:n]
            - bodies.contact_radius[i]
        )
        expected = [j for j in np.flatnonzero(gap < reach + SKIN) if j > i]
        assert lists.pair_body[lists.pair_start[i] : lists.pair_start[i + 1]].tolist() == expected
        gap = distance_to_walls(bodies.position[i], state.world.wall) - bodies.contact_radius[i]
        expected = np.flatnonzero(gap < reach + SKIN).tolist()
        assert lists.wall_item[lists.wall_start[i] : lists.wall_start[i + 1]].tolist() == expected


def fits(state, room):
    """Return whether the lists can be built with room for so many pairs, candidates of the last person included."""
    state.lists.pair_body = np.zeros(room, np.int32)
    return build(state.world, state.bodies, state.lists) == OK


def stacked(storeys, far=None):
    """Fifty people at the same places of each storey; portals join the storeys at a wall, in turns at two places."""
    places = np.array([(x, y) for x in range(10) for y in range(5)]) + 0.5
    position = np.tile(places, (storeys, 1))
    if far is not None:
        position[-1] = far
    portals = [(k, k + 1, (10.0, 1.0 + 2 * (k % 2), 10.0, 2.0 + 2 * (k % 2))) for k in range(storeys - 1)]
    building = make_building(((0.0, 0.0, 10.0, 5.0),) * storeys, portals=portals)
    crowd = make_crowd(position, level=np.repeat(np.arange(storeys), 50))
    state = make_engine(crowd, building).data
    state.bodies.row[:] = np.arange(len(position))
    gather(state, crowd, len(position))
    state.lists.pair_reach = 0.5
    return state


@pytest.mark.parametrize("far", [None, (5000.5, 0.5), (4000.5, 4000.5)])
def test_storeys_and_people_far_away_add_no_candidates(far):
    """Those in the cells around a person, of whom the list takes the near ones; few people stand near a portal."""
    one, many = stacked(1), stacked(20, far)
    alone = next(room for room in range(10_000) if fits(one, room))
    build_with_room(many)
    pairs = int(many.lists.pair_start[many.bodies.inside])
    assert pairs > 20 * one.lists.pair_start[50] * 0.95
    assert fits(many, pairs + alone - 1)


@pytest.mark.parametrize("seed", range(4))
def test_lists_across_portals_contain_all_who_can_touch(seed):
    """Of people on other levels, those whose segment to the body passes an open portal between."""
    random = np.random.default_rng(seed)
    building = make_building(
        ((0.0, 0.0, 4.0, 4.0), (4.0, 0.0, 8.0, 4.0), (4.0, 0.0, 8.0, 4.0)),
        walls=[(4.0, 0.0, 4.0, 1.0), (4.0, 3.0, 4.0, 4.0), (4.0, 0.0, 4.0, 4.0)],
        wall_level=[0, 1, 2],
        portals=[(0, 1, (4.0, 1.0, 4.0, 3.0))],
    )
    crowd = make_crowd(random.uniform((2.5, 0.5), (5.5, 3.5), (60, 2)))
    crowd.level[:] = np.where(crowd.position[:, 0] < 4.0, 0, random.integers(1, 3, 60))
    state = make_engine(crowd, building).data
    bodies, lists, contacts = state.bodies, state.lists, state.contacts
    bodies.row[:] = np.arange(60)
    gather(state, crowd, 60)
    bodies.reach[:60], lists.pair_reach, lists.wall_reach = 0.2, 0.4, 0.4
    build_with_room(state)
    state.parts.seams = reaches.address
    assert find(state) == OK
    found = {(contacts.body[c], contacts.other[c]) for c in range(contacts.number) if contacts.other[c] >= 0}
    expected = set()
    for i in range(60):
        for j in range(i + 1, 60):
            p, q = crowd.position[i], crowd.position[j]
            levels = {int(crowd.level[i]), int(crowd.level[j])}
            at = p[1] + (4.0 - p[0]) / (q[0] - p[0]) * (q[1] - p[1])
            if np.hypot(*(p - q)) <= 0.8 and (len(levels) == 1 or (levels == {0, 1} and 1.0 < at < 3.0)):
                expected.add((i, j))
    assert found == expected
    assert any(crowd.level[i] != crowd.level[j] for i, j in found)


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
            gap = (
                np.hypot(*(bodies.position[i] - bodies.position[j]))
                - bodies.contact_radius[i]
                - bodies.contact_radius[j]
            )
            if gap <= bodies.reach[i] + bodies.reach[j]:
                expected.append((i, j, gap))
    assert [pair[:2] for pair in found] == [pair[:2] for pair in expected]
    np.testing.assert_allclose([pair[2] for pair in found], [pair[2] for pair in expected], rtol=0, atol=1e-14)


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


@kernel
def sort(cells: Cells, position: Pairs, level: Ints) -> None:
    sort_by_level(cells, level.shape[0], position, level, 1.0)


def sorted_by_level(position, level, levels):
    """Return the cells, and the people in each that has any, by level, column and row."""
    cells = make_cells(len(level), levels)
    sort(cells, np.array(position, dtype=float), np.array(level, np.int32))
    found = {}
    for at in range(levels):
        for k in range(cells.columns[at] * cells.rows[at]):
            people = cells.slots[cells.start[cells.first[at] + k] : cells.start[cells.first[at] + k + 1]].tolist()
            if people:
                found[at, k // int(cells.rows[at]), k % int(cells.rows[at])] = people
    return cells, found


def test_each_level_has_cells_of_its_own():
    position = [[5.5, -1.5], [3.5, -1.5], [5.5, 0.5], [9.5, 9.5], [5.2, -1.1], [-7.5, 2.5]]
    cells, found = sorted_by_level(position, [0, 2, 0, -1, 0, 2], 3)
    assert found == {(0, 0, 0): [0, 4], (0, 0, 2): [2], (2, 0, 4): [5], (2, 11, 0): [1]}
    assert cells.cell_of[3] == -1
    assert (cells.columns * cells.rows).tolist() == [3, 0, 60]
    assert not cells.wraps.any()


@pytest.mark.parametrize("far", [(5000.5, 4000.5), (5000.5, 0.5), (0.5, -4000.5)])
def test_one_person_far_away_leaves_the_others_their_cells(far):
    place = np.array([(x, y) for x in range(20) for y in range(20)]) + 0.5
    cells, found = sorted_by_level([*place, far], [0] * 401, 1)
    assert cells.wraps[0]
    assert cells.columns[0] * cells.rows[0] <= 401 * CELLS_PER_PERSON + CELLS_PER_LEVEL
    assert min(cells.columns[0], cells.rows[0]) >= 3
    assert max(map(len, found.values())) <= 2
