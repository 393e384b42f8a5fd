"""How stiff the contacts of a sub-step may be: a bound for each body, and the limit of an explicit step.

Kernels here take a law's own struct, `own`, which has two arrays as scratch:

- ``stiffnesses``, Triples: xx, yy and xy of the sum of k n n^T / m over a body's contacts;
- ``coupling``, Floats: the sum of k / sqrt(m m') over those to other bodies; -1 once the body has been asked about.

The stiffness k of a contact may be in any unit: `makes_unstable` multiplies by it.
"""

import math

from evac.jit import inner


@inner
def damping_limit(h, tau, explicit):
    """Return the greatest stable h^2 omega^2 of contact springs with the drive's damping."""
    if explicit:
        return 4.0 - 2.0 * h / tau
    return 2.0 * (1.0 + math.exp(-h / tau))


@inner
def forget_stiffnesses(contacts, own):
    """Set the sums of all bodies that have a contact to zero."""
    for c in range(contacts.number):
        _forget(own, contacts.body[c])
        if contacts.other[c] >= 0:
            _forget(own, contacts.other[c])


@inner
def _forget(own, i):
    own.stiffnesses[i, 0] = own.stiffnesses[i, 1] = own.stiffnesses[i, 2] = 0.0
    own.coupling[i] = 0.0


@inner
def add_stiffness(bodies, contacts, own, c, stiffness):
    """Add the stiffness of contact c to the sums of its bodies."""
    i, j = contacts.body[c], contacts.other[c]
    nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
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
    """Say whether the contacts make a sub-step of `h` unstable, and note the body; `unit` is that of stiffnesses.

    omega^2 is bounded body by body (block Gershgorin): the greatest eigenvalue of sum k n n^T / m_i plus the
    couplings k / sqrt(m_i m_j) of its contacts.
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
    """Say whether the stiffness at body i makes a sub-step unstable, and note the body; asked once for each."""
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
    """Return the longest stable step [s] at an omega^2 of `square` [1/s2] with the drive's damping."""
    limit = 2.0 / math.sqrt(square)
    while limit**2 * square > damping_limit(limit, tau, explicit):
        limit *= 0.999
    return limit
