"""Base class of solvers of the contact problem."""

from typing import ClassVar

from evac.base.parameters import Configurable
from evac.contract.hooks import DEFAULT_STRONGER_SOLVER
from evac.jit import Entry


class Solver(Configurable):
    """Base class of solvers, which find the percussions of a sub-step.

    A subclass names a kernel ``solve(problem: Problem, tolerance: float, limit: int) -> int``. It starts from the
    percussions and velocities in the problem, changes both consistently, sets ``problem.residual`` to the value of
    `evac.physics.contact.rows.row_residual`, stops when the residual is at most `tolerance` [m/s] or after `limit`
    iterations, and returns the number of iterations.

    Attributes
    ----------
    solve : Entry
        The kernel.
    stronger : str
        Name of the solver that solves the problem again, without warm start, if this one did not converge.
    """

    solve: ClassVar[Entry]
    stronger: ClassVar[str] = DEFAULT_STRONGER_SOLVER
