"""NSM1, the non-smooth contact model with a constraint on positions (eqs 18-22; Maury and Venel)."""

import math
from collections.abc import Sequence

from evac.hookspecs import hookimpl
from evac.jit import Struct, inner, kernel
from evac.parameters import Parameter
from evac.physics import tallies as at
from evac.physics.contact_model import BorderScene, ContactModel, SolvedContactModel
from evac.physics.overlaps import is_to_separate
from evac.physics.percussions import find_percussions, solve_once
from evac.physics.rows import INELASTIC
from evac.physics.state import State
from evac.physics.status import NEEDS_STRONGER_SOLVER, OK, SEARCH_AGAIN, SEPARATE

#: Contacts are looked for as far as this share of a body's free path, and of the fastest one's, reaches.
REACH = 1.05
SHARED_REACH = 0.25

#: A solve whose velocities outrun the reach is repeated with a larger one, so that there are at most so many searches.
MOST_SEARCHES = 6


class Projection(Struct):
    """What the law reads."""

    gap_tolerance: float  # [m]
    velocity_tolerance: float  # [m/s]
    iterations: int


@kernel
def project(state: State, own: Projection, h: float) -> int:
    """Solve for the new velocities; ask for another search where they outrun the reach."""
    bodies, contacts, clock, problem, tally = state.bodies, state.contacts, state.clock, state.problem, state.tally
    if is_to_separate(state, own.gap_tolerance, own.iterations):
        return SEPARATE
    tolerance = min(0.5 * own.gap_tolerance / h, own.velocity_tolerance)  # the other half is for what adds up
    for c in range(contacts.number):
        contacts.bias[c] = max(contacts.gap[c], 0.0) / h
    found = find_percussions(state, bodies.free, bodies.solved, 0.0, 0.0, tolerance, own.iterations, tolerance)
    if problem.missing:
        return NEEDS_STRONGER_SOLVER
    if contacts.number > 0:
        tally[at.SOLVES] += 1.0
        tally[at.ITERATIONS] += problem.iterations
        tally[at.RETRIED_SOLVES] += problem.retried
    if found > tolerance and not state.traits.overdamped:
        _keep_apart(state, own, tolerance)
    if _outruns_reach(bodies, h) and clock.searched < MOST_SEARCHES - 1:
        clock.searched += 1
        tally[at.REPEATED_SEARCHES] += 1.0
        return SEARCH_AGAIN
    tally[at.GREATEST_RESIDUAL] = max(tally[at.GREATEST_RESIDUAL], found)
    if found > tolerance or bodies.outrun:
        tally[at.UNCONVERGED_STEPS] += 1.0
    return OK


@inner
def _outruns_reach(bodies, h):
    """Say whether somebody moves farther than it looked for contacts, and let those look farther."""
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
def _keep_apart(state, own, tolerance):
    """Take the velocities nearest to unconverged ones that let nobody overlap, in the plain Euclidean norm.

    That problem does not know the ratio of masses which the other one does not converge for. Percussions stay
    what has been found for them.
    """
    bodies, contacts = state.bodies, state.contacts
    for i in range(bodies.inside):
        bodies.inverse_mass[i] = 1.0
        bodies.spare[i, 0] = bodies.solved[i, 0]
        bodies.spare[i, 1] = bodies.solved[i, 1]
    for c in range(contacts.number):
        contacts.kept_percussion[c] = contacts.percussion[c]
        contacts.percussion[c] = 0.0
        contacts.omega[c] = 2.0 if contacts.other[c] >= 0 else 1.0
    solve_once(state, state.parts.stronger, bodies.spare, bodies.solved, INELASTIC, 0.0, tolerance, 4 * own.iterations)
    for i in range(bodies.inside):
        bodies.inverse_mass[i] = 1.0 / bodies.mass[i]
    for c in range(contacts.number):
        i, j = contacts.body[c], contacts.other[c]
        contacts.percussion[c] = contacts.kept_percussion[c]
        contacts.omega[c] = bodies.inverse_mass[i]
        if j >= 0:
            contacts.omega[c] += bodies.inverse_mass[j]


class Nsm1(SolvedContactModel):
    """Inelastic contact: the velocity nearest to the free velocity without overlaps of bodies after the step.

    `inertial` projects u + h f/m in the mass norm; `overdamped` is the original model of Maury and Venel, which
    projects the desired velocity in the Euclidean norm, has no inertia, and whose multipliers are not forces.
    """

    name = "nsm1"
    law = project
    reach_share = REACH
    reach_fastest = SHARED_REACH
    separates = True
    variant = Parameter("inertial", "with or without inertia", choices=("inertial", "overdamped"))
    gap_tolerance = Parameter(1e-4, "greatest overlap left by a solve", unit="m", above=0.0)

    @property
    def overdamped(self) -> bool:  # type: ignore[override]
        """Whether the free velocity is the desired one."""
        return bool(self.variant == "overdamped")

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return the gap tolerance [m]; people who start in one another are beyond it until they are moved apart."""
        return float(self.gap_tolerance)


evac_interface = 2


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Nsm1]
