"""The comparison with cromosim poses it the same problem; cromosim itself is not needed here."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy import sparse

from evac.evidence.accuracy.peer import INERTIAL, OVERDAMPED, compare
from evac.evidence.accuracy.problems import contact_problem, snapshots
from evac.evidence.accuracy.reference import ContactLaw, solve_contact_qp


def projection(step, discs, contacts, desired):
    """Solve what cromosim solves: contacts i, j, distance, unit vector from i to j (j = -1: from the wall to i)."""
    rows = np.zeros((len(contacts), 2 * len(discs)))
    for row, (i, j, _, ex, ey) in zip(rows, contacts, strict=True):
        sign = -1.0 if j >= 0 else 1.0
        row[2 * int(i) : 2 * int(i) + 2] = sign * ex, sign * ey
        if j >= 0:
            row[2 * int(j) : 2 * int(j) + 2] = ex, ey
    mass, slack = np.ones(rows.shape[1]), contacts[:, 2] / step
    found = solve_contact_qp(
        ContactLaw(sparse.csr_matrix(rows), mass, desired.ravel(), slack, np.zeros(len(slack)), 0.0)
    )
    return 1, None, found.reshape(-1, 2), None, None


@pytest.mark.parametrize("law", [INERTIAL, OVERDAMPED], ids=lambda law: law.variant)
def test_both_solve_the_same_problem(monkeypatch, law):
    pytest.importorskip("clarabel")
    package = ModuleType("cromosim")
    package.micro = SimpleNamespace(projection=projection)
    monkeypatch.setitem(sys.modules, "cromosim", package)
    crowd = snapshots(60, 1)["settled"]
    crowd.crowd.mass[:] = 80.0
    problem = contact_problem(crowd, law)
    row = compare(problem)
    assert row["contacts"] == problem.size > 60
    assert row["error [mm]"] < 1e-5
    assert max(row["cold: error [mm]"], row["warm: error [mm]"]) < 10.0
    assert np.abs(problem.velocity - problem.free).max() > 0.01
