"""Contact models that are defined by the forces of a single contact."""

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import PluginError, ScenarioError, fault, in_one_line
from evac.jit import Entry, Floats, Struct, Triples, call_pair_contact, call_pair_friction, row
from evac.jit.digest import kernels_in
from evac.physics.contact.contacts import push, rub, tangential_velocity, use_free_velocity
from evac.physics.contact.memory import tried_memory
from evac.physics.contact.model import BorderScene, ContactModel
from evac.physics.contact.packing import check_indices, packed_row
from evac.physics.contact.stability import add_stiffness, damping_limit, forget_stiffnesses, makes_unstable
from evac.physics.state import State
from evac.physics.status import OK, TOO_STIFF, WALL_CROSSED

#: Difference of overlaps from which the stiffness of a law is computed [m].
SPAN = 1e-6
PER_SPAN = 1.0 / SPAN


class PairLaw(Struct):
    """Parameters of the law of a single contact, and work arrays of the stability check."""

    parameters: Floats
    stiffnesses: Triples  # (n, 3) of each body, see `evac.physics.contact.stability` [1/s2]
    coupling: Floats  # (n,) [1/s2]


def law_of(pair: Entry, label: str) -> Entry:
    """Return the law of a contact model (`evac.physics.contact.model.ContactModel.law`) for the law of one contact.

    Both are compiled together, which is faster than a call for every contact.

    The stiffness of a contact is dF/dD + (2/h) dF/dw at the overlap D that it reaches within the step, with the closing
    speed w: an explicit step with springs k and dampers c is stable if h^2 (k + 2c/h) / m < 4 for all modes.
    """
    obey = _law_with_friction(pair) if _has_friction(pair) else _law_along_normal(pair)
    obey.__module__, obey.__qualname__ = label.rsplit(":", 1)
    return Entry(obey)


def _has_friction(pair: Entry) -> bool:
    return len(pair.signature[0]) == len(call_pair_friction.kinds)


def _law_along_normal(pair: Entry) -> Callable[[State, PairLaw, float], int]:

    def obey(state: State, own: PairLaw, h: float) -> int:
        bodies, contacts, given = state.bodies, state.contacts, own.parameters
        forget_stiffnesses(contacts, own)
        for c in range(contacts.number):
            gap, closing, mass = min(contacts.gap[c], 0.0), -contacts.velocity_before[c], 1.0 / contacts.omega[c]
            contacts.percussion[c] = h * max(pair(gap, closing, mass, given), 0.0)
            deepest = gap - h * max(closing, 0.0)  # equal to the gap if it opens; a branch costs more than a call
            force = pair(deepest, closing, mass, given)
            beyond = pair(deepest - SPAN, closing + 2.0 * SPAN / h, mass, given)
            stiffness = PER_SPAN * max(beyond - force, 0.0)
            add_stiffness(bodies, contacts, own, c, contacts.normal[c, 0], contacts.normal[c, 1], stiffness)
        if makes_unstable(state, own, h, 1.0):
            return TOO_STIFF
        use_free_velocity(state)
        for c in range(contacts.number):
            push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
        return OK

    return obey


def _law_with_friction(pair: Entry) -> Callable[[State, PairLaw, float], int]:
    """Return the law for a function with friction, whose stiffness along the tangent is found likewise.

    It is that towards less friction: a contact that slides may stick in the next step.
    """

    def obey(state: State, own: PairLaw, h: float) -> int:
        bodies, contacts, given = state.bodies, state.contacts, own.parameters
        forget_stiffnesses(contacts, own)
        for c in range(contacts.number):
            gap, closing, mass = min(contacts.gap[c], 0.0), -contacts.velocity_before[c], 1.0 / contacts.omega[c]
            slide = tangential_velocity(bodies.velocity, contacts, c)
            deepest, change = gap - h * max(closing, 0.0), 2.0 * SPAN / h
            tried = tried_memory(contacts, c)
            force, friction = pair(deepest, closing, slide, mass, 0.5 * h, tried, given)
            tried = tried_memory(contacts, c)
            beyond, _ = pair(deepest - SPAN, closing + change, slide, mass, 0.5 * h, tried, given)
            tried = tried_memory(contacts, c)
            _, less = pair(deepest, closing, slide + math.copysign(change, friction), mass, 0.5 * h, tried, given)
            nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
            add_stiffness(bodies, contacts, own, c, nx, ny, PER_SPAN * max(beyond - force, 0.0))
            add_stiffness(bodies, contacts, own, c, -ny, nx, PER_SPAN * abs(less - friction))
            elapsed = state.clock.h_before
            if -gap < elapsed * closing:
                elapsed = -gap / closing
            force, friction = pair(gap, closing, slide, mass, elapsed, row(contacts.memory, c), given)
            contacts.percussion[c] = h * max(force, 0.0)
            contacts.friction[c] = h * friction
            contacts.slide_before[c] = slide
            contacts.sticky[c] = 1
        if makes_unstable(state, own, h, 1.0):
            return TOO_STIFF
        use_free_velocity(state)
        for c in range(contacts.number):
            push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
            rub(bodies.solved, bodies.inverse_mass, contacts, c, contacts.friction[c])
        return OK

    return obey


