"""DEM, the smooth contact model: springs between overlapping bodies (eqs 3, 16, 17) that harden at large overlaps."""

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
from evac.physics.contacts import push, use_free_velocity
from evac.physics.stability import add_stiffness, forget_stiffnesses, longest_step, makes_unstable
from evac.physics.state import State, World
from evac.physics.status import OK, TOO_STIFF, WALL_CROSSED

#: Ratio of the tangent stiffness of a hardening contact at an overlap of one radius to k.
HARDEST = 1000.0

#: Minimum force at which contacts harden [N], so that soft springs do not harden under bearable forces.
LEAST_FORCE = 6000.0


class Spring(Struct):
    """Parameters of the law, and scratch arrays for its stability check."""

    stiffness: float  # [kg/s2]
    hardening: float  # overlap at which contacts harden, as a share of the radius
    least: float  # minimum overlap at which contacts harden [m]
    stiffnesses: Triples  # (n, 3) of each body divided by k, see `evac.physics.stability` [1/kg]
    coupling: Floats  # (n,) [1/kg]


@kernel
def spring(state: State, own: Spring, h: float) -> int:
    """Set the percussions and the velocities after the sub-step; count the hardened contacts."""
    bodies, contacts = state.bodies, state.contacts
    if _is_too_stiff(state, own, h):
        return TOO_STIFF
    use_free_velocity(state)
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
def _radius(bodies, contacts, c):
    """Return the radius of the smaller body of contact c [m]."""
    j = contacts.other[c]
    own = bodies.radius[contacts.body[c]]
    return min(own, bodies.radius[j]) if j >= 0 else own


@inner
def _is_too_stiff(state, own, h):
    """Return whether the present contacts make a sub-step of length `h` unstable; note the body as failed.

    The stiffness of a contact is the tangent stiffness at the overlap that it reaches within the step.
    """
    bodies, contacts = state.bodies, state.contacts
    onset = max(own.hardening * bodies.smallest, own.least)
    forget_stiffnesses(contacts, own)
    for c in range(contacts.number):
        tangent = 1.0
        deepest = -contacts.gap[c] - h * min(contacts.velocity_before[c], 0.0)
        if deepest > onset:
            radius = _radius(bodies, contacts, c)
            tangent = press(max(min(deepest, radius), -contacts.gap[c]), radius, own)[1]
        add_stiffness(bodies, contacts, own, c, tangent)
    return makes_unstable(state, own, h, own.stiffness)


class Dem(ContactModel):
    """Spring contact: a force k max(0, -D) along the line of centres; overlap is part of the model.

    Beyond an overlap of `hardening` times the radius (of the smaller body of two) and a force of 6 kN, contacts
    harden, see `press`, since a linear spring cannot carry the load of thousands of people: its equilibrium overlap
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

    def own(self, people: int, world: World) -> Spring:
        """Return the parameters of the law, with scratch arrays for a number of people."""
        return Spring(
            stiffness=self.stiffness,
            hardening=self.hardening,
            least=LEAST_FORCE / self.stiffness,
            stiffnesses=np.zeros((people, 3)),
            coupling=np.zeros(people),
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """Return nothing, since the arrays of `own` are overwritten in every sub-step."""
        return {}

    def advice(self) -> Mapping[int, str]:
        """Return what to change if a step fails."""
        return {
            WALL_CROSSED: "increase contact.dem.stiffness, or use contact.model = 'nsm1'",
            TOO_STIFF: "reduce contact.dem.stiffness, or use a smaller simulation.step",
        }


evac_interface = 3


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Dem]
