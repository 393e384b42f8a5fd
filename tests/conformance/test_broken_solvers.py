"""Each check of a solver finds the promise it is there for, broken."""

import pytest

from evac.conformance import check_plugin
from evac.errors import PluginError
from evac.jit import inner, kernel
from evac.physics.rows import AX, BIAS, push_row, row_residual, row_velocity, sweep_up
from evac.physics.solver import Solver
from evac.physics.state import Problem


@inner
def sweep(problem, tolerance, limit):
    """Gauss-Seidel: what the solvers below break."""
    iterations = 0
    problem.residual = row_residual(problem)
    while problem.residual > tolerance and iterations < limit:
        sweep_up(problem)
        iterations += 1
        problem.residual = row_residual(problem)
    return iterations


@kernel
def sound(problem: Problem, tolerance: float, limit: int) -> int:
    return sweep(problem, tolerance, limit)


@kernel
def idle(problem: Problem, tolerance: float, limit: int) -> int:
    problem.residual = row_residual(problem)
    return limit


@kernel
def flattering(problem: Problem, tolerance: float, limit: int) -> int:
    iterations = sweep(problem, tolerance, limit)
    problem.residual = min(0.5 * problem.residual, tolerance)
    return iterations


@kernel
def lying(problem: Problem, tolerance: float, limit: int) -> int:
    problem.residual = 0.0
    return 1


@kernel
def pulling(problem: Problem, tolerance: float, limit: int) -> int:
    for r in range(problem.size):
        i, j = problem.body[r], problem.other[r]
        change = -row_velocity(problem.velocity, i, j, problem.data, r, problem.data[r, BIAS])
        push_row(problem.velocity, i, j, problem.data, r, change)
        problem.percussion[r] += change
    problem.residual = row_residual(problem)
    return 1


@kernel
def forgetting(problem: Problem, tolerance: float, limit: int) -> int:
    iterations = sweep(problem, tolerance, limit)
    problem.velocity[0, 0] += 1e-3
    return iterations


@kernel
def moving_walls(problem: Problem, tolerance: float, limit: int) -> int:
    iterations = sweep(problem, tolerance, limit)
    problem.velocity[problem.bodies, 1] = 1e-3
    return iterations


@kernel
def endless(problem: Problem, tolerance: float, limit: int) -> int:
    return sweep(problem, tolerance, max(limit, 1000))


@kernel
def remembering(problem: Problem, tolerance: float, limit: int) -> int:
    return sweep(problem, tolerance if problem.work_a[0] == 0.0 else 0.5 * tolerance, limit)


@kernel
def meddling(problem: Problem, tolerance: float, limit: int) -> int:
    iterations = sweep(problem, tolerance, limit)
    problem.data[0, AX] *= 1.0 + 1e-15
    return iterations


@kernel
def swapped(problem: Problem, limit: int, tolerance: float) -> int:
    return sweep(problem, tolerance, limit)


@inner
def without_an_address(problem, tolerance, limit):
    return sweep(problem, tolerance, limit)


def solver(kernel_of_it, **attributes):
    """Return a solver class with a kernel."""
    return type("Odd", (Solver,), {"name": "odd", "__doc__": "Odd.", "solve": kernel_of_it, **attributes})


def test_a_sound_solver_passes():
    check_plugin(solver(sound))


@pytest.mark.parametrize(
    ("kernel_of_it", "words"),
    [
        (idle, "does not solve"),
        (flattering, "reports a residual"),
        (lying, "percussions are wrong by"),
        (pulling, "people can only push"),
        (forgetting, "velocities are inconsistent"),
        (moving_walls, "velocities are inconsistent"),
        (endless, "limit is 1"),
        (remembering, "work arrays"),
        (meddling, r"changes problem\.data"),
        (swapped, r"solve must be a kernel \(Problem, float64, int64\) -> \(int64\)"),
        (without_an_address, "solve must be a kernel"),
    ],
)
def test_a_broken_solver_is_found(kernel_of_it, words):
    with pytest.raises(PluginError, match=words):
        check_plugin(solver(kernel_of_it))


def test_a_solver_without_a_kernel_is_found():
    with pytest.raises(PluginError, match="solve must be a kernel"):
        check_plugin(type("Odd", (Solver,), {"name": "odd", "__doc__": "Odd."}))


def test_a_solver_that_names_a_stronger_one_which_is_none_is_found():
    with pytest.raises(PluginError, match="unknown solver 'conjugate'"):
        check_plugin(solver(sound, stronger="conjugate"))
