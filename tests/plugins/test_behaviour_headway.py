"""Headway: the published speed and turn, and who is followed, against exact numbers and searches over all pairs."""

import math

import numpy as np
import pytest
import shapely

from evac.people.behaviour import BehaviourScene
from evac.people.outside import make_outside
from evac.physics.state import make_crowd
from evac.simulation.scene import SharedScene
from evac_plugins.behaviour_headway import Headway
from evac_plugins.contact_nsm1 import Nsm1
from tests.physics.scenes import fields_towards, make_building, make_engine, uniform_fields

EAST, WEST, NORTH, NORTH_EAST = (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (math.sqrt(0.5), math.sqrt(0.5))


def prepared(crowd, building=None, fields=None, outside=None, **parameters):
    """Return the behaviour, ready to act on a crowd."""
    building = building or make_building()
    behaviour = Headway(**parameters)
    scene = SharedScene(building, fields or uniform_fields(len(building.levels)))
    outside = outside or make_outside(len(crowd.level))
    behaviour.prepare(BehaviourScene(crowd, scene, (), np.random.default_rng(1), 0.1, outside))
    return behaviour


def acted(position, building=None, fields=None, time=0.0, route=None, level=0, start_time=0.0, speed=1.2, **given):
    """Return people at places after the behaviour has acted on them."""
    crowd = make_crowd(position, level=level, start_time=start_time, speed=speed)
    if route is not None:
        crowd.route[:] = route
    prepared(crowd, building, fields, **given).act(crowd, time)
    return crowd


def factors(position, **given):
    """Return what becomes of the speed factors of people at places, if nobody turns from anybody."""
    return acted(position, repulsion=0.0, **given).speed_factor


def behind(position, out, building, level=0, way=EAST, **given):
    """Return crowd and people outside: one person inside, and others, who have left, at (level, x, y, direction)."""
    crowd = make_crowd([position, *([0.0, 0.0] for _ in out)], level=[level] + [-1] * len(out), speed=1.2)
    outside = make_outside(len(crowd.level))
    for row, (of, x, y, direction) in enumerate(out, start=1):
        outside.level[row], outside.position[row], outside.direction[row] = of, (x, y), direction
        outside.depth[row] = np.dot((x, y), direction)
    fields = uniform_fields(len(building.levels), way)
    prepared(crowd, building, fields, outside, **{"repulsion": 0.0, **given}).act(crowd, 0.0)
    return crowd, outside


def turns(position, **given):
    """Return what is added to the directions of people at places."""
    return acted(position, **given).extra_direction


#: A door in a wall at x = 0, and another one above a post.
DOORS = {"exits": [(0, (0.0, -0.5, 0.0, 0.5)), (0, (0.0, 0.7, 0.0, 1.7))]}
WALLS = {"walls": [(0.0, -5.0, 0.0, -0.5), (0.0, 0.5, 0.0, 0.7), (0.0, 1.7, 0.0, 5.0)]}


def test_who_has_left_is_followed_and_turned_from_as_one_inside():
    doors = make_building(**DOORS, **WALLS)
    crowd, _ = behind((-0.3, 0.0), [(0, 0.5, 0.1, EAST)], doors)
    assert crowd.speed_factor[0] == pytest.approx((math.hypot(0.8, 0.1) - 0.3) / 1.2, rel=1e-12)
    crowd, _ = behind((-0.3, 0.0), [(0, 0.2, 0.0, EAST)], doors, repulsion=8.0)
    assert crowd.extra_direction[0] == pytest.approx([-8.0 * math.exp((0.3 - 0.5) / 0.1), 0.0])
    crowd, _ = behind((-0.8, 0.1), [(0, 0.0, 0.1, EAST)], doors)  # still on the line
    assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2)
    crowd, _ = behind((-0.3, 0.0), [(-1, 0.5, 0.1, EAST)], doors)
    assert crowd.speed_factor[0] == 1.0


