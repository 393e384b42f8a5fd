"""NSM2: restitution, overlaps, opposed contacts, the tangential law."""

import numpy as np
import pytest

from evac.base.errors import PluginError
from evac.physics.state import make_crowd
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import (
    fields_towards,
    kinetic_energy,
    make_building,
    make_engine,
    random_crowd,
    uniform_fields,
    walk,
)

FREE = 1e30
TIGHT = {"velocity_tolerance": 1e-13, "iterations": 100000}
ROOM = [(0, 0, 5, 0), (5, 0, 5, 2.1), (5, 2.9, 5, 5), (5, 5, 0, 5), (0, 5, 0, 0)]
DISSIPATION = [0.0, 50.0, 160.0, 1e3, 1e5, np.inf]


def restitution(dissipation, mass):
    """(K_N/2 - m) / (K_N/2 + m) where K_N >= 2 m, else 0."""
    if np.isinf(dissipation):
        return 1.0
    return max(0.0, (dissipation / 2 - mass) / (dissipation / 2 + mass))


def test_more_iterations_than_kernels_can_count_are_refused():
    with pytest.raises(PluginError, match=r"^nsm2\.iterations: .* 1000000000, "):
        Nsm2(iterations=1e10)


@pytest.mark.parametrize("dissipation", DISSIPATION)
def test_restitution_at_a_wall(dissipation):
    crowd = make_crowd([(0, 0.21)], [(0.7, -1.5)], radius=0.2, mass=80.0, tau=FREE)
    walk(Nsm2(normal_dissipation=dissipation, **TIGHT), crowd, 1, building=make_building(walls=[(-5, 0, 5, 0)]))
    np.testing.assert_allclose(crowd.velocity[0], [0.7, 1.5 * restitution(dissipation, 80.0)], rtol=0, atol=1e-10)


@pytest.mark.parametrize("dissipation", DISSIPATION)
def test_restitution_of_a_pair(dissipation):
    mass = np.array([60.0, 100.0])
    crowd = make_crowd([(0, 0), (0.41, 0)], [(1.5, 0), (-1, 0)], radius=0.2, mass=mass, tau=FREE)
    walk(Nsm2(normal_dissipation=dissipation, **TIGHT), crowd, 1)
    after = crowd.velocity[1, 0] - crowd.velocity[0, 0]
    assert after == pytest.approx(2.5 * restitution(dissipation, 60.0 * 100.0 / 160.0), abs=1e-10)


def test_restitution_of_the_paper():
    assert restitution(1e5, 80.0) == pytest.approx(0.9968, abs=5e-5)
    assert restitution(1e5, 40.0) == pytest.approx(0.9984, abs=5e-5)


def test_infinite_dissipation_conserves_energy():
    crowd = make_crowd([(0, 0), (0.41, 0.1)], [(1.5, 0), (-1, 0.3)], radius=0.2, mass=[60, 100], tau=FREE)
    before = kinetic_energy(crowd)
    engine = walk(Nsm2(normal_dissipation=np.inf, **TIGHT), crowd, 20)
    assert kinetic_energy(crowd) == pytest.approx(before, rel=1e-10)
    assert engine.report()["elastic_fallbacks"] == 0


def test_a_body_between_two_walls_at_infinite_dissipation_falls_back():
    building = make_building(walls=[(-1, 0, 1, 0), (1, 0.36, -1, 0.36)])
    crowd = make_crowd([(0, 0.18)], [(0.0, -1.0)], radius=0.2, tau=0.5, speed=1.0)
    engine = make_engine(crowd, building, uniform_fields(1, (0.0, -1.0)))
    engine.advance(Nsm2(normal_dissipation=np.inf), crowd, 0, 20, 0.01, True, True)
    report = engine.report()
    assert 0 < report["elastic_fallbacks"] <= 20
    assert np.isfinite(crowd.velocity).all()
    assert 0.0 < crowd.position[0, 1] < 0.36


def test_a_new_contact_overlaps_by_at_most_half_the_approach():
    """h |w-| / 2 at K_N = 0, reached where the contact is touched at the start of the step."""
    crowd = make_crowd([(0, 0.2)], [(0, -1.5)], radius=0.2, tau=FREE)
    walk(Nsm2(normal_dissipation=0.0, **TIGHT), crowd, 1, building=make_building(walls=[(-5, 0, 5, 0)]))
    assert 0.2 - crowd.position[0, 1] == pytest.approx(0.01 * 1.5 / 2, abs=1e-12)


def test_a_pushed_pair_at_rest_does_not_sink_in():
    crowd = make_crowd([(0, 0), (0.4, 0)], radius=0.2, speed=[1.5, 0.0], tau=[0.2, 1e30])
    engine = walk(Nsm2(normal_dissipation=0.0, **TIGHT), crowd, 50)
    assert engine.report()["greatest_overlap"] < 1e-12
    assert crowd.velocity[0, 0] == pytest.approx(crowd.velocity[1, 0], abs=1e-12)


def test_a_separating_overlap_is_left_alone():
    crowd = make_crowd([(0, 0), (0.39, 0)], [(-1, 0), (1, 0)], radius=0.2, tau=FREE)
    walk(Nsm2(**TIGHT), crowd, 1)
    np.testing.assert_allclose(crowd.velocity, [(-1, 0), (1, 0)], rtol=0, atol=1e-12)


