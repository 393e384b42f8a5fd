"""NSM1, the non-smooth contact model with a constraint on positions (eqs 18-22; Maury and Venel)."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from evac.hookspecs import hookimpl
from evac.jit import inner, kernel
from evac.parameters import Parameter
from evac.physics import stepping
from evac.physics import tallies as at
from evac.physics.bundles import Clock
from evac.physics.contact_model import BorderScene, ContactModel, SolvedContactModel
from evac.physics.contacts import keep_percussions
from evac.physics.engine import Engine
from evac.physics.neighbours import OK
from evac.physics.overlaps import part_overlaps
from evac.physics.solvers import CONJUGATE_FACES, INELASTIC, solve, solve_or_retry

#: Contacts are looked for as far as this share of a body's free path, and of the fastest one's, reaches.
REACH = 1.05
SHARED_REACH = 0.25

#: A solve whose velocities outrun the reach is repeated with a larger one, at most so often.
MOST_SEARCHES = 6


class Law(NamedTuple):
    """What the compiled loop reads."""

    overdamped: bool
    gap_tolerance: float  # [m]
    method: int
    velocity_tolerance: float  # [m/s]
    iterations: int


class Nsm1(SolvedContactModel):
    """Inelastic contact: the velocity nearest to the free one that lets no two bodies overlap after the step.

    `inertial` projects u + h f/m in the mass norm; `overdamped` is Maury and Venel's own model, which projects
    the desired velocity in the Euclidean norm, knows no inertia, and whose multipliers are no forces.
    """

    name = "nsm1"
    variant = Parameter("inertial", "with or without inertia", choices=("inertial", "overdamped"))
    gap_tolerance = Parameter(1e-4, "greatest overlap left by a solve", unit="m", above=0.0)

    @property
    def overdamped(self) -> bool:  # type: ignore[override]
        """Whether the free velocity is the desired one."""
        return bool(self.variant == "overdamped")

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return the gap tolerance [m]; people who start in one another are beyond it until they are moved apart."""
        return float(self.gap_tolerance)

    def run(self, engine: Engine, clock: Clock) -> tuple[int, int]:
        """Make the steps of `clock` in compiled code."""
        law = Law(self.overdamped, self.gap_tolerance, *self.settings())
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
    """Make all steps; cut a step that meets a wall; return (next step, status)."""
    if law.overdamped:
        for i in range(bodies.count[0]):
            bodies.inverse_mass[i] = 1.0
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


@inner
def _parts(world, bodies, lists, contacts, events, forces, clock, tally, law, step, parts):
    """Make one step in `parts` sub-steps; return a status."""
    h = clock.step / parts
    for part in range(parts):
        time = step * clock.step + part * h
        status, fastest = stepping.free_motion(world, bodies, lists, forces, clock, tally, time, h, law.overdamped)
        if status == OK:
            status = stepping.meet(world, bodies, lists, contacts, tally, h, REACH, SHARED_REACH * h * fastest, fastest)
        if status == OK:
            stepping.tally_contacts(contacts, tally)
            status = part_overlaps(
                world,
                bodies,
                lists,
                contacts,
                events,
                clock,
                tally,
                time,
                law.method,
                law.iterations,
                law.gap_tolerance,
            )
        if status == OK:
            status = _project(world, bodies, lists, contacts, tally, law, h)
        if status != OK:
            return status
        weight = 0.0 if law.overdamped else 1.0 / h
        stepping.report_force(bodies, contacts, clock, step, part, parts, weight)
        status = stepping.finish(world, bodies, lists, contacts, events, clock, tally, time, h, 0.0)
        if status != OK:
            return status
        if law.overdamped:  # without inertia there is no kinetic energy to account for
            tally[0, at.DRIVING_WORK : at.CONTACT_CREATION + 1] = 0.0
    return OK


@inner
def _project(world, bodies, lists, contacts, tally, law, h):
    """Solve for the new velocities; search and solve again where they outrun the reach; return a status."""
    tolerance = min(0.5 * law.gap_tolerance / h, law.velocity_tolerance)  # the other half is for what adds up
    n = bodies.count[0]
    for search in range(MOST_SEARCHES):
        for c in range(contacts.count[0]):
            contacts.bias[c] = max(contacts.gap[c], 0.0) / h
        iterations, found, again = solve_or_retry(
            law.method,
            n,
            bodies.inverse_mass,
            bodies.free,
            bodies.solved,
            contacts,
            INELASTIC,
            0.0,
            tolerance,
            law.iterations,
            tolerance,
        )
        if contacts.count[0] > 0:
            tally[0, at.SOLVES] += 1.0
            tally[0, at.ITERATIONS] += iterations
            tally[0, at.RETRIED_SOLVES] += again
        if found > tolerance and not law.overdamped:
            _keep_apart(bodies, contacts, law, tolerance)
        outrun = False
        needed = 0.0
        for i in range(n):
            if bodies.level[i] >= 0:
                path = h * math.sqrt(bodies.solved[i, 0] ** 2 + bodies.solved[i, 1] ** 2)
                if path > bodies.reach[i]:
                    bodies.reach[i] = 1.5 * path
                    outrun = True
                needed = max(needed, bodies.reach[i])
        if not outrun or search == MOST_SEARCHES - 1:
            tally[0, at.GREATEST_RESIDUAL] = max(tally[0, at.GREATEST_RESIDUAL], found)
            if found > tolerance or outrun:
                tally[0, at.UNCONVERGED_STEPS] += 1.0
            return OK
        tally[0, at.REPEATED_SEARCHES] += 1.0
        keep_percussions(contacts)
        status = stepping.refresh(world, bodies, lists, tally, 0.0, 3.0 * needed)
        if status == OK:
            status = stepping.seek(world, bodies, lists, contacts)
        if status != OK:
            return status
    return OK


@inner
def _keep_apart(bodies, contacts, law, tolerance):
    """Take the velocities nearest to unconverged ones that let nobody overlap, in the plain Euclidean norm.

    That problem does not know the ratio of masses which the other one does not converge for. Percussions stay
    what has been found for them.
    """
    n = bodies.count[0]
    for i in range(n):
        bodies.inverse_mass[i] = 1.0
        bodies.spare[i, 0] = bodies.solved[i, 0]
        bodies.spare[i, 1] = bodies.solved[i, 1]
    for c in range(contacts.count[0]):
        contacts.work[c, 0] = contacts.percussion[c]
        contacts.percussion[c] = 0.0
        contacts.omega[c] = 2.0 if contacts.other[c] >= 0 else 1.0
    solve(
        CONJUGATE_FACES,
        n,
        bodies.inverse_mass,
        bodies.spare,
        bodies.solved,
        contacts,
        INELASTIC,
        0.0,
        tolerance,
        4 * law.iterations,
    )
    for i in range(n):
        bodies.inverse_mass[i] = 1.0 / bodies.mass[i]
    for c in range(contacts.count[0]):
        i, j = contacts.body[c], contacts.other[c]
        contacts.percussion[c] = contacts.work[c, 0]
        contacts.omega[c] = bodies.inverse_mass[i]
        if j >= 0:
            contacts.omega[c] += bodies.inverse_mass[j]


evac_interface = 2


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Nsm1]