@pytest.mark.parametrize(
    ("y", "is_seen"), [(0.0, True), (-0.55, False), (0.6, False), (1.0, True)], ids=["door", "wall", "post", "other"]
)
def test_who_has_left_is_seen_through_the_exits_of_its_level(y, is_seen):
    """Whoever stands in front of one of two doors side by side sees who has left by the other one, through its own."""
    crowd, _ = behind((-0.3, y), [(0, 0.5, y, EAST)], make_building(**DOORS, **WALLS))
    assert crowd.speed_factor[0] == pytest.approx(0.5 / 1.2 if is_seen else 1.0)


@pytest.mark.parametrize("repulsion", [0.0, 8.0])
def test_outside_nobody_waits_for_who_comes_towards_it_or_is_nearer_to_its_exit(repulsion):
    """Exits that face each other across a lane would otherwise block for ever; nor do people inside count."""
    lane = make_building(exits=[(0, (0.0, -0.5, 0.0, 0.5)), (0, (1.5, 0.5, 1.5, -0.5))])
    _, outside = behind((-9.0, 0.0), [(0, 0.4, 0.0, EAST), (0, 1.1, 0.0, WEST)], lane, repulsion=repulsion)
    assert outside.speed_factor.tolist() == [1.0, 1.0, 1.0]
    _, outside = behind((0.9, 0.0), [(0, 0.4, 0.0, EAST)], lane, repulsion=repulsion)
    assert outside.speed_factor.tolist() == [1.0, 1.0]
    crossing = [(0, 0.4, 0.0, EAST), (0, 0.8, 0.1, NORTH_EAST)]
    _, outside = behind((-9.0, 0.0), crossing, lane, repulsion=repulsion)
    assert outside.speed_factor.tolist() == [1.0, pytest.approx((math.hypot(0.4, 0.1) - 0.3) / 1.2), 1.0]


def test_of_two_side_by_side_at_a_door_the_nearer_goes_first():
    """Each stands ahead of the other, for their ways meet; the travel time decides."""
    found = factors([[-0.2, 0.16], [-0.2, -0.14]], fields=fields_towards((0.0, 0.0)), length=0.35)
    assert found[1] == 1.0
    assert found[0] < 0.1


def test_of_two_on_two_routes_whose_ways_meet_one_goes_first():
    to_door = fields_towards((0.0, 0.0))
    for places in ([[-0.3, 0.1], [-0.25, -0.1]], [[-0.25, 0.1], [-0.3, -0.1]]):
        one, other = places
        e, f = (-np.array(place) / np.hypot(*place) for place in (one, other))
        fields = uniform_fields(1, tuple(e), tuple(f))
        found = factors(places, fields=fields, route=[0, 1])
        assert sorted(found == 1.0) == [False, True]
        assert (found == factors(places, fields=to_door)).all()


def test_people_turn_from_each_other_by_the_published_repulsion():
    (left, right) = turns([[0.0, 0.0], [0.3, 0.4]])
    push = 8.0 * math.exp((0.3 - 0.5) / 0.1)
    assert left == pytest.approx([-0.6 * push, -0.8 * push], rel=1e-12)
    assert right == pytest.approx(-left)
    (left, _) = turns([[0.0, 0.0], [0.3, 0.4]], repulsion=5.0, range=0.2, length=0.4)
    assert np.hypot(*left) == pytest.approx(5.0 * math.exp((0.4 - 0.5) / 0.2))


def test_two_who_come_towards_each_other_pass():
    """A little beside each other they turn aside; without repulsion they push each other to a standstill or aside."""
    crowd = make_crowd([[-3.0, 0.02], [3.0, -0.02]], speed=1.2, radius=0.2)
    crowd.route[:] = [0, 1]
    fields = uniform_fields(1, EAST, WEST)
    behaviour, engine, model = prepared(crowd, fields=fields), make_engine(crowd, fields=fields), Nsm1()
    nearest = math.inf
    for tick in range(80):
        crowd.speed_factor[:] = 1.0
        crowd.extra_direction[:] = 0.0
        behaviour.act(crowd, 0.1 * tick)
        engine.advance(model, crowd, 10 * tick, 10, 0.01, False, False)
        nearest = min(nearest, np.hypot(*(crowd.position[1] - crowd.position[0])))
    assert crowd.position[0, 0] > 2.0
    assert crowd.position[1, 0] < -2.0
    assert nearest > 0.35


