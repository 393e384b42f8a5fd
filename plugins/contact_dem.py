"""DEM, the smooth contact model: a spring between overlapping bodies (eqs 3, 16, 17) that hardens when deep."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.errors import ScenarioError
from evac.hookspecs import hookimpl
from evac.jit import Floats, Struct, Triples, inner, kernel
from evac.parameters import Parameter
from evac.physics import tallies as at
from evac.physics.contact_model import BorderScene, ContactModel
from evac.physics.contacts import push
from evac.physics.motion import take_free
from evac.physics.state import State, World
from evac.physics.status import OK, TOO_STIFF, WALL_CROSSED

#: The tangent stiffness of a hardening contact rises to this many times k at an overlap of the radius.
HARDEST = 1000.0

#: No contact hardens under a smaller force, whatever its overlap: people survive it, and soft springs stay soft [N].
LEAST_FORCE = 6000.0


class Spring(Struct):
    """What the law reads, and room for the check of its stability."""

    stiffness: float  # [kg/s2]
    hardening: float  # share of the radius
    least: float  # no contact hardens at a smaller overlap, whatever its radius [m]
    stiffnesses: Triples  # (n, 3) xx, yy and xy of the sum of k n n^T / m of a body's contacts over k [1/kg]
    coupling: Floats  # (n,) of the same to other bodies; -1 once checked [1/kg]


@kernel
def spring(state: State, own: Spring, h: float) -> int:
    """Set the percussions and the velocities after the sub-step; count the hardened contacts."""
    bodies, contacts = state.bodies, state.contacts
    if _is_too_stiff(state, own, h):
        return TOO_STIFF
    take_free(state)
    onset = max(own.hardening * bodies.smallest, own.least)
    for c in range(contacts.number):
        overlap = -min(0.0, contacts.gap[c])
        if overlap > onset:
            overlap, tangent = press(overlap, _radius(bodies, contacts, c), own)
            if tangent > 1.0:
                state.tally[at.HARDENED_CONTACTS] += 1.0
        contacts.percussion[c] = h * own.stiffness * overlap
        push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
    return OK


@inner
def damping_limit(h, tau, explicit):
    """Return the greatest stable h^2 omega^2 of the contact spring with the drive's damping."""
    if explicit:
        return 4.0 - 2.0 * h / tau
    return 2.0 * (1.0 + math.exp(-h / tau))


@inner
def press(overlap, radius, own):
    """Return the force of a contact and its tangent stiffness, both divided by k: [m], [-].

    With the overlap D, the onset D_h, which is hardening r or LEAST_FORCE / k if that is greater, and the length
    L = (r - D_h) / ln(HARDEST), the force is

    - k D up to D_h;
    - k (D_h + L (exp((D - D_h) / L) - 1)) up to r: its slope rises from k to HARDEST k;
    - k D beyond r, where two people started in one another: hardened contacts would throw them.
    """
    onset = max(own.hardening * radius, own.least)
    if overlap <= onset or overlap > radius:
        return overlap, 1.0
    length = (radius - onset) / math.log(HARDEST)
    tangent = math.exp((overlap - onset) / length)
    return onset + length * (tangent - 1.0), tangent


@inner
def _radius(bodies, contacts, c):
    """Return the radius of the smaller body of contact c [m]."""
    j = contacts.other[c]
    own = bodies.radius[contacts.body[c]]
    return min(own, bodies.radius[j]) if j >= 0 else own


@inner
def _is_too_stiff(state, own, h):
    """Say whether the contacts as they are make a sub-step of `h` unstable, and note the body.

    omega^2 is bounded body by body (block Gershgorin): the greatest eigenvalue of sum k n n^T / m_i plus the
    couplings k / sqrt(m_i m_j) of its contacts, k being the tangent stiffness of each at the overlap to which its
    speed takes it within the step.
    """
    bodies, contacts = state.bodies, state.contacts
    onset = max(own.hardening * bodies.smallest, own.least)
    for c in range(contacts.number):
        _forget_stiffness(own, contacts.body[c])
        if contacts.other[c] >= 0:
            _forget_stiffness(own, contacts.other[c])
    for c in range(contacts.number):
        i, j = contacts.body[c], contacts.other[c]
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        tangent = 1.0
        deepest = -contacts.gap[c] - h * min(contacts.velocity_before[c], 0.0)
        if deepest > onset:
            radius = _radius(bodies, contacts, c)
            tangent = press(max(min(deepest, radius), -contacts.gap[c]), radius, own)[1]
        _stiffen(own, tangent * bodies.inverse_mass[i], i, nx, ny)
        if j >= 0:
            _stiffen(own, tangent * bodies.inverse_mass[j], j, nx, ny)
            coupling = tangent * math.sqrt(bodies.inverse_mass[i] * bodies.inverse_mass[j])
            own.coupling[i] += coupling
            own.coupling[j] += coupling
    for c in range(contacts.number):
        if _exceeds_limit(state, own, h, contacts.body[c]):
            return True
        if contacts.other[c] >= 0 and _exceeds_limit(state, own, h, contacts.other[c]):
            return True
    return False


