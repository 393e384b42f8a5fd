"""What drives a pedestrian: when, where to, and how fast with and without inertia."""

import math
from dataclasses import replace

import numpy as np
import pytest

from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import fields_towards, make_building, make_engine, name_of, uniform_fields, walk

FREE = 1e30


@pytest.mark.parametrize("model", [Dem(), Nsm1(variant="overdamped")], ids=name_of)
def test_a_person_sets_off_in_the_step_that_begins_at_the_start_time(model):
    crowd = make_crowd([(0, 0)], tau=0.5, speed=1.5, start_time=0.05)
    engine = walk(model, crowd, 5, tick=5)
    np.testing.assert_array_equal(crowd.velocity, 0.0)
    engine.advance(model, crowd, 5, 1, 0.01, True, False)
    gained = 1.5 if model.overdamped else 0.01 / 0.5 * 1.5
    np.testing.assert_allclose(crowd.velocity, [(gained, 0.0)], rtol=1e-15)


def test_without_inertia_a_force_gives_the_velocity_tau_f_over_m():
    crowd = make_crowd([(0, 0), (0.5, 0)], mass=[60.0, 90.0], tau=[0.3, 0.7])
    engine = make_engine(crowd, forces=[SocialForce()])
    engine.advance(Nsm1(variant="overdamped"), crowd, 0, 1, 1e-4, True, False)
    force = 2000.0 * math.exp(-0.1 / 0.08) / 2.0
    np.testing.assert_allclose(crowd.velocity, [(-0.3 * force / 60.0, 0.0), (0.7 * force / 90.0, 0.0)], rtol=1e-12)


def test_speeds_on_a_slope_are_those_of_its_use_in_plan():
    """Up, down and across a slope of 3 in 4, whose speeds are along the slope."""
    building = make_building()
    flight = replace(building.levels[0], kind="flight", slope=math.atan(0.75), uphill=np.array([1.0, 0.0]))
    crowd = make_crowd([(0, 0), (3, 0), (6, 0), (9, 0)], tau=1.0)
    crowd.speed[:] = (1.5, 0.5, 1.0)
    crowd.speed_factor[3] = 0.5
    crowd.route[:] = (0, 1, 2, 2)
    fields = uniform_fields(1, (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0))
    walk(Nsm1(variant="overdamped"), crowd, 1, building=replace(building, levels=(flight,)), fields=fields)
    expected = 0.8 * np.array([(0.5, 0.0), (-1.0, 0.0), (0.0, 1.5), (0.0, 0.75)])
    np.testing.assert_allclose(crowd.velocity, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("forces", [[], [SocialForce()]])
def test_directions_kept_from_step_to_step_are_those_of_the_place(forces):
    """Kept for a tick of fifty steps, over many cells, or for one step."""
    moved = []
    for tick in (1, 50):
        crowd = make_crowd([(0.0, 0.0), (4.0, 3.0)], [(2.0, 0.0), (0.0, 2.0)], tau=1.0, speed=2.0)
        walk(Dem(), crowd, 50, tick=tick, fields=fields_towards((2.0, -1.0)), forces=forces)
        moved.append(crowd.position)
    np.testing.assert_array_equal(*moved)
    assert np.hypot(*(moved[0] - [(0.0, 0.0), (4.0, 3.0)]).T).min() > 0.5  # more than a cell


@pytest.mark.parametrize("routes", [(0, 1), (1, 0)])
def test_each_of_a_pair_sees_the_other_from_its_own_desired_direction(routes):
    """On routes along +x and +y, for the one the other stands ahead or behind, for the other one at its side."""
    directions = np.array([(1.0, 0.0), (0.0, 1.0)])
    crowd = make_crowd([(0, 0), (0.5, 0)], mass=80.0, tau=FREE)
    crowd.route[:] = routes
    engine = make_engine(
        crowd, fields=uniform_fields(1, *directions), forces=[SocialForce(reading="anisotropic", anisotropy=0.2)]
    )
    engine.advance(Nsm1(), crowd, 0, 1, 1e-4, True, False)
    force = 2000.0 * math.exp(-0.1 / 0.08)
    cosine = directions[routes[0]] @ (1, 0), directions[routes[1]] @ (-1, 0)
    view = [0.2 + 0.8 * (1.0 + phi) / 2.0 for phi in cosine]
    np.testing.assert_allclose(
        80.0 * crowd.velocity / 1e-4, [(-force * view[0], 0.0), (force * view[1], 0.0)], rtol=1e-9, atol=1e-9
    )
