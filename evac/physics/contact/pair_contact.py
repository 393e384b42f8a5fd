"""Contact models that are defined by the forces of a single contact."""

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import PluginError, fault, in_one_line
from evac.jit import Entry, Floats, Struct, call_pair_contact, call_pair_friction, inner, row
from evac.jit.store import kernels_in
from evac.physics.contact.contacts import (
    ground_along,
    keep_only_meeting,
    new_memory,
    normal_velocity,
    push,
    rub,
    set_reach,
    tangential_velocity,
    tried_memory,
    use_free_velocity,
)
from evac.physics.contact.model import BorderScene, ContactModel
from evac.physics.force import check_indices, packed_row
from evac.physics.state import State
from evac.physics.status import CENTRES_PASSED, OK, SEARCH_AGAIN, TOO_STIFF, WALL_CROSSED

#: Difference of overlaps from which the stiffness of a law is computed [m].
SPAN = 1e-6
PER_SPAN = 1.0 / SPAN

#: Greatest h^2 k (1/m + 1/m') of a contact of stiffness k. In steps of this length, a collision changes the relative
#: speed of two people by at most 10 %, wherever in a step they touch; from 0.718 on it can be more.
COARSEST = 0.71


class PairLaw(Struct):
    """Parameters of the law of a single contact, and scratch for the check of stability."""

    parameters: Floats
    square: Floats  # (n,) bound of omega^2 of the springs of a body [1/s2]


def law_of(pair: Entry, label: str) -> Entry:
    """Return the law of a contact model (`evac.physics.contact.model.ContactModel.law`) for the law of one contact.

    Both are compiled together, which is faster than a call for every contact.

    The stiffness of a contact is dF/dD + (2/h) dF/dw at the overlap D that it reaches within the step, with the closing
    speed w: an explicit step with springs k and dampers c is stable if h^2 (k + 2c/h) / m < 4 for all modes. A step is
    divided if it is unstable, or too coarse for a collision (`COARSEST`), which may also be about to begin.
    """
    law = _law_with_friction(pair) if _has_friction(pair) else _law_along_normal(pair)
    law.__module__, law.__qualname__ = label.rsplit(":", 1)
    return Entry(law)


def _has_friction(pair: Entry) -> bool:
    return len(pair.signature[0]) == len(call_pair_friction.kinds)


def _law_along_normal(pair: Entry) -> Callable[[State, PairLaw, float], int]:

    def law(state: State, own: PairLaw, h: float) -> int:
        bodies, contacts, given = state.bodies, state.contacts, own.parameters
        if state.clock.attempt == 0:
            mass, deepest = 0.5 * bodies.lightest, _deepest(state, h)
            rise = pair(deepest - SPAN, 0.0, mass, given) - pair(deepest, 0.0, mass, given)
            if _is_coarse(h, rise, 1.0 / mass):
                return _look_ahead(bodies, h)
        else:
            for c in range(contacts.number):
                closing, mass = -normal_velocity(bodies.free, contacts, c), 1.0 / contacts.omega[c]
                deepest = contacts.gap[c] - h * max(closing, 0.0)
                rise = pair(min(deepest, 0.0) - SPAN, closing, mass, given) - pair(
                    min(deepest, 0.0), closing, mass, given
                )
                if deepest < 0.0 and _is_coarse(h, rise, contacts.omega[c]):
                    bodies.failed = contacts.body[c]
                    return TOO_STIFF
            keep_only_meeting(state.world, bodies, contacts, 0.0, 0.0)
        use_free_velocity(state)
        for i in range(bodies.inside):
            own.square[i] = 0.0
        for c in range(contacts.number):
            gap, closing, mass = min(contacts.gap[c], 0.0), -contacts.velocity_before[c], 1.0 / contacts.omega[c]
            percussion = h * max(pair(gap, closing, mass, given), 0.0)
            contacts.percussion[c] = percussion
            push(bodies.solved, bodies.inverse_mass, contacts, c, percussion)
            deepest = gap - h * max(closing, 0.0)  # equal to the gap if it opens; a branch costs more than a call
            force = pair(deepest, closing, mass, given)
            beyond = pair(deepest - SPAN, closing + 2.0 * SPAN / h, mass, given)
            _add_stiffness(bodies, contacts, own, c, PER_SPAN * max(beyond - force, 0.0))
        return TOO_STIFF if _is_unstable(state, own, h) else OK

    return law


