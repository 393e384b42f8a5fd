"""DEM, the smooth contact model: springs between overlapping bodies (eqs 3, 16, 17) that harden at large overlaps."""

import math
from collections.abc import Mapping

from evac.base.errors import ScenarioError
from evac.base.parameters import Parameter
from evac.jit import Floats, Struct, Triples, inner, kernel
from evac.physics import tallies as at
from evac.physics.contact.contacts import push, set_reach, tangential_velocity, use_free_velocity
from evac.physics.contact.model import BorderScene, ContactModel
from evac.physics.contact.stability import add_stiffness, forget_stiffnesses, longest_step, makes_unstable
from evac.physics.extent import extent
from evac.physics.state import State
from evac.physics.status import OK, SEARCH_AGAIN, TOO_STIFF, WALL_CROSSED

#: Ratio of the tangent stiffness of a hardening contact at an overlap of one radius to k.
HARDEST = 1000.0

#: Minimum force at which contacts harden [N], so that soft springs do not harden under bearable forces.
LEAST_FORCE = 6000.0

#: Share of the energy at the onset with which a contact counts as one that may harden.
LIKELY = 0.98

#: A contact counts as one in motion if its energy is less than this multiple of its kinetic energy.
STANDING = 10.0

#: Squared factor by which steps with hardened contacts are shorter than the limit of stability.
FINE = 81.0

#: Number of parts beyond which steps are divided for stability only.
MOST_FINE_PARTS = 128

#: Steps of Newton's method for the overlap that a contact reaches.
NEWTON_STEPS = 8


class Spring(Struct):
    """Parameters of the law, and scratch for its checks."""

    stiffness: float  # [kg/s2]
    hardening: float  # overlap at which contacts harden, as a share of the radius
    least: float  # minimum overlap at which contacts harden [m]
    hardens: int  # 1: a contact of the sub-step has the energy to harden
    stiffnesses: Triples  # (n, 3) of each body divided by k, see `evac.physics.contact.stability` [1/kg]
    coupling: Floats  # (n,) [1/kg]


@kernel
def spring(state: State, own: Spring, h: float) -> int:
    """Set the percussions and the velocities after the sub-step; count the hardened contacts.

    Forces act for the sub-step. While a contact has the energy to harden, they act from the middle of the previous
    sub-step to the middle of this one: the leapfrog scheme, which stays of second order where the length changes.
    """
    bodies, contacts = state.bodies, state.contacts
    onset = max(own.hardening * bodies.smallest, own.least)
    if _look_ahead(state, h, onset):
        return SEARCH_AGAIN
    if _is_too_stiff(state, own, h, onset):
        return TOO_STIFF
    use_free_velocity(state)
    for c in range(contacts.number):
        overlap, tangent = -min(0.0, contacts.gap[c]), 1.0
        if overlap > onset:
            overlap, tangent = press(overlap, _radius(bodies, contacts, c), own)
            if tangent > 1.0:
                state.tally[at.HARDENED_CONTACTS] += 1.0
        percussion = h * own.stiffness * overlap
        if own.hardens:
            percussion = 0.5 * percussion + _percussion_before(state, own, c, overlap, tangent)
        contacts.percussion[c] = percussion
        push(bodies.solved, bodies.inverse_mass, contacts, c, percussion)
    return OK


@inner
def _percussion_before(state, own, c, force, tangent):
    """Return the percussion of contact c since the middle of the last sub-step, or since it began in that sub-step.

    The latter takes the energy of the spring from the velocity. `force` [m] and `tangent` are those of `press`.
    """
    contacts, before = state.contacts, state.clock.h_before
    overlap, speed = -min(0.0, contacts.gap[c]), -contacts.velocity_before[c]
    if 0.0 < overlap < before * speed:
        radius = _radius(state.bodies, contacts, c)
        onset = max(own.hardening * radius, own.least)
        length = (radius - onset) / math.log(HARDEST)
        energy = _energy(overlap, tangent, onset, length) if tangent > 1.0 else overlap**2
        rest = speed**2 - energy * own.stiffness * contacts.omega[c]
        return (speed - math.sqrt(max(rest, 0.0))) / contacts.omega[c]
    return 0.5 * before * own.stiffness * force


