"""Broken solvers."""

from evac.jit import inner, kernel
from evac.physics.contact.rows import AX, BIAS, Solver, push_row, row_residual, row_velocity, sweep_up
from evac.physics.state import Problem
from tests.conformance.broken import Broken, odd


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


def solver(solve, **attributes):
    """Return a solver class with a kernel."""
    return odd(Solver, solve=solve, **attributes)


QUEUE = "scene 'a queue at a wall"

BROKEN = [
    Broken(solver(idle), "check_solver", QUEUE, "the residual is .* m/s after .* iterations; iterate"),
    Broken(solver(lying), "check_solver", QUEUE, "reports a residual of 0 m/s, which is .*; set problem.residual"),
    Broken(solver(pulling), "check_solver", QUEUE, "people can only push"),
    Broken(solver(forgetting), "check_solver", QUEUE, "inconsistent with percussions by .* m/s; change both"),
    Broken(solver(endless), "check_solver", f"{QUEUE}.*at most 1 iteration", "its limit is 1; stop at the limit"),
    Broken(solver(remembering), "check_solver", QUEUE, "work arrays; initialise"),
    Broken(solver(meddling), "check_solver", QUEUE, r"changes problem\.data"),
    Broken(solver(sound, stronger="conjugate"), "check_same_bits", "scene '20 ticks of", "unknown solver 'conjugate'"),
]
