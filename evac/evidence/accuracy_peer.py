"""Accuracy, beside a peer: the projection step of cromosim, where that package is installed."""

import importlib.metadata
import importlib.util
import time
from dataclasses import replace
from typing import Any

import numpy as np

from evac.evidence.accuracy_problems import LAWS, ContactProblem, contact_problem, snapshots, velocity_error
from evac.evidence.report import Evidence
from evac.evidence.snapshots import KINDS, STEP
from evac.physics.bundles import FloatArray
from evac.registry import Registry

#: What both solve to [m].
GOAL = 1e-4
REPEATS = 9


def run(evidence: Evidence) -> None:
    """Time one projection of a crowd at a door by cromosim and by evac, on the same problem in the same run."""
    if importlib.util.find_spec("cromosim") is None:
        return
    registry = Registry()
    people = 100 if evidence.quick else 1_000
    rows = []
    for kind, crowd in snapshots(people, KINDS, evidence.seed, registry).items():
        rows.append(
            {"people": people, "crowd": kind, **compare(with_equal_masses(contact_problem(crowd, LAWS[0], registry)))}
        )
    evidence.heading("Beside cromosim")
    evidence.table(
        "cromosim",
        rows,
        f"""One projection of Maury and Venel (equal masses) by cromosim {importlib.metadata.version("cromosim")} with
        cvxopt and by evac's default solver to {GOAL:g} m, cold, on the same contacts: medians of {REPEATS} runs. The
        error is the greatest distance to the positions of the independent reference. cromosim is no part of evac's
        installation; this table is made where it is installed.""",
    )


def with_equal_masses(problem: ContactProblem) -> ContactProblem:
    """Return a problem in the Euclidean norm, the only one that cromosim has."""
    contacts = problem.contacts
    omega = np.where(contacts.other >= 0, 2.0, 1.0)
    return replace(problem, inverse_mass=np.ones_like(problem.inverse_mass), contacts=contacts._replace(omega=omega))


def compare(problem: ContactProblem) -> dict[str, Any]:
    """Return contacts, times [ms] and errors [m] of both on one problem."""
    from cromosim import micro

    truth = problem.reference()
    c = problem.size
    contacts = problem.contacts
    table = np.column_stack([contacts.body[:c], contacts.other[:c], contacts.bias[:c] * STEP, -contacts.normal[:c]])
    discs = np.zeros((len(problem.free), 4))
    theirs: list[float] = []
    ours: list[float] = []
    limit = int(Registry().get("contact_model", "nsm1")().iterations)
    solver = str(Registry().get("contact_model", "nsm1")().solver)
    found: FloatArray = np.zeros(0)
    for _ in range(REPEATS):
        start = time.perf_counter()
        _, _, found, _, _ = micro.projection(STEP, discs, table, problem.free)
        theirs.append(time.perf_counter() - start)
        problem.start(False)
        start = time.perf_counter()
        problem.solve(solver, GOAL / STEP, limit)
        ours.append(time.perf_counter() - start)
    away = np.asarray(found).reshape(-1, 2) - truth
    return {
        "contacts": c,
        "cromosim [ms]": 1e3 * float(np.median(theirs)),
        "evac [ms]": 1e3 * float(np.median(ours)),
        "cromosim / evac": float(np.median(theirs) / np.median(ours)),
        "cromosim: error [m]": STEP * float(np.hypot(*away.T).max()),
        "evac: error [m]": velocity_error(problem, truth),
    }
