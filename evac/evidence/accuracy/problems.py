"""The contact problems for the comparison of solvers: those of one step of a crowd at a door."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from evac.base.arrays import FloatArray
from evac.directions.fields import Fields
from evac.evidence.accuracy.reference import PRECISION, ContactLaw, gradient_matrix, solve_contact_qp
from evac.evidence.scenes import COARSE, make_engine, packed, plugins
from evac.jit import kernel
from evac.physics.contact.model import ContactModel
from evac.physics.contact.percussions import solve_once
from evac.physics.contact.rows import INELASTIC
from evac.physics.engine import CompiledEngine, load_solver
from evac.physics.scenes import fields_of, room
from evac.physics.state import Contacts, Crowd, State, copy_of, make_crowd
from evac.physics.world import make_world, set_open

DENSITY = 3.5  # people per m2
DOOR = 1.0  # m
STEP = 0.01  # s

#: Distance of people in rows, of bodies 0.4 m wide [m].
ROW = 0.42


@dataclass
class DoorCrowd:
    """A crowd in a room with a door, ready for its next step."""

    kind: str
    engine: CompiledEngine
    crowd: Crowd
    step: int = 0  # steps made so far

    def copy(self, kind: str = "") -> "DoorCrowd":
        """Return an independent copy, with its own door and a new engine."""
        world, crowd = self.engine.data.world, copy_of(self.crowd)
        own = world.replace(wall_open=world.wall_open.copy(), link_open=world.link_open.copy())
        return DoorCrowd(kind or self.kind, make_engine(own, len(crowd.level)), crowd, self.step)

    def open_door(self, is_open: bool) -> None:
        """Open or close the door."""
        set_open(self.engine.data.world, 0, is_open)

    def walk(self, model: ContactModel, steps: int, step: float = STEP) -> None:
        """Make `steps` steps of `step` [s] in one tick."""
        self.engine.advance(model, self.crowd, self.step, steps, step, False, False)
        self.step += steps


def standing_crowd(kind: str, people: int, seed: int) -> DoorCrowd:
    """Return a crowd before its first step: of a kind of `door_crowd`, whose door is open for ``"arriving"`` alone."""
    side = float(np.sqrt(people / DENSITY))
    generator = np.random.default_rng(np.random.SeedSequence([seed, people]))
    crowd = _rows(people, side) if kind == "in rows" else _crowd(people, side, generator)
    low, high = 0.5 * (side - DOOR), 0.5 * (side + DOOR)
    door_room = room((0.0, 0.0, side, side), exits=((side, low, side, high),))
    standing = DoorCrowd(kind, make_engine(make_world(door_room, door_fields(side)), people), crowd)
    standing.open_door(kind == "arriving")
    return standing


def door_crowd(kind: str, people: int, seed: int, model: ContactModel) -> DoorCrowd:
    """Walk a crowd to a door by a contact model; NSM1 leaves no overlaps.

    Kinds are ``"arriving"``: half-way through the time that the crowd needs to pack at the door; ``"settled"``: pressed
    against the closed door for twice that time; ``"in rows"``: equal people who stood in rows before the closed door, 2
    cm apart, and have walked towards it for two seconds, so that the rows close up.
    """
    crowd = standing_crowd(kind, people, seed)
    packing = 0.35 * float(np.sqrt(people / DENSITY)) / 1.3
    seconds = {"arriving": packing, "settled": 2.0 * packing + 2.0, "in rows": 2.0}[kind]
    for _ in range(int(np.ceil(10.0 * seconds))):
        crowd.walk(model, 10)
    return crowd


def door_fields(side: float) -> Fields:
    """Return the field that points straight to the door, shrunk by 0.25 m at its posts."""
    spacing = 0.1
    axis = np.arange(-2, int(side / spacing) + 5) * spacing
    x, y = np.meshgrid(axis, axis, indexing="ij")
    across = np.clip(y, 0.5 * (side - DOOR) + 0.25, 0.5 * (side + DOOR) - 0.25) - y
    ahead = np.maximum(side - x, 0.0) + 0.05
    distance = np.hypot(ahead, across)
    direction = np.stack([ahead / distance, across / distance], axis=-1).reshape(-1, 2)
    return fields_of((axis[0], axis[0]), (len(axis), len(axis)), spacing, direction, distance.ravel())


def _crowd(people: int, side: float, generator: np.random.Generator) -> Crowd:
    columns = int(np.ceil(np.sqrt(people)))
    pitch = side / columns
    cell = np.arange(people)
    centre = pitch * (np.stack([cell // columns, cell % columns], axis=1) + 0.5)
    slack = max(0.0, 0.5 * pitch - 0.25)
    speed = generator.uniform(1.5, 2.0, people)
    return make_crowd(
        centre + generator.uniform(-slack, slack, (people, 2)),
        radius=generator.uniform(0.2, 0.25, people),
        mass=generator.uniform(60.0, 100.0, people),
        tau=generator.uniform(0.1, 0.5, people),
        speed=speed,
    )


def _rows(people: int, side: float) -> Crowd:
    rows = int((side - 0.5 * ROW - 0.02) / ROW)
    return make_crowd(packed(people, rows, 0.2, side - 0.02, 0.02, ROW - 0.4), speed=1.5)


#: Steps that a model makes from the snapshot before its contact problem is used, so that the state is typical of it.
STEPS_BEFORE = 5

#: Steps made with the defaults at the end of a walk that is solved coarsely.
SETTLING_STEPS = 20

#: The kinds of crowd, in the order of `snapshots`.
KINDS = ("arriving", "settled", "opened")


class Law(NamedTuple):
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
        """Factor from a residual [m/s] to the error on which the model stops: h for NSM1's gap error [m]."""
        return STEP if self.model == "nsm1" else 1.0

    @property
    def unit(self) -> str:
        """Unit of that error."""
        return "m" if self.model == "nsm1" else "m/s"

    def make(self) -> ContactModel:
        """Return the contact model, solved to its default tolerance."""
        parameters: dict[str, Any] = {"variant": self.variant}
        if self.model == "nsm2":
            parameters = {"normal_dissipation": self.dissipation}
        model: ContactModel = plugins().get("contact_model", self.model)(**parameters)
        return model


