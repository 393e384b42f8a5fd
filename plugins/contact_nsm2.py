"""NSM2, the non-smooth contact model with a constraint on velocities (eqs 23-32; Frémond)."""

import math
from collections.abc import Mapping

from evac.base.parameters import Parameter
from evac.jit import Struct, inner, kernel
from evac.physics import tallies as at
from evac.physics.contact.contacts import (
    ground_along,
    keep_only_meeting,
    normal_velocity,
    report_contact_force,
    tangential_velocity,
)
from evac.physics.contact.model import BorderScene, SolvedContactModel
from evac.physics.contact.percussions import find_percussions, is_to_separate
from evac.physics.state import State, Traits, World
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK, SEPARATE, TOO_FAST

#: Search distance for contacts as a share of the free paths; bodies farther apart cannot meet within the step.
REACH = 1.0 + 1e-9
TOUCH = 1e-9

FALLBACK = 1e5  #: Dissipation used to solve a step again that has no solution for infinite K_N [kg].
OVERLAP = 2e-4  #: Tolerance of overlaps of the optional position correction [m].

#: Largest gap of bodies that count as touching if positions are corrected [m]. Otherwise, a gap that was corrected to
#: zero would not be a contact of bodies that move in the same direction, and would be corrected again in every step.
MARGIN = 2e-3


class Dissipation(Struct):
    """Parameters of the law."""

    normal_dissipation: float  # K_N [kg]
    tangential_dissipation: float  # K_T [kg]
    position_correction: int  # 1: overlaps are separated
    margin: float  # largest gap of bodies that count as touching [m]
    velocity_tolerance: float  # [m/s]
    iterations: int


@kernel
def solve_velocities(state: State, own: Dissipation, h: float) -> int:
    """Find the velocities after the percussions; use a finite K_N if there is no solution for an infinite one."""
    bodies, contacts, problem, tally = state.bodies, state.contacts, state.problem, state.tally
    free, solved = bodies.free, bodies.solved
    if own.position_correction and is_to_separate(state, OVERLAP, own.iterations):
        return SEPARATE
    keep_only_meeting(state.world, bodies, contacts, h, own.margin)
    for c in range(contacts.number if own.position_correction else 0):
        if 0.0 < contacts.gap[c] <= own.margin:  # counts as touching; overlaps have been counted before
            tally[at.CONTACTS] += 1.0
    if own.tangential_dissipation > 0.0 or state.clock.full:
        _stick(state.world, bodies, contacts)
    is_elastic = math.isinf(own.normal_dissipation)
    tangential, tolerance, limit = own.tangential_dissipation, own.velocity_tolerance, own.iterations
    enough = math.inf if is_elastic else tolerance
    residual = find_percussions(state, free, solved, own.normal_dissipation, tangential, tolerance, limit, enough)
    if contacts.number > 0:
        tally[at.SOLVES] += 1.0
        tally[at.ITERATIONS] += problem.iterations
        tally[at.RETRIED_SOLVES] += problem.retried
        if is_elastic and residual > tolerance:
            for c in range(contacts.number):
                contacts.percussion[c] = 0.0
                contacts.friction[c] = 0.0
            residual = find_percussions(state, free, solved, FALLBACK, tangential, tolerance, limit, tolerance)
            tally[at.ITERATIONS] += problem.iterations
            tally[at.RETRIED_SOLVES] += problem.retried
            tally[at.ELASTIC_FALLBACKS] += 1.0
        if problem.missing:
            return NEEDS_STRONGER_SOLVER
        tally[at.GREATEST_RESIDUAL] = max(tally[at.GREATEST_RESIDUAL], residual)
        if residual > tolerance:
            tally[at.UNCONVERGED_STEPS] += 1.0
    if state.clock.reports:
        return _report_reaction(state, own, h)
    return OK


@inner
def _stick(world, bodies, contacts):
    """Mark the closing contacts, to which the tangential law applies, and store their tangential velocities."""
    for c in range(contacts.number):
        if normal_velocity(bodies.free, contacts, c) < 0.0:
            contacts.sticky[c] = 1
            before = tangential_velocity(bodies.velocity, contacts, c)
            contacts.slide_before[c] = before - 2.0 * ground_along(world, bodies, contacts, c)  # before and after
            contacts.friction[c] = 0.0


@inner
def _report_reaction(state, own, h):
    """Report contact forces from a solve with K_N = 0 for the same contacts; return a status."""
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
    """Percussions at mid-step with dissipation K_N: 0 is inelastic, infinity is elastic.

    Percussions act on the pairs whose gap the free velocity would close within the step. Bodies move by the mean of
    the old and the new velocity, so that overlaps of the order of h|u| are part of the model.
    """

    name = "nsm2"
    law = solve_velocities
    reach_share = REACH
    longest_path = 1.0
    reports_percussions = False
    midpoint = True
    normal_dissipation = Parameter(1e5, "K_N of eq. 26", unit="kg", minimum=0.0, infinite=True)
    tangential_dissipation = Parameter(0.0, "K_T of eq. 26", unit="kg", minimum=0.0)
    position_correction = Parameter(False, "separate overlapping bodies without changing velocities")

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return h v [m] with the largest desired or initial speed v.

        This is twice the largest overlap of one body with a wall; overlaps in jams can be larger.
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
        """Return the properties of the model; contacts are searched at least up to `margin`."""
        return super().traits(world).replace(reach_floor=max(TOUCH + world.rounding, self.margin))

    @property
    def separates(self) -> bool:  # type: ignore[override]
        """Whether overlaps are separated."""
        return bool(self.position_correction)

    @property
    def margin(self) -> float:
        """Largest gap of bodies that count as touching [m]."""
        return MARGIN if self.position_correction else 0.0

    def advice(self) -> Mapping[int, str]:
        """Return what to change if a step fails."""
        return {
            TOO_FAST: (
                "percussions on squeezed people increase with contact.nsm2.normal_dissipation; reduce it, or use"
                " contact.model = 'nsm1'"
            )
        }
