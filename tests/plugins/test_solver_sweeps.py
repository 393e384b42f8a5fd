"""Momentum: chains and crowds in rows, where it helps, swings up and has to turn back."""

import numpy as np
import pytest

from evac.jit import Floats, kernel
from evac.physics.contact.rows import INELASTIC, sweep_down, sweep_up
from evac.physics.state import Problem
from evac_plugins.solver_sweeps import sweep_back, sweep_on
from tests.physics.contact_problems import do_pack, find_residual, make_problem_state, run_solver
from tests.physics.scenes import SOLVERS


def solve_queue(solver, people):
    """Solve for a queue that walks against a wall at 1.5 m/s; return (iterations, error of percussions [N s])."""
    mass = np.linspace(60.0, 100.0, people)
    state = make_problem_state(1.0 / mass, people)
    contacts = state.contacts
    contacts.body[:] = np.arange(people)
    contacts.other[:] = np.arange(people) - 1  # the first one at the wall
    contacts.normal[:] = (1.0, 0.0)
    contacts.omega[:] = 1.0 / mass + np.append(0.0, 1.0 / mass[:-1])
    free = np.column_stack([np.full(people, -1.5), np.zeros(people)])
    velocity = np.zeros_like(free)
    iterations, found = run_solver(solver, state, free, velocity, INELASTIC, 0.0, 1e-9, 100000)
    assert found <= 1e-9
    exact = 1.5 * np.cumsum(mass[::-1])[::-1]  # everybody stops: each contact carries all who are behind it
    return iterations, np.abs(contacts.percussion - exact).max()


@pytest.mark.parametrize("solver", SOLVERS)
def test_queue_against_a_wall_carries_all_behind(solver):
    _, error = solve_queue(solver, 20)
    assert error <= 1e-3


def test_momentum_makes_iterations_grow_with_the_length_of_a_chain_not_its_square():
    plain = [solve_queue("gauss_seidel", people)[0] for people in (20, 80)]
    fast = [solve_queue("accelerated_sweeps", people)[0] for people in (20, 80)]
    assert plain[1] > 10 * plain[0]
    assert fast[1] < 6 * fast[0]


def packed(lines, width):
    """Return people packed in a triangular lattice at a wall, each contact with the one behind and beside in order."""
    place = [(k * np.sqrt(0.75), i + 0.5 * (k % 2)) for k in range(lines) for i in range(width)]
    found = [(i, -1, (1.0, 0.0)) for i in range(width)]
    for i, one in enumerate(place):
        for j in range(i):
            away = np.subtract(one, place[j])
            if np.hypot(*away) < 1.01:
                found.append((i, j, away / np.hypot(*away)))
    state = make_problem_state(np.full(len(place), 1.0 / 80.0), len(found))
    contacts = state.contacts
    for c, (body, other, normal) in enumerate(found):
        contacts.body[c], contacts.other[c], contacts.normal[c] = body, other, normal
        contacts.omega[c] = (1.0 if other < 0 else 2.0) / 80.0
    return state, len(place)


@pytest.mark.parametrize("limit", [7, 201, 20000])
def test_momentum_that_does_not_suit_is_given_up(limit):
    state, people = packed(20, 20)
    free = np.random.default_rng(2).normal(0.0, 1.5, (people, 2))
    velocity = np.zeros_like(free)
    iterations, found = run_solver("accelerated_sweeps", state, free, velocity, INELASTIC, 0.0, 1e-6, limit)
    assert iterations <= limit  # two sweeps at once do not go beyond it
    assert (found <= 1e-6) == (limit == 20000)
    assert np.isfinite(velocity).all()
    assert np.sum(velocity**2) <= np.sum(free**2)  # percussions of an inelastic law only take energy
    assert found == pytest.approx(find_residual(state, velocity, INELASTIC, 0.0), rel=1e-6, abs=1e-12)


def test_sweeps_of_an_orderly_crowd_run_back_and_forth():
    """Momentum of sweeps in one direction swings up here; at half of it, 3000 sweeps come to 2e-5."""
    state, people = packed(20, 20)
    state.contacts.bias[:] = -0.1
    free = np.zeros((people, 2))
    velocity = np.zeros_like(free)
    iterations, found = run_solver("accelerated_sweeps", state, free, velocity, INELASTIC, 0.0, 1e-6, 3000)
    assert found <= 1e-6
    assert iterations < 2000


