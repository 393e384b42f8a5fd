"""Who is listed around a person, against a search over all."""

import math

import numpy as np

from evac.jit import kernel
from evac.people.behaviour import BehaviourScene
from evac.people.outside import Outside, make_outside
from evac.people.sights import Sights, list_near, look_round, make_sights
from evac.physics.state import Crowd, World, make_crowd
from evac.simulation.scene import SharedScene
from tests.physics.scenes import make_building, uniform_fields


@kernel
def listed(
    world: World,
    crowd: Crowd,
    outside: Outside,
    sights: Sights,
    i: int,
    reach: float,
    ex: float,
    ey: float,
    hx: float,
    hy: float,
) -> int:
    look_round(world, crowd, outside, sights)
    list_near(world, sights, i, reach, ex, ey, hx, hy)
    return sights.number


def test_those_ahead_of_either_direction_within_reach_are_listed():
    draw, n = np.random.default_rng(1), 300
    position = draw.uniform(-6.0, 6.0, (n, 2))
    crowd, outside, building = make_crowd(position), make_outside(n), make_building()
    scene = SharedScene(building, uniform_fields(1))
    world = BehaviourScene(crowd, scene, (), draw, 0.1, outside).world
    sights = make_sights(n, 1)
    for i in range(100):
        (ex, ey), (hx, hy) = ((math.cos(angle), math.sin(angle)) for angle in draw.uniform(-math.pi, math.pi, 2))
        reach, to = draw.uniform(0.5, 4.0), position - position[i]
        number = listed(world, crowd, outside, sights, i, reach, ex, ey, hx, hy)
        is_ahead = (to @ (ex, ey) >= 0.0) | (to @ (hx, hy) >= 0.0)
        expected = np.flatnonzero(is_ahead & (np.hypot(*to.T) <= reach))
        assert sorted(sights.near[:number].tolist()) == expected.tolist()
