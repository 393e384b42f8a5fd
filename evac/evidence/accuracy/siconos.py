"""Accuracy: the same contact problems by solvers of siconos, if its library of numerical methods is installed."""

import ctypes
import ctypes.util
import math
import time
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from evac.base.arrays import FloatArray
from evac.evidence.accuracy.problems import LAWS, STEP, ContactProblem, contact_problem, default_solver, snapshots
from evac.evidence.accuracy.reference import gradient_matrix
from evac.evidence.accuracy.solvers import median_solve
from evac.evidence.evidence import Evidence, Row
from evac.evidence.verdicts import at_least, at_most

SECTION = "Comparison with siconos"

LIBRARY = "siconos_numerics"  # of the Debian package libsiconos-numerics-dev

#: Residuals of NSM1 [m], and the number of people.
GOALS = (1e-4, 1e-6)
PEOPLE, QUICK_PEOPLE = 4_000, 100

#: Targets: least ratio of the time of siconos to that of evac, and the longest cold solve to the last goal [ms].
LEAST_RATIO, LONGEST = 20.0, 5.0

#: Tolerances given to siconos, whose errors are defined otherwise: the first, and the factor of the following ones,
#: until the residual is that of evac. Maximum number of iterations.
FIRST, FACTOR, ITERATIONS = 1e-3, 0.25, 20_000

BLOCKS = 1  # storage of a matrix in blocks of the unknowns of a contact
SPARSE = 2  # storage in compressed columns


class Method(NamedTuple):
    """A solver of siconos: its number, the unknowns of a contact that it expects, and the storage of the matrix."""

    number: int
    unknowns: int
    storage: int


METHODS = {
    "NSGS": Method(400, 2, BLOCKS),  # contacts in the plane with friction 0, Gauss-Seidel
    "NSN_AC": Method(504, 3, SPARSE),  # contacts in space with friction 0, Newton on Alart and Curnier's function
}


class _Options(ctypes.Structure):
    _fields_ = (
        ("number", ctypes.c_int),
        ("is_set", ctypes.c_bool),
        ("integers", ctypes.c_int),
        ("integer", ctypes.POINTER(ctypes.c_int)),
        ("floats", ctypes.c_int),
        ("float", ctypes.POINTER(ctypes.c_double)),
        ("is_checked", ctypes.c_bool),
    )


class _Problem(ctypes.Structure):
    _fields_ = (
        ("unknowns", ctypes.c_int),
        ("contacts", ctypes.c_int),
        ("matrix", ctypes.c_void_p),
        ("vector", ctypes.c_void_p),
        ("friction", ctypes.c_void_p),
    )


@cache
def library() -> Any:
    """Return the library, or None if it is not installed."""
    name = ctypes.util.find_library(LIBRARY)
    if name is None:
        return None
    loaded = ctypes.CDLL(name)
    for function in (loaded.NM_create, loaded.NM_create_from_data, loaded.NM_csc, loaded.SBM_new):
        function.restype = ctypes.c_void_p
    loaded.solver_options_create.restype = ctypes.POINTER(_Options)
    return loaded


def run(evidence: Evidence) -> None:
    """Add cold and warm solves of a settled crowd by siconos and by evac, on the same problem in the same run."""
    if not ((evidence.folder / "siconos.csv").is_file() if evidence.page_only else library()):
        return
    people = QUICK_PEOPLE if evidence.quick else PEOPLE
    rows = evidence.measured("siconos", _rows, people, evidence.seed)
    default = default_solver()
    cold = [row for row in rows if row["start"] == "cold"]
    least = min(row[f"{method} / evac"] or math.inf for row in cold for method in METHODS)
    evidence.verdict(at_least("NSM1, settled: siconos' time over evac's, cold", least, LEAST_RATIO, "", SECTION))
    what = f"NSM1, settled, cold, to {GOALS[-1]:g} m: {default} [ms]"
    evidence.verdict(at_most(what, cold[-1]["evac [ms]"], LONGEST, "", SECTION))
    evidence.show("siconos", __name__, people=people, default=default, rows=rows)


def _rows(people: int, seed: int) -> Iterator[Row]:
    problem = contact_problem(snapshots(people, seed)["settled"], LAWS[0])
    for start in ("cold", "warm"):
        for goal in GOALS:
            yield {"contacts": problem.size, "start": start, "to [m]": goal, **compare(problem, start == "warm", goal)}


def compare(problem: ContactProblem, is_warm: bool, goal: float) -> Row:
    """Return times [ms] and iterations of evac and of each solver of siconos to a residual [m] on one problem."""
    own, iterations, _ = median_solve(problem, default_solver(), is_warm, goal / STEP, ITERATIONS)
    row: Row = {"evac [ms]": 1e3 * own, "iterations": iterations}
    for name, method in METHODS.items():
        span, iterations = _solved(problem, method, is_warm, goal / STEP)
        row[f"{name} [ms]"] = None if span is None else 1e3 * span
        row[f"{name}: iterations"] = iterations
        row[f"{name} / evac"] = None if span is None else span / own
    return row


