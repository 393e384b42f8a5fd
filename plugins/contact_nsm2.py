"""NSM2, the non-smooth contact model with a constraint on velocities (eqs 23-32; Frémond)."""

import math
from collections.abc import Mapping, Sequence

from evac.hookspecs import hookimpl
from evac.jit import Struct, inner, kernel
from evac.parameters import Parameter
from evac.physics import tallies as at
from evac.physics.contact_model import BorderScene, ContactModel, SolvedContactModel
from evac.physics.contacts import (
    keep_only_meeting,
    normal_velocity,
    report_contact_force,
    tangential_velocity,
)
from evac.physics.overlaps import is_to_separate
from evac.physics.percussions import find_percussions
from evac.physics.state import State, Traits, World
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK, SEPARATE, TOO_FAST

#: Contacts are looked for as far as the free paths reach; nothing farther can be predicted to meet.
REACH = 1.0 + 1e-9
TOUCH = 1e-9

#: A step without solution at K_N = infinity is solved again with this dissipation [kg].
FALLBACK = 1e5

#: Tolerance of overlaps of the optional position correction [m].
OVERLAP = 2e-4

#: With the correction, bodies so far apart still touch [m]. A gap that has been set to zero would be no contact where
#: both bodies want to go the same way: those behind would walk into those in front, and be put back, in every step.
MARGIN = 2e-3


class Dissipation(Struct):
    """What the law reads."""

    normal_dissipation: float  # K_N [kg]
    tangential_dissipation: float  # K_T [kg]
    position_correction: int  # 1: overlaps are separated
    margin: float  # gap up to which bodies touch [m]
    velocity_tolerance: float  # [m/s]
    iterations: int


@kernel
def strike(state: State, own: Dissipation, h: float) -> int:
    """Find the velocities after the percussions; fall back from infinite K_N where no solution exists."""
    bodies, contacts, problem, tally = state.bodies, state.contacts, state.problem, state.tally
    free, solved = bodies.free, bodies.solved
    if own.position_correction and is_to_separate(state, OVERLAP, own.iterations):
        return SEPARATE
    keep_only_meeting(state.world, bodies, contacts, h, own.margin)
    for c in range(contacts.number if own.position_correction else 0):
        if 0.0 < contacts.gap[c] <= own.margin:  # touching too; the others have been counted
            tally[at.CONTACTS] += 1.0
    if own.tangential_dissipation > 0.0 or state.clock.full:
        _stick(bodies, contacts)
    is_elastic = math.isinf(own.normal_dissipation)
    tangential, tolerance, limit = own.tangential_dissipation, own.velocity_tolerance, own.iterations
    enough = math.inf if is_elastic else tolerance
    found = find_percussions(state, free, solved, own.normal_dissipation, tangential, tolerance, limit, enough)
    if contacts.number > 0:
        tally[at.SOLVES] += 1.0
        tally[at.ITERATIONS] += problem.iterations
        tally[at.RETRIED_SOLVES] += problem.retried
        if is_elastic and found > tolerance:
            for c in range(contacts.number):
                contacts.percussion[c] = 0.0
                contacts.friction[c] = 0.0
            found = find_percussions(state, free, solved, FALLBACK, tangential, tolerance, limit, tolerance)
            tally[at.ITERATIONS] += problem.iterations
            tally[at.RETRIED_SOLVES] += problem.retried
            tally[at.ELASTIC_FALLBACKS] += 1.0
        if problem.missing:
            return NEEDS_STRONGER_SOLVER
        tally[at.GREATEST_RESIDUAL] = max(tally[at.GREATEST_RESIDUAL], found)
        if found > tolerance:
            tally[at.UNCONVERGED_STEPS] += 1.0
    if state.clock.reports:
        return _report_reaction(state, own, h)
    return OK


@inner
def _stick(bodies, contacts):
    """Mark the closing contacts, on which the tangential law acts, with their tangential velocity before."""
    for c in range(contacts.number):
        if normal_velocity(bodies.free, contacts, c) < 0.0:
            contacts.sticky[c] = 1
            contacts.slide_before[c] = tangential_velocity(bodies.velocity, contacts, c)
            contacts.friction[c] = 0.0


@inner
def _report_reaction(state, own, h):
    """Report contact forces from a solve with K_N = 0 on the same contacts; return a status.

    Between opposed contacts percussions grow with K_N, so theirs are no measure of a squeeze.
    """
    bodies, contacts = state.bodies, state.contacts
    for c in range(contacts.number):
        contacts.kept_percussion[c] = contacts.percussion[c]
        contacts.kept_friction[c] = contacts.friction[c]
    tolerance, limit = own.velocity_tolerance, own.iterations
    find_percussions(state, bodies.free, bodies.spare, 0.0, own.tangential_dissipation, tolerance, limit, tolerance)
    if state.problem.missing:
        return NEEDS_STRONGER_SOLVER
    report_contact_force(bodies, contacts, 1.0 / h)
    for c in range(contacts.number):
        contacts.percussion[c] = contacts.kept_percussion[c]
        contacts.friction[c] = contacts.kept_friction[c]
    return OK


class Nsm2(SolvedContactModel):
    """Percussions at mid-step, with dissipation K_N: 0 is inelastic, infinity elastic.

    Contacts are those that the free velocity closes within the step; bodies move by the mean of old and
    new velocity, so that overlaps of the order of h|u| are part of the model; they are reported.
    """

    name = "nsm2"
    law = strike
    reach_share = REACH
    longest_path = 1.0
    reports_percussions = False
    midpoint = True
    normal_dissipation = Parameter(1e5, "K_N of eq. 26", unit="kg", minimum=0.0, infinite=True)
    tangential_dissipation = Parameter(0.0, "K_T of eq. 26", unit="kg", minimum=0.0)
    position_correction = Parameter(False, "whether overlapping bodies are moved apart, without a change of velocities")

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return h v [m], the path in a step at the greatest speed v that somebody wants or starts with.

        It is twice what one body closes on a wall by; jams in which percussions push people further exceed it.
        """
        return scene.step * float(scene.speed.max())

    def parts(self) -> list[tuple[str, bool, str]]:
        """Return the tangential law and the position correction."""
        return [
            ("tangential contact", self.tangential_dissipation > 0, f"K_T = {self.tangential_dissipation:g} kg"),
            (
                "position correction",
                self.position_correction,
                f"position_correction = {str(self.position_correction).lower()}",
            ),
        ]

    def traits(self, world: World) -> Traits:
        """Return what the step loop needs to know: contacts are looked for at least as far as bodies touch."""
        return super().traits(world).replace(reach_floor=max(TOUCH + world.rounding, self.margin))

    @property
    def separates(self) -> bool:  # type: ignore[override]
        """Whether overlaps are separated."""
        return bool(self.position_correction)

    @property
    def margin(self) -> float:
        """Gap up to which bodies touch [m]."""
        return MARGIN if self.position_correction else 0.0

    def advice(self) -> Mapping[int, str]:
        """Return what to change where a step cannot be made."""
        return {
            TOO_FAST: (
                "where people are squeezed, percussions grow with contact.nsm2.normal_dissipation: lower it, or use"
                " contact.model = 'nsm1'"
            )
        }


evac_interface = 2


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Nsm2]