class PairContact(ContactModel):
    """Base class of contact models that are defined by the forces of a single contact.

    A subclass names a function compiled with `evac.jit.pair_contact`, which returns the repulsive force of two people
    who overlap, or of a person and a wall, or one compiled with `evac.jit.pair_friction`, which also returns a force
    along the tangent and may have a `memory`. A negative repulsive force is replaced by zero. Steps that are unstable
    because of the stiffness of the law are divided.
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
        """Check that the law of this model is the one that has been compiled with its function.

        Raises
        ------
        PluginError
            `pair` is missing or of another signature, it reads a parameter that does not exist, it has been replaced,
            or the class names a law of its own; or the parameters are not finite.
        """
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
        """Refuse steps beyond the stability limit of a dense packing, omega^2 = 6k/m (docs/physics.md).

        The stiffness k is taken at the overlap at which a contact balances the driving force of one person.

        Raises
        ------
        ScenarioError
            The step is too long.
        PluginError
            The law attracts bodies, or is not finite.
        """
        super().check_scene(scene)
        self._check_sign(scene)
        if self.overdamped:
            return
        load = float((scene.mass * scene.speed / scene.tau).max(initial=0.0))
        mass, tau, step = float(scene.mass.min()), float(scene.tau.min()), scene.step
        overlap = self._overlap(load, 0.5 * mass, float(scene.radius.min()))
        while step > 0.0:
            rise = self._force(overlap + SPAN, 0.5 * mass, 2.0 * SPAN / step) - self._force(overlap, 0.5 * mass)
            if step**2 * 6.0 * PER_SPAN * rise / mass < damping_limit(step, tau, scene.explicit):
                break
            step *= 0.98
        if step < scene.step:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for contact model {self.name!r} with its stiffness"
                f" under a load of {load:.0f} N, a least mass of {mass:.1f} kg and a least tau of {tau:g} s; it must"
                f" be at most {step:.2g} s (or choose parameters of contact.{self.name} that make contacts softer)"
            )

    def _check_sign(self, scene: BorderScene) -> None:
        """Refuse a law that only attracts, which would have no effect, since such forces are replaced by zero."""
        mass, radius = 0.5 * float(scene.mass.min()), float(scene.radius.min())
        forces = [self._force(share * radius, mass) for share in (0.001, 0.01, 0.1, 0.5, 1.0)]
        if min(forces) < 0.0 and max(forces) <= 0.0:
            wrong = f"{self.pair.title} returns {forces[-1]:.3g} N for the gap {-radius:.3g} m"
            remedy = "return a positive force, which is repulsive, for a negative gap"
            raise fault(f"contact model {self.name!r}", wrong, remedy, self.pair)

    def _force(self, overlap: float, mass: float, closing: float = 0.0) -> float:
        return self.forces(-overlap, closing, mass, self.packed())[0]

    def forces(
        self, gap: float, closing: float, mass: float, packed: FloatArray, slide: float = 0.0, elapsed: float = 0.0
    ) -> tuple[float, float]:
        """Return the forces along normal and tangent [N] that the function returns in Python, without a past.

        Raises
        ------
        PluginError
            One of them is not a finite number; names the function and its arguments.
        """
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

    def _overlap(self, load: float, mass: float, largest: float) -> float:
        """Return the overlap [m] that balances a load [N], or the largest one."""
        low, high = 0.0, largest
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self._force(middle, mass) > load else (middle, high)
        return high

    @property
    def parameters(self) -> FloatArray:
        """What the law reads."""
        return self.packed()

    def advice(self) -> Mapping[int, str]:
        """Return advice for steps that fail."""
        own = f"parameters of contact.{self.name}"
        return {
            WALL_CROSSED: f"choose {own} that make contacts stiffer, or a contact model that prevents overlaps",
            TOO_STIFF: f"choose {own} that make contacts softer, or use a smaller simulation.step",
        }
