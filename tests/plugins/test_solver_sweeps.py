"""Momentum: chains and crowds in rows, where it helps, swings up and has to turn back."""

import numpy as np
import pytest

from evac.physics.rows import INELASTIC
from tests.physics.contact_problems import find_residual, make_problem_state, run_solver
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


@pytest.mark.parametrize("limit", [7, 30, 50, 201, 20000])
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


@pytest.mark.parametrize("seed", [2, 3])
def test_rises_between_sweeps_back_and_forth_cost_little(seed):
    """The energy rises here also once sweeps run back and forth, but not soon: they keep their momentum."""
    state, people = packed(20, 20)
    free = np.random.default_rng(seed).normal(0.0, 1.5, (people, 2))
    velocity = np.zeros_like(free)
    iterations, found = run_solver("accelerated_sweeps", state, free, velocity, INELASTIC, 0.0, 1e-6, 2000)
    assert found <= 1e-6
    assert iterations < 800
