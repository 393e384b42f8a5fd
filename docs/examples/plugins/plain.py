"""Relaxes one contact after the other, in plain Python."""

from evac import Solver
from evac.physics.contact.rows import relax, row_residual


class Plain(Solver):
    """The method of Gauss and Seidel without a kernel: for trials with few people."""

    name = "plain"

    @staticmethod
    def solve(problem, tolerance, limit):
        """Relax the rows in turns, and return the number of turns."""
        made = 0
        problem.residual = row_residual(problem)
        while problem.residual > tolerance and made < limit:
            for row in range(problem.size):
                relax(problem, row, problem.rigid == 1)
            problem.residual = row_residual(problem)
            made += 1
        return made


evac_interface = 3
