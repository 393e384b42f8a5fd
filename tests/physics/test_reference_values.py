"""The reference values of the paper and of exact solutions, each to 1e-9."""

import numpy as np
import pytest

from evac.directions.fields import Fields
from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import SOLVERS, make_building, make_engine, uniform_fields, walk

FREE = 1e30  # a relaxation time so long that nothing drives
TIGHT = {"velocity_tolerance": 1e-12, "iterations": 200000}
EXACT = {"rtol": 0.0, "atol": 1e-9}


def fall_on_wall(model):
    """Figure 2: a disc that meets the ground y = 0 obliquely; returns (81, 2) positions and velocities."""
    crowd = make_crowd([(0.5, 0.5)], [(2**-0.5, -(2**-0.5))], radius=0.22, tau=FREE)
    engine = make_engine(crowd, make_building(walls=[(-10, 0, 10, 0)]))
    states = [np.concatenate([crowd.position[0], crowd.velocity[0]])]
    for step in range(80):
        engine.advance(model, crowd, step, 1, 0.01, True, False)
        states.append(np.concatenate([crowd.position[0], crowd.velocity[0]]))
    return np.array(states)


@pytest.mark.parametrize("solver", SOLVERS)
def test_figure_2_nsm1(solver):
    states = fall_on_wall(Nsm1(solver=solver, gap_tolerance=1e-12, **TIGHT))
    np.testing.assert_allclose(states[39, 1], 0.5 - 0.39 / 2**0.5, **EXACT)
    np.testing.assert_allclose(states[40, [1, 3]], [0.22, -(states[39, 1] - 0.22) / 0.01], **EXACT)
    np.testing.assert_allclose([states[39, 1], states[40, 3]], [0.224228, -0.422836], atol=5e-7)
    np.testing.assert_allclose(states[41:, 1], 0.22, **EXACT)
    np.testing.assert_allclose(states[41:, 3], 0.0, **EXACT)
    np.testing.assert_allclose(states[:, 0], 0.5 + 0.01 * np.arange(81) / 2**0.5, **EXACT)
    np.testing.assert_allclose(states[80, 0], 1.065685, atol=5e-7)


@pytest.mark.parametrize("solver", SOLVERS)
def test_figure_2_nsm2(solver):
    states = fall_on_wall(Nsm2(solver=solver, normal_dissipation=0.0, **TIGHT))
    np.testing.assert_allclose(states[:40, 3], -(2**-0.5), **EXACT)
    np.testing.assert_allclose(states[40:, 3], 0.0, **EXACT)
    np.testing.assert_allclose(states[40:, 1], 0.5 - 0.395 / 2**0.5, **EXACT)
    np.testing.assert_allclose(states[40:, 1], 0.220693, atol=5e-7)
    np.testing.assert_allclose(states[80, 0], 1.065685, atol=5e-7)


def three_in_line(model, mass=80.0):
    crowd = make_crowd([(0, 0), (0.4, 0), (0.8, 0)], [(1, 0), (0, 0), (0, 0)], mass=mass, tau=FREE)
    walk(model, crowd, 1)
    return crowd.velocity


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("kind", "mass", "expected"),
    [
        (lambda **given: Nsm1(gap_tolerance=1e-12, **given), 80.0, [1 / 3, 1 / 3, 1 / 3]),
        (lambda **given: Nsm2(normal_dissipation=0.0, **given), 80.0, [1 / 3, 1 / 3, 1 / 3]),
        (lambda **given: Nsm2(normal_dissipation=np.inf, **given), 80.0, [-1 / 3, 2 / 3, 2 / 3]),
        (lambda **given: Nsm2(normal_dissipation=10.0, **given), 1.0, [-3 / 17, 10 / 17, 10 / 17]),
    ],
    ids=["nsm1", "nsm2-0", "nsm2-inf", "nsm2-10"],
)
def test_three_equal_discs_in_line(kind, mass, expected, solver):
    velocity = three_in_line(kind(solver=solver, **TIGHT), mass)
    np.testing.assert_allclose(velocity[:, 0], expected, **EXACT)
    np.testing.assert_array_equal(velocity[:, 1], 0.0)


