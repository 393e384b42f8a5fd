"""NSM2, the non-smooth contact model with a constraint on velocities (eqs 23-32; Frémond)."""

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
from evac.physics.contacts import (
    keep_only_meeting,
    normal_velocity,
    report_contact_force,
    set_velocity_before,
    tangential_velocity,
)
from evac.physics.engine import Engine
from evac.physics.neighbours import OK
from evac.physics.overlaps import part_overlaps
from evac.physics.solvers import INELASTIC, solve_or_retry

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


class Law(NamedTuple):
    """What the compiled loop reads."""

    normal: float  # K_N [kg]
    tangential: float  # K_T [kg]
    correction: bool
    smallest: float  # smallest radius [m]
    method: int
    velocity_tolerance: float  # [m/s]
    iterations: int


class Nsm2(SolvedContactModel):
    """Percussions at mid-step, with dissipation K_N: 0 is inelastic, infinity elastic.

    Contacts are those that the free velocity closes within the step; bodies move by the mean of old and
    new velocity, so overlaps of the order of h|u| are part of the model and are reported.
    """

    name = "nsm2"
    midpoint = True
    normal_dissipation = Parameter(1e5, "K_N of eq. 26", unit="kg", minimum=0.0, infinite=True)
    tangential_dissipation = Parameter(0.0, "K_T of eq. 26", unit="kg", minimum=0.0)
    position_correction = Parameter(False, "push bodies apart where they overlap, without touching velocities")

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

    def run(self, engine: Engine, clock: Clock) -> tuple[int, int]:
        """Make the steps of `clock` in compiled code."""
        inside = engine.bodies.count[0]
        law = Law(
            self.normal_dissipation,
            self.tangential_dissipation,
            self.position_correction,
            float(engine.bodies.radius[:inside].min()),
            *self.settings(),
        )
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


@inner
def _parts(world, bodies, lists, contacts, events, forces, clock, tally, law, step, parts):
    """Make one step in `parts` sub-steps; return a status."""
    h = clock.step / parts
    margin = MARGIN if law.correction else 0.0
    floor = max(TOUCH + world.rounding, margin)
    for part in range(parts):
        time = step * clock.step + part * h
        status, fastest = stepping.free_motion(world, bodies, lists, forces, clock, tally, time, h, False)
        if status == OK and stepping.is_too_fast(bodies, h, fastest, law.smallest):
            return stepping.TOO_FAST
        if status == OK:
            status = stepping.meet(world, bodies, lists, contacts, tally, h, REACH, floor, fastest)
        if status == OK:
            stepping.tally_contacts(contacts, tally)
        if status == OK and law.correction:
            status = part_overlaps(
                world, bodies, lists, contacts, events, clock, tally, time, law.method, law.iterations, OVERLAP
            )
        if status != OK:
            return status
        keep_only_meeting(world, bodies, contacts, h, margin)
        for c in range(contacts.count[0] if law.correction else 0):
            if 0.0 < contacts.gap[c] <= margin:  # touching too; the others have been counted
                tally[0, at.CONTACTS] += 1.0
        set_velocity_before(bodies, contacts)
        _stick(bodies, contacts, law, clock.full)
        _strike(bodies, contacts, tally, law)
        if clock.report_force and step == clock.last - 1 and part == parts - 1:
            _report_reaction(bodies, contacts, law, h)
        status = stepping.finish(world, bodies, lists, contacts, events, clock, tally, time, h, 0.5)
        if status != OK:
            return status
    return OK


@inner
def _stick(bodies, contacts, law, full):
    """Mark the closing contacts, on which the tangential law acts, with their tangential velocity before."""
    if law.tangential <= 0.0 and not full:
        return
    for c in range(contacts.count[0]):
        if normal_velocity(bodies.free, contacts, c) < 0.0:
            contacts.sticky[c] = 1
            contacts.work[c, 2] = tangential_velocity(bodies.velocity, contacts, c)
            contacts.friction[c] = 0.0


@inner
def _percussions(bodies, velocity, contacts, law, normal, enough):
    """Solve with K_N = `normal`; retry above a residual `enough`; return (iterations, residual, retried)."""
    compliance = 2.0 / normal if normal > 0.0 else INELASTIC
    return solve_or_retry(
        law.method,
        bodies.count[0],
        bodies.inverse_mass,
        bodies.free,
        velocity,
        contacts,
        compliance,
        law.tangential,
        law.velocity_tolerance,
        law.iterations,
        enough,
    )


@inner
def _strike(bodies, contacts, tally, law):
    """Find the velocities after the percussions; fall back from infinite K_N where no solution exists."""
    enough = math.inf if math.isinf(law.normal) else law.velocity_tolerance
    iterations, found, again = _percussions(bodies, bodies.solved, contacts, law, law.normal, enough)
    if contacts.count[0] == 0:
        return
    tally[0, at.SOLVES] += 1.0
    tally[0, at.ITERATIONS] += iterations
    tally[0, at.RETRIED_SOLVES] += again
    if found > law.velocity_tolerance and math.isinf(law.normal):
        for c in range(contacts.count[0]):
            contacts.percussion[c] = 0.0
            contacts.friction[c] = 0.0
        iterations, found, again = _percussions(bodies, bodies.solved, contacts, law, FALLBACK, law.velocity_tolerance)
        tally[0, at.ITERATIONS] += iterations
        tally[0, at.RETRIED_SOLVES] += again
        tally[0, at.ELASTIC_FALLBACKS] += 1.0
    tally[0, at.GREATEST_RESIDUAL] = max(tally[0, at.GREATEST_RESIDUAL], found)
    if found > law.velocity_tolerance:
        tally[0, at.UNCONVERGED_STEPS] += 1.0


@inner
def _report_reaction(bodies, contacts, law, h):
    """Report contact forces from a solve with K_N = 0 on the same contacts.

    Between opposed contacts percussions grow with K_N, so theirs are no measure of a squeeze.
    """
    for c in range(contacts.count[0]):
        contacts.work[c, 0] = contacts.percussion[c]
        contacts.work[c, 1] = contacts.friction[c]
    _percussions(bodies, bodies.spare, contacts, law, 0.0, law.velocity_tolerance)
    report_contact_force(bodies, contacts, 1.0 / h)
    for c in range(contacts.count[0]):
        contacts.percussion[c] = contacts.work[c, 0]
        contacts.friction[c] = contacts.work[c, 1]


evac_interface = 2


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Nsm2]
