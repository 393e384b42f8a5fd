"""The packed contact problem of solvers: one row per unknown percussion, scaled to a unit diagonal.

Each normal percussion is one row; the tangential percussion of a sticky contact is another one without a lower
bound. Walls are represented by one last body with infinite mass. Solvers work on scaled unknowns

    x = sqrt(omega) P  [J^1/2],    U = sqrt(m) v  [J^1/2]

so that a row is a unit vector with components A for its body and B for the other one: its velocity w / sqrt(omega)
is A.U_i + B.U_j, a change dx of x changes U_i by A dx and U_j by B dx, and masses are not needed. A sweep then costs
about 3 ns per row; working on contacts and bodies directly would cost ten times as much (memory and branches).

The columns of ``Problem.data`` are A, B and the bias b / sqrt(omega), which suffice for rigid rows; those of
``Problem.elastic`` are the velocity before the step w- / sqrt(omega), s = omega / (omega + 2/K_N), which is 0 without
the elastic term, and the lower bound of x. The local law (docs/physics.md) is

    x = max(bound, x - (w + b), s (x - (w + w-)))

and reduces to its last term for tangential rows, whose bound is minus infinity and whose b is plus infinity.

The speed of a sweep is limited by the latency from the velocities that one row writes to those that the next row of
the same body writes. To keep it short, multiplications and additions are fused, and the change of x is computed.
"""

import math
from typing import Any, ClassVar

from evac.base.parameters import Configurable
from evac.contract.hooks import DEFAULT_STRONGER_SOLVER
from evac.jit import AddressCall, fused, inlined, inner
from evac.physics.state import Problem

AX, AY, BX, BY, BIAS = range(5)
BEFORE, SPRING, BOUND = range(3)

#: Initial estimate of the residual as a share of the largest change in a sweep, and safety factor of later estimates,
#: which use the share at the last evaluation. Evaluating the residual costs half a sweep.
LIKELY, CAUTION = 0.5, 0.8

#: Value used instead of 2/K_N for K_N = 0, where the local form has no third term.
INELASTIC = -1.0

#: Call a solver with the problem, the tolerance of the residual [m/s] and the maximum number of iterations.
call_solver = AddressCall([Problem, float, int], (int,))


@inlined
def push_row(velocity, i, j, data, r, change):
    """Apply a change of x along row r."""
    # All loads precede the first store, so that the compiler can reuse the values loaded by `row_velocity`.
    ux, uy, vx, vy = velocity[i, 0], velocity[i, 1], velocity[j, 0], velocity[j, 1]
    velocity[i, 0] = fused(data[r, AX], change, ux)
    velocity[i, 1] = fused(data[r, AY], change, uy)
    velocity[j, 0] = fused(data[r, BX], change, vx)
    velocity[j, 1] = fused(data[r, BY], change, vy)


@inlined
def row_velocity(velocity, i, j, data, r, start):
    """Return `start` plus the scaled velocity along row r, positive if the contact opens."""
    own = fused(data[r, AX], velocity[i, 0], data[r, AY] * velocity[i, 1])
    return own + fused(data[r, BX], velocity[j, 0], fused(data[r, BY], velocity[j, 1], start))


@inlined
def law(rows, r, x, rigid):
    """Return the change of x after which row r satisfies its local law, with all other rows fixed.

    `rigid` is ``rows.rigid``, read before a loop over rows so that the compiler specialises the loop: a sweep over
    rigid rows (also those with K_N = 0) is a quarter cheaper.
    """
    data, i, j = rows.data, rows.body[r], rows.other[r]
    if rigid:
        return max(-row_velocity(rows.velocity, i, j, data, r, data[r, BIAS]), -x)
    w = row_velocity(rows.velocity, i, j, data, r, 0.0)
    spring = rows.elastic[r, SPRING]
    elastic = fused(-spring, w, (spring - 1.0) * x - spring * rows.elastic[r, BEFORE])
    return max(max(-w - data[r, BIAS], elastic), rows.elastic[r, BOUND] - x)