def test_pairs_within_reach_that_part_leave_the_one_between_them_its_collision():
    places = [(0, 0), (0.42, 0), (5, 0), (5.4, 0), (10, 0), (10.42, 0)]
    before = [-1.5, 1.5, 1.0, -1.0, -1.5, 1.5]
    crowd = make_crowd(places, [(x, 0) for x in before], mass=80.0, tau=FREE)
    walk(Nsm2(normal_dissipation=0.0, **TIGHT), crowd, 1)
    np.testing.assert_allclose(crowd.velocity[:, 0], [-1.5, 1.5, 0.0, 0.0, -1.5, 1.5], **EXACT)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("dissipation", "expected", "digits"),
    [(1e5, [-1.622658, 0.873595], 5e-7), (100.0, [-2 / 7, 1 / 14], 1e-9), (0.0, [-0.0625, -0.0625], 1e-9)],
)
def test_pair_of_60_and_100_kg(dissipation, expected, digits, solver):
    crowd = make_crowd([(0, 0), (0.4, 0)], [(1.5, 0.3), (-1, -0.7)], mass=[60, 100], tau=FREE)
    walk(Nsm2(normal_dissipation=dissipation, solver=solver, **TIGHT), crowd, 1)
    np.testing.assert_allclose(crowd.velocity[:, 0], expected, rtol=0, atol=digits)
    np.testing.assert_array_equal(crowd.velocity[:, 1], [0.3, -0.7])


@pytest.mark.parametrize("tau", [0.1, 0.5])
def test_explicit_drive_alone(tau):
    crowd = make_crowd([(0, 0)], tau=tau, speed=1.4)
    engine = make_engine(crowd)
    speeds = []
    model = Dem()
    for step in range(50):
        engine.advance(model, crowd, step, 1, 0.01, True, False)
        speeds.append(crowd.velocity[0, 0])
    np.testing.assert_allclose(speeds, 1.4 * (1 - (1 - 0.01 / tau) ** np.arange(1, 51)), **EXACT)


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=["dem", "nsm1", "nsm2"])
def test_exponential_drive_alone_is_exact_in_velocity(model):
    crowd = make_crowd([(0, 0)], tau=0.3, speed=1.4)
    walk(model, crowd, 100, explicit=False)
    np.testing.assert_allclose(crowd.velocity[0, 0], 1.4 * -np.expm1(-1.0 / 0.3), **EXACT)


@pytest.mark.parametrize(
    ("model", "explicit", "lag"),
    [
        (Dem(), True, 0.5 - 0.01),
        (Nsm1(), True, 0.5 - 0.01),
        (Nsm2(), True, 0.5 - 0.005),
        (Dem(), False, 0.01 / np.expm1(0.01 / 0.5)),  # about tau - h/2
        (Nsm2(), False, 0.01 / np.expm1(0.01 / 0.5) + 0.005),  # about tau + h^2 / (12 tau)
    ],
    ids=["dem", "nsm1", "nsm2", "dem-exponential", "nsm2-exponential"],
)
def test_lag_from_rest(model, explicit, lag):
    crowd = make_crowd([(-9, 0)], tau=0.5, speed=1.33)
    walk(model, crowd, 1200, explicit=explicit)
    np.testing.assert_allclose(crowd.position[0, 0], -9 + 1.33 * (12.0 - lag), **EXACT)


def walk_against_each_other(model, tau):
    """Figure 3: two people walk against each other, offset by 0.1 m; returns the time until both are at speed."""
    fields = uniform_fields(2)
    away = uniform_fields(1, (-1.0, 0.0))
    both = away.packed.replace(
        field_of=np.array([[0, 1]], np.int32),
        offset=np.array([0, 4], np.int64),
        direction=np.concatenate([fields.packed.direction, away.packed.direction]),
        travel_time=np.concatenate([fields.packed.travel_time, away.packed.travel_time]),
    )
    fields = Fields((*fields.routes, *away.routes), both)
    crowd = make_crowd([(-1, 0), (1, 0.1)], [(1.4, 0), (-1.4, 0)], radius=0.22, tau=tau, speed=1.4)
    crowd.route[1] = 1
    engine = make_engine(crowd, fields=fields)
    wanted = np.array([[1.4, 0.0], [-1.4, 0.0]])
    last = 0.0
    slowest = 1.4
    for step in range(1200):
        engine.advance(model, crowd, step, 1, 0.01, True, False)
        slowest = min(slowest, abs(crowd.velocity[0, 0]))
        if np.abs(crowd.velocity - wanted).max() > 0.014:
            last = 0.01 * (step + 1)
    assert slowest < 0.7  # they did collide
    assert crowd.position[0, 0] > crowd.position[1, 0]  # and passed
    return last


@pytest.mark.parametrize("model", [Dem(), Nsm1(), Nsm2()], ids=["dem", "nsm1", "nsm2"])
def test_figure_3_people_return_to_their_velocity_sooner_with_a_smaller_tau(model):
    ends = [walk_against_each_other(model, tau) for tau in (0.1, 0.3, 0.5)]
    assert ends[0] < ends[1] < ends[2] < 12.0