@inner
def _look_ahead(state, h, onset):
    """Extend the reach of bodies to their free paths if these can be longer than the onset; return whether.

    Contacts that begin within the sub-step are then found before, as they could end it too deep for their energy.
    """
    bodies = state.bodies
    if state.clock.attempt > 0 or 2.0 * h * bodies.fastest <= onset:
        return False
    set_reach(bodies, 0, bodies.inside, h, 1.0)
    bodies.farthest_reach = h * bodies.fastest
    return True


@inner
def _least(state, own, omega, is_new, speed, onset):
    """Return the energy, over k / 2, from which on steps are those of a contact that hardens [m2].

    It is less by what a collision can gain in steps that are not cut, for contacts that begin, and, so that the steps
    stay the same, for those that move in steps that have been cut.
    """
    clock = state.clock
    gain = 0.0
    if is_new or clock.h_before < clock.length:
        gain = min(own.stiffness * omega * onset**2, STANDING * speed**2)
    return LIKELY * onset**2 - 0.5 * clock.length**2 * gain


@inner
def press(overlap, radius, own):
    """Return the force and the tangent stiffness of a contact, both divided by k: [m], [-].

    With the overlap D, the onset D_h, which is hardening r or LEAST_FORCE / k if that is greater, and the length
    L = (r - D_h) / ln(HARDEST), the force is

    - k D up to D_h;
    - k (D_h + L (exp((D - D_h) / L) - 1)) up to r, with a slope that increases from k to HARDEST k;
    - k D beyond r, which occurs for initial overlaps: a hardened contact would accelerate them too much.
    """
    onset = max(own.hardening * radius, own.least)
    if overlap <= onset or overlap > radius:
        return overlap, 1.0
    length = (radius - onset) / math.log(HARDEST)
    tangent = math.exp((overlap - onset) / length)
    return onset + length * (tangent - 1.0), tangent


@inner
def _energy(overlap, tangent, onset, length):
    """Return the energy of the spring of a contact, over k / 2 [m2]."""
    beyond = length * (tangent - 1.0) + (onset - length) * math.log(tangent)
    return min(overlap, onset) ** 2 + 2.0 * length * beyond


@inner
def _hardest(state, own, c, radius):
    """Return the tangent stiffness over k up to which contact c hardens with its energy; 0 if it does not.

    The energy is that of the spring and of the normal velocity, less what the rotation of two bodies takes up to the
    onset. Velocities are those of half a sub-step ago. Where the energy is more than the spring takes up to the radius,
    the bodies started with a greater overlap.
    """
    contacts, before = state.contacts, state.clock.h_before
    onset = max(own.hardening * radius, own.least)
    gap, speed, mass = contacts.gap[c], -contacts.velocity_before[c], 1.0 / (contacts.omega[c] * own.stiffness)
    overlap = -min(0.0, gap)
    if onset >= radius or overlap > radius:
        return 0.0
    length = (radius - onset) / math.log(HARDEST)
    is_new = overlap < before * speed
    energy = mass * speed**2
    if not is_new:
        force, tangent = press(overlap, radius, own)
        energy += _energy(overlap, tangent, onset, length) - before * speed * force
    if contacts.other[c] >= 0:
        i, j, nx, ny = contacts.body[c], contacts.other[c], contacts.normal[c, 0], contacts.normal[c, 1]
        distance = extent(state.bodies, i, -nx, -ny) + extent(state.bodies, j, nx, ny)
        turn = tangential_velocity(state.bodies.velocity, contacts, c)
        energy -= mass * turn**2 * (((distance + gap) / (distance - onset)) ** 2 - 1.0)
    most = _energy(radius, HARDEST, onset, length)
    if energy < _least(state, own, contacts.omega[c], is_new, speed, onset) or energy > most:
        return 0.0
    # The energy beyond that at the onset, over k L^2, is exp(s) - 1 + a s, s being the logarithm of the slope.
    beyond, a = 0.5 * (energy - onset**2) / length**2, onset / length - 1.0
    s = min(math.log(HARDEST), beyond / (a + 1.0))  # at least the root, from where Newton's method converges
    for _ in range(NEWTON_STEPS):
        s -= (math.exp(s) - 1.0 + a * s - beyond) / (math.exp(s) + a)
    return math.exp(max(s, 0.0))


