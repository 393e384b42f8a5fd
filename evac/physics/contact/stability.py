"""Stability of a sub-step with stiff contacts.

The functions work on two arrays in the struct `own` of a law:

- ``stiffnesses``, Triples: xx, yy and xy of the sum of k n n^T / m over the contacts of a body;
- ``coupling``, Floats: the sum of k / sqrt(m m') over its contacts with other bodies; -1 after the check.

The stiffness k of a contact may be given in any unit, by which `makes_unstable` multiplies.
"""

import math

from evac.jit import inner


@inner
def damping_limit(h, tau, explicit):
    """Return the stability limit of h^2 omega^2 for a contact spring with the damping of the drive."""
    if explicit:
        return 4.0 - 2.0 * h / tau
    return 2.0 * (1.0 + math.exp(-h / tau))


@inner
def forget_stiffnesses(contacts, own):
    """Set the sums of all bodies in contact to zero."""
    for c in range(contacts.number):
        _forget(own, contacts.body[c])
        if contacts.other[c] >= 0:
            _forget(own, contacts.other[c])


@inner
def _forget(own, i):
    own.stiffnesses[i, 0] = own.stiffnesses[i, 1] = own.stiffnesses[i, 2] = 0.0
    own.coupling[i] = 0.0


@inner
def add_stiffness(bodies, contacts, own, c, nx, ny, stiffness):
    """Add the stiffness of contact c along (nx, ny) to the sums of its bodies."""
    i, j = contacts.body[c], contacts.other[c]
    _stiffen(own, stiffness * bodies.inverse_mass[i], i, nx, ny)
    if j >= 0:
        _stiffen(own, stiffness * bodies.inverse_mass[j], j, nx, ny)
        coupling = stiffness * math.sqrt(bodies.inverse_mass[i] * bodies.inverse_mass[j])
        own.coupling[i] += coupling
        own.coupling[j] += coupling


@inner
def _stiffen(own, share, i, nx, ny):
    own.stiffnesses[i, 0] += share * nx * nx
    own.stiffnesses[i, 1] += share * ny * ny
    own.stiffnesses[i, 2] += share * nx * ny


@inner
def makes_unstable(state, own, h, unit):
    """Return whether the contacts make a sub-step of `h` unstable; note the body as failed.

    omega^2 is bounded for each body (block Gershgorin) by the largest eigenvalue of sum k n n^T / m_i plus the
    couplings k / sqrt(m_i m_j) of its contacts. `unit` is the unit of the added stiffnesses.
    """
    contacts = state.contacts
    for c in range(contacts.number):
        if _exceeds_limit(state, own, h, unit, contacts.body[c]):
            return True
        if contacts.other[c] >= 0 and _exceeds_limit(state, own, h, unit, contacts.other[c]):
            return True
    return False


@inner
def _exceeds_limit(state, own, h, unit, i):
    """Return whether the stiffness at body i makes a sub-step unstable; note the body as failed. Checks a body once."""
    if own.coupling[i] < 0.0:
        return False
    xx, yy, xy = own.stiffnesses[i, 0], own.stiffnesses[i, 1], own.stiffnesses[i, 2]
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    square = unit * (mean + math.sqrt(half * half + xy**2) + own.coupling[i])
    own.coupling[i] = -1.0
    if h * h * square <= damping_limit(h, state.bodies.tau[i], state.clock.explicit):
        return False
    state.bodies.failed = i
    return True


def longest_step(square: float, tau: float, explicit: bool) -> float:
    """Return the stability limit of the step [s] for an omega^2 of `square` [1/s2] with the damping of the drive."""
    limit = 2.0 / math.sqrt(square)
    while limit**2 * square > damping_limit(limit, tau, explicit):
        limit *= 0.999
    return limit
