"""Rows in groups of four: nobody is twice in a group, and a sweep over groups is a sweep over rows in their order."""

import numpy as np
import pytest

from evac.jit import kernel
from evac.lanes import FOUR
from evac.physics.engine import make_contacts
from evac.physics.groups import dissolve, form, group_residual, sweep_back, sweep_on
from evac.physics.momentum import energy
from evac.physics.rows import pack, relax, row_energy, row_residual
from evac.physics.solvers import INELASTIC, SOLVERS
from tests.physics.contact_problems import ring, run_solver

DISSIPATION = [0.0, 1e3]


@kernel
def do_form(contacts, inverse_mass, free, compliance, tangential):
    n = pack(contacts, inverse_mass.shape[0], inverse_mass, free, compliance, tangential)
    return n, form(contacts.rows, contacts.groups, n, inverse_mass.shape[0])


@kernel
def do_sweep(contacts, n, count, share, back):
    rows = contacts.rows
    found = sweep_back(rows, contacts.groups, count) if back else sweep_on(rows, contacts.groups, count, share)
    dissolve(rows, contacts.groups, n, count)
    return found


@kernel
def do_relax(contacts, order):
    rows = contacts.rows
    change = 0.0
    for r in order:
        change = max(change, relax(rows, r, rows.rigid[0] == 1))
    return change


@kernel
def energies(contacts, n, bodies, count):
    rows = contacts.rows
    found = 0.0
    for i in range(bodies):
        found += 0.5 * (rows.velocity[i, 0] ** 2 + rows.velocity[i, 1] ** 2)
    for r in range(n):
        found += row_energy(rows, r, rows.percussion[r])
    return found, energy(rows, contacts.groups, n, bodies, count)


@kernel
def residuals(contacts, n, count):
    return row_residual(contacts.rows, n), group_residual(contacts.rows, contacts.groups, count)


def crowd(seed, people=40, contacts_each=3, walls=15, sticky=False):
    """Return contacts of people with random others and with walls, percussions between them, masses, velocities."""
    random = np.random.default_rng(seed)
    pairs = {tuple(sorted(random.choice(people, 2, replace=False))) for _ in range(contacts_each * people)}
    at_wall = random.choice(people, walls, replace=False)
    body = np.concatenate([[pair[0] for pair in pairs], at_wall]).astype(int)
    other = np.concatenate([[pair[1] for pair in pairs], np.full(walls, -1)]).astype(int)
    angle = random.uniform(0.0, 2.0 * np.pi, len(body))
    mass = random.uniform(50.0, 100.0, people)
    contacts = make_contacts(people, len(body))
    contacts.count[0] = len(body)
    contacts.body[:], contacts.other[:] = body, other
    contacts.normal[:] = np.column_stack([np.cos(angle), np.sin(angle)])
    contacts.omega[:] = 1.0 / mass[body] + np.where(other < 0, 0.0, 1.0 / mass[other])
    contacts.bias[:] = random.uniform(0.0, 0.3, len(body))
    contacts.velocity_before[:] = random.normal(0.0, 1.0, len(body))
    contacts.percussion[:] = random.uniform(0.0, 30.0, len(body))
    contacts.sticky[:] = sticky
    contacts.work[:, 2] = random.normal(0.0, 1.0, len(body))
    return contacts, 1.0 / mass, random.normal(0.0, 1.5, (people, 2))


def lanes_of(contacts, count):
    return contacts.groups.row[: FOUR * count].astype(int)


def check_groups(contacts, n, count, people):
    row = lanes_of(contacts, count)
    np.testing.assert_array_equal(np.sort(row[row < n]), np.arange(n))
    rows, groups = contacts.rows, contacts.groups
    for first in range(0, FOUR * count, FOUR):
        here = [r for r in row[first : first + FOUR] if r < n]
        bodies = [int(b) for r in here for b in (rows.body[r], rows.other[r]) if b < people]
        assert len(bodies) == len(set(bodies))
        assert here
    free = np.flatnonzero(row == n)
    for array in (groups.body, groups.other):
        assert (array[free] == 2 * people).all()
    lanes = groups.data[: 5 * FOUR * count].reshape(count, 5, FOUR).transpose(0, 2, 1).reshape(-1, 5)
    assert not lanes[free].any()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sticky", [False, True])
