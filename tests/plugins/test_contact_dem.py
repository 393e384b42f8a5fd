"""DEM: the spring, its collisions, the division of steps, its limits, and the same law written in numpy."""

import re

import numpy as np
import pytest

from evac.base.errors import PluginError, ScenarioError, SimulationError
from evac.base.parameters import Parameter
from evac.physics.contact.model import BorderScene, ContactModel
from evac.physics.contact.pair_contact import COARSEST
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


def collide(model, masses, speed, gap, h, steps=60):
    """Two people meet at `speed`, or one of one mass meets a wall; return the engine and the speed after it."""
    if len(masses) == 1:
        crowd, walls = make_crowd([(-0.2 - gap, 0)], [(speed, 0)], mass=masses, tau=FREE), [(0, -3, 0, 3)]
    else:
        places = [(-0.2 - 0.5 * gap, 0), (0.2 + 0.5 * gap, 0)]
        crowd, walls = make_crowd(places, [(0.5 * speed, 0), (-0.5 * speed, 0)], mass=masses, tau=FREE), []
    engine = walk(model, crowd, steps, h=h, building=make_building(walls=walls))
    return engine, np.ptp([*crowd.velocity[:, 0], *([0.0] if len(masses) == 1 else [])])


@pytest.mark.parametrize("masses", [(80.0,), (70.0, 70.0), (20.0, 100.0)], ids=["wall", "equal", "unequal"])
def test_a_collision_is_half_a_period_of_an_oscillation(masses):
    """The overlap is v / W sin(W t), W^2 = k / m with the reduced mass, up to an error that vanishes with the step."""
    reduced = masses[0] if len(masses) == 1 else masses[0] * masses[1] / sum(masses)
    frequency, speed, errors = np.sqrt(1.2e5 / reduced), 2.0, []
    for h in (4e-5, 1e-5):
        wall = len(masses) == 1
        places = [(-0.2, 0)] if wall else [(-0.2, 0), (0.2, 0)]
        velocity = [(speed, 0)] if wall else [(speed, 0), (0, 0)]
        crowd = make_crowd(places, velocity, radius=0.2, mass=masses, tau=FREE)
        engine = make_engine(crowd, make_building(walls=[(0, -3, 0, 3)] if wall else []))
        tick, error = round(2e-3 / h), 0.0
        for k in range(round(1.2 * np.pi / frequency / 2e-3)):
            engine.advance(Dem(), crowd, k * tick, tick, h, False, False)
            time = 2e-3 * (k + 1)
            exact = speed / frequency * np.sin(frequency * time)
            if time > np.pi / frequency:
                exact = -speed * (time - np.pi / frequency)
            overlap = 0.2 + crowd.position[0, 0] if wall else 0.4 - np.ptp(crowd.position[:, 0])
            error = max(error, abs(overlap - exact))
        errors.append(error)
        assert kinetic_energy(crowd) == pytest.approx(0.5 * masses[0] * speed**2, rel=1e-3)
    assert errors[0] < 1e-7
    assert errors[1] < 0.3 * errors[0]


def speeds_after(h_squared):
    """The least and greatest speed after a collision at speed 1, W = 1, by eqs 16 and 17, over where steps begin."""
    h, speeds = np.sqrt(h_squared), []
    for share in np.linspace(0.0, 1.0, 2001):
        overlap, velocity = -h * share, 1.0
        while velocity > 0.0 or overlap > 0.0:
            velocity -= h * max(overlap, 0.0)
            overlap += h * velocity
        speeds.append(-velocity)
    return min(speeds), max(speeds)


def test_up_to_the_coarsest_step_no_collision_changes_the_speed_by_more_than_a_tenth():
    for h_squared in np.linspace(0.05, COARSEST, 40):
        least, greatest = speeds_after(h_squared)
        assert least > 0.9
        assert greatest < 1.1
    assert speeds_after(0.72)[1] > 1.1


@pytest.mark.parametrize(
    ("stiffness", "masses"),
    [(1.2e5, (20.0, 20.0)), (1.2e5, (30.0, 30.0)), (1.2e5, (35.0, 35.0)), (1.2e5, (20.0, 90.0)), (1.2e5, (10.0,)),
     (1.2e6, (70.0, 70.0)), (1.2e8, (70.0, 70.0))],
)  # fmt: skip
def test_contact_steps_are_divided_until_the_lightest_pair_keeps_its_speed(stiffness, masses):
    """To a tenth, in steps of 10 ms, wherever the people are when the step begins in which they touch."""
    squared = 1e-4 * stiffness * sum(1.0 / mass for mass in masses)
    for share in np.linspace(0.0, 0.99, 34):
        engine, speed = collide(Dem(stiffness=stiffness), masses, 1.5, (3.0 + share) * 0.015, 0.01)
        report = engine.report()
        assert speed == pytest.approx(1.5, rel=0.1)
        assert (report["too_stiff_steps"] > 0) == (squared > COARSEST)
        touching = np.pi / np.sqrt(squared) + 2.0  # in steps
        assert report["steps"] <= report["sub_steps"] <= report["steps"] + touching * 2 ** report["too_stiff_steps"]


