"""The independent solution of ways that keep clear of walls, against exact answers."""

import numpy as np
import pytest
import shapely

from evac.directions.build import BEND
from evac.evidence.accuracy.fields import angles_between
from evac.evidence.accuracy.plans import l_corner, stair
from evac.evidence.accuracy.sweeping import _directions, clean_ways, sweep, wall_distances


def test_sweeping_from_a_line_over_a_seam_of_slowness_is_exact():
    cost = np.full((40, 7), np.inf)
    cost[0] = 0.0
    slowness = np.ones_like(cost)
    slowness[21:] = 3.0
    slowness[:, 3] = np.where(np.arange(40) == 30, np.inf, slowness[:, 3])
    sweep(cost, slowness, 0.1)
    assert cost[20] == pytest.approx(2.0)
    assert cost[25] == pytest.approx(2.0 + 3.0 * 0.5)
    assert cost[30, 3] == np.inf


def test_sweeping_from_a_point_is_of_first_order():
    errors = []
    for number in (41, 81):
        axis = np.linspace(-1.0, 1.0, number)
        distance = np.hypot(*np.meshgrid(axis, axis, indexing="ij"))
        cost = np.where(distance < 0.3, distance, np.inf)
        sweep(cost, np.ones_like(cost), axis[1] - axis[0])
        errors.append(np.abs(cost - distance).max())
    assert errors[1] < 0.65 * errors[0] < 0.03


def test_distances_to_walls_are_those_of_the_library():
    walls = np.array([[0.2, 0.1, 1.4, 0.9], [1.0, 1.5, 1.0, 0.2]])
    x, y = np.meshgrid(np.arange(0.0, 2.0, 0.05), np.arange(0.0, 1.8, 0.05), indexing="ij")
    exact = shapely.distance(shapely.multilinestrings(walls.reshape(-1, 2, 2)), shapely.points(x, y))
    assert wall_distances(walls, x, y, 0.3) == pytest.approx(np.minimum(exact, 0.3))


def test_ways_in_the_middle_go_straight_and_beside_a_wall_lead_away_from_it_as_refraction_says():
    """Along a straight corridor the cost to go grows by 1 per metre, so that across it is sqrt(s^2 - 1)."""
    plan = l_corner(10, np.random.default_rng(0))
    places = np.array([[5.0, 1.0], [4.5, 0.1], [4.5, 1.9]])
    ways = clean_ways(plan.building, places, 0.25, 0.0125)
    slowness = 1.0 + BEND * (1.0 - 0.1 / 0.25) ** 2
    across = np.sqrt(1.0 - 1.0 / slowness**2)
    exact = np.array([[1.0, 0.0], [1.0 / slowness, across], [1.0 / slowness, -across]])
    assert angles_between(ways.direction, exact) == pytest.approx(0.0, abs=2.0)


@pytest.mark.slow
def test_ways_over_a_stair_without_walls_near_tend_to_those_of_refraction():
    plan = stair(200, np.random.default_rng(0))
    far = plan.wall_distance > 0.4
    assert far.sum() > 20
    coarse, fine = (
        angles_between(clean_ways(plan.building, plan.points, 0.02, spacing).direction, plan.direction)[far].mean()
        for spacing in (0.02, 0.01)
    )
    assert fine < 0.75 * coarse < 1.0


def test_places_where_two_ways_meet_are_known():
    """Exits on both sides: in the middle neither way is better."""
    cost = np.tile(np.minimum(np.arange(41), 40 - np.arange(41))[:, None] * 0.1, (1, 11))
    cost = np.pad(cost, 1, constant_values=np.inf)
    ways = _directions(cost, np.ones_like(cost), np.array([[9.0, 6.0], [18.0, 6.0], [24.0, 6.0]]), 0.1)
    assert ways.direction == pytest.approx(np.array([[-1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]]))
    assert ways.to_meeting == pytest.approx([1.2, 0.3, 0.3])