@pytest.mark.parametrize("dissipation", [0.0, 1e5])
def test_position_correction_keeps_overlaps_small(dissipation):
    """In the mean: the greatest overlap is that of one new contact, which is counted before it is put right."""
    mean = {False: [], True: []}
    for seed in range(4):
        for correction, found in mean.items():
            crowd = random_crowd(60, (0, 0), (5, 5), seed=seed)
            model = Nsm2(normal_dissipation=dissipation, position_correction=correction)
            engine = make_engine(crowd, make_building(walls=ROOM), fields_towards((6, 2.5)))
            engine.advance(model, crowd, 0, 400, 0.01, False, False)
            report = engine.report()
            found.append(report["overlap_sum"] / report["overlaps"])
            assert (report["position_corrections"] > 0) == correction
    assert min(mean[False]) > 1e-3
    assert np.mean(mean[True]) < 0.7 * np.mean(mean[False])


def test_position_correction_leaves_velocities():
    crowd = make_crowd([(0, 0), (0.3, 0.1)], [(0.5, 0), (0.5, 0)], radius=0.2, mass=[60, 90], tau=FREE)
    walk(Nsm2(position_correction=True), crowd, 1)
    np.testing.assert_allclose(crowd.velocity, [(0.5, 0), (0.5, 0)], rtol=0, atol=1e-12)
    assert 0.4 - np.hypot(*(crowd.position[1] - crowd.position[0])) <= 2e-4


@pytest.mark.parametrize("dissipation", [0.0, 1e3, 1e4, 1e5])
def test_contact_forces_do_not_grow_with_the_dissipation(dissipation):
    """Five people in a row who press on a wall with 160 N each, touching and at rest."""
    crowd = make_crowd([(-0.2 - 0.4 * k, 0) for k in range(5)], radius=0.2, mass=80.0, tau=0.5, speed=1.0)
    building = make_building(walls=[(0, -2, 0, 2)])
    walk(Nsm2(normal_dissipation=dissipation, **TIGHT), crowd, 1, building=building, report=True)
    np.testing.assert_allclose(crowd.contact_force, [800 + 640, 640 + 480, 480 + 320, 320 + 160, 160], rtol=1e-8)


@pytest.mark.parametrize("tangential", [0.0, 40.0, 160.0, 1e3])
def test_tangential_law_at_a_wall(tangential):
    """u+ = u- (2m - K_T) / (2m + K_T) along the wall: the percussion opposes the mean sliding velocity."""
    crowd = make_crowd([(0, 0.2)], [(1.0, -1.5)], radius=0.2, mass=80.0, tau=FREE)
    model = Nsm2(normal_dissipation=0.0, tangential_dissipation=tangential, **TIGHT)
    walk(model, crowd, 1, building=make_building(walls=[(-5, 0, 5, 0)]))
    np.testing.assert_allclose(crowd.velocity[0], [(160 - tangential) / (160 + tangential), 0.0], rtol=0, atol=1e-10)


def test_the_tangential_law_acts_on_who_is_driven_onto_a_wall_from_rest():
    """The contact closes with the free velocity, though nobody approached before: u+ = u_free 2m / (2m + K_T)."""
    crowd = make_crowd([(0, 0.2)], radius=0.2, mass=80.0, tau=0.1, speed=2.0)
    model = Nsm2(normal_dissipation=0.0, tangential_dissipation=40.0, **TIGHT)
    fields = uniform_fields(1, (0.6, -0.8))
    walk(model, crowd, 1, building=make_building(walls=[(-5, 0, 5, 0)]), fields=fields)
    np.testing.assert_allclose(crowd.velocity, [(0.1 * 2.0 * 0.6 * 160 / 200, 0.0)], rtol=0, atol=1e-12)


def test_a_report_of_forces_changes_nothing():
    """It takes percussions of its own, which are neither those of the energy sums nor of the next start."""
    found = []
    for report in (False, True):
        crowd = random_crowd(12, (0, 0), (3, 3), seed=3, speed=1.5)
        engine = make_engine(crowd, make_building(walls=ROOM), uniform_fields(1, (0.6, -0.8)))
        felt = 0.0
        model = Nsm2(tangential_dissipation=40.0)
        for first in range(150):
            engine.advance(model, crowd, first, 1, 0.01, True, report)
            felt += crowd.contact_force.sum()
        assert (felt > 0.0) == report
        found.append((crowd.position.tolist(), engine.report()))
    assert found[0] == found[1]
    assert found[0][1]["contact_dissipation"] > 1.0


def test_the_tangential_law_acts_on_closing_contacts_only():
    crowd = make_crowd([(0, 0.2)], [(1.0, 0.5)], radius=0.2, mass=80.0, tau=FREE)
    walk(Nsm2(tangential_dissipation=100.0), crowd, 5, building=make_building(walls=[(-5, 0, 5, 0)]))
    np.testing.assert_allclose(crowd.velocity[0], [1.0, 0.5], rtol=0, atol=1e-12)


def test_parts_that_a_scene_may_not_need():
    assert [is_in for _, is_in, _ in Nsm2().parts()] == [False, False]
    assert [is_in for _, is_in, _ in Nsm2(tangential_dissipation=1.0, position_correction=True).parts()] == [True, True]
