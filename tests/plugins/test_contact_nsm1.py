"""NSM1: nobody overlaps, at any step; overlaps at the start go away without a push."""

import numpy as np
import pytest

from evac.physics.state import make_crowd
from evac_plugins.contact_nsm1 import Nsm1
from tests.physics.scenes import (
    fields_towards,
    make_building,
    make_engine,
    random_crowd,
    uniform_fields,
    walk,
)

FREE = 1e30
ROOM = [(0, 0, 5, 0), (5, 0, 5, 2.1), (5, 2.9, 5, 5), (5, 5, 0, 5), (0, 5, 0, 0)]


def deepest(crowd, walls=()):
    """Return the greatest overlap of two bodies, and of a body and a wall [m]."""
    inside = crowd.level >= 0
    position, radius = crowd.position[inside], crowd.radius[inside]
    gap = np.linalg.norm(position[:, None] - position, axis=2) - radius - radius[:, None]
    np.fill_diagonal(gap, np.inf)
    overlaps = [-gap.min()]
    for x1, y1, x2, y2 in walls:
        along = np.array([x2 - x1, y2 - y1])
        share = np.clip((position - (x1, y1)) @ along / (along @ along), 0.0, 1.0)
        overlaps.append(np.max(radius - np.linalg.norm(position - (x1, y1) - share[:, None] * along, axis=1)))
    return max(overlaps)


