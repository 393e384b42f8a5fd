"""Momentum and energy of contacts: what the report adds up is what the bodies have."""

import numpy as np
import pytest

from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import (
    cut_wall,
    fields_towards,
    kinetic_energy,
    make_building,
    make_engine,
    name_of,
    random_crowd,
)

FREE = 1e30
TIGHT = {"velocity_tolerance": 1e-12, "iterations": 20000}
MODELS = [
    Dem(),
    Nsm1(gap_tolerance=1e-12, **TIGHT),
    Nsm2(**TIGHT),
    Nsm2(normal_dissipation=0.0, **TIGHT),
    Nsm2(normal_dissipation=1e3, tangential_dissipation=40.0, **TIGHT),
]
ENERGY = ("driving_work", "contact_creation", "contact_dissipation")


def room():
    """A room of 4 x 3 m whose door, 0.8 m wide, is at (4, 1.5)."""
    walls = [(0, 0, 4, 0), (4, 0, 4, 1.1), (4, 1.9, 4, 3), (4, 3, 0, 3), *cut_wall(0, 3, 0, 0, 3)]
    return make_building(walls=walls)


def jam(model, steps, driven=True, **settings):
    """Yield the engine and the crowd after every step of 20 people who press towards a door."""
    crowd = random_crowd(20, (0, 0), (4, 3), seed=3, **settings)
    if not driven:
        crowd.velocity[:] = np.random.default_rng(4).normal(0.0, 1.5, crowd.velocity.shape)
        crowd.tau[:] = FREE
    engine = make_engine(crowd, room(), fields_towards((4.5, 1.5)))
    for step in range(steps):
        before = kinetic_energy(crowd)
        engine.advance(model, crowd, step, 1, 0.01, True, False)
        yield engine, crowd, kinetic_energy(crowd) - before


@pytest.mark.parametrize("model", MODELS, ids=name_of)
def test_pair_contact_conserves_momentum(model):
    crowd = make_crowd([(0, 0), (0.5, 0.1)], [(1.5, 0.2), (-1.0, 0.1)], mass=[60, 100], tau=FREE)
    engine = make_engine(crowd)
    momentum = crowd.mass @ crowd.velocity
    for step in range(60):
        engine.advance(model, crowd, step, 1, 0.01, True, False)
        np.testing.assert_allclose(crowd.mass @ crowd.velocity, momentum, rtol=0, atol=1e-12 * 150)
    assert engine.report()["contact_dissipation"] > 0.0


@pytest.mark.parametrize("model", MODELS, ids=name_of)
def test_change_of_kinetic_energy_is_the_work_done(model):
    sums = dict.fromkeys(ENERGY, 0.0)
    for engine, crowd, change in jam(model, 200):  # noqa: B007
        report = engine.report()
        driving, creation, dissipation = (report[key] - sums[key] for key in ENERGY)
        assert change == pytest.approx(driving + creation - dissipation, abs=1e-10)
        assert creation >= 0.0
        assert dissipation >= 0.0
        sums = {key: report[key] for key in ENERGY}
    assert sums["contact_dissipation"] > 10.0
    assert np.isfinite(crowd.velocity).all()


def test_driving_work_of_one_person_is_its_kinetic_energy():
    crowd = make_crowd([(0, 0)], tau=0.3, mass=70.0, speed=1.5)
    engine = make_engine(crowd)
    engine.advance(Dem(), crowd, 0, 100, 0.01, True, False)
    assert engine.report()["driving_work"] == pytest.approx(kinetic_energy(crowd), rel=1e-12)


def test_nsm1_never_raises_kinetic_energy():
    for engine, _, change in jam(Nsm1(gap_tolerance=1e-12, **TIGHT), 150, driven=False):  # noqa: B007
        assert change <= 1e-9
    assert engine.report()["contact_dissipation"] > 1.0


@pytest.mark.parametrize("dissipation", [0.0, 1e3, 1e5])
def test_nsm2_raises_kinetic_energy_only_by_what_it_logs(dissipation):
    created = 0.0
    for engine, _, change in jam(Nsm2(normal_dissipation=dissipation, **TIGHT), 150, driven=False):
        now = engine.report()["contact_creation"]
        assert change <= now - created + 1e-9
        created = now


@pytest.mark.parametrize("dissipation", [0.0, 10.0, 1e3, 1e5])
def test_nsm2_contacts_that_all_close_take_energy(dissipation):
    for seed in range(20):
        random = np.random.default_rng(seed)
        centres = 0.4 * np.array([(0, 0), (1, 0), (0.5, 0.75**0.5), (-0.5, 0.75**0.5)])
        velocity = -random.uniform(0.5, 2.0) * (centres - centres.mean(axis=0)) / 0.4
        crowd = make_crowd(centres, velocity, mass=random.uniform(50, 100, 4), tau=FREE)
        before = kinetic_energy(crowd)
        engine = make_engine(crowd)
        engine.advance(Nsm2(normal_dissipation=dissipation, **TIGHT), crowd, 0, 1, 0.01, True, False)
        assert engine.report()["contacts"] >= 4
        assert kinetic_energy(crowd) <= before * (1.0 + 1e-12)
        assert engine.report()["contact_creation"] <= 1e-12
