"""Checks of solvers of the contact problem with small problems whose solutions are known."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evac.base.errors import counted
from evac.conformance.failures import CheckError, examining, scene
from evac.physics.allocation import make_problem
from evac.physics.contact.blocks import make_on_blocks
from evac.physics.contact.rows import call_solver
from evac.physics.contact.solver import Solver
from evac.physics.parts import load_solver
from evac.physics.state import Problem

FloatArray = NDArray[np.float64]

#: Tolerance of the residual [m/s] and maximum number of iterations of the solves.
TOLERANCE, LIMIT = 1e-8, 200_000

#: Tolerances of residuals and velocities: relative, and absolute [m/s].
ROUNDING, LEAST = 1e-6, 1e-12

#: Tolerance of percussions, relative to the largest exact one.
SHARE = 1e-5


class Exercise(NamedTuple):
    """A contact problem with its exact solution, see docs/physics.md.

    Attributes
    ----------
    title : str
    mass, free : (n,), (n, 2)
        Masses [kg] and free velocities [m/s] of the bodies.
    body, other : (c,)
        The bodies of each contact; -1 is a wall.
    normal : (c, 2)
        Unit vectors towards `body`.
    bias, before : (c,)
        Bias of the normal velocities after the step, and normal velocities before it [m/s].
    dissipation : float
        K_N [kg].
    percussion : (c,)
        Exact percussions [N s].
    """

    title: str
    mass: FloatArray
    free: FloatArray
    body: NDArray[np.int64]
    other: NDArray[np.int64]
    normal: FloatArray
    bias: FloatArray
    before: FloatArray
    dissipation: float
    percussion: FloatArray

    @property
    def omega(self) -> FloatArray:
        """1/m_i + 1/m_j of each contact [1/kg]."""
        return 1.0 / self.mass[self.body] + np.where(self.other >= 0, 1.0 / self.mass[self.other], 0.0)

    @property
    def spring(self) -> FloatArray:
        """Return omega / (omega + 2/K_N) of each contact, 0 where K_N = 0."""
        return self.omega / (self.omega + 2.0 / self.dissipation) if self.dissipation > 0.0 else 0.0 * self.omega

    def velocities(self, percussion: FloatArray) -> FloatArray:
        """Return the velocities after percussions, (n, 2) [m/s]."""
        velocity, push, two = self.free.copy(), percussion[:, None] * self.normal, self.other >= 0
        np.add.at(velocity, self.body, push / self.mass[self.body, None])
        np.subtract.at(velocity, self.other[two], push[two] / self.mass[self.other[two], None])
        return velocity

    def residual(self, percussion: FloatArray) -> float:
        """Return max omega |P - P_local| [m/s]."""
        velocity = self.velocities(percussion)
        apart = velocity[self.body] - np.where(self.other[:, None] >= 0, velocity[self.other], 0.0)
        alone = (self.normal * apart).sum(axis=1) - self.omega * percussion
        local = np.maximum(0.0, -(alone + self.bias) / self.omega)
        elastic = -self.spring * (alone + self.before) / self.omega
        return float(np.max(self.omega * np.abs(percussion - np.maximum(local, elastic))))

    def pose(self) -> Problem:
        """Return the packed problem, see `evac.physics.contact.rows`, with zero percussions."""
        n, c = len(self.mass), len(self.body)
        problem = make_problem(n, c)
        problem.size, problem.bodies, problem.rigid = c, n, int(self.dissipation == 0.0)
        problem.blocks, problem.ends = 1, n + 1
        problem.first_row[1:3], problem.first_body[1:3] = c, n
        scale, root = np.sqrt(self.omega), np.append(self.mass**-0.5, 0.0)
        rows = slice(0, c)
        problem.scale[rows] = scale
        problem.body[rows], problem.other[rows] = self.body, np.where(self.other >= 0, self.other, n)
        problem.inverse_root[: n + 1] = root
        problem.data[rows, 0:2] = self.normal * (root[problem.body[rows]] / scale)[:, None]
        problem.data[rows, 2:4] = -self.normal * (root[problem.other[rows]] / scale)[:, None]
        problem.data[rows, 4] = self.bias / scale
        problem.elastic[rows, 0], problem.elastic[rows, 1] = self.before / scale, self.spring
        problem.free[:n] = self.free * np.sqrt(self.mass)[:, None]
        problem.velocity[:] = problem.free
        return problem


def exercise(
    title: str,
    mass: ArrayLike,
    free: ArrayLike,
    contacts: list[tuple[int, int, tuple[float, float]]],
    percussion: ArrayLike,
    dissipation: float = 0.0,
    bias: ArrayLike = 0.0,
) -> Exercise:
    """Return an exercise whose velocities before the step are the free ones; contacts are (body, other, normal)."""
    velocity = np.array(free, dtype=np.float64)
    body, other = np.array([one[:2] for one in contacts]).T
    normal = np.array([one[2] for one in contacts])
    apart = velocity[body] - np.where(other[:, None] >= 0, velocity[other], 0.0)
    return Exercise(
        title,
        np.array(mass, dtype=np.float64),
        velocity,
        body,
        other,
        normal,
        np.array(np.broadcast_to(np.asarray(bias, dtype=np.float64), len(body))),
        (normal * apart).sum(axis=1),
        dissipation,
        np.array(percussion, dtype=np.float64),
    )


def queue(people: int) -> Exercise:
    """Return a queue that is stopped by a wall; each contact carries the momentum of all people behind it."""
    mass = np.linspace(60.0, 100.0, people)
    contacts = [(k, k - 1, (1.0, 0.0)) for k in range(people)]  # the first person touches the wall, -1
    return exercise(
        f"a queue of {people} at a wall", mass, [(-1.5, 0.0)] * people, contacts, 1.5 * np.cumsum(mass[::-1])[::-1]
    )


def exercises() -> list[Exercise]:
    """Return the problems, starting with a single contact."""
    west, root = (-1.0, 0.0), math.sqrt(0.5)
    mass, free, touching = [60.0, 100.0], [(1.5, 0.3), (-1.0, -0.7)], [(0, 1, west)]
    omega = 1.0 / 60.0 + 1.0 / 100.0
    row = [(0, 1, west), (1, 2, west)]
    return [
        exercise("two people who move apart", mass, [(-1.0, 0.0), (1.0, 0.0)], touching, [0.0]),
        exercise("a person in a corner", [80.0], [(-1.5, -1.0)], [(0, -1, (1.0, 0.0)), (0, -1, (0.0, 1.0))], [120, 80]),
        exercise("a wall out of reach", [80.0], [(-root, -root)], [(0, -1, (root, root))], [24.0], bias=0.7),
        queue(12),
        exercise("two people, inelastic", mass, free, touching, [2.5 / omega]),
        exercise("two people, K_N = 100", mass, free, touching, [5.0 / (omega + 0.02)], dissipation=100.0),
        exercise(
            "three in line, elastic",
            [80.0] * 3,
            [(1.0, 0.0), (0.0, 0.0), (0.0, 0.0)],
            row,
            [320.0 / 3.0, 160.0 / 3.0],
            dissipation=math.inf,
        ),
    ]


def check_signature(solver: type[Solver]) -> None:
    """Check that the kernel takes a problem, a tolerance and a limit, and returns a count."""
    with examining("its kernel solve"):
        call_solver.check(getattr(solver, "solve", None), "solve", solver)


def check_answers(solver: type[Solver]) -> None:
    """Check that small problems are solved exactly, and that a solve that starts from the solution keeps it."""
    for one in exercises():
        problem = one.pose()
        for tolerance in (TOLERANCE, 10.0 * TOLERANCE):
            with scene(one.title):
                _solve(solver, one, problem, tolerance, LIMIT)
                if not problem.residual <= tolerance:
                    raise CheckError(
                        f"does not solve it: the residual is {problem.residual:.3g} m/s after {LIMIT} iterations",
                        "iterate until problem.residual is below the tolerance",
                    )
                wrong = float(np.abs(_percussions(problem) - one.percussion).max())
                if not wrong <= SHARE * max(1.0, float(one.percussion.max())):
                    raise CheckError(
                        f"percussions are wrong by {wrong:.3g} N s",
                        "satisfy evac.physics.contact.rows.law in every row",
                    )


def check_limits(solver: type[Solver]) -> None:
    """Check that a solve stops at its limit and reports the remaining residual."""
    one = queue(40)
    for limit in (1, 2, 7, 30):
        problem = one.pose()
        with scene(f"{one.title}, at most {counted(limit, 'iteration')}"):
            made = _solve(solver, one, problem, 1e-14, limit)
            if not 0 < made <= limit:
                raise CheckError(
                    f"makes {made} iterations, but its limit is {limit}",
                    "stop at the limit, and return the number of iterations",
                )
            residual = one.residual(_percussions(problem))
            if not abs(problem.residual - residual) <= LEAST + ROUNDING * residual:
                raise CheckError(
                    f"reports a residual of {problem.residual:.3g} m/s, which is {residual:.3g}",
                    "set problem.residual = row_residual(problem) of evac.physics.contact.rows",
                )


def check_work_arrays(solver: type[Solver]) -> None:
    """Check that a solver does not depend on the initial content of work arrays, and does not change the problem."""
    one = queue(12)
    with scene(one.title):
        if _solved_from(solver, one, 0.0) != _solved_from(solver, one, math.nan):
            raise CheckError("the result depends on previous values of work arrays", "initialise them")


def _solved_from(solver: type[Solver], one: Exercise, rest: float) -> bytes:
    """Return the solution found with given values in the work arrays; refuse changes of the problem."""
    problem = one.pose()
    for name in Problem.kinds:
        if name.startswith(("work", "image", "face", "branch")):
            array = getattr(problem, name)
            array[...] = rest if array.dtype == np.float64 else 0 if rest == 0.0 else 1
    problem.residual = rest
    given = {name: np.copy(getattr(problem, name)) for name in _GIVEN}
    _solve(solver, one, problem, TOLERANCE, LIMIT)
    for name, before in given.items():
        if not np.array_equal(before, getattr(problem, name)):
            raise CheckError(f"changes problem.{name}, which solvers must not change", "use a work array")
    found: bytes = problem.percussion.tobytes() + problem.velocity.tobytes()
    return found


#: Arrays of the problem that a solver must not change.
_GIVEN = ("size", "bodies", "rigid", "body", "other", "data", "elastic", "scale", "inverse_root", "free")


def _solve(solver: type[Solver], one: Exercise, problem: Problem, tolerance: float, limit: int) -> int:
    """Solve a problem, check the result, and return the number of iterations."""
    problem.on_blocks, problem.make_phase = make_on_blocks.address, load_solver(solver).make_phase
    made = int(solver.solve(problem, tolerance, limit))
    percussion = _percussions(problem)
    if not np.isfinite(percussion).all() or percussion.min() < 0.0:
        raise CheckError(
            f"a percussion is {percussion.min():.3g} N s",
            "people can only push, so all must be finite and not negative",
        )
    expected = one.velocities(percussion)
    n = problem.bodies
    velocity = problem.velocity[: n + 1] * np.append(problem.inverse_root[:n], 1.0)[:, None]
    wrong = float(np.abs(velocity - np.vstack([expected, [0.0, 0.0]])).max())
    if not wrong <= LEAST + ROUNDING * np.abs(expected).max():
        raise CheckError(
            f"velocities are inconsistent with percussions by {wrong:.3g} m/s",
            "change both with evac.physics.contact.rows.push_row",
        )
    return made


def _percussions(problem: Problem) -> FloatArray:
    return problem.percussion[: problem.size] / problem.scale[: problem.size]


SOLVER_CHECKS: tuple[Callable[[type[Solver]], None], ...] = (
    check_signature,
    check_answers,
    check_limits,
    check_work_arrays,
)