def _law_with_friction(pair: Entry) -> Callable[[State, PairLaw, float], int]:
    """Return the law for a function with friction, whose stiffness along the tangent is that towards less friction."""

    def law(state: State, own: PairLaw, h: float) -> int:
        bodies, contacts, given = state.bodies, state.contacts, own.parameters
        if state.clock.attempt == 0:
            mass, deepest = 0.5 * bodies.lightest, _deepest(state, h)
            force, _ = pair(deepest, 0.0, 0.0, mass, 0.5 * h, new_memory(contacts), given)
            beyond, _ = pair(deepest - SPAN, 0.0, 0.0, mass, 0.5 * h, new_memory(contacts), given)
            if _is_coarse(h, beyond - force, 1.0 / mass):
                return _look_ahead(bodies, h)
        else:
            for c in range(contacts.number):
                closing, mass = -normal_velocity(bodies.free, contacts, c), 1.0 / contacts.omega[c]
                deepest = contacts.gap[c] - h * max(closing, 0.0)
                force, _ = pair(min(deepest, 0.0), closing, 0.0, mass, 0.5 * h, tried_memory(contacts, c), given)
                tried = tried_memory(contacts, c)
                beyond, _ = pair(min(deepest, 0.0) - SPAN, closing, 0.0, mass, 0.5 * h, tried, given)
                if deepest < 0.0 and _is_coarse(h, beyond - force, contacts.omega[c]):
                    bodies.failed = contacts.body[c]
                    return TOO_STIFF
            keep_only_meeting(state.world, bodies, contacts, 0.0, 0.0)
        use_free_velocity(state)
        for i in range(bodies.inside):
            own.square[i] = 0.0
        for c in range(contacts.number):
            gap, closing, mass = min(contacts.gap[c], 0.0), -contacts.velocity_before[c], 1.0 / contacts.omega[c]
            ground = ground_along(state.world, bodies, contacts, c)
            slide = tangential_velocity(bodies.velocity, contacts, c) - ground
            deepest, change = gap - h * max(closing, 0.0), 2.0 * SPAN / h
            tried = tried_memory(contacts, c)
            force, friction = pair(deepest, closing, slide, mass, 0.5 * h, tried, given)
            tried = tried_memory(contacts, c)
            beyond, _ = pair(deepest - SPAN, closing + change, slide, mass, 0.5 * h, tried, given)
            tried = tried_memory(contacts, c)
            _, less = pair(deepest, closing, slide + math.copysign(change, friction), mass, 0.5 * h, tried, given)
            _add_stiffness(bodies, contacts, own, c, PER_SPAN * max(beyond - force, abs(less - friction)))
            elapsed = state.clock.h_before
            if -gap < elapsed * closing:
                elapsed = -gap / closing
            force, friction = pair(gap, closing, slide, mass, elapsed, row(contacts.memory, c), given)
            contacts.percussion[c] = h * max(force, 0.0)
            contacts.friction[c] = h * friction
            contacts.slide_before[c] = slide - ground  # relative to the wall after the step, too
            contacts.sticky[c] = 1
            push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
            rub(bodies.solved, bodies.inverse_mass, contacts, c, contacts.friction[c])
        return TOO_STIFF if _is_unstable(state, own, h) else OK

    return law


@inner
def _deepest(state, h):
    """Return the gap of the deepest overlap that a contact may have within the step [m]."""
    return -max(state.contacts.deepest, 0.0) - 2.0 * h * state.bodies.fastest


@inner
def _is_coarse(h, rise, omega):
    """Return whether steps of `h` are too coarse for a collision; `rise` is that of the force over `SPAN` [N]."""
    return h * h * PER_SPAN * rise * omega > COARSEST


@inner
def _look_ahead(bodies, h):
    """Extend the reach of bodies to their free paths, to find the contacts that may begin within the step."""
    set_reach(bodies, h, 1.0)
    bodies.farthest_reach = h * bodies.fastest
    return SEARCH_AGAIN


@inner
def _add_stiffness(bodies, contacts, own, c, stiffness):
    """Add the greatest stiffness of contact c along a direction to the bounds of omega^2 of its bodies."""
    # Gershgorin's bound is the sum of k (1/m + 1/sqrt(m m')) over the contacts of a body of mass m with those of mass
    # m', which is at most that of k (3/m + 1/m') / 2.
    i, j = contacts.body[c], contacts.other[c]
    if j < 0:
        own.square[i] += stiffness * bodies.inverse_mass[i]
    else:
        own.square[i] += 0.5 * stiffness * (contacts.omega[c] + 2.0 * bodies.inverse_mass[i])
        own.square[j] += 0.5 * stiffness * (contacts.omega[c] + 2.0 * bodies.inverse_mass[j])


@inner
def _is_unstable(state, own, h):
    """Return whether the contacts make a sub-step unstable; note the body as failed."""
    # The limit of h^2 omega^2 is that of a spring with the damping of the drive, at least 2 if that is not explicit.
    bodies, explicit = state.bodies, state.clock.explicit
    least = 0.0 if explicit else 2.0
    for i in range(bodies.inside):
        if h * h * own.square[i] > least:
            kept = 1.0 - h / bodies.tau[i] if explicit else math.exp(-h / bodies.tau[i])
            if h * h * own.square[i] > 2.0 * (1.0 + kept):
                bodies.failed = i
                return True
    return False