def test_nobody_is_twice_in_a_group(seed, sticky):
    contacts, inverse_mass, free = crowd(seed, sticky=sticky)
    n, count = do_form(contacts, inverse_mass, free, 2.0 / 1e3, 50.0)
    assert n == contacts.count[0] * (2 if sticky else 1)
    check_groups(contacts, n, count, len(free))


@pytest.mark.parametrize("dissipation", DISSIPATION)
def test_groups_do_not_depend_on_what_was_in_their_arrays(dissipation):
    compliance = 2.0 / dissipation if dissipation else INELASTIC
    fresh, inverse_mass, free = crowd(3, people=200)
    used, _, _ = crowd(3, people=200)
    for array in (*used.rows, *used.groups):
        array[...] = 1
    n, count = do_form(fresh, inverse_mass, free, compliance, 0.0)
    assert do_form(used, inverse_mass, free, compliance, 0.0) == (n, count)
    columns = {"row": 1, "body": 1, "other": 1, "data": 5, "scale": 1, "percussion": 1}
    for name, width in (columns | ({"elastic": 3} if dissipation else {})).items():
        one, other = (getattr(contacts.groups, name)[: width * FOUR * count] for contacts in (fresh, used))
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(fresh.rows.velocity, used.rows.velocity)


def test_contacts_with_walls_share_groups():
    contacts, inverse_mass, free = crowd(1, people=64, contacts_each=0, walls=64)
    n, count = do_form(contacts, inverse_mass, free, INELASTIC, 0.0)
    assert (n, count) == (64, 16)
    check_groups(contacts, n, count, 64)


def test_few_lanes_are_free_in_a_crowd():
    contacts, inverse_mass, free = crowd(1, people=2000)
    n, count = do_form(contacts, inverse_mass, free, INELASTIC, 0.0)
    assert FOUR * count < 1.05 * n


def star(people, capacity):
    """Return the contacts of a big body with all others around it, and their velocities."""
    contacts, free = ring(people)
    around = np.flatnonzero(contacts.body == 0)
    roomy = make_contacts(people, capacity)
    roomy.count[0] = len(around)
    for array, source in zip(roomy[1:9], contacts[1:9], strict=True):
        array[: len(around)] = source[around]
    return roomy, free


def test_contacts_of_one_body_take_a_group_each():
    contacts, free = star(14, 13)
    n, count = do_form(contacts, np.full(14, 1.0 / 80.0), free, INELASTIC, 0.0)
    assert (n, count) == (13, 13)
    check_groups(contacts, n, count, 14)


def test_groups_stay_within_their_arrays():
    formed = []
    for people in range(4, 150, 5):
        contacts, free = star(people, people - 1)
        contacts.sticky[:] = 1  # as many rows as there is room for
        room = np.full(2 * len(contacts.groups.row), 7, np.uint32)
        lanes = len(contacts.groups.row)
        contacts = contacts._replace(groups=contacts.groups._replace(row=room[:lanes]))
        n, count = do_form(contacts, np.full(people, 1.0 / 80.0), free, 2.0 / 1e3, 50.0)
        assert n == 2 * (people - 1)
        assert count in (0, n)
        formed.append(count > 0)
        assert (room[lanes:] == 7).all()
    assert formed == sorted(formed, reverse=True)  # in small problems
    assert 0 < sum(formed) < len(formed)


@pytest.mark.parametrize("capacity", [199, 400])
def test_where_many_contacts_are_of_one_body_another_solver_takes_over(capacity):
    inverse_mass = np.full(200, 1.0 / 80.0)
    assert do_form(star(200, capacity)[0], inverse_mass, np.zeros((200, 2)), INELASTIC, 0.0) == (199, 0)
    found = []
    for solver in ("accelerated_sweeps", "conjugate_faces"):
        contacts, free = star(200, capacity)
        contacts.percussion[:] = 0.0
        velocity = np.zeros_like(free)
        code = SOLVERS.index(solver)
        found.append(run_solver(code, inverse_mass, free, velocity, contacts, INELASTIC, 0.0, 1e-10, 10_000))
        assert found[-1][1] <= 1e-10
        found[-1] += (velocity.tobytes(),)
    assert found[0] == found[1]