#: Three levels in a row: a thin one between two others, and one above all of them. Lines at 0 and 0.3 are portals
#: between walls with a gap, exits are at the ends.
STOREYS = {
    "bounds": ((-6.0, -6.0, 0.0, 6.0), (0.0, -6.0, 0.3, 6.0), (0.3, -6.0, 0.6, 6.0), (-6.0, -6.0, 0.6, 6.0)),
    "portals": [(0, 1, (0.0, -5.0, 0.0, 5.0)), (1, 2, (0.3, -5.0, 0.3, 4.0))],
    "exits": [(2, (0.6, -4.0, 0.6, 4.0)), (3, (0.6, -3.0, 0.6, 6.0))],
}


def crowd_of_storeys(draw, n, far):
    """Return crowd and people outside at random places of `STOREYS`, and one of each far away if told."""
    level = draw.integers(0, 4, n)
    low, high = np.array(STOREYS["bounds"])[level].reshape(n, 2, 2).swapaxes(0, 1)
    position = draw.uniform(low, high)
    if far:
        position[0], level[0] = (4000.0, 3000.0), 2
    outside = make_outside(n)
    out = np.flatnonzero(draw.uniform(size=n) < 0.2)
    outside.level[out] = draw.integers(2, 4, len(out))
    outside.position[out] = draw.uniform((0.6, -6.0), (2.6, 6.0), (len(out), 2))
    if far:
        outside.position[out[0]] = 2.0, 3000.0
    angle = draw.uniform(-1.0, 1.0, len(out))
    outside.direction[out] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outside.depth[out] = outside.position[out, 0] - 0.6
    level[out] = -1
    crowd = make_crowd(np.where(level[:, None] < 0, np.nan, position), level=level, speed=draw.uniform(0.6, 2.0, n))
    crowd.route[:] = draw.integers(0, 3, n)
    return crowd, outside


class Pairs:
    """The rules of the docstring for all pairs of people, with shapely's geometry and without cells."""

    def __init__(self, crowd, directions, walls, wall_level, outside):
        self.met: set[tuple[int, bool, bool]] = set()
        self.route = crowd.route
        self.out = outside.level >= 0
        self.level = np.where(self.out, outside.level, crowd.level)
        self.position = np.where(self.out[:, None], outside.position, crowd.position)
        self.direction = np.where(self.out[:, None], outside.direction, directions[crowd.route])
        along = np.einsum("nk,nk->n", directions[crowd.route], self.position)
        self.remaining = np.where(self.out, -outside.depth, 100.0 - along)
        self.walls = [
            shapely.MultiLineString([wall.reshape(2, 2) for wall in walls[wall_level == level]]) for level in range(4)
        ]
        self.portals = {(a, b): shapely.LineString(np.reshape(at, (2, 2))) for a, b, at in STOREYS["portals"]}
        self.exits = {level: shapely.LineString(np.reshape(at, (2, 2))) for level, at in STOREYS["exits"]}

    def sees(self, i, j):
        """Return whether person i sees j, through at most two portals, or an exit of the level that j has left."""
        a, b = self.level[i], self.level[j]
        if self.out[i]:
            return self.out[j] and a == b
        line = shapely.LineString([self.position[i], self.position[j]])
        if self.out[j]:
            if b not in self.exits or not line.intersects(self.exits[b]):
                return False
            line = shapely.LineString([self.position[i], line.intersection(self.exits[b])])
        low, high = min(a, b), max(a, b)
        if low != high and high == 3:
            return False
        if not all(line.intersects(self.portals[k, k + 1]) for k in range(low, high)):
            return False
        return not line.intersects(self.walls[a]) and not line.intersects(self.walls[b])

    def nearby(self, i, reach):
        """Return (person, step, distance) of all whom person i sees within `reach` [m]."""
        steps = self.position - self.position[i]
        distances = np.hypot(*steps.T)
        near = np.flatnonzero((distances < reach) & (self.level >= 0) & (np.arange(len(steps)) != i))
        found = [(j, steps[j], distances[j]) for j in near if self.sees(i, j)]
        self.met.update((abs(self.level[i] - self.level[j]), self.out[i], self.out[j]) for j, _, _ in found)
        return found

    def brakes(self, i, j, step, length):
        """Return whether person i slows down for j, whom it sees."""
        e, f = self.direction[i], self.direction[j]
        if e @ step <= 0.0 or abs(e[0] * step[1] - e[1] * step[0]) > length:
            return False
        if e @ f <= 0.0:
            return not self.out[i]
        if self.out[i] or self.route[i] == self.route[j]:
            return self.remaining[j] < self.remaining[i]
        return (e + f) @ step > 0.0

    def factor(self, i, speed, length=0.3, time_gap=1.0):
        full = time_gap * speed
        ahead = [s for j, step, s in self.nearby(i, length + full) if self.brakes(i, j, step, length)]
        return min(1.0, max(0.0, (min(ahead, default=math.inf) - length) / full))

    def turn(self, i, length=0.3, repulsion=8.0, reach=0.1):
        near = self.nearby(i, length + reach * math.log(repulsion / 0.01))
        return -sum((repulsion * math.exp((length - s) / reach) * step / s for _, step, s in near), np.zeros(2))


