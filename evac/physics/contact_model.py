"""Contact models: the law that a sub-step obeys; the base class of contact plugins."""

import math
from abc import ABC
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.arrays import FloatArray
from evac.errors import PluginError, ScenarioError
from evac.jit import Entry, Struct
from evac.parameters import Configurable, Parameter
from evac.physics import driver
from evac.physics.state import Crowd, Traits, World
from evac.physics.status import OK

if TYPE_CHECKING:
    from evac.physics.engine import Engine


class StepContacts(NamedTuple):
    """The contacts of one sub-step, as a contact model written in numpy sees them: read-only but for `percussion`.

    Attributes
    ----------
    body : (c,) int32
        The body the normal points to.
    other : (c,) int32
        The body on the other side, -1 for a wall.
    normal : (c, 2)
        Unit vectors towards `body`.
    gap : (c,) [m]
        Distance between the surfaces, negative where they overlap.
    velocity : (n, 2) [m/s]
        Before the step.
    free : (n, 2) [m/s]
        After the step if nobody touched.
    mass, radius : (n,) [kg], [m]
    percussion : (c,) [N s]
        To be filled with the normal percussions, for energy and contact forces.
    """

    body: NDArray[np.int32]
    other: NDArray[np.int32]
    normal: FloatArray
    gap: FloatArray
    velocity: FloatArray
    free: FloatArray
    mass: FloatArray
    radius: FloatArray
    percussion: FloatArray


class BorderScene(NamedTuple):
    """What a contact model checks its step against before a run.

    Attributes
    ----------
    step : float [s]
    explicit : bool
        Whether the drive is explicit Euler.
    radius, mass, tau : (n,) [m], [kg], [s]
    speed : (n,)
        The greatest that each wants to walk or starts with [m/s].
    """

    step: float
    explicit: bool
    radius: FloatArray
    mass: FloatArray
    tau: FloatArray
    speed: FloatArray


def border_scene(crowd: Crowd, step: float, explicit: bool) -> BorderScene:
    """Return what contact models check a step [s] against, of a crowd as it starts."""
    speed = np.maximum(crowd.speed.max(axis=1), np.hypot(*crowd.velocity.T))
    return BorderScene(step, explicit, crowd.radius, crowd.mass, crowd.tau, speed)