class PairContact(ContactModel):
    """Base class of contact models that are defined by the forces of a single contact.

    A subclass names a function compiled with `evac.jit.pair_contact`, which returns the repulsive force of two people
    who overlap, or of a person and a wall, or one compiled with `evac.jit.pair_friction`, which also returns a force
    along the tangent and may have a `memory`. A negative repulsive force is replaced by zero. Steps that are unstable
    because of the stiffness of the law, or too coarse for a collision, are divided.
    """

    longest_path = 0.5
    remembers = False

    #: Function compiled by `evac.jit.pair_contact` or `evac.jit.pair_friction`.
    pair: ClassVar[Any] = None

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        nearest = next(vars(base) for base in cls.__mro__ if "pair" in vars(base) or "law" in vars(base))
        if "law" not in nearest and isinstance(cls.pair, Entry):
            cls.law = law_of(cls.pair, f"{cls.__module__}:{cls.__qualname__}.law")

    def check_pair(self) -> None:
        """Check that the law of this model is the one that has been compiled with its function, and what that reads."""
        what = f"contact model {self.name!r}"
        has_friction = isinstance(self.pair, Entry) and _has_friction(self.pair)
        call = call_pair_friction if has_friction else call_pair_contact
        call.check(self.pair, f"{what}: pair", type(self))
        if self.memory and not has_friction:
            wrong = f"it declares a memory, but {self.pair.title} does not receive it"
            raise fault(what, wrong, "decorate the function with evac.jit.pair_friction", self, "memory")
        if self.law is None or self.pair not in kernels_in(self.law):
            wrong = f"its law does not call its function {self.pair.title}"
            remedy = "name `pair` in the body of the class, and derive a model with a law of its own from ContactModel"
            raise fault(what, wrong, remedy, self)
        check_indices(self.pair, len(packed_row(self, what)), what)
        if has_friction:
            check_indices(self.pair, len(self.memory), what, -2, f"{type(self).__name__}.memory names")

    def packed(self) -> FloatArray:
        """Return the parameters (p,) float64 that the function reads; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    def check_scene(self, scene: BorderScene) -> None:
        """Refuse a law that attracts bodies or is not finite, and steps that are too long for explicit driving."""
        super().check_scene(scene)
        self._check_sign(scene)

    def _check_sign(self, scene: BorderScene) -> None:
        """Refuse a law that only attracts, which would have no effect, since such forces are replaced by zero."""
        mass, radius = 0.5 * float(scene.mass.min()), float(scene.radius.min())
        forces = [self.forces(-share * radius, 0.0, mass, self.packed())[0] for share in (0.001, 0.01, 0.1, 0.5, 1.0)]
        if min(forces) < 0.0 and max(forces) <= 0.0:
            wrong = f"{self.pair.title} returns {forces[-1]:.3g} N for the gap {-radius:.3g} m"
            remedy = "return a positive force, which is repulsive, for a negative gap"
            raise fault(f"contact model {self.name!r}", wrong, remedy, self.pair)

    def forces(
        self, gap: float, closing: float, mass: float, packed: FloatArray, slide: float = 0.0, elapsed: float = 0.0
    ) -> tuple[float, float]:
        """Return the forces along normal and tangent [N] that the function returns in Python, without a past."""
        what, remedy = f"contact model {self.name!r}", "return a finite number for every gap that is negative or zero"
        called = f"for the gap {gap:.3g} m, the closing speed {closing:.3g} m/s and the reduced mass {mass:.3g} kg"
        if _has_friction(self.pair):
            called = f"{called}, the sliding speed {slide:.3g} m/s and the time {elapsed:.3g} s"
        try:
            with np.errstate(all="ignore"):
                if _has_friction(self.pair):
                    memory = np.zeros(len(self.memory))
                    force, friction = self.pair.function(gap, closing, slide, mass, elapsed, memory, packed)
                else:
                    force, friction = self.pair.function(gap, closing, mass, packed), 0.0
        except Exception as error:
            raise fault(what, f"{self.pair.title} raises {in_one_line(error)} {called}", remedy, self.pair) from error
        for component in (force, friction):
            if not (isinstance(component, (int, float, np.number)) and np.isreal(component) and np.isfinite(component)):
                raise fault(what, f"{self.pair.title} returns {component} {called}", remedy, self.pair)
        return float(force), float(friction)

    def culprit(self, state: State) -> PluginError | None:
        """Return the error for the first contact at which the function is not finite; None if there is none."""
        contacts, packed, elapsed = state.contacts, self.packed(), state.clock.h_before
        for c in range(contacts.number):
            gap, closing = min(float(contacts.gap[c]), 0.0), -float(contacts.velocity_before[c])
            slide = float(tangential_velocity(state.bodies.velocity, contacts, c))
            try:
                self.forces(gap, closing, 1.0 / float(contacts.omega[c]), packed, slide, elapsed)
            except PluginError as error:
                return error
        return super().culprit(state)

    @property
    def parameters(self) -> FloatArray:
        """What the law reads."""
        return self.packed()

    def advice(self) -> Mapping[int, str]:
        """Return advice for steps that fail."""
        own = f"parameters of contact.{self.name}"
        stiffer = f"choose {own} that make contacts stiffer, or a contact model that prevents overlaps"
        return {
            WALL_CROSSED: stiffer,
            CENTRES_PASSED: f"use a behaviour with which people keep their distance, {stiffer}",
            TOO_STIFF: f"choose {own} that make contacts softer, or use a smaller simulation.step",
        }
