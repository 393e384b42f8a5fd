"""The rows of the packed contact problem: their order, and the same solution by all solvers for many of them."""

import numpy as np
import pytest

from evac.jit import Longs, kernel
from evac.physics.contact.percussions import APART, interleaved
from evac.physics.contact.rows import INELASTIC
from tests.physics.contact_problems import do_pack, find_residual, make_problem_state, run_solver


@kernel
def fill_order(rows: int, order: Longs) -> None:
    for k in range(rows):
        order[k] = interleaved(k, rows)


def order_of(rows):
    order = np.full(rows, -1)
    fill_order(rows, order)
    return order


@pytest.mark.parametrize("rows", [1, 7, 63, 64, 65, 127, 128, 300, 1000])
def test_every_row_is_used_once(rows):
    np.testing.assert_array_equal(np.sort(order_of(rows)), np.arange(rows))


def test_rows_of_full_parts_stand_apart_and_the_rest_in_order():
    order = order_of(3 * APART**2 + 10)
    apart = np.abs(np.diff(order))
    within = np.arange(1, len(order)) % APART != 0  # but for the last of a stride and the first of the next
    assert (apart[: 3 * APART**2 - 1][within[: 3 * APART**2 - 1]] == APART).all()
    np.testing.assert_array_equal(order[3 * APART**2 :], np.arange(3 * APART**2, len(order)))


def lattice(lines, width, tangential=0.0):
    """Return the packed state of people on a square lattice beside a wall, and their free velocities."""
    number = np.arange(lines * width).reshape(lines, width)
    walls = [(int(i), -1, (0.0, 1.0)) for i in number[:, 0]]
    pairs = [(int(i), int(j), (1.0, 0.0)) for i, j in zip(number[1:].ravel(), number[:-1].ravel(), strict=True)]
    pairs += [(int(i), int(j), (0.0, 1.0)) for i, j in zip(number[:, 1:].ravel(), number[:, :-1].ravel(), strict=True)]
    found = sorted(walls + pairs, key=lambda contact: contact[0])
    random = np.random.default_rng(1)
    mass = random.uniform(60.0, 100.0, number.size)
    state = make_problem_state(1.0 / mass, len(found))
    contacts = state.contacts
    contacts.body[:], contacts.other[:] = [one[0] for one in found], [one[1] for one in found]
    contacts.normal[:] = [one[2] for one in found]
    two = contacts.other >= 0
    contacts.omega[:] = 1.0 / mass[contacts.body] + np.where(two, 1.0 / mass[contacts.other], 0.0)
    contacts.sticky[:] = random.random(len(found)) < 0.3
    contacts.bias[:] = random.uniform(0.0, 0.1, len(found))
    free = random.normal(0.0, 1.0, (number.size, 2))
    do_pack(state, free, INELASTIC, tangential)
    return state, free


def test_rows_are_the_same_in_python_as_compiled():
    """There are more tangential rows than a byte can count."""
    (compiled, free), (interpreted, _) = lattice(30, 40, 50.0), lattice(30, 40, 50.0)
    assert compiled.contacts.sticky.sum() > 255
    do_pack.function(interpreted, free, INELASTIC, 50.0)
    assert interpreted.problem.size == compiled.problem.size
    for name in ("row", "body", "other"):
        np.testing.assert_array_equal(getattr(interpreted.problem, name), getattr(compiled.problem, name))
    np.testing.assert_allclose(interpreted.problem.data, compiled.problem.data, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("solver", ["accelerated_sweeps", "conjugate_faces"])
def test_solvers_find_the_same_as_sweeps_in_a_large_problem(solver):
    """Percussions need not be unique; velocities are."""
    found = []
    for name in ("gauss_seidel", solver):
        state, free = lattice(60, 40)
        velocity = np.zeros_like(free)
        _, residual = run_solver(name, state, free, velocity, INELASTIC, 0.0, 1e-9, 20_000)
        assert residual <= 1e-9
        assert find_residual(state, velocity, INELASTIC, 0.0) <= 2e-9
        found.append(velocity)
    np.testing.assert_allclose(found[1], found[0], rtol=0.0, atol=1e-6)