LAWS = (
    Law("NSM1", "nsm1"),
    Law("NSM2, K_N = 0", "nsm2", 0.0),
    Law("NSM2, K_N = 1e3", "nsm2", 1e3),
    Law("NSM2, K_N = 1e5", "nsm2", 1e5),
)


@dataclass(frozen=True)
class ContactProblem:
    """The contact problem of one step."""

    law: Law
    # of an engine that has just made the step: contacts, masses and free velocities are those of the problem.
    # ``contacts.percussion`` is where a solver starts, ``bodies.solved`` where it writes.
    state: State
    warm: FloatArray  # (c,) [N s]: percussions of the previous step for contacts that existed then

    @property
    def size(self) -> int:
        """Number of contacts."""
        return len(self.warm)

    @property
    def free(self) -> FloatArray:
        """Velocities without contacts (n, 2) [m/s]."""
        return self.state.bodies.free[: self.state.bodies.inside]

    @property
    def velocity(self) -> FloatArray:
        """Velocities (n, 2) found by the last solve [m/s]."""
        return self.state.bodies.solved[: self.state.bodies.inside]

    def start(self, is_warm: bool) -> None:
        """Set the initial percussions of a solver: those of the last step, or zero."""
        self.state.contacts.percussion[: self.size] = self.warm if is_warm else 0.0

    def solve(self, solver: str, tolerance: float, limit: int) -> tuple[int, float]:
        """Solve to a residual [m/s] in at most `limit` iterations; return (iterations, residual)."""
        self.state.parts.solver = load_solver(plugins().solvers[solver])
        return run_solver(self.state, self.law.compliance, tolerance, limit), self.state.problem.residual

    def reference(self, precision: float = PRECISION) -> FloatArray:
        """Return the velocities (n, 2) from the library's interior-point solver, to a residual [m/s]."""
        c, n, contacts = self.size, len(self.free), self.state.contacts
        gradient = gradient_matrix(contacts.body[:c], contacts.other[:c], contacts.normal[:c], n)
        mass, before = np.repeat(1.0 / self.state.bodies.inverse_mass[:n], 2), contacts.velocity_before[:c]
        law = ContactLaw(gradient, mass, self.free.ravel(), contacts.bias[:c], before, self.law.dissipation)
        return solve_contact_qp(law, precision).reshape(-1, 2)


@kernel
def run_solver(state: State, compliance: float, tolerance: float, limit: int) -> int:
    """Solve the problem in a state, without tangential law, by its solver; return the iterations."""
    state.problem.iterations = 0
    solve_once(state, state.parts.solver, state.bodies.free, state.bodies.solved, compliance, 0.0, tolerance, limit)
    return state.problem.iterations


def default_solver() -> str:
    """Return the default solver of NSM1 and NSM2."""
    return str(plugins().get("contact_model", "nsm1").declared()["solver"].default)


def snapshots(people: int, seed: int) -> dict[str, DoorCrowd]:
    """Return crowds at a door by kind: arriving, settled against the closed door, and 0.05 s after it opened."""
    nsm1 = plugins().get("contact_model", "nsm1")
    made = {kind: door_crowd(kind, people, seed, nsm1(**COARSE)) for kind in ("arriving", "settled")}
    for crowd in made.values():
        crowd.walk(nsm1(), SETTLING_STEPS)
    made["opened"] = made["settled"].copy("opened")
    made["opened"].open_door(True)
    made["opened"].walk(nsm1(), 5)
    return made


def contact_problem(snapshot: DoorCrowd, law: Law) -> ContactProblem:
    """Return the contact problem of a law in its sixth step from a snapshot, as set up by the model."""
    model = law.make()
    before = _after(snapshot, model, STEPS_BEFORE).contacts
    known = dict(zip(_keys(before), before.percussion[: before.number], strict=True))
    # A separate engine, so that the result does not depend on earlier steps of the model.
    state = _after(snapshot, model, STEPS_BEFORE + 1)
    warm = np.array([known.get(key, 0.0) for key in _keys(state.contacts)], dtype=np.float64)
    return ContactProblem(law, state, warm)


def _keys(contacts: Contacts) -> list[tuple[int, int]]:
    return list(zip(contacts.body[: contacts.number].tolist(), contacts.key[: contacts.number].tolist(), strict=True))


def _after(snapshot: DoorCrowd, model: ContactModel, steps: int) -> State:
    crowd = snapshot.copy()
    crowd.walk(model, steps)
    return crowd.engine.data


def velocity_error(problem: ContactProblem, truth: FloatArray) -> float:
    """Return the greatest distance of the velocities found from the true ones, in the unit of the law."""
    return float(np.max(np.hypot(*(problem.velocity - truth).T))) * problem.law.scale