def _solved(problem: ContactProblem, method: Method, is_warm: bool, goal: float) -> tuple[float | None, int]:
    """Return CPU time [s], None if the residual [m/s] is not reached, and iterations of one solve, without set-up."""
    matrix, vector = delassus(problem, method.unknowns)
    stored, tolerance = store(matrix, method), FIRST
    while True:
        percussion = np.zeros(len(vector))
        percussion[:: method.unknowns] = problem.warm * np.sqrt(_omega(problem)) if is_warm else 0.0
        span, iterations = solve(stored, method, vector, percussion, tolerance)
        if residual(problem, percussion[:: method.unknowns]) <= goal:
            return span, iterations
        if iterations >= ITERATIONS or tolerance < np.finfo(float).eps:
            return None, iterations
        tolerance *= FACTOR


def _omega(problem: ContactProblem) -> FloatArray:
    return problem.state.contacts.omega[: problem.size]


def _rows_of(problem: ContactProblem, tangent: bool) -> Any:
    """Return G M^(-1/2) / sqrt(omega) of the normal or the tangential velocities, a sparse matrix with unit rows."""
    contacts, c, n = problem.state.contacts, problem.size, len(problem.free)
    normal = contacts.normal[:c]
    along = np.column_stack([-normal[:, 1], normal[:, 0]]) if tangent else normal
    gradient = gradient_matrix(contacts.body[:c], contacts.other[:c], along, n)
    root = np.sqrt(np.repeat(problem.state.bodies.inverse_mass[:n], 2))
    return sparse.diags(1.0 / np.sqrt(_omega(problem))) @ gradient @ sparse.diags(root)


def delassus(problem: ContactProblem, unknowns: int) -> tuple[Any, FloatArray]:
    """Return matrix and vector of the problem, scaled to a unit diagonal: w = W x + q, with 1 to 3 unknowns a contact.

    They are the normal percussion, which the law determines, and without friction vanishing ones along the tangent in
    the plane and across it.
    """
    c, n = problem.size, len(problem.free)
    parts = [_rows_of(problem, tangent) for tangent in (False, True)[:unknowns]]
    blocks = sparse.vstack(parts).tocsr()
    root = np.sqrt(np.repeat(problem.state.bodies.inverse_mass[:n], 2))
    vector = np.zeros((unknowns, c))
    vector[: len(parts)] = (blocks @ (problem.free.ravel() / root)).reshape(-1, c)
    vector[0] += problem.state.contacts.bias[:c] / np.sqrt(_omega(problem))
    matrix = blocks @ blocks.T
    if unknowns > len(parts):
        matrix = sparse.block_diag([matrix, sparse.identity(c)])
    by_contact = np.arange(unknowns * c).reshape(unknowns, c).T.ravel()
    return matrix.tocsr()[by_contact][:, by_contact].tocoo(), vector.ravel()[by_contact]


def residual(problem: ContactProblem, scaled: FloatArray) -> float:
    """Return the residual of percussions times sqrt(omega), as evac defines it [m/s]."""
    matrix, vector = delassus(problem, 1)
    change = np.maximum(-(matrix @ scaled + vector), -scaled)
    return float(np.max(np.abs(change) * np.sqrt(_omega(problem)), initial=0.0))


def store(matrix: Any, method: Method) -> ctypes.c_void_p:
    """Return a matrix in the storage of siconos, which is kept until the process ends."""
    numerics, size = library(), matrix.shape[0]
    stored = ctypes.c_void_p(numerics.NM_create(SPARSE, size, size))
    numerics.NM_triplet_alloc(stored, ctypes.c_long(matrix.nnz))
    for i, j, value in zip(matrix.row.tolist(), matrix.col.tolist(), matrix.data.tolist(), strict=True):
        numerics.NM_entry(stored, i, j, ctypes.c_double(value))
    columns = ctypes.c_void_p(numerics.NM_csc(stored))
    if method.storage == SPARSE:
        return stored
    blocks = ctypes.c_void_p(numerics.SBM_new())
    numerics.SBM_from_csparse(method.unknowns, columns, blocks)
    return ctypes.c_void_p(numerics.NM_create_from_data(BLOCKS, size, size, blocks))


def solve(
    stored: ctypes.c_void_p, method: Method, vector: FloatArray, percussion: FloatArray, tolerance: float
) -> tuple[float, int]:
    """Solve from the scaled percussions, which are replaced by the solution; return CPU time [s] and iterations."""
    numerics, size, velocity = library(), len(vector), np.zeros(len(vector))
    options = numerics.solver_options_create(method.number)
    options.contents.integer[0], options.contents.float[0] = ITERATIONS, tolerance
    options.contents.is_checked = False
    given, found = (array.ctypes.data_as(ctypes.c_void_p) for array in (percussion, velocity))
    friction = np.zeros(size // method.unknowns)
    problem = _Problem(method.unknowns, len(friction), stored, vector.ctypes.data, friction.ctypes.data)
    driver = numerics.fc2d_driver if method.unknowns == 2 else numerics.fc3d_driver
    start = time.process_time()
    driver(ctypes.byref(problem), given, found, options)
    span = time.process_time() - start
    iterations = options.contents.integer[1]
    numerics.solver_options_delete(options)
    return span, iterations
