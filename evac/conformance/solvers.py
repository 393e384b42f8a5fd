"""Checks of solvers with the contact problem of a queue at a wall."""

import copy
import math

import numpy as np

from evac.base.errors import counted
from evac.conformance.contact_models import PLAIN, WALLS, walk
from evac.conformance.failures import examining, require, require_close, scene
from evac.conformance.scenes import plugins
from evac.physics.contact.model import ContactModel, SolvedContactModel
from evac.physics.contact.rows import BEFORE, SPRING, call_solver, renew_velocity, row_residual
from evac.physics.contact.solver import Solver
from evac.physics.state import Problem, make_crowd

#: Tolerance of the residual [m/s] and maximum number of iterations of the solves.
TOLERANCE, LIMIT = 1e-8, 200_000

#: Tolerances of residuals and velocities: relative, and absolute [m/s].
ROUNDING, LEAST = 1e-6, 1e-12

#: Arrays with intermediate results, and attributes of the problem that a solver must not change.
WORK = [name for name in Problem.kinds if name.startswith(("work", "image", "face", "branch"))]
GIVEN = ("size", "bodies", "rigid", "body", "other", "data", "elastic", "scale", "inverse_root", "free")

QUEUE = "a queue at a wall"


def check_solver(solver: Solver) -> None:
    """Check that the problem is solved, rigid and elastic, whatever work arrays contain; solutions and limits are kept.

    A solve that starts from the solution keeps it. A solve stops at its limit and reports the remaining residual.
    """
    with examining("its kernel solve"):
        call_solver.check(getattr(solver, "solve", None), "solve", type(solver))
    for what in ("rigid", "elastic"):
        with scene(f"{QUEUE}, {what} contacts"):
            problem = _problem(what == "elastic")
            for tolerance in (TOLERANCE, 10.0 * TOLERANCE):
                _solve(solver, problem, tolerance, LIMIT)
                wrong = f"does not solve it: the residual is {problem.residual:.3g} m/s after {LIMIT} iterations"
                require(
                    problem.residual <= tolerance, f"{wrong}; iterate until problem.residual is below the tolerance"
                )
    for limit in (1, 2, 7):
        with scene(f"{QUEUE}, at most {counted(limit, 'iteration')}"):
            made = _solve(solver, _problem(), 1e-14, limit)
            told = f"makes {made} iterations, but its limit is {limit}; stop at the limit, and return their number"
            require(0 < made <= limit, told)
    with scene(f"{QUEUE}, work arrays with numbers and with NaN"):
        filled, cleared = _problem(), _problem()
        filled.residual = math.nan
        for array in (getattr(filled, name) for name in WORK):
            array[...] = math.nan if array.dtype == np.float64 else 1
        for problem in (filled, cleared):
            _solve(solver, problem, TOLERANCE, LIMIT)
        same = (filled.percussion == cleared.percussion).all() and (filled.velocity == cleared.velocity).all()
        require(same, "the result depends on previous values of work arrays; initialise them")


def solved_model() -> type[ContactModel]:
    """Return a registered contact model that solves contact problems."""
    return next(model for model in plugins().contact_models.values() if issubclass(model, SolvedContactModel))


def _problem(elastic: bool = False) -> Problem:
    """Return the problem of a step, without percussions, also with an elastic term; work arrays are zero."""
    places = [(2.3, -0.41), *((2.3 - 0.4 * k, 0.02 * (k % 2)) for k in range(12))]  # the first one stands beside
    _, engine = walk(solved_model()(), PLAIN, make_crowd(places, speed=1.5, mass=np.linspace(60, 100, 13)), 10, WALLS)
    problem: Problem = copy.deepcopy(engine.state.problem)
    rows = slice(0, problem.size)
    problem.percussion[:], problem.velocity[:], problem.rigid = 0.0, problem.free, int(not elastic)
    for name in WORK:
        getattr(problem, name)[...] = 0
    if elastic:
        bodies = np.hstack([problem.free[problem.body[rows]], problem.free[problem.other[rows]]])
        problem.elastic[rows, BEFORE] = (problem.data[rows, :4] * bodies).sum(axis=1)
        problem.elastic[rows, SPRING] = 0.5
    return problem


def _solve(solver: Solver, problem: Problem, tolerance: float, limit: int) -> int:
    """Solve a problem, check percussions, velocities and residual, and return the number of iterations."""
    exact, n = copy.deepcopy(problem), problem.bodies
    made = int(solver.solve(problem, tolerance, limit))
    changed = [name for name in GIVEN if not np.array_equal(getattr(exact, name), getattr(problem, name))]
    told = f"changes problem.{', '.join(changed)}, which solvers must not change; use a work array"
    require(not changed, told)
    percussion = problem.percussion[: exact.size] / exact.scale[: exact.size]
    told = f"a percussion is {percussion.min():.3g} N s; people can only push, so all must be finite and not negative"
    require(np.isfinite(percussion).all() and percussion.min() >= 0.0, told)
    exact.percussion[:] = problem.percussion
    renew_velocity(exact)
    unit = np.append(exact.inverse_root[:n], 1.0)[:, None]  # from scaled velocities to those of people
    found, velocity = problem.velocity[: n + 1] * unit, exact.velocity[: n + 1] * unit
    wrong, rows = "velocities are inconsistent with percussions by {:.3g} m/s", "evac.physics.contact.rows"
    require_close(
        found,
        velocity,
        LEAST + ROUNDING * float(np.abs(velocity).max()),
        f"{wrong}; change both with push_row of {rows}",
    )
    residual = row_residual(exact)
    wrong = f"reports a residual of {problem.residual:.3g} m/s, which is {residual:.3g}"
    told = f"{wrong}; set problem.residual = row_residual(problem) of {rows}"
    require_close(problem.residual, residual, LEAST + ROUNDING * residual, told)
    return made
