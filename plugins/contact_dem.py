"""DEM, the smooth contact model: a linear spring between overlapping bodies (eqs 3, 16, 17)."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from evac.errors import ScenarioError
from evac.hookspecs import hookimpl
from evac.jit import inner, kernel
from evac.parameters import Parameter
from evac.physics import stepping
from evac.physics.bundles import Clock
from evac.physics.contact_model import BorderScene, ContactModel
from evac.physics.engine import Engine
from evac.physics.neighbours import OK
from evac.physics.solvers import push


class Law(NamedTuple):
    """What the compiled loop reads."""

    stiffness: float  # [kg/s2]
    smallest: float  # smallest radius [m]


class Dem(ContactModel):
    """Spring contact: force k min(0, D) along the line of centres; overlap is part of the model."""

    name = "dem"
    stiffness = Parameter(1.2e5, "contact stiffness k of eq. 3", unit="kg/s2", above=0.0)

    def check_scene(self, scene: BorderScene) -> None:
        """Refuse steps beyond h^2 6k/m + 2h/tau < 4, the limit of a dense packing (PHYSICS 3.1)."""
        rate = 6.0 * self.stiffness / float(scene.mass.min())
        drag = 2.0 / float(scene.tau.min()) if scene.explicit else 0.0
        limit = (math.sqrt(drag**2 + 16.0 * rate) - drag) / (2.0 * rate)
        if scene.step >= limit:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for contact model 'dem' with stiffness"
                f" {self.stiffness:g} kg/s2 and a least mass of {scene.mass.min():.1f} kg;"
                f" it must be below {limit:.4f} s (or choose a smaller contact.dem.stiffness)"
            )

    def run(self, engine: Engine, clock: Clock) -> tuple[int, int]:
        """Make the steps of `clock` in compiled code."""
        inside = engine.bodies.count[0]
        law = Law(self.stiffness, float(engine.bodies.radius[:inside].min()))
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
def run(world, bodies, lists, contacts, events, forces, clock, tally, law):  # type: ignore[no-untyped-def]
    """Make all steps; cut a step that moves too far or meets a wall; return (next step, status)."""
    for step in range(clock.first, clock.last):
        stepping.save(bodies)
        fired = stepping.begin_step(events, tally)
        parts = np.int64(1)
        while True:
            status = _parts(world, bodies, lists, contacts, events, forces, clock, tally, law, step, parts)
            if status == OK:
                break
            stepping.undo(bodies, lists, contacts, events, tally, fired)
            parts = stepping.more_parts(status, parts, tally)
            if parts == 0:
                return step, status
    return clock.last, OK


@inner
def _parts(world, bodies, lists, contacts, events, forces, clock, tally, law, step, parts):  # type: ignore[no-untyped-def]
    """Make one step in `parts` sub-steps; return a status."""
    h = clock.step / parts
    for part in range(parts):
        time = step * clock.step + part * h
        status, fastest = stepping.free_motion(world, bodies, lists, forces, clock, tally, time, h, False)
        if status == OK and stepping.is_too_fast(bodies, h, 0.5 * law.smallest):
            return stepping.TOO_FAST
        if status == OK:
            status = stepping.meet(world, bodies, lists, contacts, tally, h, 0.0, 0.0, fastest)
        if status != OK:
            return status
        stepping.take_free(bodies)
        for c in range(contacts.count[0]):
            contacts.impulse[c] = -h * law.stiffness * min(0.0, contacts.gap[c])
            push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.impulse[c])
        stepping.report_force(bodies, contacts, clock, step, part, parts, 1.0 / h)
        stepping.tally_contacts(contacts, tally)
        status = stepping.finish(world, bodies, lists, contacts, events, clock, tally, time, h, 0.0)
        if status != OK:
            return status
    return OK


@hookimpl
def evac_contact_models() -> Sequence[type[ContactModel]]:
    """Register the model."""
    return [Dem]
