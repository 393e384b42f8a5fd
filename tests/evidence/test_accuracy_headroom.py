"""How few sweeps a best combination needs: against least squares, and against what solvers need."""

import numpy as np
import pytest
from scipy import sparse

from evac.evidence.accuracy import headroom
from evac.evidence.accuracy.headroom import least_sweeps, pushing_system, sweep_order
from evac.evidence.accuracy.problems import LAWS, contact_problem, snapshots


@pytest.fixture(scope="module")
def settled():
    return snapshots(40, 1)["settled"]


def chain(n):
    """Return the matrix of n equal contacts in line, one of them at a wall, with unit diagonal."""
    dense = np.eye(n) - 0.5 * np.eye(n, k=1) - 0.5 * np.eye(n, k=-1)
    dense[0, :2] = 1.0, -np.sqrt(0.5)
    dense[1, 0] = -np.sqrt(0.5)
    return sparse.csc_matrix(dense)


def best_residuals(matrix, right, sweeps):
    """Return the least residuals by root mean square over all combinations of 1, 2, ... sweeps, by least squares."""
    dense = matrix.toarray()
    lower = np.tril(dense)
    steps, found = [], []
    step = np.linalg.solve(lower, right)
    for _ in range(sweeps):
        steps.append(step / np.linalg.norm(step))
        basis = np.linalg.qr(np.array(steps).T)[0]
        share = np.linalg.lstsq(dense @ basis, right, rcond=None)[0]
        found.append(right - dense @ basis @ share)
        step = np.linalg.solve(lower, dense @ steps[-1])  # what one more sweep can find
    return found


def test_contacts_apart_from_each_other_take_one_sweep():
    assert least_sweeps(sparse.identity(5, format="csc"), np.ones(5), np.ones(5), 1e-12) == 1


def test_no_sweep_where_nothing_is_left():
    assert least_sweeps(sparse.identity(5, format="csc"), np.full(5, 1e-3), np.full(5, 2.0), 2e-3) == 0


def test_the_search_ends_after_the_longest(monkeypatch):
    monkeypatch.setattr(headroom, "LONGEST", 3)
    assert least_sweeps(chain(12), np.ones(12), np.ones(12), 1e-12) == 3


@pytest.mark.parametrize("residual", [3e-2, 1e-2, 1e-4])
def test_sweeps_are_those_that_least_squares_over_all_combinations_need(residual):
    matrix, right = chain(12), np.random.default_rng(3).normal(size=12)
    scale = np.linspace(0.5, 2.0, 12)
    worst = [np.max(np.abs(left) * scale) for left in best_residuals(matrix, right, 12)]
    assert least_sweeps(matrix, right, scale, residual) == 1 + next(k for k, w in enumerate(worst) if w <= residual)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.label)
def test_percussions_found_solve_the_system_of_the_contacts_that_push(settled, law):
    problem = contact_problem(settled, law)
    matrix, right, scale = pushing_system(problem, "gauss_seidel")
    c = problem.size
    percussion = problem.contacts.percussion[:c]
    order = sweep_order(problem)
    assert sorted(order) == list(range(c))
    pushing = order[percussion[order] > 0.0]
    root = problem.contacts.omega[:c][pushing] / scale
    assert matrix.diagonal() == pytest.approx(1.0, rel=1e-12)
    assert len(right) == (percussion > 0.0).sum() > 10
    left = right - matrix @ (root * percussion[pushing])
    assert np.max(np.abs(left) * scale) < 10.0 * headroom.SURE


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.label)
def test_no_solver_by_sweeps_needs_fewer_than_the_best_combination(settled, law):
    problem = contact_problem(settled, law)
    residual = 1e-7
    best = least_sweeps(*pushing_system(problem, "gauss_seidel"), residual)
    for solver in ("gauss_seidel", "accelerated_sweeps"):
        problem.start(False)
        assert problem.solve(solver, residual, 100_000)[0] >= best > 1


def test_sweeps_are_counted_to_the_residual_that_the_goal_means(settled):
    """A goal of 1e-7 m is 1e-5 m/s under NSM1, whose step is 0.01 s."""
    problem = contact_problem(settled, LAWS[0])
    found = headroom._counted(problem, 1e-7, "accelerated_sweeps")
    assert found["best: sweeps"] == least_sweeps(*pushing_system(problem, "gauss_seidel"), 1e-5)
    problem.start(False)
    assert found["gauss_seidel: sweeps"] == problem.solve("gauss_seidel", 1e-5, 100_000)[0]
    span = found["accelerated_sweeps [ms]"]
    assert span > 0.0
    assert found["accelerated_sweeps: [ns] per contact and sweep"] == pytest.approx(
        1e6 * span / found["accelerated_sweeps: sweeps"] / problem.size
    )
    assert found["one factorisation [ms]"] > 0.0


def test_medians_over_crowds_are_told_beside_the_target():
    def row(best, factorisation):
        found = {
            "gauss_seidel: sweeps": 300.0,
            "fast: sweeps": 20.0,
            "best: sweeps": best,
            "gauss_seidel [ms]": 60.0,
            "fast [ms]": 5.0,
            "one factorisation [ms]": factorisation,
        }
        return headroom._row([{**found, "best: sweeps": 1.0}, found, found], "fast", 30.0)

    first = row(15.0, 2.5)
    assert first["best: sweeps"] == 15.0
    assert first["gauss_seidel / fast"] == 12.0
    assert first["gauss_seidel / best"] == 16.0  # at 0.25 ms a sweep
    assert first["time at the target [ms]"] == 2.0