@pytest.mark.parametrize("masses", [(80.0, 20.0), (20.0, 80.0)], ids=["light behind", "light ahead"])
@pytest.mark.parametrize(("share", "cuts"), [(0.999, 0), (1.001, 1)])
def test_the_masses_of_both_decide_which_step_is_too_coarse(masses, share, cuts):
    limit = (COARSEST / (1.2e5 * (1.0 / 80.0 + 1.0 / 20.0))) ** 0.5
    crowd = make_crowd([(0.39, 0), (0, 0)], radius=0.2, mass=masses, tau=FREE)
    assert walk(Dem(), crowd, 1, h=share * limit).report()["too_stiff_steps"] == cuts


def test_no_step_is_refused():
    for step in (0.01, 0.1):
        scene = BorderScene(step, False, np.full(2, 0.2), np.array([5.0, 100.0]), np.full(2, 0.1), np.ones(2))
        Dem(stiffness=1e9).check_scene(scene)
    with pytest.raises(ScenarioError, match=r"simulation\.step: .* 0\.2 s"):
        Dem().check_scene(scene._replace(step=0.2, explicit=True))


def test_two_people_at_one_place_are_parted():
    crowd = make_crowd([(0, 0), (0, 0)], radius=0.2, mass=80.0, tau=0.5)
    walls = [(-3, -3, 3, -3), (3, -3, 3, 3), (3, 3, -3, 3), (-3, 3, -3, -3)]
    walk(Dem(), crowd, 300, building=make_building(walls=walls))
    assert np.hypot(*(crowd.position[0] - crowd.position[1])) > 0.4
    assert np.abs(crowd.position).max() < 3.0


def towards_each_other(distance, stiffness=1e3, row=0.0):
    """Two people who push each other with 1600 N, and others far away, who come first in the crowd."""
    places = [(-0.5 * distance, row), (0.5 * distance, row)]
    others = [(-5.0 + k, 5.0) for k in range(3)]
    crowd = make_crowd([*others, *places], radius=0.2, mass=80.0, tau=0.1, speed=[0.0] * 3 + [2.0] * 2)
    return crowd, make_engine(crowd, fields=fields_towards((0.0, row), extent=24.0)), Dem(stiffness=stiffness)


def push_on(crowd, engine, model, steps, first=0):
    for step in range(first, first + steps):
        engine.advance(model, crowd, step, 1, 0.01, False, False)


def test_a_run_ends_where_two_people_would_pass_through_each_other():
    """At an overlap of two radii the spring has 400 N against 1600 N."""
    crowd, engine, model = towards_each_other(0.6)
    with pytest.raises(SimulationError) as caught:
        push_on(crowd, engine, model, 100)
    report = engine.report()
    assert re.search(
        r"^t = 0\.\d+ s: person [34] at \(-?0\.0\d, -?0\.00\) on level 0 and person [34] would pass .*256 parts.*"
        r"\[behaviours\.walking\].*contact\.dem\.stiffness.*simulation\.step.*'nsm1'",
        str(caught.value),
    )
    assert report["passes_prevented"] > 0
    assert 0.35 < report["greatest_overlap"] < 0.4
    assert crowd.position[3, 0] < 0.0 < crowd.position[4, 0]


def test_springs_that_hold_the_load_let_nobody_pass():
    crowd, engine, model = towards_each_other(0.6, stiffness=1e4)
    push_on(crowd, engine, model, 300)
    assert engine.report()["passes_prevented"] == 0
    assert 0.4 - np.ptp(crowd.position[3:, 0]) == pytest.approx(0.16, abs=0.01)


def test_people_who_overlap_at_the_start_may_pass_until_they_have_parted():
    crowd, engine, model = towards_each_other(0.25)
    crowd.velocity[3:, 0] = 2.0, -2.0
    push_on(crowd, engine, model, 20)
    assert crowd.position[3, 0] > crowd.position[4, 0]
    crowd.position[3:] = (-0.3, 0.0), (0.3, 0.0)
    with pytest.raises(SimulationError, match="would pass through each other"):
        push_on(crowd, engine, model, 100, first=20)


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
