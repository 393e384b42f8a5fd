"""Contact problems made by hand, and their solution and residual as Python can call them."""

import numpy as np

from evac.jit import Pairs, kernel
from evac.physics.contact.percussions import pack, solve_once
from evac.physics.contact.rows import row_residual
from evac.physics.engine import load_solver
from evac.physics.force import pack_forces
from evac.physics.state import State, make_contacts, make_problem, make_state
from evac.physics.world import make_world
from tests.physics.scenes import SOLVERS, make_building, uniform_fields

WORLD = make_world(make_building(), uniform_fields())


@kernel
def do_solve(
    state: State,
    free: Pairs,
    velocity: Pairs,
    compliance: float,
    tangential: float,
    tolerance: float,
    limit: int,
) -> None:
    solve_once(state, state.parts.solver, free, velocity, compliance, tangential, tolerance, limit)


@kernel
def do_pack(state: State, free: Pairs, compliance: float, tangential: float) -> None:
    pack(state, free, compliance, tangential)


@kernel
def residual_of_packed(state: State, velocity: Pairs) -> float:
    problem = state.problem
    for i in range(problem.bodies):
        problem.velocity[i, 0] = velocity[i, 0] / problem.inverse_root[i]
        problem.velocity[i, 1] = velocity[i, 1] / problem.inverse_root[i]
    return row_residual(problem)


def make_problem_state(inverse_mass, contacts):
    """Return a state of bodies with these inverse masses [1/kg], and so many contacts, which are to be filled in."""
    people = len(inverse_mass)
    state = make_state(WORLD, people, pack_forces([]), pack_forces([]))
    state.bodies.inside = people
    state.bodies.inverse_mass[:] = inverse_mass
    state.contacts = make_contacts(contacts)
    state.contacts.number = contacts
    state.problem = make_problem(people, contacts)
    return state


def run_solver(solver, state, free, velocity, compliance, tangential, tolerance, limit):
    """Solve by the solver of a name, from the percussions in the contacts; return (iterations, residual [m/s])."""
    state.problem.iterations = 0
    state.parts.solver = load_solver(SOLVERS[solver])
    do_solve(state, free, velocity, compliance, tangential, tolerance, limit)
    return state.problem.iterations, state.problem.residual


def find_residual(state, velocity, compliance, tangential):
    """Return the residual of the percussions in the contacts with velocities that need not belong to them [m/s]."""
    do_pack(state, velocity, compliance, tangential)
    return residual_of_packed(state, velocity)


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
    state = make_problem_state(np.full(people, 1.0 / 80.0), len(body))
    contacts = state.contacts
    contacts.body[:], contacts.other[:], contacts.normal[:] = body[order], other[order], normal[order]
    contacts.omega[:] = 2.0 / 80.0
    return state, random.normal(0.0, 1.5, (people, 2))
