"""Base class of contact models, which set the velocities after a sub-step."""

import math
from abc import ABC
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import PluginError, ScenarioError, fault, is_foreign
from evac.base.parameters import Configurable, Parameter
from evac.contract.hooks import DEFAULT_SOLVER
from evac.jit import Entry, Struct
from evac.jit.kernels import Array
from evac.physics import stepping
from evac.physics.state import Crowd, State, Traits, World, allocate
from evac.physics.status import OK

if TYPE_CHECKING:
    from evac.physics.engine import CompiledEngine


class StepContacts(NamedTuple):
    """The contacts of one sub-step for contact models written in NumPy; read-only except for the last two."""

    body: NDArray[np.int32]  #: (c,): the body that the normal points to
    other: NDArray[np.int32]  #: (c,): the body on the other side, -1 for a wall
    normal: FloatArray  #: (c, 2): unit vectors towards `body`
    gap: FloatArray  #: (c,): distance between the surfaces, negative where they overlap [m]
    velocity: FloatArray  #: (n, 2): velocities before the sub-step [m/s]
    free: FloatArray  #: (n, 2): velocities after the sub-step if there were no contacts [m/s]
    mass: FloatArray  #: (n,) [kg]
    radius: FloatArray  #: (n,) [m]
    percussion: FloatArray  #: (c,), output: normal percussions, for energy and contact forces [N s]
    #: (c, w), input and output: the numbers that `ContactModel.memory` names, from the last sub-step, to be replaced
    memory: FloatArray


class BorderScene(NamedTuple):
    """Properties of a scene that limit the step of a contact model, checked before a run."""

    step: float  #: [s]
    explicit: bool  #: whether the drive is integrated by explicit Euler
    radius: FloatArray  #: (n,) [m]
    mass: FloatArray  #: (n,) [kg]
    tau: FloatArray  #: (n,) [s]
    speed: FloatArray  #: (n,): largest desired or initial speed of each person [m/s]


def border_scene(crowd: Crowd, step: float, explicit: bool) -> BorderScene:
    """Return the `BorderScene` of a crowd at the start, for a step [s]."""
    speed = np.maximum(crowd.speed.max(axis=1), np.hypot(*crowd.velocity.T))
    return BorderScene(step, explicit, crowd.contact_radius, crowd.mass, crowd.tau, speed)


