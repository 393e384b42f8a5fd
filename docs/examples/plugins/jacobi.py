"""Damped projected Jacobi iterations: all percussions are updated from the same velocities."""

from evac import Solver
from evac.jit import kernel
from evac.physics.contact.rows import law, renew_velocity, row_residual
from evac.physics.state import Problem


@kernel
def damped_jacobi(problem: Problem, tolerance: float, limit: int) -> int:
    """Change every percussion by a third of what its own law asks for, then renew the velocities."""
    iterations = 0
    problem.residual = row_residual(problem)
    while problem.residual > tolerance and iterations < limit:
        for r in range(problem.size):
            problem.work_a[r] = law(problem, r, problem.percussion[r], problem.rigid == 1)
        for r in range(problem.size):
            problem.percussion[r] += problem.work_a[r] / 3.0
        renew_velocity(problem)
        problem.residual = row_residual(problem)
        iterations += 1
    return iterations


class Jacobi(Solver):
    """Projected Jacobi with a damping of one third: simple, and slow in jams."""

    name = "jacobi"
    solve = damped_jacobi


evac_interface = 3
