"""The contact problems that solvers are compared on: what a model solves in one step of a crowd at a door."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.arrays import FloatArray
from evac.evidence.accuracy.reference import PRECISION, gradient_matrix, solve_contact_qp
from evac.evidence.accuracy.snapshots import STEP, DoorCrowd, door_crowd
from evac.evidence.models import COARSE
from evac.jit import kernel
from evac.physics.contact_model import ContactModel
from evac.physics.engine import Engine
from evac.physics.solvers import INELASTIC, SOLVERS, solve
from evac.physics.state import Bodies, Contacts, copy_of
from evac.physics.world import set_open
from evac.registry import Registry

#: Steps that a model makes from the snapshot before its contact problem is taken, so that the state is its own.
STEPS_BEFORE = 5

#: Steps made with the defaults at the end of a walk that is solved coarsely.
SETTLING_STEPS = 20

#: The kinds of crowd, in the order of `snapshots`.
KINDS = ("arriving", "settled", "opened")


@dataclass(frozen=True)
class Law:
    """A contact law to be solved: its model, its dissipation K_N [kg] (NSM2) and its variant (NSM1)."""

    label: str
    model: str
    dissipation: float = 0.0
    variant: str = "inertial"

    @property
    def compliance(self) -> float:
        """2/K_N [1/kg], or INELASTIC."""
        return 2.0 / self.dissipation if self.dissipation > 0.0 else INELASTIC

    @property
    def scale(self) -> float:
        """What a residual [m/s] is multiplied by for the error that the model stops at: h for NSM1's gap error [m]."""
        return STEP if self.model == "nsm1" else 1.0

    @property
    def unit(self) -> str:
        """Unit of that error."""
        return "m" if self.model == "nsm1" else "m/s"

    def make(self, registry: Registry) -> ContactModel:
        """Return the contact model, solved to its default tolerance."""
        parameters: dict[str, Any] = {"variant": self.variant}
        if self.model == "nsm2":
            parameters = {"normal_dissipation": self.dissipation}
        model: ContactModel = registry.get("contact_model", self.model)(**parameters)
        return model


LAWS = (
    Law("NSM1", "nsm1"),
    Law("NSM2, K_N = 0", "nsm2", 0.0),
    Law("NSM2, K_N = 1e3", "nsm2", 1e3),
    Law("NSM2, K_N = 1e5", "nsm2", 1e5),
)


@dataclass(frozen=True)
class ContactProblem:
    """The contact problem of one step.

    Attributes
    ----------
    law : Law
    inverse_mass : (n,) [1/kg]
    free : (n, 2) [m/s]
    contacts : Contacts
        Copies; ``percussion`` is where a solver starts.
    warm : (c,) [N s]
        Percussions found in the step before, where a contact was there already.
    velocity : (n, 2) [m/s]
        Where a solver writes.
    """

    law: Law
    inverse_mass: FloatArray
    free: FloatArray
    contacts: Contacts
    warm: FloatArray
    velocity: FloatArray

    @property
    def size(self) -> int:
        """Number of contacts."""
        return len(self.warm)

    def start(self, is_warm: bool) -> None:
        """Set the percussions that a solver starts from: the last step's, or zero."""
        self.contacts.percussion[: self.size] = self.warm if is_warm else 0.0
        self.contacts.friction[:] = 0.0

    def solve(self, solver: str, tolerance: float, limit: int) -> tuple[int, float]:
        """Solve to a residual [m/s] in at most `limit` iterations; return (iterations, residual)."""
        iterations, found = run_solver(
            SOLVERS.index(solver),
            self.inverse_mass,
            self.free,
            self.velocity,
            self.contacts,
            self.law.compliance,
            tolerance,
            limit,
        )
        return int(iterations), float(found)

    def reference(self, precision: float = PRECISION) -> FloatArray:
        """Return the velocities (n, 2) from the library's interior-point solver, to a residual [m/s]."""
        c = self.size
        gradient = gradient_matrix(
            self.contacts.body[:c], self.contacts.other[:c], self.contacts.normal[:c], len(self.free)
        )
        return solve_contact_qp(
            gradient,
            np.repeat(1.0 / self.inverse_mass, 2),
            self.free.ravel(),
            self.contacts.bias[:c],
            self.contacts.velocity_before[:c],
            self.law.dissipation,
            precision,
        ).reshape(-1, 2)


