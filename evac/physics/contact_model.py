"""Contact models own the sub-step: the base class of contact plugins."""

from abc import ABC
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.errors import PluginError, ScenarioError
from evac.parameters import Configurable, Parameter
from evac.physics import stepping
from evac.physics.bundles import Clock, Crowd
from evac.physics.solvers import SOLVERS

if TYPE_CHECKING:
    from evac.physics.engine import Engine

FloatArray = NDArray[np.float64]


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
    """A law of contact. Either define `step` in numpy, or override `run` with a compiled loop.

    Attributes
    ----------
    midpoint : bool
        Whether bodies move by the mean of old and new velocity (as NSM2) or by the new one.
    overdamped : bool
        Whether the free velocity is the desired one, without inertia.
    """

    midpoint: bool = False
    overdamped: bool = False

    #: How far beyond touching contacts are looked for: this share of both bodies' free paths in a step.
    reach_share: ClassVar[float] = 0.0

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
            If the model defines neither this nor `run`.
        """
        raise PluginError(f"contact model {self.name!r} defines neither step(contacts, h) nor run(engine, clock)")

    def run(self, engine: "Engine", clock: Clock) -> tuple[int, int]:
        """Make the steps of `clock`; return (next step, status), status 0 when all were made.

        This one calls `step` from Python, with the same kernels around it as compiled models.
        """
        bodies, lists, contacts, events, tally = (
            engine.bodies,
            engine.lists,
            engine.contacts,
            engine.events,
            engine.tally,
        )
        for step in range(clock.first, clock.last):
            fired = stepping.open_step(bodies, events, tally)
            parts = 1
            while (status := self._parts(engine, clock, step, parts)) != 0:
                parts = stepping.cut(bodies, lists, contacts, events, tally, fired, status, parts)
                if not parts:
                    return step, status
        return clock.last, 0

    def _parts(self, engine: "Engine", clock: Clock, step: int, parts: int) -> int:
        world, bodies, lists, contacts = engine.world, engine.bodies, engine.lists, engine.contacts
        h = clock.step / parts
        for part in range(parts):
            time = step * clock.step + part * h
            status = stepping.approach(
                world,
                bodies,
                lists,
                contacts,
                engine.forces,
                clock,
                engine.tally,
                time,
                h,
                self.reach_share,
                0.0,
                self.overdamped,
            )
            if status:
                return int(status)
            self._call_step(engine, h)
            is_last = step == clock.last - 1 and part == parts - 1
            status = stepping.conclude(
                world,
                bodies,
                lists,
                contacts,
                engine.events,
                clock,
                engine.tally,
                time,
                h,
                0.5 if self.midpoint else 0.0,
                is_last,
            )
            if status:
                return int(status)
        return 0

    def _call_step(self, engine: "Engine", h: float) -> None:
        bodies, contacts = engine.bodies, engine.contacts
        n, c = int(bodies.count[0]), int(contacts.count[0])
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
        found = self.step(seen, h)
        if np.shape(found) != (n, 2):
            raise PluginError(
                f"contact model {self.name!r}: step returned velocities of shape {np.shape(found)}, not {(n, 2)}"
            )
        if not np.isfinite(found).all():
            row = int(np.argwhere(~np.isfinite(found))[0, 0])
            raise PluginError(f"contact model {self.name!r}: step returned the velocity {found[row]} of body {row}")
        bodies.solved[:n] = found


class SolvedContactModel(ContactModel):
    """A contact model that solves a contact problem in every step: NSM1 and NSM2 share these parameters."""

    solver = Parameter("accelerated_sweeps", "method of the contact problem", choices=SOLVERS)
    velocity_tolerance = Parameter(5e-4, "greatest residual of the contact problem", unit="m/s", above=0.0)
    iterations = Parameter(5_000, "iterations after which a solve is counted as unconverged", minimum=1, maximum=10**9)

    def method(self) -> int:
        """Return the code of the solver."""
        return SOLVERS.index(self.solver)

    def settings(self) -> tuple[Any, ...]:
        """Return the solver's settings as the compiled loop reads them: method, tolerance, limit."""
        return self.method(), self.velocity_tolerance, self.iterations
