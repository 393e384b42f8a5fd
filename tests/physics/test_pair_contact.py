"""Contact laws of one contact: Hertz against its exact collision, and the division of steps."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.integrate import quad

from evac.base.errors import PluginError, ScenarioError
from evac.base.parameters import Parameter
from evac.jit import pair_contact, pair_friction
from evac.physics.contact.model import border_scene
from evac.physics.contact.pair_contact import COARSEST, PairContact
from evac.physics.state import make_crowd
from tests.physics.scenes import kinetic_energy, make_building, make_engine, walk

FREE = 1e30


@pair_contact
def hertz(gap, closing_speed, reduced_mass, parameters):
    return -parameters[0] * gap * math.sqrt(-gap)


@pair_contact
def linear(gap, closing_speed, reduced_mass, parameters):
    return -parameters[0] * gap + parameters[1] * closing_speed


@pair_contact
def of_a_frequency(gap, closing_speed, reduced_mass, parameters):
    return -reduced_mass * parameters[0] ** 2 * gap


class Hertz(PairContact):
    """Elastic spheres."""

    name = "hertz"
    pair = hertz
    stiffness = Parameter(1e6, "K", unit="N/m^1.5")


class Linear(PairContact):
    """A spring and a damper."""

    name = "linear"
    pair = linear
    stiffness = Parameter(1.2e5, "k", unit="kg/s2")
    damping = Parameter(0.0, "c", unit="kg/s")


@pair_friction
def without_friction(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters):
    return -parameters[0] * gap, 0.0


class Sticky(PairContact):
    """A spring that could brake sliding."""

    name = "sticky"
    pair = without_friction
    stiffness = Parameter(1.2e5, "k", unit="kg/s2")


class Tuned(PairContact):
    """A spring of the same frequency for every pair."""

    name = "tuned"
    pair = of_a_frequency
    frequency = Parameter(40.0, "omega", unit="1/s")


def collide(model, masses, speed=2.0, h=1e-4):
    """Let two people run head-on into each other at `speed` each."""
    crowd = make_crowd([(-0.21, 0), (0.21, 0)], [(speed, 0), (-speed, 0)], radius=0.2, mass=masses, tau=FREE)
    return crowd, walk(model, crowd, round(0.15 / h), h=h, tick=100)


@pytest.mark.parametrize(("stiffness", "masses"), [(1e6, (80.0, 80.0)), (1e6, (60.0, 100.0)), (2e7, (80.0, 50.0))])
def test_hertz_has_the_exact_overlap_and_duration(stiffness, masses):
    """(5 m v^2 / 4K)^(2/5), and its integral of dt = dD / v(D) there and back, m being the reduced mass."""
    crowd, engine = collide(Hertz(stiffness=stiffness), masses, h=1e-5)
    reduced, speed = masses[0] * masses[1] / sum(masses), 4.0
    deepest = (1.25 * reduced * speed**2 / stiffness) ** 0.4
    duration = 2.0 * deepest / speed * quad(lambda x: 1.0 / math.sqrt(1.0 - x**2.5), 0.0, 1.0)[0]
    report = engine.report()
    assert report["greatest_overlap"] == pytest.approx(deepest, rel=1e-4)
    assert report["contacts"] * 1e-5 == pytest.approx(duration, rel=1e-3)
    assert kinetic_energy(crowd) == pytest.approx(2.0 * sum(masses), rel=1e-3)
    assert report["sub_steps"] == report["steps"]


def test_undamped_energy_is_kept_better_with_shorter_steps():
    errors = [abs(kinetic_energy(collide(Hertz(), (80.0, 80.0), h=h)[0]) / 320.0 - 1.0) for h in (1e-3, 1e-4, 1e-5)]
    assert errors[0] < 0.05
    assert errors[1] < 0.3 * errors[0]
    assert errors[2] < 0.3 * errors[1]


def test_percussions_account_for_what_a_damper_takes():
    crowd, engine = collide(Linear(damping=800.0), (60.0, 100.0))
    report = engine.report()
    taken = report["contact_dissipation"] - report["contact_creation"]
    assert 320.0 - kinetic_energy(crowd) == pytest.approx(taken, rel=1e-9)
    assert 0.05 < taken / 320.0 < 0.9
    assert crowd.mass @ crowd.velocity[:, 0] == pytest.approx(-80.0, abs=1e-9)


def test_the_reduced_mass_is_that_of_the_pair_and_of_the_body_at_a_wall():
    """Half a period of the frequency passes in every contact, whoever takes part."""
    for masses in ((80.0, 80.0), (20.0, 140.0)):
        engine = collide(Tuned(), masses)[1]
        assert engine.report()["contacts"] * 1e-4 == pytest.approx(math.pi / 40.0, rel=5e-3)
    crowd = make_crowd([(-0.21, 0)], [(2.0, 0)], radius=0.2, mass=55.0, tau=FREE)
    engine = walk(Tuned(), crowd, 1500, h=1e-4, tick=100, building=make_building(walls=[(0, -3, 0, 3)]))
    assert engine.report()["contacts"] * 1e-4 == pytest.approx(math.pi / 40.0, rel=5e-3)
    assert crowd.velocity[0, 0] == pytest.approx(-2.0, rel=1e-2)


@pytest.mark.parametrize("share", [0.999, 1.001])
@pytest.mark.parametrize("normal", [(-1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
@pytest.mark.parametrize("model", [Hertz(), Linear(damping=9000.0)], ids=["hertz", "damped"])
def test_a_step_is_cut_by_the_slopes_of_the_law(model, normal, share):
    """A body at rest against a wall, 0.03 m deep: too coarse for a spring, or unstable for a spring with a damper.

    The limits are h^2 k / m = `COARSEST` and h^2 k / m + 2 h c / m = 4.
    """
    mass, (x, y) = 80.0, normal
    if model.name == "hertz":
        limit = math.sqrt(COARSEST * mass / (1.5e6 * math.sqrt(0.03)))
    else:
        limit = (math.sqrt(9000.0**2 + 4.0 * 1.2e5 * mass) - 9000.0) / 1.2e5
    crowd = make_crowd([(0.17 * x, 0.17 * y)], radius=0.2, mass=mass, tau=FREE)
    engine = walk(model, crowd, 1, h=share * limit, building=make_building(walls=[(-3 * y, 3 * x, 3 * y, -3 * x)]))
    assert (engine.report()["too_stiff_steps"] > 0) == (share > 1.0)


@pytest.mark.parametrize("share", [0.999, 1.001])
@pytest.mark.parametrize(("tau", "explicit"), [(FREE, False), (0.03, False), (0.03, True)])
@pytest.mark.parametrize("along", [(1.0, 0.0), (0.0, 1.0)])
def test_a_step_is_cut_by_the_sum_of_the_contacts_of_a_body(along, tau, explicit, share):
    """A light body between two heavy ones, with dampers: the sum of 2 c / h (3/m + 1/m') / 2 over its contacts."""
    h = 0.005
    limit = 4.0 - 2.0 * h / tau if explicit else 2.0 * (1.0 + math.exp(-h / tau))
    damping = share * limit / (2.0 * h) / (3.0 / 40.0 + 1.0 / 60.0)
    crowd = make_crowd(np.outer([1.0, 1.39, 1.78], along), radius=0.2, mass=[60.0, 40.0, 60.0], tau=tau)
    engine = make_engine(crowd)
    engine.advance(Linear(stiffness=1e3, damping=damping - 0.5 * h * 1e3), crowd, 0, 1, h, explicit, False)
    assert (engine.report()["too_stiff_steps"] > 0) == (share > 1.0)


@pytest.mark.parametrize("model", [Hertz(stiffness=1e9), Linear(stiffness=1e8), Sticky(stiffness=1e8)])
def test_collisions_of_stiff_contacts_keep_their_speed(model):
    """In steps of 10 ms, which are not refused but divided, also by a collision that begins within one."""
    for gap in np.linspace(0.01, 0.04, 13):
        crowd = make_crowd([(-0.2 - gap, 0), (0.2, 0)], [(1.5, 0), (0, 0)], radius=0.2, mass=60.0, tau=FREE)
        model.check_scene(border_scene(crowd, 0.01, False))
        engine = walk(model, crowd, 20)
        assert crowd.velocity[1, 0] - crowd.velocity[0, 0] == pytest.approx(1.5, rel=0.1)
        assert engine.report()["too_stiff_steps"] > 0


def test_a_law_that_only_attracts_is_refused_and_one_that_does_nothing_is_not():
    scene = border_scene(make_crowd([(0, 0), (1, 0)]), 0.01, False)
    with pytest.raises(PluginError, match=r"'linear': .*linear returns -\d.* N for the gap .*repulsive"):
        Linear(stiffness=-1e3).check_scene(scene)
    Linear(stiffness=0.0).check_scene(scene)


def test_bodies_push_and_do_not_pull():
    """A damper alone brakes while the overlap grows, and holds nobody back after."""
    crowd = make_crowd([(-0.19, 0), (0.19, 0)], [(-1, 0), (1, 0)], radius=0.2, tau=FREE)
    walk(Linear(stiffness=0.0, damping=1e3), crowd, 20)
    np.testing.assert_array_equal(crowd.velocity[:, 0], [-1.0, 1.0])


@pair_contact
def stiffer(gap, closing_speed, reduced_mass, parameters):
    return -3.0 * parameters[0] * gap


class Stiffer(Linear):
    """Has another function than its base class."""

    name = "stiffer"
    pair = stiffer


class Renamed(Stiffer):
    """Has the function of its base class."""

    name = "renamed"


def test_a_subclass_has_the_law_of_its_own_function_or_that_of_its_base():
    wanted = collide(Linear(stiffness=3.6e5), (80.0, 60.0))[0]
    for model in (Stiffer(), Renamed()):
        np.testing.assert_array_equal(collide(model, (80.0, 60.0))[0].velocity, wanted.velocity)
    assert Renamed.law is Stiffer.law is not Linear.law


@pytest.mark.parametrize(("step", "is_refused"), [(0.0199, False), (0.02, True), (0.03, True)])
def test_explicit_driving_needs_a_step_below_twice_the_smallest_relaxation_time(step, is_refused):
    crowd = make_crowd([(0, 0), (1, 0)], tau=[0.5, 0.01])
    Linear(stiffness=0.0).check_scene(border_scene(crowd, step, False))
    with pytest.raises(ScenarioError, match=r"below 0\.02 s") if is_refused else nullcontext():
        Linear(stiffness=0.0).check_scene(border_scene(crowd, step, True))