class ContactModel(Configurable, ABC):
    """A law of contact: name a compiled `law`, or define `step` in numpy.

    Attributes
    ----------
    law : Entry or None
        A kernel ``law(state: State, own: ..., h: float) -> int`` that sets the velocities after a sub-step of `h` [s],
        ``state.bodies.solved``, and the percussions, ``state.contacts.percussion``, from the contacts and
        ``state.bodies.free``, and returns a status of `evac.physics.status`. Its second argument is the struct that
        `own` returns.
    midpoint : bool
        Whether bodies move by the mean of old and new velocity (as NSM2) or by the new one.
    overdamped : bool
        Whether the free velocity is the desired one, without inertia.
    reach_share, reach_fastest : float
        How far beyond touching contacts are looked for: a share of both bodies' free paths in a step, and at least a
        share of the fastest one's.
    longest_path : float
        A step is cut into parts where somebody's free path is longer than so many of the smallest radii.
    remembers : bool
        Whether the law starts from the percussions of the sub-step before.
    reports_percussions : bool
        Whether contact forces are percussions over the length of a step; if not, the law reports them.
    along_the_way : bool
        Whether bodies, and with them contacts, are in the order of travel time, in which sweeps pass loads on; if not,
        they are in the order of place, which is quicker in large crowds.
    """

    law: ClassVar[Entry | None] = None
    midpoint: bool = False
    overdamped: bool = False
    reach_share: float = 0.0
    reach_fastest: float = 0.0
    longest_path: float = math.inf
    remembers: bool = True
    reports_percussions: bool = True
    along_the_way: bool = False

    def check_scene(self, scene: BorderScene) -> None:
        """Refuse a scene that the model cannot step through.

        Raises
        ------
        ScenarioError
            Here: explicit driving (eq. 33) at steps of 2 tau or longer, which grows without bound.
        """
        tau = float(scene.tau.min())
        if scene.explicit and not self.overdamped and scene.step >= 2.0 * tau:
            raise ScenarioError(
                f"simulation.step: {scene.step} s is too long for simulation.driving = 'explicit' with a least tau of"
                f" {tau:g} s; it must be below {2.0 * tau:g} s, or use simulation.driving = 'exponential'"
            )

    def promised_overlap(self, scene: BorderScene) -> float:
        """Return the overlap [m] that the model promises not to exceed; a run that does has a quality warning.

        Here: half the smallest radius, beyond which people pass through one another.
        """
        return 0.5 * float(scene.radius.min())

    def parts(self) -> list[tuple[str, bool, str]]:
        """Return the parts of the model that a scene may not need: name, whether in, why."""
        return []

    def traits(self, world: World) -> Traits:
        """Return what the step loop needs to know."""
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
        """Return the parameters of the law: here its struct, filled with the model's attributes of the same names.

        To be overridden where the struct has scratch arrays for so many people.

        Raises
        ------
        PluginError
            If the model lacks one of these attributes.
        """
        kinds = [kind for _, kind in self.law.signature[0]] if isinstance(self.law, Entry) else []
        struct = kinds[1] if len(kinds) > 1 else None
        if not (isinstance(struct, type) and issubclass(struct, Struct)):
            return NoParameters()  # a law that takes none is refused where it is loaded
        missing = [name for name in struct.kinds if not hasattr(self, name)]
        if missing:
            raise PluginError(
                f"contact model {self.name!r}: its law reads {struct.__name__}.{missing[0]}; give the model an"
                " attribute of that name, or define own(people, world), which returns the struct"
            )
        return struct(**{name: getattr(self, name) for name in struct.kinds})

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the model keeps from tick to tick, by names of its own; they are copied.

        Here none. A model that keeps attributes or arrays of `own` and has no method of its own is refused by name
        where a checkpoint is asked for; one that writes all of them anew in each sub-step returns an empty dict.
        """
        return {}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned; `own` has been called before."""

    def advice(self) -> Mapping[int, str]:
        """Return what to change in the case where a step ends in a status, for the message."""
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
            If the model has neither this nor a law.
        """
        raise PluginError(f"contact model {self.name!r} has neither a law nor step(contacts, h); define one of them")

    def advance(self, engine: "Engine") -> int:
        """Make the steps of the clock and return a status, OK when all were made."""
        state = engine.state
        if self.law is not None:
            return int(driver.advance(state))
        clock = state.clock
        while clock.now < clock.last:
            driver.open_step(state)
            parts = clock.parts
            while (status := self._make_step(engine, parts)) != OK:
                parts = driver.cut(state, status, parts)
                if not parts:
                    return status
            clock.now += 1
            clock.parts = 1
        return OK

    def _make_step(self, engine: "Engine", parts: int) -> int:
        """Make one step in parts, calling `step` from Python with the kernels of the step loop around it."""
        for part in range(parts):
            driver.set_clock(engine.state, part, parts)
            status = driver.approach(engine.state)
            if status == OK:
                self._call_step(engine)
                status = driver.conclude(engine.state)
            if status != OK:
                return int(status)
        return OK

    def _call_step(self, engine: "Engine") -> None:
        bodies, contacts = engine.state.bodies, engine.state.contacts
        n, c = bodies.inside, contacts.number
        contacts.percussion[:c] = 0.0
        seen = StepContacts(
            contacts.body[:c],
            contacts.other[:c],
            contacts.normal[:c],
            contacts.gap[:c],
            bodies.velocity[:n],
            bodies.free[:n],
            bodies.mass[:n],
            bodies.radius[:n],
            contacts.percussion[:c],
        )
        for name, array in seen._asdict().items():
            array.flags.writeable = name == "percussion"
        found = self.step(seen, engine.state.clock.h)
        if np.shape(found) != (n, 2):
            raise PluginError(
                f"contact model {self.name!r}: step returned velocities of shape {np.shape(found)}, not {(n, 2)}"
            )
        if not np.isfinite(found).all():
            row = int(np.argwhere(~np.isfinite(found))[0, 0])
            raise PluginError(f"contact model {self.name!r}: step returned the velocity {found[row]} of body {row}")
        bodies.solved[:n] = found


class NoParameters(Struct):
    """The parameters of a law that has none."""


class SolvedContactModel(ContactModel):
    """A contact model that solves a contact problem in every step: NSM1 and NSM2 share these parameters."""

    solver = Parameter("accelerated_sweeps", "method of the contact problem, a registered solver")
    velocity_tolerance = Parameter(5e-4, "greatest residual of the contact problem", unit="m/s", above=0.0)
    along_the_way = True
    #: Whether overlaps are separated, on positions, before the law acts.
    separates: bool = False

    iterations = Parameter(5_000, "iterations after which a solve is counted as unconverged", minimum=1, maximum=10**9)