@pytest.mark.parametrize("step", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("variant", ["inertial", "overdamped"])
def test_a_crowd_pressed_to_a_door_does_not_overlap(variant, step):
    crowd = random_crowd(60, (0, 0), (5, 5), seed=8)
    engine = make_engine(crowd, make_building(walls=ROOM), fields_towards((6, 2.5)))
    model = Nsm1(variant=variant)
    for first in range(round(6.0 / step)):
        engine.advance(model, crowd, first, 1, step, False, False)
        assert deepest(crowd, ROOM) <= 1e-4
    report = engine.report()
    assert report["unconverged_steps"] == 0
    assert report["contacts"] > 50
    assert report["greatest_overlap"] <= 1e-4


def test_the_tolerance_is_what_it_says():
    for tolerance in (1e-3, 1e-6, 1e-9):
        crowd = random_crowd(40, (0, 0), (5, 5), seed=8)
        model = Nsm1(gap_tolerance=tolerance, velocity_tolerance=1.0, iterations=20000)
        engine = walk(model, crowd, 300, building=make_building(walls=ROOM), fields=fields_towards((6, 2.5)))
        assert deepest(crowd, ROOM) <= tolerance
        assert engine.report()["greatest_residual"] <= tolerance / 0.01


@pytest.mark.parametrize("variant", ["inertial", "overdamped"])
def test_very_different_sizes_and_masses_do_not_overlap(variant):
    """The projection can throw a small body far beyond its free path: contacts are then searched again."""
    random = np.random.default_rng(4)
    angle = random.uniform(0, 2 * np.pi, 30)
    small = np.column_stack([np.cos(angle), np.sin(angle)]) * random.uniform(1.03, 1.4, 30)[:, None]
    keep = [k for k in range(30) if all(np.hypot(*(small[k] - small[q])) > 0.03 for q in range(k))]
    place = np.concatenate([[(0, 0), (2.5, 0)], small[keep]])
    radius = np.concatenate([[1.0, 1.0], np.full(len(keep), 0.01)])
    crowd = make_crowd(place, radius=radius, mass=np.where(radius > 0.5, 500.0, 1.0), tau=0.2)
    crowd.velocity[0] = (3.0, 0.5)
    crowd.speed[0] = 3.0
    engine = make_engine(crowd)
    model = Nsm1(variant=variant)
    for first in range(100):
        engine.advance(model, crowd, first, 1, 0.05, False, False)
        assert deepest(crowd) <= 1e-4
    if variant == "inertial":
        assert engine.report()["repeated_searches"] > 0


@pytest.mark.parametrize("axis", [0, 1])
def test_contacts_are_searched_again_along_the_way_on_which_a_body_is_thrown(axis):
    place = np.array([(0.0, 0.0), (1.02, 0.0), (1.14, 0.0)])[:, [axis, 1 - axis]]
    crowd = make_crowd(place, radius=[1.0, 0.01, 0.01], mass=[500.0, 1.0, 1.0], tau=0.2)
    crowd.velocity[0, axis] = crowd.speed[0] = 3.0
    engine = make_engine(crowd)
    engine.advance(Nsm1(), crowd, 0, 1, 0.05, False, False)
    assert engine.report()["repeated_searches"] > 0
    assert deepest(crowd) <= 1e-4


def test_an_overlap_at_the_start_goes_without_touching_velocities():
    crowd = make_crowd(
        [(0, 0), (0.3, 0.1), (5, 5)], [(0.5, 0), (0.5, 0), (0, 0)], radius=0.2, mass=[60, 90, 80], tau=FREE
    )
    centre = crowd.mass @ crowd.position
    engine = walk(Nsm1(), crowd, 1)
    np.testing.assert_allclose(crowd.velocity, [(0.5, 0), (0.5, 0), (0, 0)], rtol=0, atol=1e-12)
    assert -1e-9 < 0.4 - np.hypot(*(crowd.position[1] - crowd.position[0])) <= 1e-4
    np.testing.assert_allclose(crowd.mass @ crowd.position, centre + 0.01 * crowd.mass @ crowd.velocity, atol=1e-9)
    assert engine.report()["position_corrections"] == 1
    np.testing.assert_allclose(crowd.distance, [0.005, 0.005, 0.0], atol=1e-12)  # being put right is no walk


def test_an_overlap_of_many_goes():
    crowd = random_crowd(40, (0, 0), (4, 4), seed=1)
    crowd.radius[:] *= 1.1
    crowd.contact_radius[:] = crowd.radius
    crowd.speed[:] = 0.0
    assert deepest(crowd) > 0.01
    walk(Nsm1(), crowd, 5)
    assert deepest(crowd) <= 1e-4
    np.testing.assert_allclose(crowd.velocity, 0.0, atol=1e-9)


def test_a_body_too_wide_for_its_gap_stays_calm():
    """Between two walls 0.36 m apart a body of 0.4 m cannot be put right; it is not thrown out either."""
    building = make_building(walls=[(-1, 0, 1, 0), (1, 0.36, -1, 0.36)])
    crowd = make_crowd([(0, 0.18)], radius=0.2, speed=1.0, tau=0.2)
    walk(Nsm1(), crowd, 100, building=building, fields=uniform_fields(1, (0.0, 1.0)))
    assert np.abs(crowd.velocity).max() < 0.1
    np.testing.assert_allclose(crowd.position, [(0, 0.18)], atol=0.02)


def test_people_standing_at_a_wall_do_not_jitter():
    for step in (1e-2, 1e-3):
        crowd = make_crowd([(0.3 + 0.45 * k, 0.21) for k in range(8)], radius=0.2, speed=1.5, tau=0.2)
        building = make_building(walls=[(-3, 0, 8, 0)])
        engine = make_engine(crowd, building, uniform_fields(1, (0.0, -1.0)))
        engine.advance(Nsm1(), crowd, 0, 300, step, False, False)
        assert np.abs(crowd.velocity).max() < 0.005


def test_overdamped_takes_the_nearest_velocity_without_regard_to_mass():
    for masses in ((80.0, 80.0), (50.0, 500.0)):
        crowd = make_crowd([(0, 0), (0.4, 0)], radius=0.2, mass=masses, speed=[1.5, 0.5])
        engine = walk(Nsm1(variant="overdamped", gap_tolerance=1e-12, velocity_tolerance=1e-12), crowd, 1, report=True)
        np.testing.assert_allclose(crowd.velocity[:, 0], 1.0, rtol=0, atol=1e-9)
        assert crowd.contact_force.tolist() == [0.0, 0.0]  # its multipliers are no forces
        assert engine.report()["driving_work"] == 0.0


def test_contact_forces_of_a_queue_at_a_wall_add_up():
    """Three people who press with 240 N each: the wall carries 720 N."""
    crowd = make_crowd([(-0.2, 0), (-0.6, 0), (-1.0, 0)], radius=0.2, mass=80.0, tau=0.5, speed=1.5)
    building = make_building(walls=[(0, -2, 0, 2)])
    walk(Nsm1(gap_tolerance=1e-12, velocity_tolerance=1e-12), crowd, 10, building=building, report=True)
    np.testing.assert_allclose(crowd.contact_force, [720 + 480, 480 + 240, 240], rtol=1e-7)


def test_what_does_not_converge_is_counted():
    crowd = random_crowd(60, (0, 0), (5, 5), seed=8)
    model = Nsm1(iterations=25, solver="uzawa", velocity_tolerance=1e-3)
    engine = walk(model, crowd, 200, building=make_building(walls=ROOM), fields=fields_towards((6, 2.5)))
    report = engine.report()
    assert report["retried_solves"] > 0
    assert report["unconverged_steps"] == 0  # the stronger method did converge
    assert report["greatest_residual"] <= 1e-3


def test_bodies_stay_apart_where_the_solve_does_not_converge():
    """Sixteen people who touch, of 8 to 800 kg, pressed towards a point of a wall: four iterations do not do."""
    places = [(-0.2 - 0.3464 * row, 0.4 * (column + 0.5 * (row % 2))) for row in range(4) for column in range(4)]
    mass = 80.0 * 10.0 ** np.random.default_rng(1).uniform(-1.0, 1.0, len(places))
    crowd = make_crowd(places, radius=0.2, mass=mass, tau=0.2, speed=1.5)
    wall = (0, -9, 0, 9)
    engine = make_engine(crowd, make_building(walls=[wall]), fields_towards((0.0, 0.9)))
    model = Nsm1(iterations=4, solver="uzawa")
    for first in range(10):
        engine.advance(model, crowd, first, 1, 0.05, False, False)
        assert deepest(crowd, [wall]) <= 1e-4
    assert engine.report()["unconverged_steps"] == 10
    assert np.abs(crowd.velocity).max() > 0.1  # they still move