@inner
def row_energy(rows, r, x):
    """Return the energy [J] whose derivative with respect to x is minus the velocity required by the law of row r.

    The derivative is min(b, w- + (1/s - 1) x): that of the elastic term up to the transition to the rigid one.
    """
    spring, bias, before = rows.elastic[r, SPRING], rows.data[r, BIAS], rows.elastic[r, BEFORE]
    if spring <= 0.0 or before >= bias:
        return bias * x
    compliance = (1.0 - spring) / spring
    if before + compliance * x <= bias:
        return x * (before + 0.5 * compliance * x)
    edge = (bias - before) / compliance
    return edge * (before + 0.5 * compliance * edge) + bias * (x - edge)


@inner
def relax(rows, r, rigid):
    """Relax row r, so that it satisfies its local law; return its residual before [m/s]."""
    x = rows.percussion[r]
    change = law(rows, r, x, rigid)
    push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, change)
    rows.percussion[r] = x + change
    return abs(change) * rows.scale[r]


@inner
def sweep_up(rows):
    """Relax the rows in ascending order, away from the exit along the force chains; return the largest change [m/s]."""
    change = 0.0
    rigid = rows.rigid == 1
    for r in range(rows.size):
        change = max(change, relax(rows, r, rigid))
    return change


@inner
def sweep_down(rows):
    """Relax the rows in descending order; return the largest change [m/s]."""
    change = 0.0
    rigid = rows.rigid == 1
    for r in range(rows.size - 1, -1, -1):
        change = max(change, relax(rows, r, rigid))
    return change


@inner
def row_residual(rows):
    """Return max omega |P - P_local| over the rows [m/s]."""
    worst = 0.0
    rigid = rows.rigid == 1
    for r in range(rows.size):
        change = law(rows, r, rows.percussion[r], rigid)
        worst = max(worst, abs(change) * rows.scale[r])
    return worst


@inner
def evaluate(rows, change, likely, tolerance):
    """Evaluate the residual after a sweep unless its estimate is too large; return its likely share of the change."""
    if likely * change > tolerance:
        return likely
    rows.residual = row_residual(rows)
    return CAUTION * rows.residual / change if change > 0.0 else likely


@inner
def renew_velocity(rows):
    """Recompute the velocities from the free ones and all percussions."""
    for i in range(rows.ends):
        rows.velocity[i, 0] = rows.free[i, 0]
        rows.velocity[i, 1] = rows.free[i, 1]
    for r in range(rows.size):
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, rows.percussion[r])


@inner
def copy_solution(rows, percussion, velocity, percussions, velocities):
    """Copy a percussion for each row and a velocity for each body to other arrays."""
    for r in range(rows.size):
        percussions[r] = percussion[r]
    for i in range(rows.bodies):
        for k in range(2):
            velocities[i, k] = velocity[i, k]


@inner
def momentum_after(momentum):
    """Return the next momentum parameter of Nesterov's method, and the extrapolation factor of the last step."""
    following = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
    return following, (momentum - 1.0) / following


class Solver(Configurable):
    """Base class of solvers, which find the percussions of a sub-step.

    A subclass names a kernel ``solve(problem: Problem, tolerance: float, limit: int) -> int``, or defines a static
    method of these arguments in plain Python, which is slower. It starts from the percussions and velocities in the
    problem, changes both consistently, sets ``problem.residual`` to the value of
    `evac.physics.contact.rows.row_residual`, stops when the residual is at most `tolerance` [m/s] or after `limit`
    iterations, and returns the number of iterations.

    Attributes
    ----------
    solve : Entry or static method
    stronger : str
        Name of the solver that solves the problem again, without warm start, if this one did not converge.
    """

    solve: ClassVar[Any]
    stronger: ClassVar[str] = DEFAULT_STRONGER_SOLVER
