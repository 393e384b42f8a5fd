"""NSM1, the non-smooth contact model with a constraint on positions (eqs 18-22; Maury and Venel)."""

import math

from evac.base.parameters import Parameter
from evac.jit import Struct, inner, kernel
from evac.physics import tallies as at
from evac.physics.contact.model import BorderScene, SolvedContactModel
from evac.physics.contact.percussions import find_percussions, is_to_separate, solve_once
from evac.physics.contact.rows import INELASTIC
from evac.physics.state import State
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK, SEARCH_AGAIN, SEPARATE

#: Search distance for contacts, as shares of the free path of a body and of that of the fastest body.
REACH = 1.05
SHARED_REACH = 0.25

#: Maximum number of contact searches in a sub-step; solves whose velocities exceed the reach are repeated.
MOST_SEARCHES = 6


class Projection(Struct):
    """Parameters of the law."""

    gap_tolerance: float  # [m]
    velocity_tolerance: float  # [m/s]
    iterations: int


@kernel
def project(state: State, own: Projection, h: float) -> int:
    """Solve for the new velocities; request another contact search if they exceed the reach."""
    bodies, contacts, clock, problem, tally = state.bodies, state.contacts, state.clock, state.problem, state.tally
    if is_to_separate(state, own.gap_tolerance, own.iterations):
        return SEPARATE
    tolerance = min(0.5 * own.gap_tolerance / h, own.velocity_tolerance)  # the other half is for accumulated errors
    for c in range(contacts.number):
        contacts.bias[c] = max(contacts.gap[c], 0.0) / h
    residual = find_percussions(state, bodies.free, bodies.solved, 0.0, 0.0, tolerance, own.iterations, tolerance)
    if problem.missing:
        return NEEDS_STRONGER_SOLVER
    if contacts.number > 0:
        tally[at.SOLVES] += 1.0
        tally[at.ITERATIONS] += problem.iterations
        tally[at.RETRIED_SOLVES] += problem.retried
    if residual > tolerance and not state.traits.overdamped:
        _project_euclidean(state, own, tolerance)
    if _outruns_reach(bodies, h) and clock.searched < MOST_SEARCHES - 1:
        clock.searched += 1
        tally[at.REPEATED_SEARCHES] += 1.0
        return SEARCH_AGAIN
    tally[at.GREATEST_RESIDUAL] = max(tally[at.GREATEST_RESIDUAL], residual)
    if residual > tolerance or bodies.outrun:
        tally[at.UNCONVERGED_STEPS] += 1.0
    return OK


@inner
def _outruns_reach(bodies, h):
    """Return whether a body moves farther than the contact search reached, and increase the reach of such bodies."""
    bodies.outrun = 0
    bodies.farthest_reach = 0.0
    for i in range(bodies.inside):
        if bodies.level[i] >= 0:
            path = h * math.sqrt(bodies.solved[i, 0] ** 2 + bodies.solved[i, 1] ** 2)
            if path > bodies.reach[i]:
                bodies.reach[i] = 1.5 * path
                bodies.outrun = 1
            bodies.farthest_reach = max(bodies.farthest_reach, bodies.reach[i])
    return bodies.outrun == 1


@inner
def _project_euclidean(state, own, tolerance):
    """Project unconverged velocities onto the constraints in the Euclidean norm."""
    bodies, contacts = state.bodies, state.contacts
    for i in range(bodies.inside):
        bodies.inverse_mass[i] = 1.0 / bodies.firmness[i]
        bodies.spare[i, 0] = bodies.solved[i, 0]
        bodies.spare[i, 1] = bodies.solved[i, 1]
    for c in range(contacts.number):
        contacts.kept_percussion[c] = contacts.percussion[c]
        contacts.percussion[c] = 0.0
    _add_inverse_masses(bodies, contacts)
    solve_once(state, state.parts.stronger, bodies.spare, bodies.solved, INELASTIC, 0.0, tolerance, 4 * own.iterations)
    for i in range(bodies.inside):
        bodies.inverse_mass[i] = 1.0 / bodies.mass[i] / bodies.firmness[i]
    for c in range(contacts.number):
        contacts.percussion[c] = contacts.kept_percussion[c]
    _add_inverse_masses(bodies, contacts)


@inner
def _add_inverse_masses(bodies, contacts):
    """Set the sums of the inverse masses of the bodies in contact."""
    for c in range(contacts.number):
        contacts.omega[c] = bodies.inverse_mass[contacts.body[c]]
        if contacts.other[c] >= 0:
            contacts.omega[c] += bodies.inverse_mass[contacts.other[c]]


class Nsm1(SolvedContactModel):
    """Inelastic contact: the velocity nearest to the free one for which no bodies overlap after the step.

    The variant `inertial` projects the velocity u + h f/m in the mass norm. The variant `overdamped` is the original
    model of Maury and Venel, without inertia: it projects the desired velocity in the Euclidean norm, and its
    multipliers are not forces.
    """

    name = "nsm1"
    law = project
    reach_share = REACH
    reach_fastest = SHARED_REACH
    separates = True
    rigid = True
    variant = Parameter("inertial", "with or without inertia", choices=("inertial", "overdamped"))
    gap_tolerance = Parameter(1e-4, "largest overlap after a solve", unit="m", above=0.0)

    @property
    def overdamped(self) -> bool:  # type: ignore[override]
        """Whether the free velocity equals the desired velocity."""
        return bool(self.variant == "overdamped")

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return the gap tolerance [m]; initial overlaps exceed it until they are separated."""
        return float(self.gap_tolerance)