@kernel
def do_sweep(rows: Problem, share: float, back: bool, found: Floats) -> None:
    if back:
        found[0], found[1] = sweep_back(rows)
    else:
        found[0], found[1] = sweep_on(rows, share)


@kernel
def do_relax(rows: Problem, back: bool) -> float:
    return sweep_down(rows) if back else sweep_up(rows)


def crowd(seed, dissipation=0.0, people=40):
    """Return the packed rows of people with random others and with walls, and percussions between them."""
    random = np.random.default_rng(seed)
    pairs = sorted({tuple(sorted(random.choice(people, 2, replace=False))) for _ in range(3 * people)})
    at_wall = random.choice(people, 15, replace=False)
    mass = random.uniform(50.0, 100.0, people)
    state = make_problem_state(1.0 / mass, len(pairs) + len(at_wall))
    contacts = state.contacts
    contacts.body[:] = [*(i for i, _ in pairs), *at_wall]
    contacts.other[:] = [*(j for _, j in pairs), *np.full(len(at_wall), -1)]
    angle = random.uniform(0.0, 2.0 * np.pi, contacts.number)
    contacts.normal[:] = np.column_stack([np.cos(angle), np.sin(angle)])
    contacts.omega[:] = 1.0 / mass[contacts.body] + np.where(contacts.other < 0, 0.0, 1.0 / mass[contacts.other])
    contacts.bias[:] = random.uniform(0.0, 0.3, contacts.number)
    contacts.velocity_before[:] = random.normal(0.0, 1.0, contacts.number)
    contacts.percussion[:] = random.uniform(0.0, 30.0, contacts.number)
    free = random.normal(0.0, 1.5, (people, 2))
    do_pack(state, free, 2.0 / dissipation if dissipation else INELASTIC, 0.0)
    return state.problem


@pytest.mark.parametrize("dissipation", [0.0, 1e3])
@pytest.mark.parametrize("back", [False, True])
def test_a_sweep_relaxes_the_rows_one_after_the_other(dissipation, back):
    rows, twin = crowd(7, dissipation), crowd(7, dissipation)
    n, found = rows.size, np.zeros(2)
    rows.work_a[:] = rows.percussion
    before = rows.percussion[:n].copy()
    do_sweep(rows, 0.0, back, found)
    assert found[1] == pytest.approx(do_relax(twin, back), rel=1e-12)
    np.testing.assert_allclose(rows.percussion[:n], twin.percussion[:n], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows.velocity, twin.velocity, rtol=0, atol=1e-12)
    assert found[0] == pytest.approx(-np.sum((twin.percussion[:n] - before) ** 2), rel=1e-12)


def test_a_sweep_goes_on_by_a_share_of_the_last_step():
    rows, twin = crowd(8), crowd(8)
    n, found = rows.size, np.zeros(2)
    x, last = rows.percussion.copy(), 0.5 * rows.percussion
    rows.work_a[:] = last
    start = x + 0.4 * (x - last)
    moving, slow = rows.velocity[: rows.bodies].copy(), 0.5 * rows.velocity[: rows.bodies]
    rows.image_a[: rows.bodies] = slow
    twin.velocity[: rows.bodies] += 0.4 * (moving - slow)
    do_sweep(rows, 0.4, False, found)
    assert found[0] == pytest.approx(-np.sum((rows.percussion - start)[:n] * (rows.percussion - x)[:n]), rel=1e-9)
    twin.percussion[:n] = start[:n]
    assert found[1] == pytest.approx(do_relax(twin, False), rel=1e-12)
    np.testing.assert_allclose(rows.percussion[:n], twin.percussion[:n], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows.velocity, twin.velocity, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(rows.work_a[:n], x[:n])
    np.testing.assert_array_equal(rows.image_a[: rows.bodies], moving)


def test_the_slope_of_a_sweep_back_is_along_the_step_of_both_sweeps():
    rows, found = crowd(9), np.zeros(2)
    n = rows.size
    x, last = rows.percussion[:n].copy(), 0.5 * rows.percussion[:n]
    rows.work_a[:n] = last
    do_sweep(rows, 0.0, True, found)
    assert found[0] == pytest.approx(-np.sum((rows.percussion[:n] - x) * (rows.percussion[:n] - last)), rel=1e-9)
    np.testing.assert_array_equal(rows.work_a[:n], last)
