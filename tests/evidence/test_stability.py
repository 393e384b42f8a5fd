"""The theory that the stability evidence draws, its verdicts, and a quick run of the whole."""

import numpy as np
import pytest

from evac.evidence import scenes
from evac.evidence.scenes import Scene
from evac.evidence.stability.dem import GROWTH, NUDGE, crowd_in_corridor, nudged, settled
from evac.evidence.stability.theory import (
    greatest_frequency,
    spring_forces,
    step_limit,
    uncut_speed,
    walk_lag,
)
from evac.evidence.stability.trials import (
    attempt,
    make_model,
)
from evac.physics.scenes import one_direction, room
from evac.physics.state import make_crowd

ROOM = (0.0, 0.0, 8.0, 4.0)


def room_with(position, **settings):
    crowd = make_crowd(position, **settings)
    return Scene(ROOM, room(ROOM), one_direction(ROOM), crowd)


def test_frequency_of_a_pair():
    scene = room_with([(3.0, 2.0), (3.4, 2.0)], mass=np.array([60.0, 100.0]))
    assert greatest_frequency(scene, scene.crowd.position, 1e5) ** 2 == pytest.approx(1e5 * (1 / 60 + 1 / 100))


def test_frequency_of_a_body_at_a_wall():
    scene = room_with([(7.8, 2.0)], mass=60.0)
    assert greatest_frequency(scene, scene.crowd.position, 1e5) ** 2 == pytest.approx(1e5 / 60)


def test_large_triangular_packing_nears_six_k_over_m():
    bounds = (0.0, 0.0, 40.0, 40.0)
    crowd = make_crowd(scenes.packed(200, 14, 0.2, 30.0, 5.0), mass=60.0)
    scene = Scene(bounds, room(bounds), one_direction(bounds), crowd)
    value = greatest_frequency(scene, crowd.position, 1e5) ** 2 * 60.0 / 1e5
    assert 5.7 < value < 6.0


@pytest.mark.parametrize("explicit", [True, False])
@pytest.mark.parametrize("tau", [0.01, 0.5])
def test_step_limit_is_where_the_companion_matrix_leaves_the_unit_circle(explicit, tau):
    omega = 100.0
    limit = step_limit(omega, tau, explicit)

    def radius(h):
        kept = 1.0 - h / tau if explicit else np.exp(-h / tau)
        # velocity, then position with the new velocity
        step = np.array([[kept, -h * omega**2], [h * kept, 1.0 - (h * omega) ** 2]])
        return np.abs(np.linalg.eigvals(step)).max()

    assert radius(0.999 * limit) <= 1.0 + 1e-12
    assert radius(1.001 * limit) > 1.0


def test_pressed_crowd_turns_unstable_at_the_limit_of_its_network():
    rest = settled(crowd_in_corridor(12, 3, 60.0), 1e5)
    limit = step_limit(greatest_frequency(rest, rest.crowd.position, 1e5), 0.5, False)
    start = nudged(rest, np.random.default_rng(1))
    assert uncut_speed(start, 1e5, 0.98 * limit, False, 400) <= GROWTH * NUDGE
    assert uncut_speed(start, 1e5, 1.02 * limit, False, 400) > GROWTH * NUDGE


def test_spring_forces_hold_what_drives_a_crowd_at_rest():
    rest = settled(crowd_in_corridor(12, 3, 60.0), 1e5)
    start = nudged(rest, np.random.default_rng(1))
    plain = spring_forces(start, start.crowd.position, 1e5)
    # in balance: the contacts hold what drives each person, m v (1 - exp(-h/tau)) / h in the limit of small h
    np.testing.assert_allclose(plain[:, 0], -start.crowd.mass * start.crowd.speed[:, 0] / start.crowd.tau, rtol=0.02)
    np.testing.assert_allclose(plain[:, 1], 0.0, atol=1e-6)


@pytest.mark.parametrize("explicit", [True, False])
@pytest.mark.parametrize(("variant", "midpoint"), [("NSM1 inertial", False), ("NSM2 K_N = 1e5", True)])
def test_theory_of_a_free_walk_is_what_the_engine_makes(variant, midpoint, explicit):
    scene = room_with([(1.0, 2.0)], speed=1.5, tau=0.1)
    trial = attempt(make_model(variant), scene, 0.05, 4.0, explicit=explicit, every=0.05)
    exact = 1.0 + 1.5 * (trial.time + 0.1 * np.expm1(-trial.time / 0.1))
    lag = np.abs(trial.position[:, 0, 0] - exact).max()
    assert lag == pytest.approx(1.5 * walk_lag(0.1, 0.05, 4.0, explicit, midpoint), rel=1e-9)
