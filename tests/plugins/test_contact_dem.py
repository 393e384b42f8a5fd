"""DEM: the spring, how it hardens, its limits, and the same law written in numpy."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from evac.base.errors import PluginError, ScenarioError, SimulationError
from evac.base.parameters import Parameter
from evac.evidence.scaling import halls
from evac.evidence.scaling.walks import Walk
from evac.physics.contact.model import BorderScene, ContactModel
from evac.physics.state import copy_of, make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import (
    cut_wall,
    fields_towards,
    kinetic_energy,
    make_building,
    make_engine,
    random_crowd,
    uniform_fields,
    walk,
)

FREE = 1e30


def test_static_overlap_is_force_over_stiffness():
    crowd = make_crowd([(-0.25, 0)], radius=0.2, mass=80.0, tau=0.1, speed=2.0)
    engine = walk(Dem(), crowd, 1500, building=make_building(walls=[(0, -3, 0, 3)]), report=True)
    assert 0.2 + crowd.position[0, 0] == pytest.approx(1600.0 / 1.2e5, abs=1e-12)
    assert crowd.contact_force[0] == pytest.approx(1600.0, abs=1e-6)
    assert engine.report()["greatest_overlap"] >= 1600.0 / 1.2e5


@pytest.mark.parametrize(("stiffness", "masses"), [(1.2e5, (80.0, 80.0)), (1.2e5, (60.0, 100.0)), (5e4, (70.0, 70.0))])
def test_head_on_overlap(stiffness, masses):
    """v sqrt(m_reduced / k), 73 mm for two of 80 kg with 2 m/s each, without driving."""
    crowd = make_crowd([(-0.21, 0), (0.21, 0)], [(2, 0), (-2, 0)], radius=0.2, mass=masses, tau=FREE)
    engine = walk(Dem(stiffness=stiffness), crowd, 2000, h=1e-4, tick=100)
    reduced = masses[0] * masses[1] / sum(masses)
    assert engine.report()["greatest_overlap"] == pytest.approx(4.0 * (reduced / stiffness) ** 0.5, rel=1e-3)
    assert kinetic_energy(crowd) == pytest.approx(2.0 * sum(masses), rel=1e-2)  # parted again, elastically
    if masses == (80.0, 80.0):
        assert engine.report()["greatest_overlap"] == pytest.approx(0.073, abs=5e-4)


def slope(overlap, radius):
    """The tangent stiffness over k with the default hardening: from 1 at r / 2 to 1000 at r, exponentially."""
    return 1000.0 ** max(0.0, 2.0 * overlap / radius - 1.0)


def force(overlap, radius, stiffness=1.2e5):
    return stiffness * quad(slope, 0.0, overlap, (radius,), points=[0.5 * radius], epsabs=0.0, epsrel=1e-12)[0]


@pytest.mark.parametrize("load", [11e3, 13e3, 1e5, 1.2e6])
def test_static_overlap_of_a_hardened_contact(load):
    """A disc against a wall under a known load, against the root of the integrated stiffness."""
    exact = brentq(lambda overlap: force(overlap, 0.2) - load, 0.01, 0.2, xtol=1e-14)
    crowd = make_crowd([(0.98 * exact - 0.2, 0)], radius=0.2, mass=8000.0, tau=0.1, speed=load * 0.1 / 8000.0)
    engine = walk(Dem(), crowd, 1500, building=make_building(walls=[(0, -3, 0, 3)]), report=True)
    assert 0.2 + crowd.position[0, 0] == pytest.approx(exact, abs=1e-9)
    assert crowd.contact_force[0] == pytest.approx(load, rel=1e-6)
    assert (engine.report()["hardened_contacts"] > 0) == (exact > 0.1)


def test_the_smaller_body_of_two_decides_how_a_contact_hardens():
    """Two people run into each other; at the deepest the spring holds their energy."""
    crowd = make_crowd([(-0.25, 0), (0.26, 0)], [(5, 0), (-5, 0)], radius=[0.3, 0.2], mass=80.0, tau=FREE)
    engine = walk(Dem(), crowd, 1000, h=1e-4, tick=100)

    def missing(overlap):
        return quad(force, 0.0, overlap, (0.2,), points=[0.1])[0] - 0.5 * 40.0 * 10.0**2

    report = engine.report()
    assert report["greatest_overlap"] == pytest.approx(brentq(missing, 0.1, 0.2), rel=1e-3)
    assert report["hardened_contacts"] > 0
    assert kinetic_energy(crowd) == pytest.approx(2000.0, rel=1e-2)  # parted again, elastically


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_hardened_contact_cuts_steps_by_its_tangent_stiffness(share):
    """A body at rest against a wall: a ninth of the step that is unstable, h^2 k(D) / m = 4."""
    limit = 2.0 / 9.0 / (1.2e5 * slope(0.14, 0.2) / 80.0) ** 0.5
    crowd = make_crowd([(-0.06, 0)], radius=0.2, mass=80.0, tau=FREE)
    engine = walk(Dem(), crowd, 1, h=share * limit, building=make_building(walls=[(0, -3, 0, 3)]))
    assert engine.report()["too_stiff_steps"] == (share > 1.0)


def collide(model, speed, gap, mass, beside=0.0):
    """Two people meet, or one meets a wall if one mass is given; return the engine and the share of energy left."""
    if len(mass) == 1:
        crowd, walls = make_crowd([(-0.2 - gap, 0)], [(speed, 0)], mass=mass, tau=FREE), [(0, -3, 0, 3)]
    else:
        places = [(-0.2 - 0.5 * gap, 0), (0.2 + 0.5 * gap, beside)]
        crowd, walls = make_crowd(places, [(0.5 * speed, 0), (-0.5 * speed, 0)], mass=mass, tau=FREE), []
    before = kinetic_energy(crowd)
    engine = walk(model, crowd, 60, h=0.01, building=make_building(walls=walls))
    return engine, kinetic_energy(crowd) / before


@pytest.mark.parametrize("mass", [(80.0,), (70.0, 70.0), (50.0, 100.0)], ids=["wall", "equal", "unequal"])
@pytest.mark.parametrize("stiffness", [7e4, 1.2e5, 3e5])
def test_hardened_contacts_return_the_energy_of_a_collision(stiffness, mass):
    """With steps of 10 ms, wherever the bodies are when the step begins in which they touch."""
    hardened = 0
    for speed in np.linspace(2.0, 18.0, 17):
        for share in (0.1, 0.5, 0.8):
            beside = 0.0 if share < 0.7 else 0.1
            engine, left = collide(Dem(stiffness=stiffness), speed, (3.0 + share) * 0.01 * speed, mass, beside)
            if engine.report()["hardened_contacts"]:
                hardened += 1
                assert left == pytest.approx(1.0, abs=0.01), (speed, share)
    assert hardened > 15


def test_a_hardened_contact_goes_on_from_a_snapshot_to_the_bit():
    """The force of the first sub-step after it depends on the length of the last one before."""
    building = make_building(walls=[(0, -3, 0, 3)])

    def begin():
        crowd = make_crowd([(-0.35, 0)], [(15.0, 0)], tau=FREE)
        return crowd, walk(Dem(), crowd, 2, building=building)

    (crowd, engine), (other, first) = begin(), begin()
    second = make_engine(other, building)
    second.restore(first.snapshot())
    for one, each in ((engine, crowd), (second, other)):
        one.advance(Dem(), each, 2, 10, 0.01, True, False)
    assert engine.report()["hardened_contacts"] > 0
    assert second.report() == engine.report()
    np.testing.assert_array_equal(other.velocity, crowd.velocity)


def test_steps_are_not_cut_for_a_collision_that_does_not_harden():
    engine, _ = collide(Dem(), 4.4, 0.1, (80.0, 80.0))
    report = engine.report()
    assert report["greatest_overlap"] > 0.07
    assert report["sub_steps"] == report["steps"]


def test_contacts_below_the_onset_are_those_of_the_linear_law_to_the_bit():
    """Twenty people at a door; the deepest contact is not far below half the smallest radius."""
    building = make_building(walls=[(0, 0, 4, 0), (4, 0, 4, 1.1), (4, 1.9, 4, 3), (4, 3, 0, 3), (0, 3, 0, 0)])
    crowds = [random_crowd(20, (0, 0), (4, 3), seed=3) for _ in range(2)]
    engines = [
        walk(model, crowd, 300, building=building, fields=fields_towards((4.5, 1.5)))
        for model, crowd in zip((Dem(), Dem(hardening=1.0)), crowds, strict=True)
    ]
    np.testing.assert_array_equal(crowds[0].position, crowds[1].position)
    np.testing.assert_array_equal(crowds[0].velocity, crowds[1].velocity)
    assert engines[0].report() == engines[1].report()
    assert 0.25 < engines[0].report()["greatest_overlap"] / crowds[0].radius.min() < 0.5


@pytest.mark.parametrize(("stiffness", "overlap"), [(1e4, 0.16), (2.9e4, 0.19)])
def test_a_soft_contact_stays_linear_under_a_load_that_people_survive(stiffness, overlap):
    """Pressed against a wall by m v / tau below 6 kN: the overlap m v / (tau k) is beyond half of the radius."""
    crowd = make_crowd([(overlap - 0.2, 0)], radius=0.2, mass=80.0, tau=0.5, speed=overlap * stiffness * 0.5 / 80.0)
    walls = make_building(walls=[(0, -3, 0, 3)])
    engine = walk(Dem(stiffness=stiffness), crowd, 200, building=walls, fields=uniform_fields(1, (1.0, 0.0)))
    assert -crowd.position[0, 0] == pytest.approx(0.2 - overlap, abs=1e-9)
    assert engine.report()["hardened_contacts"] == 0


def test_two_people_at_one_place_are_parted_without_hardening():
    """Beyond an overlap of the radius contacts are linear; what hardens below it throws nobody out of a room."""
    crowd = make_crowd([(0, 0), (0, 0)], radius=0.2, mass=80.0, tau=0.5)
    walls = [(-3, -3, 3, -3), (3, -3, 3, 3), (3, 3, -3, 3), (-3, 3, -3, -3)]
    walk(Dem(), crowd, 300, building=make_building(walls=walls))
    assert np.hypot(*(crowd.position[0] - crowd.position[1])) > 0.4
    assert np.abs(crowd.position).max() < 3.0


def test_whether_contacts_can_harden_is_explained():
    assert [is_in for _, is_in, _ in Dem().parts()] == [True]
    assert [is_in for _, is_in, _ in Dem(hardening=1.0).parts()] == [False]


def border(step, mass=60.0, tau=0.1, explicit=True):
    array = np.array([mass, 100.0])
    return BorderScene(step, explicit, np.full(2, 0.2), array, np.array([tau, 0.5]), np.ones(2))


@pytest.mark.parametrize(
    ("mass", "tau", "explicit", "limit"),
    [(60.0, 0.5, False, 0.018092), (50.0, 0.5, False, 0.016529), (60.0, 0.1, True, 0.017449)],
)
def test_the_border_is_the_limit_of_a_dense_packing(mass, tau, explicit, limit):
    rate = 6.0 * 1.2e5 / mass
    right = 4.0 - 2.0 * limit / tau if explicit else 2.0 * (1.0 + np.exp(-limit / tau))
    assert limit**2 * rate == pytest.approx(right, rel=1e-3)
    Dem().check_scene(border(0.997 * limit, mass, tau, explicit))
    with pytest.raises(ScenarioError, match=r"simulation\.step: .* 0\.01\d\d s"):
        Dem().check_scene(border(1.003 * limit, mass, tau, explicit))
    Dem(stiffness=1e3).check_scene(border(0.02, mass, tau, explicit))


def packing():
    """46 people of 60 kg in a triangular packing, pressed down into a box that they fill."""
    rows = [(0.5 * (row % 2) + np.arange(7 - row % 2), 0.75**0.5 * row) for row in range(7)]
    lattice = np.concatenate([np.column_stack([column, np.full(len(column), height)]) for column, height in rows])
    crowd = make_crowd(0.395 * lattice, radius=0.2, mass=60.0, tau=0.5, speed=1.5)
    left, right = -0.2, 0.395 * 6 + 0.2
    walls = [(left, -0.2, right, -0.2), (right, -0.2, right, 4), (left, 4, left, -0.2)]
    return crowd, make_building(walls=walls), uniform_fields(1, (0.0, -1.0))


@pytest.mark.parametrize(("step", "is_cut"), [(0.01, False), (0.02, True)])
def test_a_dense_packing_under_load_stands_and_is_cut_beyond_its_limit(step, is_cut):
    """What `check_scene` refuses, run all the same: the step finds its contacts too stiff and is cut."""
    crowd, building, fields = packing()
    steps = round(6.0 / step)
    engine = make_engine(crowd, building, fields)
    greatest = 0.0
    for first in range(0, steps, 5):
        engine.advance(Dem(), crowd, first, 5, step, False, False)
        if first * step > 4.0:
            greatest = max(greatest, np.abs(crowd.velocity).max())
    assert greatest < 0.15
    assert (engine.report()["too_stiff_steps"] > 0) == is_cut


def press_hard(model, steps):
    """Press the packing with 6 kN a person; return the engine and the crowd."""
    crowd, building, fields = packing()
    crowd.tau[:], crowd.speed[:] = 0.05, 5.0
    engine = make_engine(crowd, building, fields)
    for first in range(0, steps, 5):
        engine.advance(model, crowd, first, 5, 0.01, False, False)
    return engine, crowd


def test_a_load_beyond_what_linear_springs_carry():
    """The lowest row carries seven rows, 42 kN a person: with linear springs its centres reach the wall."""
    with pytest.raises(SimulationError, match=r"person .* wall"):
        press_hard(Dem(hardening=1.0), 400)
    engine, crowd = press_hard(Dem(), 400)
    report = engine.report()
    assert (crowd.position[:, 1] > -0.2).all()
    assert report["hardened_contacts"] > 0
    assert report["sub_steps"] > report["steps"] == 400
    work = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
    assert work == pytest.approx(kinetic_energy(crowd), abs=1e-9 * report["contact_dissipation"])


@pytest.mark.slow
def test_ten_thousand_people_at_four_doors_go_on(monkeypatch):
    """For 20 s, twice as long as with linear springs, whose run is refused after 11 s."""
    monkeypatch.setattr(halls, "STRETCH", 12.5)
    hall = halls.make_hall(10_000, 4.0, seed=1)
    assert len(hall.building.exits) == 4
    jam = Walk(hall, 0.01)
    jam.advance(Dem(), 200)
    is_inside = jam.crowd.level >= 0
    place = jam.crowd.position[is_inside]
    assert np.isfinite(place).all()
    assert np.isfinite(jam.crowd.velocity).all()
    assert (place > 0.0).all()
    assert (place < (hall.depth, hall.length)).all()
    report = jam.engine.report()
    assert report["hardened_contacts"] > 0
    assert report["greatest_overlap"] < jam.crowd.radius.min()
    assert 2_000 < (~is_inside).sum() < 3_000


@pytest.mark.parametrize("masses", [(80.0, 20.0), (20.0, 80.0)], ids=["light behind", "light ahead"])
@pytest.mark.parametrize(("share", "cuts"), [(0.999, 0), (1.001, 1)])
def test_the_lighter_of_a_pair_decides_which_step_is_too_long(masses, share, cuts):
    """At h^2 k (1/m + 1/sqrt(m m')) = 4, m being the lesser mass: its own contact and the coupling to the other."""
    least = min(masses)
    limit = 2.0 / (1.2e5 * (1.0 / least + 1.0 / np.sqrt(masses[0] * masses[1]))) ** 0.5
    crowd = make_crowd([(0.39, 0), (0, 0)], radius=0.2, mass=masses, tau=FREE)
    assert walk(Dem(), crowd, 1, h=share * limit).report()["too_stiff_steps"] == cuts


class NumpyDem(ContactModel):
    """The spring of eq. 3, written in numpy."""

    name = "numpy_dem"
    stiffness = Parameter(1.2e5, "contact stiffness", unit="kg/s2", above=0.0)

    def step(self, contacts, h):
        contacts.percussion[:] = -h * self.stiffness * np.minimum(contacts.gap, 0.0)
        push = contacts.percussion[:, None] * contacts.normal
        velocity = contacts.free.copy()
        np.add.at(velocity, contacts.body, push / contacts.mass[contacts.body, None])
        pair = contacts.other >= 0
        np.add.at(velocity, contacts.other[pair], -push[pair] / contacts.mass[contacts.other[pair], None])
        return velocity


@pytest.mark.parametrize("forces", [(), (SocialForce(),)], ids=["alone", "social"])
def test_the_model_in_numpy_is_the_compiled_one(forces):
    walls = [(0, 0, 4, 0), (4, 0, 4, 1.1), (4, 1.9, 4, 3), (4, 3, 0, 3), *cut_wall(0, 3, 0, 0, 4)]
    building = make_building(walls=walls, exits=[(0, (4.5, 0, 4.5, 3))])
    compiled = random_crowd(20, (0, 0), (4, 3), seed=3)
    written = copy_of(compiled)
    reports = []
    for model, crowd in ((Dem(), compiled), (NumpyDem(), written)):
        engine = make_engine(crowd, building, fields_towards((5.5, 1.5)), forces)
        for first in range(0, 200, 10):
            engine.advance(model, crowd, first, 10, 0.01, True, True)
        reports.append(engine.report())
    np.testing.assert_allclose(written.position, compiled.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(written.contact_force, compiled.contact_force, rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(written.level, compiled.level)
    for name in ("contacts", "greatest_overlap", "contact_dissipation", "driving_work"):
        assert reports[1][name] == pytest.approx(reports[0][name], rel=1e-9)
    assert reports[0]["contacts"] > 100


class Nothing(ContactModel):
    """A model that forgot to say what it does."""

    name = "nothing"


def test_a_model_without_a_law_says_so():
    with pytest.raises(PluginError, match="'nothing'"):
        walk(Nothing(), make_crowd([(0, 0)]), 1)