@kernel
def run_solver(method, inverse_mass, free, velocity, contacts, compliance, tolerance, limit):
    """Call a solver on a problem without tangential law; return (iterations, residual)."""
    n = inverse_mass.shape[0]
    return solve(method, n, inverse_mass, free, velocity, contacts, compliance, 0.0, tolerance, limit)


def default_solver(registry: Registry) -> str:
    """Return the solver that NSM1 and NSM2 are shipped with."""
    return str(registry.get("contact_model", "nsm1").declared()["solver"].default)


def snapshots(people: int, seed: int, registry: Registry) -> dict[str, DoorCrowd]:
    """Return crowds at a door by kind: arriving, settled against the closed door, and 0.05 s after it opened."""
    rough = registry.get("contact_model", "nsm1")(**COARSE)
    made = {
        kind: _walked_on(door_crowd(kind, people, seed, rough), SETTLING_STEPS, registry)
        for kind in ("arriving", "settled")
    }
    made["opened"] = _opened(made["settled"], registry)
    return made


def _walked_on(crowd: DoorCrowd, steps: int, registry: Registry) -> DoorCrowd:
    """Make some more steps with NSM1 as it is shipped."""
    crowd.engine.advance(registry.get("contact_model", "nsm1")(), crowd.crowd, crowd.step, steps, STEP, False, False)
    return DoorCrowd(crowd.kind, crowd.engine, crowd.crowd, crowd.step + steps)


def _opened(settled: DoorCrowd, registry: Registry) -> DoorCrowd:
    """Return a copy of a settled crowd 0.05 s after its door has opened."""
    world = settled.engine.world
    copied = world._replace(wall_open=world.wall_open.copy(), link_open=world.link_open.copy())
    set_open(copied, 0, True)
    crowd = copy_of(settled.crowd)
    engine = Engine(copied, len(crowd.level), [])
    return _walked_on(DoorCrowd("opened", engine, crowd, settled.step), 5, registry)


def contact_problem(snapshot: DoorCrowd, law: Law, registry: Registry) -> ContactProblem:
    """Return the contact problem of a law in the sixth of its steps from a snapshot, as the model itself poses it."""
    model = law.make(registry)
    _, held = _after(snapshot, model, STEPS_BEFORE)
    bodies, contacts = _after(snapshot, model, STEPS_BEFORE + 1)
    n, c = int(bodies.count[0]), int(contacts.count[0])
    known = {
        (int(body), int(key)): float(percussion)
        for body, key, percussion in zip(
            held.body[: held.count[0]], held.key[: held.count[0]], held.percussion[: held.count[0]], strict=True
        )
    }
    warm = np.array(
        [known.get((int(b), int(k)), 0.0) for b, k in zip(contacts.body[:c], contacts.key[:c], strict=True)]
    )
    # A fresh bundle: nothing in it can come from the step that the model has made already.
    return ContactProblem(
        law, bodies.inverse_mass[:n].copy(), bodies.free[:n].copy(), contacts, warm.reshape(c), np.zeros((n, 2))
    )


def _after(snapshot: DoorCrowd, model: ContactModel, steps: int) -> tuple[Bodies, Contacts]:
    """Return bodies and contacts of the last of some steps made in one tick from a snapshot, which stays as it is."""
    crowd = copy_of(snapshot.crowd)
    engine = Engine(snapshot.engine.world, len(crowd.level), [])
    engine.advance(model, crowd, snapshot.step, steps, STEP, False, False)
    return engine.bodies, engine.contacts


def velocity_error(problem: ContactProblem, truth: FloatArray) -> float:
    """Return the greatest distance of the velocities found from the true ones, in the unit of the law."""
    return float(np.max(np.hypot(*(problem.velocity - truth).T))) * problem.law.scale