class ContactModel(Configurable, ABC):
    """Base class of contact models. A subclass names a compiled kernel `law`, or defines `step` with NumPy."""

    #: a kernel ``law(state: State, own: ..., h: float) -> int`` that sets the velocities after a sub-step of `h` [s],
    #: ``state.bodies.solved``, and the percussions, ``state.contacts.percussion``, from the contacts and
    #: ``state.bodies.free``, and returns a status of `evac.physics.status`. Its second argument is the struct that
    #: `own` returns.
    law: ClassVar[Entry | None] = None
    midpoint: bool = False  #: whether bodies move by the mean of the old and new velocity or by the new velocity
    overdamped: bool = False  #: whether the free velocity equals the desired velocity, without inertia
    #: search distance for contacts beyond touching, as a share of the free paths of both bodies in a step
    reach_share: float = 0.0
    reach_fastest: float = 0.0  #: at least this share of the free path of the fastest body is searched, too
    #: maximum free path of a body in a sub-step, in units of the smallest radius; longer steps are subdivided
    longest_path: float = math.inf
    remembers: bool = True  #: whether the law starts from the percussions of the previous sub-step (warm start)
    #: whether contact forces are the percussions divided by the length of a step; if not, the law reports them
    reports_percussions: bool = True
    #: names of the numbers that the law keeps of each contact, column by column of ``state.contacts.memory``. They are
    #: zero where a contact begins; the law replaces them in every sub-step, and they are lost when the contact is open
    #: at the end of a sub-step. The two people of a contact may be exchanged, so the numbers must not depend on their
    #: order; of a vector, keep the components along the normal and the tangent (-ny, nx), which are reversed together,
    #: instead of x and y. The contacts of a person with two walls are different contacts.
    memory: ClassVar[tuple[str, ...]] = ()
    #: whether bodies, and with them contacts, are sorted by travel time, the order in which sweeps transmit loads; if
    #: not, they are sorted by place, which is faster in large crowds
    along_the_way: bool = False
    #: whether bodies neither overlap nor rebound; warnings on overlaps and rebounds recommend such models
    rigid: ClassVar[bool] = False

    def check_scene(self, scene: BorderScene) -> None:
        """Check that the model is stable for a scene.

        Raises
        ------
        ScenarioError
            By default, for explicit driving (eq. 33) with a step of at least 2 tau, which is unstable.
        """
        tau = float(scene.tau.min())
        if scene.explicit and not self.overdamped and scene.step >= 2.0 * tau:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for simulation.driving = 'explicit' with a smallest tau"
                f" of {tau:g} s; it must be below {2.0 * tau:g} s, or use simulation.driving = 'exponential'"
            )

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return the largest expected overlap [m]; a run that exceeds it gets a quality warning.

        By default half the smallest radius, beyond which people pass through each other.
        """
        return 0.5 * float(scene.radius.min())

    def parts(self) -> list[tuple[str, bool, str]]:
        """Return the optional parts of the model: name, whether it is included, and the reason."""
        return []

    def traits(self, world: World) -> Traits:
        """Return the properties of the model that the step loop uses."""
        return Traits(
            overdamped=int(self.overdamped),
            old_share=0.5 if self.midpoint else 0.0,
            reach_share=self.reach_share,
            reach_fastest=self.reach_fastest,
            reach_floor=0.0,
            longest_path=self.longest_path if self.law else min(self.longest_path, 0.5),
            remembers=int(self.remembers),
            reports_percussions=int(self.reports_percussions),
        )

    def own(self, people: int, world: World) -> Struct:
        """Return the parameters of the law; by default its struct, filled with the attributes of the same names.

        Arrays for which the model has no attribute have a row for each person and are scratch: the law must set them in
        every sub-step before it reads them.

        Raises
        ------
        PluginError
            The model lacks the attribute for a number.
        """
        kinds = [kind for _, kind in self.law.signature[0]] if isinstance(self.law, Entry) else []
        struct = kinds[1] if len(kinds) > 1 else None
        if not (isinstance(struct, type) and issubclass(struct, Struct)):
            return NoParameters()  # a law without a struct is refused when it is loaded
        given = {name: getattr(self, name) for name in struct.kinds if hasattr(self, name)}
        missing = [name for name, kind in struct.kinds.items() if name not in given and not isinstance(kind, Array)]
        if missing:
            remedy = "give the model an attribute of that name, or define own(people, world), which returns the struct"
            raise fault(self._what, f"its law reads {struct.__name__}.{missing[0]}", remedy, self)
        return allocate(struct, people, **given)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the model keeps from tick to tick, by name; they are copied.

        By default none. Checkpoints are refused for a model that keeps attributes or arrays of `own` and does not
        override this method. A model that overwrites all of them in each sub-step returns an empty dict.
        """
        return {}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned; called after `own`."""

    def advice(self) -> Mapping[int, str]:
        """Return, for each status of a failed step, what to change in the case; used in error messages."""
        return {}

    def step(self, contacts: StepContacts, h: float) -> FloatArray:
        """Return the velocities after a sub-step and fill ``contacts.percussion``.

        Parameters
        ----------
        contacts : StepContacts
        h : float
            Length of the sub-step [s].

        Returns
        -------
        (n, 2) [m/s]

        Raises
        ------
        PluginError
            The model defines neither this method nor a law.
        """
        raise fault(self._what, "has neither a law nor step(contacts, h)", "define one of them", self)

    def culprit(self, state: State) -> PluginError | None:
        """Return the error if the law of a plugin has set velocities that are not finite, in a step that failed."""
        bodies = state.bodies
        free, solved = bodies.free[: bodies.inside], bodies.solved[: bodies.inside]
        lost = np.flatnonzero(np.isfinite(free).all(axis=1) & ~np.isfinite(solved).all(axis=1))
        if not len(lost) or not is_foreign(self):
            return None
        wrong = f"its law sets the velocity {solved[lost[0]]} of person {bodies.row[lost[0]]}"
        return fault(self._what, wrong, "it must be finite", self.law or self)

    @property
    def _what(self) -> str:
        return f"contact model {self.name!r}"

    def advance(self, engine: "CompiledEngine") -> int:
        """Make all steps of the clock; return a status, OK if all were made."""
        state = engine.data
        if self.law is not None:
            return int(stepping.advance(state))
        clock = state.clock
        while clock.now < clock.last:
            stepping.open_step(state)
            parts = clock.parts
            while (status := self._make_step(engine, parts)) != OK:
                parts = stepping.undo_step(state, status, parts)
                if not parts:
                    return status
            clock.now += 1
            clock.parts = 1
        return OK

    def _make_step(self, engine: "CompiledEngine", parts: int) -> int:
        """Make one step in `parts` sub-steps, calling `step` from Python between the kernels of the step loop."""
        for part in range(parts):
            stepping.set_clock(engine.data, part, parts)
            status = stepping.prepare_step(engine.data)
            if status == OK:
                self._call_step(engine)
                status = stepping.finish_step(engine.data)
            if status != OK:
                return int(status)
        return OK

    def _call_step(self, engine: "CompiledEngine") -> None:
        bodies, contacts = engine.data.bodies, engine.data.contacts
        n, c = bodies.inside, contacts.number
        contacts.percussion[:c] = 0.0
        of_bodies = {name: getattr(bodies, name)[:n] for name in ("velocity", "free", "mass")}
        of_contacts = {name: getattr(contacts, name)[:c] for name in contacts.kinds if name in StepContacts._fields}
        seen = StepContacts(**of_bodies, **of_contacts, radius=bodies.contact_radius[:n])
        for name, array in seen._asdict().items():
            array.flags.writeable = name in ("percussion", "memory")
        returned = self.step(seen, engine.data.clock.h)
        if np.shape(returned) != (n, 2):
            wrong = f"step returns velocities of shape {np.shape(returned)}, not {(n, 2)}"
            raise fault(self._what, wrong, "return one velocity for each body", type(self).step)
        if not np.isfinite(returned).all():
            row = int(np.argwhere(~np.isfinite(returned))[0, 0])
            wrong = f"step returns the velocity {returned[row]} of body {row}"
            raise fault(self._what, wrong, "it must be finite", type(self).step)
        bodies.solved[:n] = returned


class NoParameters(Struct):
    """Struct for laws without parameters."""


class SolvedContactModel(ContactModel):
    """Base class of contact models that solve a contact problem in every sub-step."""

    solver = Parameter(DEFAULT_SOLVER, "registered solver of the contact problem")
    velocity_tolerance = Parameter(5e-4, "largest accepted residual of the contact problem", unit="m/s", above=0.0)
    along_the_way = True
    #: Whether overlaps are separated, by moving positions, before the law is called.
    separates: bool = False

    iterations = Parameter(5_000, "iterations after which a solve is stopped as unconverged", minimum=1, maximum=10**9)