@pytest.mark.parametrize("dissipation", DISSIPATION)
@pytest.mark.parametrize("sticky", [False, True])
@pytest.mark.parametrize("back", [False, True])
def test_a_sweep_is_one_over_the_rows_in_their_order(dissipation, sticky, back):
    compliance = 2.0 / dissipation if dissipation else INELASTIC
    contacts, inverse_mass, free = crowd(7, sticky=sticky)
    twin, _, _ = crowd(7, sticky=sticky)
    n, count = do_form(contacts, inverse_mass, free, compliance, 50.0 if sticky else 0.0)
    do_form(twin, inverse_mass, free, compliance, 50.0 if sticky else 0.0)
    contacts.groups.last[:] = contacts.groups.percussion
    before = twin.rows.percussion[:n].copy()
    both = residuals(contacts, n, count)
    assert both[0] == pytest.approx(both[1], rel=1e-12)
    row = lanes_of(contacts, count)
    row = row[row < n]
    uphill, change = do_sweep(contacts, n, count, 0.0, back)
    assert change == pytest.approx(do_relax(twin, row[::-1] if back else row), rel=1e-12)
    np.testing.assert_allclose(contacts.rows.percussion[:n], twin.rows.percussion[:n], rtol=0, atol=1e-12)
    np.testing.assert_allclose(contacts.rows.velocity, twin.rows.velocity, rtol=0, atol=1e-12)
    assert uphill == pytest.approx(-np.sum((twin.rows.percussion[:n] - before) ** 2), rel=1e-12)


@pytest.mark.parametrize("people", [40, 41])
@pytest.mark.parametrize("dissipation", DISSIPATION)
def test_the_energy_is_that_of_rows_and_bodies(people, dissipation):
    contacts, inverse_mass, free = crowd(5, people)
    n, count = do_form(contacts, inverse_mass, free, 2.0 / dissipation if dissipation else INELASTIC, 0.0)
    plain, found = energies(contacts, n, people, count)
    assert found == pytest.approx(plain, rel=1e-12)


def test_a_sweep_goes_on_by_a_share_of_the_last_step():
    contacts, inverse_mass, free = crowd(8)
    n, count = do_form(contacts, inverse_mass, free, INELASTIC, 0.0)
    groups = contacts.groups
    x, last = groups.percussion.copy(), 0.5 * groups.percussion
    groups.last[:] = last
    uphill, change = do_sweep(contacts, n, count, 0.4, False)
    start = x + 0.4 * (x - last)
    assert uphill == pytest.approx(-np.sum((groups.percussion - start) * (groups.percussion - x)), rel=1e-9)
    twin, _, _ = crowd(8)
    do_form(twin, inverse_mass, free, INELASTIC, 0.0)
    row = lanes_of(contacts, count)
    twin.rows.percussion[row[row < n]] = start[: FOUR * count][row < n]
    assert change == pytest.approx(do_relax(twin, row[row < n]), rel=1e-12)
    np.testing.assert_allclose(contacts.rows.percussion[:n], twin.rows.percussion[:n], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(groups.last[: FOUR * count], x[: FOUR * count])


def test_the_slope_of_a_sweep_back_is_along_the_step_of_both_sweeps():
    contacts, inverse_mass, free = crowd(9)
    n, count = do_form(contacts, inverse_mass, free, INELASTIC, 0.0)
    groups = contacts.groups
    x, last = groups.percussion.copy(), 0.5 * groups.percussion
    groups.last[:] = last
    uphill, _ = do_sweep(contacts, n, count, 0.0, True)
    assert uphill == pytest.approx(-np.sum((groups.percussion - x) * (groups.percussion - last)), rel=1e-9)
    np.testing.assert_array_equal(groups.last, last)


@pytest.mark.parametrize("back", [False, True])
def test_the_greatest_change_of_a_sweep_may_be_a_fall(back):
    contacts, inverse_mass, free = crowd(4)
    contacts.bias[:] = 100.0  # all part: every percussion goes
    n, count = do_form(contacts, inverse_mass, free, INELASTIC, 0.0)
    fall = contacts.rows.scale[:n] * contacts.rows.percussion[:n]
    assert do_sweep(contacts, n, count, 0.0, back)[1] == pytest.approx(fall.max(), rel=1e-12)
    assert not contacts.rows.percussion[:n].any()
