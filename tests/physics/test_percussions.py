"""Packing: rows stand apart, and what is found for them comes back to the contacts that they are of."""

import numpy as np
import pytest

from evac.physics.contact.rows import AX, BIAS, INELASTIC
from tests.physics.contact_problems import do_pack, make_problem_state, run_solver


@pytest.mark.parametrize("tangential", [0.0, 50.0])
def test_rows_are_those_of_their_contacts(tangential):
    """Two hundred people at walls of their own: every answer is known, and different."""
    people = 200
    mass = np.linspace(50.0, 100.0, people)
    state = make_problem_state(1.0 / mass, people)
    contacts = state.contacts
    contacts.body[:], contacts.other[:], contacts.normal[:] = np.arange(people), -1, (1.0, 0.0)
    contacts.omega[:] = 1.0 / mass
    contacts.bias[:] = np.linspace(0.0, 0.5, people)
    contacts.sticky[::3] = tangential > 0.0
    contacts.slide_before[:] = 0.3
    free = np.column_stack([np.full(people, -1.5), np.linspace(0.5, 1.0, people)])
    velocity = np.zeros_like(free)
    run_solver("gauss_seidel", state, free, velocity, INELASTIC, tangential, 1e-12, 100)
    slides = contacts.sticky == 1
    np.testing.assert_allclose(contacts.percussion, mass * (1.5 - contacts.bias), rtol=1e-12)
    np.testing.assert_allclose(velocity[:, 0], -contacts.bias, rtol=0, atol=1e-14)
    # K_T (w- + w+) / 2 against the sliding, with w+ = w + F / m
    exact = np.where(slides, -(free[:, 1] + 0.3) / (1.0 / mass + 2.0 / 50.0), 0.0)
    np.testing.assert_allclose(contacts.friction, exact, rtol=1e-12)
    np.testing.assert_allclose(velocity[:, 1], free[:, 1] + exact / mass, rtol=1e-12)
    assert slides.sum() == (67 if tangential else 0)


def test_a_row_is_a_unit_vector_over_both_bodies():
    state = make_problem_state([1.0 / 60.0, 1.0 / 100.0], 1)
    contacts, problem = state.contacts, state.problem
    contacts.body[:], contacts.other[:], contacts.normal[:] = 0, 1, (0.6, 0.8)
    contacts.omega[:] = 1.0 / 60.0 + 1.0 / 100.0
    contacts.bias[:], contacts.percussion[:] = 0.2, 30.0
    free = np.array([[1.0, 0.0], [0.0, 2.0]])
    do_pack(state, free, INELASTIC, 0.0)
    assert (problem.size, problem.bodies, problem.rigid) == (1, 2, 1)
    assert np.sum(problem.data[0, AX : AX + 4] ** 2) == pytest.approx(1.0, rel=1e-15)
    assert problem.data[0, BIAS] == pytest.approx(0.2 / np.sqrt(1.0 / 60.0 + 1.0 / 100.0), rel=1e-15)
    after = problem.velocity[:2] * problem.inverse_root[:2, None]
    np.testing.assert_allclose(after, free + 30.0 * np.outer([1.0 / 60.0, -1.0 / 100.0], [0.6, 0.8]), rtol=1e-14)
