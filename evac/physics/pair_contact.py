"""Contact models whose law is one function of a contact: its gap, closing speed and reduced mass to a force."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray
from evac.errors import ScenarioError
from evac.jit import Floats, Struct, Triples, call_pair_contact, kernel
from evac.physics.contact_model import BorderScene, ContactModel
from evac.physics.contacts import push, take_free
from evac.physics.stability import (
    add_stiffness,
    damping_limit,
    forget_stiffnesses,
    makes_unstable,
)
from evac.physics.state import State, World
from evac.physics.status import OK, TOO_STIFF, WALL_CROSSED

#: Change of the overlap over which the stiffness of a law is taken [m].
SPAN = 1e-6
PER_SPAN = 1.0 / SPAN


class PairLaw(Struct):
    """What the law of a contact reads, and room for the check of its stability."""

    parameters: Floats
    stiffnesses: Triples  # (n, 3) of each body, see `evac.physics.stability` [1/s2]
    coupling: Floats  # (n,) [1/s2]


@kernel
def obey_pair_law(state: State, own: PairLaw, h: float) -> int:
    """Set the percussions that the law of a contact asks for and the velocities after the sub-step; return a status.

    The stiffness of a contact is dF/dD + 2/h dF/dw with the overlap D, where its closing speed w takes it within the
    step: an explicit step is stable where h^2 times that of a mode, over its mass, is below 4.
    """
    bodies, contacts, law, given = state.bodies, state.contacts, state.parts.pair_contact, own.parameters
    forget_stiffnesses(contacts, own)
    for c in range(contacts.number):
        gap, closing, mass = min(contacts.gap[c], 0.0), -contacts.velocity_before[c], 1.0 / contacts.omega[c]
        force = call_pair_contact(law, gap, closing, mass, given)
        contacts.percussion[c] = h * max(force, 0.0)
        deepest = gap - h * max(closing, 0.0)  # the same place for half of them: a branch would cost more than a call
        force = call_pair_contact(law, deepest, closing, mass, given)
        beyond = call_pair_contact(law, deepest - SPAN, closing + 2.0 * SPAN / h, mass, given)
        add_stiffness(bodies, contacts, own, c, PER_SPAN * max(beyond - force, 0.0))
    if makes_unstable(state, own, h, 1.0):
        return TOO_STIFF
    take_free(bodies)
    for c in range(contacts.number):
        push(bodies.solved, bodies.inverse_mass, contacts, c, contacts.percussion[c])
    return OK


class PairContact(ContactModel):
    """A contact model whose law is a function of one contact, compiled by `evac.jit.pair_contact`.

    It gives the force with which people who overlap push each other apart, and walls push them; a force below zero
    counts as none, since bodies only push. Steps that its stiffness makes unstable are cut into parts.
    """

    law = obey_pair_law
    longest_path = 0.5
    remembers = False

    #: Function compiled by `evac.jit.pair_contact`.
    pair: ClassVar[Any] = None

    def packed(self) -> FloatArray:
        """Return the parameters as the function reads them, (p,) float64; by default all declared numbers."""
        return np.array(list(self.values().values()), dtype=np.float64)

    def check_scene(self, scene: BorderScene) -> None:
        """Refuse steps at which a dense packing is unstable, omega^2 = 6k/m (docs/physics.md).

        The stiffness k is that of the overlap at which a contact carries the drive of one person.

        Raises
        ------
        ScenarioError
            The step is too long.
        """
        super().check_scene(scene)
        if self.overdamped:
            return
        load = float((scene.mass * scene.speed / scene.tau).max(initial=0.0))
        mass, tau = float(scene.mass.min()), float(scene.tau.min())
        step = scene.step
        while step > 0.0 and step**2 * 6.0 * self._stiffness(scene, load, step) / mass >= damping_limit(
            step, tau, scene.explicit
        ):
            step *= 0.98
        if step < scene.step:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for contact model {self.name!r} as stiff as it is where"
                f" it carries {load:.0f} N, with a least mass of {mass:.1f} kg and a least tau of {tau:g} s; it must"
                f" be at most {step:.2g} s (or choose parameters in contact.{self.name} that make it softer)"
            )

    def _stiffness(self, scene: BorderScene, load: float, step: float) -> float:
        """Return the stiffness in a step [s] at the overlap that carries a load [N], or at the smallest radius."""
        given, mass = self.packed(), 0.5 * float(scene.mass.min())

        def force(overlap: float, closing: float = 0.0) -> float:
            return float(self.pair.function(-overlap, closing, mass, given))

        low, high = 0.0, float(scene.radius.min())
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if force(middle) > load else (middle, high)
        return (force(high + SPAN, 2.0 * SPAN / step) - force(high)) / SPAN

    def own(self, people: int, world: World) -> PairLaw:
        """Return the parameters of the law, with room for so many people."""
        return PairLaw(parameters=self.packed(), stiffnesses=np.zeros((people, 3)), coupling=np.zeros(people))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return nothing: the arrays of `own` are written anew in every sub-step."""
        return {}

    def advice(self) -> Mapping[int, str]:
        """Return what to change where a step cannot be made."""
        own = f"parameters of contact.{self.name}"
        return {
            WALL_CROSSED: f"choose {own} that make contacts stiffer, or use contact.model = 'nsm1'",
            TOO_STIFF: f"choose {own} that make contacts softer, or use a smaller simulation.step",
        }