@inner
def _forget_stiffness(own, i):
    own.stiffnesses[i, 0] = own.stiffnesses[i, 1] = own.stiffnesses[i, 2] = 0.0
    own.coupling[i] = 0.0


@inner
def _exceeds_limit(state, own, h, i):
    """Say whether the stiffness at body i makes a sub-step unstable, and note the body; asked once for each."""
    if own.coupling[i] < 0.0:
        return False
    xx, yy, xy = own.stiffnesses[i, 0], own.stiffnesses[i, 1], own.stiffnesses[i, 2]
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    square = own.stiffness * (mean + math.sqrt(half * half + xy**2) + own.coupling[i])
    own.coupling[i] = -1.0
    if h * h * square <= damping_limit(h, state.bodies.tau[i], state.clock.explicit):
        return False
    state.bodies.failed = i
    return True


@inner
def _stiffen(own, inverse_mass, i, nx, ny):
    own.stiffnesses[i, 0] += inverse_mass * nx * nx
    own.stiffnesses[i, 1] += inverse_mass * ny * ny
    own.stiffnesses[i, 2] += inverse_mass * nx * ny


class Dem(ContactModel):
    """Spring contact: a force k max(0, -D) along the line of centres; overlap is part of the model.

    Beyond an overlap of `hardening` times the radius (of the smaller body of two) and a force of 6 kN contacts
    harden, see `press`: a linear spring cannot carry the load of thousands of people, since its equilibrium overlap
    exceeds the radius.
    """

    name = "dem"
    law = spring
    longest_path = 0.5
    remembers = False
    stiffness = Parameter(1.2e5, "contact stiffness k of eq. 3", unit="kg/s2", above=0.0)
    hardening = Parameter(
        0.5, "overlap beyond which contacts harden, as a share of the smaller radius; 1: never", above=0.0, maximum=1.0
    )

    def check_scene(self, scene: BorderScene) -> None:
        """Refuse steps beyond the limit of a dense packing, omega^2 = 6k/m (docs/physics.md).

        h^2 omega^2 < 4 - 2h/tau with explicit driving, < 2 (1 + exp(-h/tau)) with the exponential update. Stiffer
        configurations are found in the run, whose steps are then cut into parts.
        """
        super().check_scene(scene)
        mass, tau = float(scene.mass.min()), float(scene.tau.min())
        square = 6.0 * self.stiffness / mass
        limit = 2.0 / math.sqrt(square)
        while limit**2 * square > damping_limit(limit, tau, scene.explicit):
            limit *= 0.999
        if scene.step >= limit:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for contact model 'dem' with stiffness"
                f" {self.stiffness:g} kg/s2, a least mass of {mass:.1f} kg and a least tau of {tau:g} s;"
                f" it must be below {limit:.4f} s (or choose a smaller contact.dem.stiffness)"
            )

    def parts(self) -> list[tuple[str, bool, str]]:
        """Return whether contacts can harden."""
        why = f"contact.dem.hardening = {self.hardening:g}"
        if self.hardening < 1.0:
            why += ": contacts harden beyond this share of the smaller radius"
        return [("hardening contacts", self.hardening < 1.0, why)]

    def own(self, people: int, world: World) -> Spring:
        """Return the stiffness and the hardening, with room for so many people."""
        return Spring(
            stiffness=self.stiffness,
            hardening=self.hardening,
            least=LEAST_FORCE / self.stiffness,
            stiffnesses=np.zeros((people, 3)),
            coupling=np.zeros(people),
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """Return nothing: the arrays of `own` are written anew in every sub-step."""
        return {}

    def advice(self) -> Mapping[int, str]:
        """Return what to change where a step cannot be made."""
        return {
            WALL_CROSSED: "make contacts stiffer with contact.dem.stiffness, or use contact.model = 'nsm1'",
            TOO_STIFF: "lower contact.dem.stiffness or use a smaller simulation.step",
        }


evac_interface = 2


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Dem]
