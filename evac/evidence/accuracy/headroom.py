"""Accuracy, part a: a lower bound for the sweeps of any acceleration of Gauss-Seidel with known active contacts.

On the active contacts the law is a linear system, A x = y with unit diagonal. Any method that combines the results of
Gauss-Seidel sweeps in one order, by momentum or otherwise, has a combination of k directions after k sweeps. The one
with the least residual, by root mean square (Saad and Schultz, 1986), is computed here, ignoring its cost.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from evac.base.arrays import FloatArray, IndexArray
from evac.evidence.accuracy.problems import LAWS, ContactProblem, contact_problem, default_solver, snapshots
from evac.evidence.accuracy.reference import gradient_matrix
from evac.evidence.accuracy.targets import CROWDS, LEAST_RATIOS, PEOPLE, seconds_to
from evac.evidence.report import Evidence

#: Residual of the solve that determines the active contacts [m/s], and its greatest number of iterations.
SURE, ENOUGH = 1e-11, 100_000

#: Sweeps after which the search for the best combination ends.
LONGEST = 2_000

QUICK_PEOPLE, REPEATS = 100, 3


def run(evidence: Evidence) -> None:
    """Add the sweeps under every law, on crowds of several seeds, to the page."""
    people, crowds = (QUICK_PEOPLE, 1) if evidence.quick else (PEOPLE, CROWDS)
    rows = evidence.measured("solvers_headroom", lambda: _rows(people, crowds, evidence.seed))
    evidence.heading("What acceleration of sweeps could reach")
    beyond = sum(row["gauss_seidel / best"] < row["target"] for row in rows)
    longer = sum(row["one factorisation [ms]"] > row["time at the target [ms]"] for row in rows)
    evidence.table(
        "solvers_headroom",
        rows,
        f"""Sweeps of cold solves to a residual, {people} people, medians over {crowds} crowds. "best" is the
        combination of so many sweeps, in the order of gauss_seidel, that has the least residual by root mean square
        if the contacts that push are known beforehand; its time is that of so many sweeps of the default, without
        what it takes to combine them. In {beyond} of {len(rows)} problems even that misses the target for the ratio
        of times, and in {longer} one factorisation of the matrix of the pushing contacts (SuperLU, least degree)
        takes longer than the whole solve may.""",
    )


def _rows(people: int, crowds: int, first_seed: int) -> list[dict[str, Any]]:
    """Return the row of each target for the ratio to Gauss-Seidel, under each law."""
    default = default_solver()
    made = [snapshots(people, seed) for seed in range(first_seed, first_seed + crowds)]
    rows = []
    for kind, goal, solver, least in LEAST_RATIOS:
        if solver != "gauss_seidel":
            continue
        for law in LAWS:
            found = [_counted(contact_problem(crowd[kind], law), goal, default) for crowd in made]
            rows.append({"problem": f"{kind}, {law.label}, to {goal:g} {law.unit}", **_row(found, default, least)})
    return rows


def _row(found: Sequence[dict[str, float]], default: str, least: float) -> dict[str, float]:
    """Return the medians over crowds, and their relation to a target, the least ratio of times."""
    row = {key: float(np.median([one[key] for one in found])) for key in found[0]}
    best = row[f"{default} [ms]"] * row["best: sweeps"] / row[f"{default}: sweeps"]
    return {
        **row,
        f"gauss_seidel / {default}": row["gauss_seidel [ms]"] / row[f"{default} [ms]"],
        "gauss_seidel / best": row["gauss_seidel [ms]"] / best,
        "target": least,
        "time at the target [ms]": row["gauss_seidel [ms]"] / least,
    }


def _counted(problem: ContactProblem, goal: float, default: str) -> dict[str, float]:
    """Return the sweeps of Gauss-Seidel, of the default solver and of the best combination, and times [ms]."""
    residual = goal / problem.law.scale
    counts: dict[str, float] = {}
    for solver in ("gauss_seidel", default):
        problem.start(False)
        sweeps = problem.solve(solver, residual, ENOUGH)[0]
        span = 1e3 * seconds_to(problem, solver, goal)
        counts[f"{solver}: sweeps"] = sweeps
        counts[f"{solver} [ms]"] = span
        counts[f"{solver}: [ns] per contact and sweep"] = 1e6 * span / (sweeps * problem.size)
    matrix, right, scale = pushing_system(problem, default)
    spans = []
    for _ in range(REPEATS):
        start = time.process_time()
        splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        spans.append(time.process_time() - start)
    return {
        **counts,
        "best: sweeps": least_sweeps(matrix, right, scale, residual),
        "one factorisation [ms]": 1e3 * float(np.median(spans)),
    }


def pushing_system(problem: ContactProblem, solver: str) -> tuple[Any, FloatArray, FloatArray]:
    """Return sparse A (k, k) and y (k,) of the active contacts, and factors (k,) from residuals y - A x to m/s.

    They are in the order of sweeps. Rigid contacts obey w + b = 0, elastic ones w + w- + (2/K_N) P = 0, each divided by
    the root of its diagonal.
    """
    problem.start(False)
    problem.solve(solver, SURE, ENOUGH)
    c, contacts, law = problem.size, problem.contacts, problem.law
    gradient = gradient_matrix(contacts.body[:c], contacts.other[:c], contacts.normal[:c], len(problem.free)).tocsr()
    percussion, before, bias = contacts.percussion[:c], contacts.velocity_before[:c], contacts.bias[:c]
    after = gradient @ problem.velocity.ravel()
    spring = law.dissipation * np.maximum(0.0, -0.5 * (after + before))
    elastic = (spring > 0.0) & (after + bias > contacts.omega[:c] * (percussion - spring))
    order = sweep_order(problem)
    pushing = order[percussion[order] > 0.0]
    compliance = np.where(elastic, law.compliance, 0.0)[pushing]
    omega = contacts.omega[:c][pushing]
    root = np.sqrt(omega + compliance)
    inverse_root_mass = np.sqrt(np.repeat(problem.inverse_mass, 2))
    held = sparse.diags(1.0 / root) @ gradient[pushing] @ sparse.diags(inverse_root_mass)
    matrix = (held @ held.T + sparse.diags(compliance / root**2)).tocsc()
    right = -(gradient @ problem.free.ravel() + np.where(elastic, before, bias))[pushing] / root
    return matrix, right, omega / root


def sweep_order(problem: ContactProblem) -> IndexArray:
    """Return the indices of contacts in the order in which solvers have swept over them."""
    return np.argsort(problem.state.problem.row[: problem.size])


def least_sweeps(matrix: Any, right: FloatArray, scale: FloatArray, residual: float) -> int:
    """Return the least number of Gauss-Seidel sweeps whose best combination has this greatest residual [m/s].

    The combination is that of least root mean square, built with directions whose images under A are orthonormal.
    """
    lower = splu(sparse.tril(matrix).tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)
    images = np.zeros((len(right), LONGEST))
    left = right.copy()
    sweeps = 0
    while np.max(np.abs(left) * scale, initial=0.0) > residual and sweeps < LONGEST:
        image = matrix @ lower.solve(left)
        for _ in range(2):  # repeated because of rounding errors
            image -= images[:, :sweeps] @ (images[:, :sweeps].T @ image)
        image /= np.linalg.norm(image)
        images[:, sweeps] = image
        left -= (image @ left) * image
        sweeps += 1
    return sweeps