@inner
def _radius(bodies, contacts, c):
    """Return how far the smaller body of contact c extends towards the contact [m]."""
    j, nx, ny = contacts.other[c], contacts.normal[c, 0], contacts.normal[c, 1]
    own = extent(bodies, contacts.body[c], -nx, -ny)
    return min(own, extent(bodies, j, nx, ny)) if j >= 0 else own


@inner
def _is_too_stiff(state, own, h, onset):
    """Return whether the contacts make a sub-step of length `h` unstable or, if they harden, inaccurate.

    The body is noted as failed. The stiffness of a contact is the tangent stiffness at the overlap that it reaches
    within the step; of one with the energy to harden, the one that it reaches at all, for equal steps throughout.
    """
    bodies, contacts, before = state.bodies, state.contacts, state.clock.h_before
    fine = FINE if MOST_FINE_PARTS * h > state.clock.length else 1.0
    own.hardens = 0
    forget_stiffnesses(contacts, own)
    for c in range(contacts.number):
        tangent = 1.0
        gap, speed = contacts.gap[c], -contacts.velocity_before[c]
        overlap = -min(gap, 0.0)
        deepest = h * max(speed, 0.0) - gap
        if deepest > 0.0:
            is_new = overlap < before * speed
            least = _least(state, own, contacts.omega[c], is_new, speed, onset)
            if not is_new:
                least += overlap * (before * speed - overlap)
            if deepest > onset or speed**2 > least * own.stiffness * contacts.omega[c]:
                radius = _radius(bodies, contacts, c)
                tangent = press(max(min(deepest, radius), -gap), radius, own)[1]
                hardest = _hardest(state, own, c, radius)
                if hardest > 0.0:
                    own.hardens = 1
                    tangent = max(tangent, fine * hardest)
        add_stiffness(bodies, contacts, own, c, contacts.normal[c, 0], contacts.normal[c, 1], tangent)
    return makes_unstable(state, own, h, own.stiffness)


class Dem(ContactModel):
    """Spring contact: a force k max(0, -D) along the line of centres; overlap is part of the model.

    Beyond an overlap of `hardening` times the radius of the smaller body and a force of 6 kN, contacts become stiffer,
    because the overlap at which a linear spring carries the load of thousands of people exceeds the radius.
    """

    name = "dem"
    law = spring
    longest_path = 0.5
    remembers = False
    hardens = 0
    stiffness = Parameter(1.2e5, "contact stiffness k of eq. 3", unit="kg/s2", above=0.0)
    hardening = Parameter(
        0.5, "overlap beyond which contacts harden, as a share of the smaller radius; 1: never", above=0.0, maximum=1.0
    )

    def check_scene(self, scene: BorderScene) -> None:
        """Refuse steps beyond the stability limit of a dense packing, omega^2 = 6k/m (docs/physics.md).

        The limit of h^2 omega^2 is 4 - 2h/tau with explicit driving, and 2 (1 + exp(-h/tau)) with the exponential
        update. Stiffer configurations are detected during the run, whose steps are then subdivided.
        """
        super().check_scene(scene)
        mass, tau = float(scene.mass.min()), float(scene.tau.min())
        limit = longest_step(6.0 * self.stiffness / mass, tau, scene.explicit)
        if scene.step >= limit:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for contact model 'dem' with stiffness"
                f" {self.stiffness:g} kg/s2, a smallest mass of {mass:.1f} kg and a smallest tau of {tau:g} s;"
                f" it must be below {limit:.4f} s (or choose a smaller contact.dem.stiffness)"
            )

    def parts(self) -> list[tuple[str, bool, str]]:
        """Return whether contacts can harden."""
        why = f"contact.dem.hardening = {self.hardening:g}"
        if self.hardening < 1.0:
            why += ": contacts harden beyond this share of the smaller radius"
        return [("hardening contacts", self.hardening < 1.0, why)]

    @property
    def least(self) -> float:
        """Minimum overlap at which contacts harden [m]."""
        return LEAST_FORCE / float(self.stiffness)

    def advice(self) -> Mapping[int, str]:
        """Return what to change if a step fails."""
        return {
            WALL_CROSSED: "increase contact.dem.stiffness, or use contact.model = 'nsm1'",
            TOO_STIFF: "reduce contact.dem.stiffness, or use a smaller simulation.step",
        }
