"""DEM, the smooth contact model: a spring between overlapping bodies (eqs 3, 16, 17) that hardens when deep."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from evac.errors import ScenarioError
from evac.hookspecs import hookimpl
from evac.jit import inner, kernel
from evac.parameters import Parameter
from evac.physics import stepping
from evac.physics import tallies as at
from evac.physics.bundles import Clock
from evac.physics.contact_model import BorderScene, ContactModel
from evac.physics.contacts import push
from evac.physics.engine import Engine
from evac.physics.neighbours import OK

#: The tangent stiffness of a hardening contact rises to this many times k at an overlap of the radius.
HARDEST = 1000.0

#: No contact hardens under a smaller force, whatever its overlap: people survive it, and soft springs stay soft [N].
LEAST_FORCE = 6000.0


class Law(NamedTuple):
    """What the compiled loop reads."""

    stiffness: float  # [kg/s2]
    smallest: float  # smallest radius [m]
    hardening: float  # share of the radius
    least: float  # no contact hardens at a smaller overlap, whatever its radius [m]
    onset: float  # nor does any here [m]


class Dem(ContactModel):
    """Spring contact: a force k max(0, -D) along the line of centres; overlap is part of the model.

    Beyond an overlap of `hardening` times the radius (of the smaller body of two) and a force of 6 kN contacts
    harden, see `press`: a linear spring cannot carry the load of thousands of people, since its equilibrium overlap
    exceeds the radius.
    """

    name = "dem"
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

    def run(self, engine: Engine, clock: Clock) -> tuple[int, int]:
        """Make the steps of `clock` in compiled code."""
        inside = engine.bodies.count[0]
        smallest = float(engine.bodies.radius[:inside].min())
        least = LEAST_FORCE / self.stiffness
        law = Law(self.stiffness, smallest, self.hardening, least, max(self.hardening * smallest, least))
        return run(
            engine.world,
            engine.bodies,
            engine.lists,
            engine.contacts,
            engine.events,
            engine.forces,
            clock,
            engine.tally,
            law,
        )


@kernel
def run(world, bodies, lists, contacts, events, forces, clock, tally, law):
    """Make all steps; cut a step that moves too far or meets a wall; return (next step, status)."""
    for step in range(clock.first, clock.last):
        fired = stepping.open_step(bodies, events, tally)
        parts = np.int64(1)
        while True:
            status = _parts(world, bodies, lists, contacts, events, forces, clock, tally, law, step, parts)
            if status == OK:
                break
            parts = stepping.cut(bodies, lists, contacts, events, tally, fired, status, parts)
            if parts == 0:
                return step, status
    return clock.last, OK


@kernel
def damping_limit(h, tau, explicit):
    """Return the greatest stable h^2 omega^2 of the contact spring with the drive's damping."""
    if explicit:
        return 4.0 - 2.0 * h / tau
    return 2.0 * (1.0 + math.exp(-h / tau))


@inner
def press(overlap, radius, law):
    """Return the force of a contact and its tangent stiffness, both divided by k: [m], [-].

    With the overlap D, the onset D_h, which is hardening r or LEAST_FORCE / k if that is greater, and the length
    L = (r - D_h) / ln(HARDEST), the force is

    - k D up to D_h;
    - k (D_h + L (exp((D - D_h) / L) - 1)) up to r: its slope rises from k to HARDEST k;
    - k D beyond r, where two people started in one another: hardened contacts would throw them.
    """
    onset = max(law.hardening * radius, law.least)
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
def is_too_stiff(bodies, contacts, law, h, explicit):
    """Say whether the contacts as they are make a step of `h` unstable, and note the body.

    omega^2 is bounded body by body (block Gershgorin): the greatest eigenvalue of sum k n n^T / m_i plus the
    couplings k / sqrt(m_i m_j) of its contacts, k being the tangent stiffness of each at the overlap to which its
    speed takes it within the step.
    """
    own, cross = contacts.rows.image[0], contacts.rows.image[1]  # xx and yy; xy and couplings [1/kg]
    for c in range(contacts.count[0]):
        for i in (contacts.body[c], contacts.other[c]):
            if i >= 0:
                for k in range(2):
                    own[i, k] = cross[i, k] = 0.0
    for c in range(contacts.count[0]):
        i, j = contacts.body[c], contacts.other[c]
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        tangent = 1.0
        deepest = -contacts.gap[c] - h * min(contacts.velocity_before[c], 0.0)
        if deepest > law.onset:
            radius = _radius(bodies, contacts, c)
            tangent = press(max(min(deepest, radius), -contacts.gap[c]), radius, law)[1]
        _stiffen(own, cross, tangent * bodies.inverse_mass[i], i, nx, ny)
        if j >= 0:
            _stiffen(own, cross, tangent * bodies.inverse_mass[j], j, nx, ny)
            coupling = tangent * math.sqrt(bodies.inverse_mass[i] * bodies.inverse_mass[j])
            cross[i, 1] += coupling
            cross[j, 1] += coupling
    for c in range(contacts.count[0]):
        for i in (contacts.body[c], contacts.other[c]):
            if i < 0 or cross[i, 1] < 0.0:  # a wall, or looked at before
                continue
            mean, half = 0.5 * (own[i, 0] + own[i, 1]), 0.5 * (own[i, 0] - own[i, 1])
            square = law.stiffness * (mean + math.sqrt(half * half + cross[i, 0] ** 2) + cross[i, 1])
            if h * h * square > damping_limit(h, bodies.tau[i], explicit):
                bodies.count[1] = i
                return True
            cross[i, 1] = -1.0
    return False


@inner
def _stiffen(own, cross, inverse_mass, i, nx, ny):
    own[i, 0] += inverse_mass * nx * nx
    own[i, 1] += inverse_mass * ny * ny
    cross[i, 0] += inverse_mass * nx * ny


@inner
def _parts(world, bodies, lists, contacts, events, forces, clock, tally, law, step, parts):
    """Make one step in `parts` sub-steps; return a status."""
    h = clock.step / parts
    for part in range(parts):
        time = step * clock.step + part * h
        status, fastest = stepping.free_motion(world, bodies, lists, forces, clock, tally, time, h, False)
        if status == OK and stepping.is_too_fast(bodies, h, fastest, 0.5 * law.smallest):
            return stepping.TOO_FAST
        if status == OK:
            status = stepping.meet(world, bodies, lists, contacts, tally, h, 0.0, 0.0, fastest)
        if status != OK:
            return status
        if is_too_stiff(bodies, contacts, law, h, clock.explicit):
            return stepping.TOO_STIFF
        _push_apart(bodies, contacts, law, h, tally)
        stepping.report_force(bodies, contacts, clock, step, part, parts, 1.0 / h)
        stepping.tally_contacts(contacts, tally)
        status = stepping.finish(world, bodies, lists, contacts, events, clock, tally, time, h, 0.0)
        if status != OK:
            return status
    return OK


@inner
def _push_apart(bodies, contacts, law, h, tally):
    """Set the percussions and the velocities after the sub-step; count the hardened contacts."""
    stepping.take_free(bodies)
    for c in range(contacts.count[0]):
        overlap = -min(0.0, contacts.gap[c])
        if overlap > law.onset:
            overlap, tangent = press(overlap, _radius(bodies, contacts, c), law)
            if tangent > 1.0:
                tally[0, at.HARDENED_CONTACTS] += 1.0
        contacts.percussion[c] = h * law.stiffness * overlap
        push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])


evac_interface = 2


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Dem]
