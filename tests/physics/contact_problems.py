"""Contact problems made by hand, and the solvers and the residual as Python can call them."""

import numpy as np

from evac.jit import kernel
from evac.physics.engine import make_contacts
from evac.physics.solvers import residual, solve


@kernel
def run_solver(method, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit):
    n = inverse_mass.shape[0]
    return solve(method, n, inverse_mass, free, velocity, contacts, compliance, tangential, tolerance, limit)


@kernel
def find_residual(velocity, contacts, compliance, tangential):
    return residual(velocity, contacts, compliance, tangential)


def ring(people=100, seed=1):
    """Return a big body in a closed ring of small ones, contacts in random order: momentum alone diverges here."""
    random = np.random.default_rng(seed)
    small = people - 1
    angle = 2.0 * np.pi * np.arange(small) / small
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    chord = out - np.roll(out, -1, axis=0)
    body = np.concatenate([np.zeros(small), 1 + np.minimum(np.arange(small), (np.arange(small) + 1) % small)])
    other = np.concatenate([1 + np.arange(small), 1 + np.maximum(np.arange(small), (np.arange(small) + 1) % small)])
    normal = np.concatenate([-out, chord / np.hypot(*chord.T)[:, None]])
    normal[-1] *= -1.0  # between the last and the first
    order = random.permutation(len(body))
    contacts = make_contacts(people, len(body))
    contacts.count[0] = len(body)
    contacts.body[:], contacts.other[:], contacts.normal[:] = body[order], other[order], normal[order]
    contacts.omega[:] = 2.0 / 80.0
    return contacts, random.normal(0.0, 1.5, (people, 2))
