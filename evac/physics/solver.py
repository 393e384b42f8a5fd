"""Solvers of the contact problem: the base class of solver plugins."""

from typing import ClassVar

from evac.jit import Entry
from evac.parameters import Configurable


class Solver(Configurable):
    """A method that finds the percussions of a step.

    A subclass names a kernel ``solve(problem: Problem, tolerance: float, limit: int) -> int``. It starts from the
    percussions and velocities in the problem, changes both together, sets ``problem.residual`` as
    `evac.physics.rows.row_residual` returns it, stops where that is at most the tolerance [m/s] or after `limit`
    iterations, and returns the iterations made.

    Attributes
    ----------
    solve : Entry
        The kernel.
    stronger : str
        Name of the solver that tries again, without percussions to start from, where this one did not converge.
    """

    solve: ClassVar[Entry]
    stronger: ClassVar[str] = "conjugate_faces"