@pytest.mark.parametrize("seed", range(2))
def test_everybody_does_what_a_search_over_all_pairs_tells(seed):
    """On levels behind portals and above each other, from which some have left."""
    draw = np.random.default_rng(seed)
    angles = draw.uniform(-math.pi, math.pi, 3)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    fields = uniform_fields(4, *map(tuple, directions))
    crowd, outside = crowd_of_storeys(draw, 500, far=seed % 2)
    walls, wall_level = draw.uniform(-6.0, 6.0, (16, 4)), np.repeat(range(4), 4)
    walls[:, 2:] = walls[:, :2] + 0.3 * (walls[:, 2:] - walls[:, :2])
    building = make_building(**STOREYS, walls=walls, wall_level=wall_level)
    pairs = Pairs(crowd, directions, walls, wall_level, outside)
    prepared(crowd, building, fields, outside, repulsion=0.0).act(crowd, 0.0)
    for i in np.flatnonzero(pairs.level >= 0):
        expected = pairs.factor(i, crowd.speed[i, 0])
        found = (outside if pairs.out[i] else crowd).speed_factor[i]
        assert found == pytest.approx(expected, abs=1e-12), i
    prepared(crowd, building, fields, outside).act(crowd, 0.0)
    for i in np.flatnonzero(crowd.level >= 0):
        assert crowd.extra_direction[i] == pytest.approx(pairs.turn(i), abs=1e-9), i
    # Levels between two people, and whether each of them has left.
    inside = {(apart, False, is_out) for apart in range(3) for is_out in (False, True)}
    assert pairs.met == inside | {(0, True, True)}


def test_a_fast_person_ends_up_behind_a_slow_one_at_the_time_gap():
    """Both at 0.8 m/s at last, 0.3 m + 1 s x 0.8 m/s apart, and never in touch."""
    crowd = make_crowd([[-9.0, 0.0], [-7.0, 0.0]], speed=[1.6, 0.8], radius=0.14)
    behaviour, engine, model = prepared(crowd), make_engine(crowd), Nsm1()
    apart = []
    for tick in range(110):
        crowd.speed_factor[:] = 1.0
        crowd.extra_direction[:] = 0.0
        behaviour.act(crowd, 0.1 * tick)
        engine.advance(model, crowd, 10 * tick, 10, 0.01, False, False)
        apart.append(crowd.position[1, 0] - crowd.position[0, 0])
    assert crowd.velocity[:, 0] == pytest.approx(0.8, abs=1e-3)
    assert apart[-1] == pytest.approx(1.1, abs=2e-3)
    assert min(apart) > 0.28
