"""Forces on one person: exact motion, what they see of walls, and that they cost nothing where there are none."""

import math

import numpy as np
import pytest

from evac.base.parameters import Parameter
from evac.jit import body_force, pair_force
from evac.physics.force import Force, add_body_forces, add_forces
from evac.physics.state import make_crowd
from evac.physics.world import set_open
from evac_plugins.contact_dem import Dem
from tests.physics.scenes import make_building, make_engine, random_crowd, walk

FREE = 1e30


@body_force
def wind(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    return parameters[0], parameters[1]


@body_force
def seen(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    """Tell what it is given: the direction of the wall, as long as the gap; nothing without one."""
    if gap == math.inf:
        return 0.0, 0.0
    return gap * nx, gap * ny


@body_force
def spring(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    return -parameters[0] * x - 3.0 * vx, 5.0 * ex


@pair_force
def apart(gap, nx, ny, vx, vy, ex, ey, parameters):
    if gap >= 1.0:
        return 0.0, 0.0
    return parameters[0] * nx, parameters[0] * ny


@pair_force
def damper(gap, nx, ny, vx, vy, ex, ey, parameters):
    """Resist the velocity relative to the other person."""
    return -parameters[0] * vx, -parameters[0] * vy


@pair_force
def of_person(gap, nx, ny, vx, vy, ex, ey, ux, uy, mass, speed, group, parameters):
    """Tell what it is given of the person."""
    return parameters[0] * (ux + 10.0 * mass) + vx, parameters[0] * (uy + 100.0 * speed + 1000.0 * group)


class Wind(Force):
    """The same force everywhere."""

    name = "wind"
    body = wind
    x = Parameter(40.0, "along x", unit="N")
    y = Parameter(-30.0, "along y", unit="N")

    def cutoff(self):
        return 0.0


class Seen(Force):
    """Feels walls up to a gap."""

    name = "seen"
    body = seen
    reach = Parameter(1.0, "how far", unit="m")

    def cutoff(self):
        return self.reach


class Spring(Wind):
    """Pulls to x = 0."""

    name = "spring"
    body = spring


class Both(Wind):
    """Acts on each person and between two."""

    name = "both"
    pair = apart

    def cutoff(self):
        return 1.0


class Damper(Force):
    """A dashpot between two people."""

    name = "damper"
    pair = damper
    rate = Parameter(20.0, "force per velocity", unit="kg/s")

    def cutoff(self):
        return 1.0


class OfPerson(Damper):
    """Takes what it can get of a person."""

    name = "of_person"
    pair = of_person


def pushes(force, place, building=None, level=0, **settings):
    """Return the forces (n, 2) [N] on people at rest, in the order of the crowd."""
    crowd = make_crowd(place, level=level, radius=0.2, tau=FREE)
    engine = make_engine(crowd, building, forces=[force], **settings)
    engine.advance(Dem(), crowd, 0, 1, 1e-6, True, False)
    found = np.empty((len(place), 2))
    found[engine.data.bodies.row[: len(place)]] = engine.data.bodies.push[: len(place)]
    return found


def test_who_leaves_within_a_tick_hides_nobody_from_a_force():
    """One step a tick or ten: those who are listed after somebody who has left are pushed all the same."""
    building, found = make_building(exits=[(0, (1.0, 0.51, -1.0, 0.51))]), []
    for tick in (1, 10):
        places = [(-0.5, 0.0), (0.0, 0.0), (0.0, 0.5), (0.5, 0.0)]
        crowd = make_crowd(places, [(0, 0), (0, 0), (0, 2), (0, 0)], radius=0.1, tau=FREE)
        engine = make_engine(crowd, building, forces=[Both()])
        for first in range(0, 10, tick):
            engine.advance(Dem(), crowd, first, tick, 0.01, True, False)
        assert crowd.level.tolist() == [0, 0, -1, 0]
        found.append(crowd.position)
    np.testing.assert_array_equal(*found)


def test_a_constant_force_moves_a_person_as_exactly_known():
    """u = f tau / m (1 - exp(-t / tau)), with the exponential update exact at every step."""
    crowd = make_crowd([(0, 0)], mass=80.0, tau=0.5)
    walk(Dem(), crowd, 70, explicit=False, forces=[Wind()])
    expected = 0.5 / 80.0 * (1.0 - math.exp(-0.7 / 0.5)) * np.array([40.0, -30.0])
    np.testing.assert_allclose(crowd.velocity[0], expected, rtol=1e-12)


def test_a_force_between_two_people_gets_their_relative_velocity():
    """The relative velocity of two people joined by a dashpot decays as exp(-2 c t / m), their mean stays."""
    crowd = make_crowd([(0, 0), (1.0, 0)], [(0.1, 0.3), (0.2, -0.1)], mass=80.0, tau=FREE)
    walk(Dem(), crowd, 1000, h=1e-3, forces=[Damper()])
    decay = math.exp(-2.0 * 20.0 * 1.0 / 80.0)
    expected = np.array([0.15, 0.1]) + decay * np.array([[-0.05, 0.2], [0.05, -0.2]])
    np.testing.assert_allclose(crowd.velocity, expected, rtol=2e-3)


def test_a_force_between_two_people_gets_velocity_mass_desired_speed_and_group_of_the_person():
    velocity, mass, speed = np.array([(0.1, 0.3), (0.2, -0.1)]), np.array([60.0, 90.0]), np.array([1.0, 1.4])
    crowd = make_crowd([(0, 0), (1.0, 0)], velocity, mass=mass, speed=speed, tau=FREE)
    crowd.group[:], crowd.speed_factor[:] = (2, 1), (1.0, 0.5)
    engine = walk(Dem(), crowd, 1, h=1e-9, forces=[OfPerson(rate=1.0)])
    found = engine.data.bodies.push[np.argsort(engine.data.bodies.row[:2])]
    expected = velocity + np.column_stack([10.0 * mass, 100.0 * speed * (1.0, 0.5) + 1000.0 * np.array([2, 1])])
    expected[:, 0] += velocity[:, 0] - velocity[::-1, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_place_velocity_and_desired_direction_are_those_of_the_person():
    crowd = make_crowd([(2.0, 0), (-1.0, 3.0)], [(0.5, 0), (0, 0.1)], mass=80.0, tau=FREE)
    engine = walk(Dem(), crowd, 1, h=1e-9, forces=[Spring(x=7.0)])
    found = {int(row): push for row, push in zip(engine.data.bodies.row, engine.data.bodies.push, strict=True)}
    np.testing.assert_allclose(found[0], [-14.0 - 1.5, 5.0])
    np.testing.assert_allclose(found[1], [7.0, 5.0])


@pytest.mark.parametrize("reach", [0.4, 3.0])
def test_the_nearest_wall_is_found(reach):
    """Forty people among slanted walls, against a search of all."""
    walls = [(-5, -4, 4, -5), (4, -5, 5, 4), (0, 0, 1, 2), (-3, 3, -1, 3), (5, 4, -5, -4)]
    crowd = random_crowd(40, (-4, -4), (4, 4), seed=5)
    found = pushes(Seen(reach=reach), crowd.position, make_building(walls=walls))
    expected = []
    for place in crowd.position:
        candidates = []
        for x1, y1, x2, y2 in walls:
            start, along = np.array([x1, y1]), np.array([x2 - x1, y2 - y1])
            share = np.clip(along @ (place - start) / (along @ along), 0.0, 1.0)
            candidates.append(place - start - share * along)
        away = min(candidates, key=np.linalg.norm)
        distance = np.linalg.norm(away)
        gap = distance - 0.2
        expected.append(gap * away / distance if gap < reach else [0.0, 0.0])
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert ((found == 0.0).all(axis=1).sum() > 5) == (reach < 1.0)


def test_walls_behind_a_portal_are_felt_and_those_of_another_storey_are_not():
    bounds = ((0, 0, 2, 2), (2, 0, 4, 2), (0, 0, 4, 2))
    walls, of_level = [(2.5, 0, 2.5, 2), (0, 0.6, 4, 0.6)], [1, 2]
    building = make_building(bounds, walls, of_level, [(0, 1, (2, 0, 2, 2))])
    found = pushes(Seen(reach=1.5), [(1.8, 1.0), (1.8, 1.0)], building, level=[0, 2])
    np.testing.assert_allclose(found, [[-0.5, 0.0], [0.0, 0.2]], atol=1e-12)


def test_a_closed_exit_is_a_wall():
    building = make_building(exits=[(0, (2.0, -1.0, 2.0, 1.0))])
    crowd = make_crowd([(1.5, 0.0)], radius=0.2, tau=FREE)
    engine = make_engine(crowd, building, forces=[Seen()])
    for is_open, expected in ((True, [0.0, 0.0]), (False, [-0.3, 0.0])):
        set_open(engine.data.world, building.link_of(building.exits[0]), is_open)
        engine.advance(Dem(), crowd, 0, 1, 1e-6, True, False)
        np.testing.assert_allclose(engine.data.bodies.push[0], expected, atol=1e-9)


def test_a_force_may_act_on_each_and_between_two():
    found = pushes(Both(), [(0, 0), (0.9, 0)])
    np.testing.assert_allclose(found, [[40.0 - 40.0, -30.0], [40.0 + 40.0, -30.0]])
    engine = make_engine(make_crowd([(0, 0)]), forces=[Both(), Wind()])
    assert list(engine.explain_forces()) == ["both", "wind"]


def test_nothing_is_loaded_where_there_is_no_such_force():
    engine = make_engine(make_crowd([(0, 0)]))
    engine.load(Dem())
    assert engine.data.parts.body_forces == engine.data.parts.forces == 0
    assert add_body_forces not in engine.entries(Dem())
    engine = make_engine(make_crowd([(0, 0)]), forces=[Wind()])
    assert add_body_forces in engine.entries(Dem())
    assert add_forces not in engine.entries(Dem())
    engine.load(Dem())
    assert engine.data.parts.forces == 0 != engine.data.parts.body_forces
