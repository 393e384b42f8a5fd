"""The social force against eq. 34 by hand."""

import math

import numpy as np
import pytest

from evac.physics.state import make_crowd
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import make_engine, random_crowd, uniform_fields

FREE = 1e30


def push(force, place, direction=(1.0, 0.0), radius=0.2):
    """Return the forces (n, 2) [N] on people at rest, from their velocities after a short step."""
    crowd = make_crowd(place, radius=radius, mass=[60.0 + 10.0 * k for k in range(len(place))], tau=FREE)
    engine = make_engine(crowd, fields=uniform_fields(1, direction), forces=[force])
    engine.advance(Nsm1(), crowd, 0, 1, 1e-4, True, False)
    return crowd.mass[:, None] * crowd.velocity / 1e-4


@pytest.mark.parametrize("gap", [0.0, 0.05, 0.2, 0.5])
def test_isotropic_force(gap):
    found = push(SocialForce(), [(0, 0), (0.4 + gap, 0)])
    expected = 2000.0 * math.exp(-gap / 0.08) / 2.0
    np.testing.assert_allclose(found, [(-expected, 0), (expected, 0)], rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("reach", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("angle", [0.0, 1.0, math.pi / 2, 2.5, math.pi])
def test_anisotropic_force(angle, reach):
    """Everybody faces along x; the other stands at `angle` to the left."""
    force = SocialForce(reading="anisotropic", anisotropy=reach)
    towards = np.array([math.cos(angle), math.sin(angle)])
    found = push(force, [(0, 0), tuple(0.5 * towards)])
    strength = 2000.0 * math.exp(-0.1 / 0.08)
    view = [reach + (1 - reach) * (1 + math.cos(phi)) / 2 for phi in (angle, math.pi - angle)]
    expected = [-strength * view[0] * towards, strength * view[1] * towards]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_nobody_behind_is_felt_with_lambda_zero():
    found = push(SocialForce(reading="anisotropic"), [(0, 0), (0.5, 0)])
    assert found[0, 0] < -100.0
    np.testing.assert_allclose(found[1], 0.0, atol=1e-9)


def test_newtons_third_law_in_the_isotropic_reading():
    crowd = random_crowd(30, (0, 0), (4, 4), seed=3, gap=0.02, tau=FREE)
    engine = make_engine(crowd, forces=[SocialForce()])
    engine.advance(Nsm1(), crowd, 0, 1, 1e-4, True, False)
    force = crowd.mass[:, None] * crowd.velocity / 1e-4
    assert np.abs(force).max() > 100.0
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-6)
    expected = np.zeros((30, 2))
    for i in range(30):
        for j in range(30):
            away = crowd.position[i] - crowd.position[j] + 1e-4 * (crowd.velocity[j] - crowd.velocity[i])
            distance = np.hypot(*away)
            gap = distance - crowd.radius[i] - crowd.radius[j]
            if i != j and gap < SocialForce().cutoff():
                expected[i] += 1000.0 * math.exp(-gap / 0.08) * away / distance
    np.testing.assert_allclose(force, expected, rtol=1e-6, atol=1e-3)


def test_cut_off_where_it_is_below_the_tolerance():
    force = SocialForce(tolerance=5.0)
    assert force.cutoff() == pytest.approx(0.08 * math.log(400.0))
    near = push(force, [(0, 0), (0.4 + force.cutoff() - 1e-6, 0)])
    assert near[1, 0] == pytest.approx(2.5, rel=1e-3)
    far = push(force, [(0, 0), (0.4 + force.cutoff() + 1e-6, 0)])
    np.testing.assert_array_equal(far, 0.0)


def test_not_needed_without_strength():
    assert SocialForce().is_needed()
    none = SocialForce(strength=0.0)
    assert not none.is_needed()
    assert none.cutoff() == 0.0
    np.testing.assert_array_equal(push(none, [(0, 0), (0.4, 0)]), 0.0)
    assert SocialForce(strength=0.5).cutoff() == 0.0


def test_two_forces_add_up_each_within_its_own_cut_off():
    strong, long = SocialForce(), SocialForce(strength=500.0, range=0.3)
    place = [(0, 0), (1.3, 0)]
    assert strong.cutoff() < 0.9 < long.cutoff()
    crowd = make_crowd(place, tau=FREE, mass=60.0)
    engine = make_engine(crowd, forces=[strong, long])
    engine.advance(Nsm1(), crowd, 0, 1, 1e-4, True, False)
    assert crowd.velocity[1, 0] * 60.0 / 1e-4 == pytest.approx(250.0 * math.exp(-3.0), rel=1e-9)


def test_stands_off_by_the_gap_where_it_balances_the_drive():
    """Evaluated in every sub-step, somebody who presses against a person who stands comes to rest."""
    crowd = make_crowd([(0, 0), (3, 0)], mass=80.0, tau=[0.5, 1e-3], speed=[1.0, 0.0])
    engine = make_engine(crowd, forces=[SocialForce()])
    engine.advance(Nsm1(), crowd, 0, 2000, 0.01, False, False)
    gap = crowd.position[1, 0] - crowd.position[0, 0] - 0.4
    assert np.abs(crowd.velocity[0]).max() < 1e-2
    assert gap == pytest.approx(0.08 * math.log(1000.0 / 160.0), abs=5e-3)
