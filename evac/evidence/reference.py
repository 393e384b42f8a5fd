"""Independent references: contact problems by an interior-point solver of a library, geodesics by a visibility graph.

Nothing here shares code with what it judges.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from evac.errors import EvacError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

#: Walls may be touched by this much on the way, so that ways along walls and round corners count as free [m].
TOUCH = 1e-7

#: A contact reference must be this precise [m/s]; what Clarabel is asked for in turn: refinements, tolerance.
PRECISION = 1e-9
ATTEMPTS = ((50, 1e-15), (10, 1e-13), (10, 1e-12), (10, 1e-11))

#: A visibility graph is asked for at most so many points at once: memory.
BLOCK = 20_000


def gradient_matrix(body: IntArray, other: IntArray, normal: FloatArray, bodies: int) -> Any:
    """Return the sparse G (c, 2n) of normal velocities, w = G v; a wall is at rest."""
    c = len(body)
    row = np.repeat(np.arange(c), 2)
    columns = (2 * body[:, None] + np.arange(2)).ravel()
    pair = other >= 0
    other_columns = (2 * other[pair, None] + np.arange(2)).ravel()
    return sparse.csc_matrix(
        (
            np.concatenate([normal.ravel(), -normal[pair].ravel()]),
            (np.concatenate([row, np.repeat(np.flatnonzero(pair), 2)]), np.concatenate([columns, other_columns])),
        ),
        shape=(c, 2 * bodies),
    )


def solve_contact_qp(
    gradient: Any, mass: FloatArray, free: FloatArray, bias: FloatArray, approach: FloatArray, dissipation: float
) -> FloatArray:
    """Return the velocities that minimise the law's energy, by the interior-point solver Clarabel.

    min 1/2 |v - V|_M^2 + K_N |s|^2   subject to   G v + b >= 0,   s >= -(G v + w-)/2,   s >= 0

    whose multipliers are the percussions of PHYSICS 3.2 (K_N = 0, b = max(D, 0)/h) and 3.3 (b = 0). Solved for
    M^(1/2) (v - V), which is well scaled.

    Parameters
    ----------
    gradient : (c, k) sparse
    mass : (k,) [kg]
    free : (k,) [m/s]
    bias, approach : (c,) [m/s]
    dissipation : float
        K_N [kg], finite.

    Raises
    ------
    EvacError
        The solver is not installed, or has not found a solution.
    """
    try:
        import clarabel
    except ImportError as error:
        raise EvacError("the reference of contact problems needs clarabel; install it with: pip install evac[evidence]") from error
    c, k = gradient.shape
    unit = float(np.mean(mass))
    root = np.sqrt(unit / mass)
    start = gradient @ free
    scaled = gradient @ sparse.diags(root)
    quadratic, matrix, bound = sparse.identity(k), -scaled, start + bias
    if dissipation > 0.0:
        # The slack is scaled so that its quadratic term has the size of the others.
        slack = np.sqrt(unit / (2.0 * dissipation))
        quadratic = sparse.identity(k + c)
        matrix = sparse.vstack(
            [sparse.hstack([-scaled, sparse.csc_matrix((c, c))]), sparse.hstack([-0.5 * scaled, -slack * sparse.identity(c)])]
        )
        bound = np.concatenate([start + bias, 0.5 * (start + approach)])
    best, found = free, np.inf
    for refinements, tolerance in ATTEMPTS:
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_iter = 400
        settings.max_threads = 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        settings.iterative_refinement_max_iter = refinements
        settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = 0.1 * tolerance
        size = quadratic.shape[0]
        solver = clarabel.DefaultSolver(
            sparse.csc_matrix(quadratic),
            np.zeros(size),
            sparse.csc_matrix(matrix),
            bound,
            [clarabel.NonnegativeConeT(len(bound))],
            settings,
        )
        solution = solver.solve()
        velocity = free + root * np.array(solution.x)[:k]
        percussion = unit * np.array(solution.z)[:c]
        if dissipation > 0.0:
            percussion += 0.5 * unit * np.array(solution.z)[c:]
        left = law_residual(gradient, mass, free, bias, approach, dissipation, velocity, percussion)
        if left < found:
            best, found = velocity, left
        if found <= PRECISION:
            return np.asarray(best)
    raise EvacError(f"the reference of a contact problem was found to {found:.1e} m/s only, {PRECISION:.0e} is asked for")


def law_residual(
    gradient: Any,
    mass: FloatArray,
    free: FloatArray,
    bias: FloatArray,
    approach: FloatArray,
    dissipation: float,
    velocity: FloatArray,
    percussion: FloatArray,
) -> float:
    """Return by how much velocities and percussions break the law and the balance of momentum [m/s].

    The greatest of |v - V - M^-1 G^T P| and of |min(., .)| of the two complementary quantities of each
    contact, percussions turned into velocities by omega.
    """
    balance = velocity - free - (gradient.T @ percussion) / mass
    omega = np.asarray(gradient.multiply(gradient) @ (1.0 / mass)).ravel()
    after = gradient @ velocity
    spring = dissipation * np.maximum(0.0, -0.5 * (after + approach))
    law = np.minimum(omega * (percussion - spring), after + bias)
    return float(max(np.abs(balance).max(), np.abs(law).max(initial=0.0)))
