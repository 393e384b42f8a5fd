"""The engine, which makes the steps of a tick: what a simulation requires of one, and the compiled engine."""

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import PluginError, SimulationError, fault, is_foreign, place_of, plugin_code
from evac.base.parameters import did_you_mean
from evac.base.saved import Saved
from evac.directions.sampling import column_of, sample_travel_time
from evac.jit import AddressCall, Bytes, Callback, Entry, call_body_force, call_pair_force, call_person_force, kernel
from evac.jit.loading import addresses_of
from evac.physics import status, stepping
from evac.physics import tallies as at
from evac.physics.contact.contacts import memory_by_person, recall, remember_by_person, retain
from evac.physics.contact.model import ContactModel, SolvedContactModel
from evac.physics.contact.pair_contact import PairContact
from evac.physics.contact.percussions import separate
from evac.physics.contact.rows import Solver, call_solver
from evac.physics.force import (
    Force,
    add_body_forces,
    add_forces,
    check_indices,
    cutoff_of,
    is_of_person,
    pack_forces,
    packed_row,
)
from evac.physics.seams import reaches
from evac.physics.state import (
    Bodies,
    Crowd,
    Events,
    LoadedSolver,
    Parts,
    State,
    World,
    allocate,
    grown,
    make_kept,
    make_lists,
    make_problem,
    make_room_for_contacts,
    make_state,
    no_solver,
)
from evac.physics.world import have_seams

PER_METRE = 65536  #: Places are rounded to a grid of 1 / PER_METRE [m], which repeats every 2**28 / PER_METRE = 4 km.

#: Shifts and masks that put a zero between any two of the lower 28 bits of a number.
_SPREAD = (
    (16, 0xFFF0000FFFF),
    (8, 0xF00FF00FF00FF),
    (4, 0xF0F0F0F0F0F0F),
    (2, 0x33333333333333),
    (1, 0x55555555555555),
)


def rows_by_travel_time(state: State, crowd: Crowd) -> IntArray:
    """Return the rows of the people inside, the nearest to their destination first, ties in order of rows."""
    bodies, inside = state.bodies, find_travel_times(state, crowd)
    rows: IntArray = bodies.row[:inside].take(bodies.distance[:inside].argsort(kind="stable"))
    return rows


@kernel
def find_travel_times(state: State, crowd: Crowd) -> int:
    """Write the rows of the people inside to the bodies, and their travel times [s] as distances; return the number."""
    bodies, fields, inside = state.bodies, state.world.fields, 0
    for p in range(len(crowd.level)):
        if crowd.level[p] >= 0:
            x, y = crowd.position[p, 0], crowd.position[p, 1]
            column = column_of(fields, crowd.route[p], crowd.contact_radius[p])
            bodies.row[inside] = p
            bodies.distance[inside] = sample_travel_time(fields, x, y, crowd.level[p], column)
            inside += 1
    return inside


def rows_by_place(crowd: Crowd) -> NDArray[np.int64]:
    """Return the rows of the people inside, level by level along Morton's curve, ties in order of rows."""
    rows = np.flatnonzero(crowd.level >= 0)
    position = np.take(crowd.position, rows, axis=0)
    return rows[np.argsort(along_curve(position, crowd.level[rows]), kind="stable")]


def along_curve(position: FloatArray, level: IntArray) -> NDArray[np.int64]:
    """Return how far along the curve places (n, 2) [m] on levels (n,) are: the bits of x and y in turns."""
    bits = np.floor(PER_METRE * position).astype(np.int64) & 0xFFFFFFF
    for shift, mask in _SPREAD:
        bits = (bits | bits << shift) & mask
    return level.astype(np.int64) << 56 | bits[:, 0] << 1 | bits[:, 1]


@kernel
def gather(state: State, crowd: Crowd, inside: int) -> None:
    """Copy the people in ``bodies.row`` to the bodies, and reset the data of the previous tick."""
    bodies, fields = state.bodies, state.world.fields
    lightest, smallest = 1e-300, math.inf
    for b in range(inside):
        p = bodies.row[b]
        for k in range(2):
            bodies.position[b, k], bodies.velocity[b, k] = crowd.position[p, k], crowd.velocity[p, k]
            bodies.extra_direction[b, k], bodies.ahead[b, k] = crowd.extra_direction[p, k], crowd.ahead[p, k]
        for k in range(3):
            bodies.speed[b, k] = crowd.speed[p, k]
        bodies.level[b], bodies.group[b], bodies.passing[b] = crowd.level[p], crowd.group[p], crowd.passing[p]
        bodies.contact_radius[b], bodies.mass[b], bodies.tau[b] = crowd.contact_radius[p], crowd.mass[p], crowd.tau[p]
        bodies.start_time[b], bodies.speed_factor[b] = crowd.start_time[p], crowd.speed_factor[p]
        bodies.distance[b], bodies.contact_force[b] = crowd.distance[p], crowd.contact_force[p]
        bodies.firmness[b] = crowd.firmness[p]
        bodies.column[b] = column_of(fields, crowd.route[p], crowd.contact_radius[p])
        bodies.inverse_mass[b] = 1.0 / (1.0 if state.traits.overdamped else bodies.mass[b]) / bodies.firmness[b]
        lightest = max(lightest, bodies.inverse_mass[b])
        smallest = min(smallest, bodies.contact_radius[b])
        bodies.node[b] = -1
    for b in range(inside):
        p = bodies.row[b]
        bodies.mingled[b] = 1 if crowd.mingled[p] and crowd.overlap[p] > 0.5 * smallest else 0
        bodies.overlap[b] = 0.0
    bodies.lightest, bodies.smallest, bodies.inside = 1.0 / lightest, smallest, inside
    bodies.relaxation_step = 0.0
    state.warm_start.number = 0
    state.contacts.separation_failed = 0
    state.lists.stale = 1
    state.events.number = 0


@kernel
def scatter(crowd: Crowd, bodies: Bodies) -> None:
    """Copy the results of the steps back to the crowd."""
    for b in range(bodies.inside):
        p = bodies.row[b]
        for k in range(2):
            crowd.position[p, k], crowd.velocity[p, k] = bodies.position[b, k], bodies.velocity[b, k]
        crowd.level[p], crowd.passing[p], crowd.mingled[p] = bodies.level[b], bodies.passing[b], bodies.mingled[b]
        crowd.distance[p], crowd.overlap[p] = bodies.distance[b], bodies.overlap[b]
        crowd.contact_force[p] = bodies.contact_force[b]


#: Descriptions of failed steps for messages; contact models add what to change.
_FAILURES = {
    status.WALL_CROSSED: (
        "would pass through a wall even if the step is divided into {parts} parts: the contact is too soft for the"
        " load, or the run started with overlaps"
    ),
    status.CENTRES_PASSED: (
        "and person {other} would pass through each other even if the step is divided into {parts} parts: the contact"
        " is too soft for the load"
    ),
    status.TOO_FAST: (
        "moves too fast even if the step is divided into {parts} parts, or faster than {fastest:g} m/s; check speeds,"
        " forces, masses and overlaps"
    ),
    status.TOO_STIFF: "has contacts that are too stiff even if the step is divided into {parts} parts",
    status.NOT_FINITE: (
        "has a NaN or infinite velocity; use a smaller simulation.step or softer contact parameters, and check the"
        " forces and contact models of plugins"
    ),
}


class Engine(Saved, ABC):
    """What a simulation requires of an engine, which moves people between two ticks.

    `evac.simulation.assembly.ENGINE` is the class of all runs, made with the parameters of `CompiledEngine`. It reads
    the `World`, in which the scene opens and closes links between ticks, and writes the arrays of the `Crowd` that
    belong to the contact model (docs/architecture.md). Results must not depend on anything but the crowd, the world and
    what `saved` names, which is restored after `load`.
    """

    @classmethod
    def kernels(
        cls,
        model: ContactModel,
        forces: Sequence[Force],
        solvers: Mapping[str, type[Solver]],
        backed: Bytes,
        full: bool,
    ) -> list[Entry]:
        """Return the kernels that a run is known to need, which are compiled together before it; none by default.

        `backed` are the `walls_behind_exits` of levels; `full` includes what the scene does not need.
        """
        return []

    @abstractmethod
    def load(self, model: ContactModel) -> None:
        """Prepare a contact model, at least before its first tick; nothing happens if it has been prepared."""

    @abstractmethod
    def advance(
        self, model: ContactModel, crowd: Crowd, first: int, steps: int, length: float, explicit: bool, report: bool
    ) -> Events:
        """Make the steps of a tick, each of a `length` [s], and return its crossings of portals and exits.

        The step of index `first` starts at ``first * length``. Rows of the crowd with a negative level are not inside.
        Position, velocity, level and distance are written, and to `report`, the contact forces of the last step. If
        `explicit`, the drive is integrated by explicit Euler, as in the paper.
        """

    @abstractmethod
    def own_arrays(self) -> list[str]:
        """Return the names of the arrays that the loaded contact model keeps in the engine."""

    @abstractmethod
    def explain(self, model: ContactModel) -> list[tuple[str, bool, str]]:
        """Return the optional parts of the engine: name, whether it is included, and the reason."""

    @abstractmethod
    def explain_forces(self) -> dict[str, str]:
        """Return how each force in use acts, by name."""

    @abstractmethod
    def contact_report(self, model: ContactModel) -> dict[str, Any]:
        """Return the counts and sums of the run until now for summary.json, with the names in docs/summary.md.

        Quality warnings need ``model``, ``parameters``, ``steps``, ``greatest_overlap``, ``unconverged_steps``,
        ``failed_solves``, ``failed_position_corrections`` and ``energy``.
        """


class CompiledEngine(Engine):
    """The step loop of a run, with its state and compiled kernels."""

    saved = ("memory", "room", "data.tally", "data.lists.pair_reach", "data.lists.wall_reach", "data.clock.h_before")
    growing = ("memory", "room")

    def __init__(
        self,
        world: World,
        people: int,
        forces: Sequence[Force],
        full: bool = False,
        levels: Sequence[str] = (),
        solvers: Mapping[str, type[Solver]] | None = None,
        spare_waiting: bool = False,
    ) -> None:
        self.levels = levels
        self.full = full
        self._forces = list(forces)
        self._solvers = solvers or {}
        self._pair_forces = [force for force in self._forces if force.pair is not None]
        self._body_forces = [force for force in self._forces if force.body is not None]
        self.data = make_state(world, people, pack_forces(self._pair_forces), pack_forces(self._body_forces))
        self.data.forces.spare_waiting = int(spare_waiting)
        self.memory: dict[str, np.ndarray] = {}  # of contacts between two ticks, see `memory_by_person`
        self._own: Any = None
        self._callbacks: dict[str, Callback] = {}  # of solvers in Python, by name
        self._model: ContactModel | None = None

    def advance(
        self, model: ContactModel, crowd: Crowd, first: int, steps: int, length: float, explicit: bool, report: bool
    ) -> Events:
        """Make the steps of a tick and return its crossings, see `Engine.advance`."""
        self.load(model)
        state, clock = self.data, self.data.clock
        if self._gather(model, crowd):
            clock.now, clock.last, clock.length, clock.parts = first, first + steps, length, 1
            clock.explicit, clock.report_force, clock.full = int(explicit), int(report), int(self.full)
            while clock.now < clock.last:
                with plugin_code(f"t = {clock.now * length:.3f} s: contact model {model.name!r}", model):
                    outcome = model.advance(self)
                self._raise_of_solvers(clock.now * length)
                if outcome != status.OK:
                    self._handle(model, int(outcome), clock.now * length)
        if model.memory:
            self.memory = memory_by_person(state)
        state.tally[at.STEPS] += steps
        scatter(crowd, state.bodies)
        return state.events

    def _gather(self, model: ContactModel, crowd: Crowd) -> int:
        """Copy the people inside to the bodies, in the order that the model requires; return their number."""
        rows = rows_by_travel_time(self.data, crowd) if model.along_the_way else rows_by_place(crowd)
        self.data.bodies.row[: len(rows)] = rows
        gather(self.data, crowd, len(rows))
        if model.memory:
            remember_by_person(self.data, **self.memory)
        return len(rows)

    def load(self, model: ContactModel) -> None:
        """Load the kernels that a scene is known to need, compiling those that are not on disk."""
        if self._model is model:
            return
        self._model = None  # until all of it is loaded
        state = self.data
        with plugin_code(f"contact model {model.name!r}", model):
            state.traits = model.traits(state.world)
            self._own = model.own(len(state.bodies.row), state.world)
            if model.law is not None:
                call = AddressCall([State, type(self._own), float], (int,))
                call.check(model.law, f"contact model {model.name!r}: law", type(model))
        addresses_of(self.entries(model))
        room, width = len(state.contacts.body), len(model.memory)
        state.contacts.memory, state.memory = np.zeros((room + 1, width)), make_kept(room if width else 0, width)
        self.memory = memory_by_person(state) if width else {}
        if isinstance(model, SolvedContactModel):
            state.problem = make_problem(len(state.bodies.row), room)
        loaded = entries_of_parts(model, self._forces, self.full or have_seams(state.world.backed))
        addresses = {name: entry.address for name, entry in loaded.items()}
        self._callbacks.clear()
        solver = self._loaded_solver(model) if isinstance(model, SolvedContactModel) else no_solver()
        state.parts = allocate(Parts, 0, **addresses, parameters=self._own, solver=solver, stronger=no_solver())
        for k, force in enumerate(self._pair_forces):
            state.forces.address[k] = force.pair.address
        for k, force in enumerate(self._body_forces):
            state.body_forces.address[k] = force.body.address
        if self.full and isinstance(model, SolvedContactModel):
            self._load_part(model, status.NEEDS_STRONGER_SOLVER)
            if model.separates:
                self._load_part(model, status.NEEDS_SEPARATION)
        self._model = model

    @classmethod
    def kernels(
        cls,
        model: ContactModel,
        forces: Sequence[Force],
        solvers: Mapping[str, type[Solver]],
        backed: Bytes,
        full: bool,
    ) -> list[Entry]:
        """Return the kernels of the step loop, see `Engine.kernels`."""
        entries = [gather, scatter, *entries_of_parts(model, forces, full or have_seams(backed)).values()]
        if isinstance(model, PairContact):
            model.check_pair()
        if model.along_the_way:
            entries.append(find_travel_times)
        if model.law is None:
            entries += stepping.CALLED_APART
        else:
            entries.append(stepping.advance)
        if isinstance(model, SolvedContactModel):
            chosen = [solver_of(model, solvers), *([solver_of(model, solvers, stronger=True)] if full else [])]
            entries += [one.solve for one in chosen if isinstance(one.solve, Entry)]
            if full and model.separates:
                entries.append(separate)
        for force in forces:
            entries += functions_of(force)
        return list(dict.fromkeys(entries))

    def entries(self, model: ContactModel) -> list[Entry]:
        """Return the kernels that a run is known to need."""
        return self.kernels(model, self._forces, self._solvers, self.data.world.backed, self.full)

    def explain(self, model: ContactModel) -> list[tuple[str, bool, str]]:
        """Return the optional parts of the step loop: name, whether it is included, and the reason."""
        backed = self.data.world.backed
        why = f"levels: {len(backed)}, of which {int(backed.sum())} have walls right behind an exit"
        rows = [("contacts across portals and exits", self.full or have_seams(backed), why)]
        if isinstance(model, SolvedContactModel):
            is_compiled = isinstance(solver_of(model, self._solvers).solve, Entry)
            in_python = "" if is_compiled else ", in Python, which is slower than a kernel"
            stronger, later = solver_of(model, self._solvers).stronger, "loaded if a solve does not converge"
            rows += [
                (f"solver {model.solver}", True, f"contact.{model.name}.solver{in_python}"),
                (f"solver {stronger}, for solves that fail", self.full, later),
            ]
        if isinstance(model, SolvedContactModel) and model.separates:
            rows.append(("separation of overlaps", self.full, "loaded if overlaps exceed the tolerance"))
        if model.memory:
            rows.append(("memory of contacts", True, ", ".join(model.memory)))
        return rows

    def explain_forces(self) -> dict[str, str]:
        """Return how each force in use acts, by name."""
        effects = {}
        for k, force in enumerate(self._body_forces):
            cutoff = self.data.body_forces.cutoff[k]
            walls = f", depending on walls up to a gap of {cutoff:.2f} m" if cutoff > 0.0 else ""
            effects[force.name] = f"acts on each person{walls}"
        for k, force in enumerate(self._pair_forces):
            between = f"acts up to a gap of {self.data.forces.cutoff[k]:.2f} m"
            effects[force.name] = f"{between}; {effects[force.name]}" if force.name in effects else between
        return effects

    def _loaded_solver(self, model: SolvedContactModel, stronger: bool = False) -> LoadedSolver:
        """Return a solver of the loaded contact model as kernels call it."""
        solver = solver_of(model, self._solvers, stronger)
        if isinstance(solver.solve, Entry):
            return load_solver(solver)

        def solve(_: int, tolerance: float, limit: int) -> int:
            made: int = solver.solve(self.data.problem, tolerance, limit)
            return made

        callback = self._callbacks[solver.name] = Callback(solve, call_solver)
        return LoadedSolver(solve=callback.address, is_checked=int(is_foreign(solver)))

    def _raise_of_solvers(self, time: float) -> None:
        """Raise what a solver in Python has raised."""
        for name, callback in self._callbacks.items():
            error, callback.error = callback.error, None
            if error is not None:
                with plugin_code(f"t = {time:.3f} s: solver {name!r}", self._solvers[name]):
                    raise error

    def _load_part(self, model: SolvedContactModel, needed: int) -> None:
        """Load a part that a step turned out to need."""
        if needed == status.NEEDS_STRONGER_SOLVER:
            self.data.parts.stronger = self._loaded_solver(model, stronger=True)
        else:
            self.data.parts.separation = separate.address

    def _handle(self, model: ContactModel, outcome: int, time: float) -> None:
        """Handle a status: load a part, enlarge an array, or raise SimulationError."""
        state, parts = self.data, self.data.parts
        loaded = {status.NEEDS_STRONGER_SOLVER: parts.stronger.solve, status.NEEDS_SEPARATION: parts.separation}
        if isinstance(model, SolvedContactModel) and not loaded.get(outcome, 1):
            self._load_part(model, outcome)
        elif outcome == status.PAIRS_FULL:
            state.lists.pair_body = grown(state.lists.pair_body)
            state.lists.stale = 1
        elif outcome == status.WALLS_FULL:
            state.lists.wall_item = grown(state.lists.wall_item)
            state.lists.stale = 1
        elif outcome == status.CONTACTS_FULL:
            # The new warm start is empty; the step that ran out of room has been undone.
            make_room_for_contacts(state, 2 * len(state.contacts.body))
        elif outcome == status.NEAR_WALLS_FULL:
            raise SimulationError(
                f"t = {time:.3f} s: more than {len(state.contacts.near)} walls within one body's reach;"
                " use a smaller simulation.step or a mesh with fewer, longer walls"
            )
        elif outcome == status.EVENTS_FULL:
            for name in ("row", "kind", "link", "time"):
                setattr(state.events, name, grown(getattr(state.events, name)))
        elif outcome in _FAILURES:
            if culprit := self._force_at_fault(time) or model.culprit(state):
                raise culprit
            other = state.bodies.row[state.bodies.other_failed]
            failure = _FAILURES[outcome].format(parts=stepping.GREATEST_PARTS, fastest=stepping.FASTEST, other=other)
            advice = model.advice().get(outcome, "")
            raise SimulationError(f"t = {time:.3f} s: {self._place()} {failure}{'; ' if advice else ''}{advice}")
        else:
            wrong = f"its law returns {outcome}, not a status of evac.physics.status that a law may return"
            remedy = "return OK, and derive models that solve contact problems from SolvedContactModel"
            raise fault(f"contact model {model.name!r}", wrong, remedy, model.law or model)

    def _force_at_fault(self, time: float) -> PluginError | None:
        """Return the error if a force in the step that failed was not finite; None if all were finite."""
        state, bodies = self.data, self.data.bodies
        if np.isfinite(bodies.push[: bodies.inside]).all():
            return None
        kinds = (("pair", self._pair_forces, add_forces), ("body", self._body_forces, add_body_forces))
        for name, forces, entry in kinds:
            for force in forces:
                alone = pack_forces([force])
                alone.address[0] = getattr(force, name).address
                setattr(state, "forces" if name == "pair" else "body_forces", alone)
                bodies.push[:] = 0.0
                entry(state)
                lost = np.flatnonzero(~np.isfinite(bodies.push[: bodies.inside]).all(axis=1))
                if len(lost):
                    x, y = bodies.push[lost[0]]
                    function = getattr(force, name)
                    wrong = f"{function.title} adds a force of ({x:g}, {y:g}) N to person {bodies.row[lost[0]]}"
                    remedy = "return finite numbers at every gap, also where bodies overlap"
                    return fault(f"t = {time:.3f} s: force {force.name!r}", wrong, remedy, function)
        return None

    def own_arrays(self) -> list[str]:
        """Return the names of the arrays in the parameter struct of the loaded contact model, besides scratch."""
        if self._model is None or type(self._model).own is ContactModel.own:
            return []
        return [name for name, value in self._own.values().items() if isinstance(value, np.ndarray)]

    @property
    def room(self) -> np.ndarray:
        """Sizes (4,) of the arrays of pairs, walls, contacts and crossings, which affect warm starts."""
        state = self.data
        arrays = state.lists.pair_body, state.lists.wall_item, state.contacts.body, state.events.row
        return np.array([len(array) for array in arrays])

    @room.setter
    def room(self, room: np.ndarray) -> None:
        """Replace these arrays by empty ones."""
        state, (pairs, walls, contacts, events) = self.data, room.tolist()
        state.lists = make_lists(len(state.bodies.row), pairs, walls, len(state.world.cosine))
        make_room_for_contacts(state, contacts)
        state.events = allocate(Events, events)

    def report(self) -> dict[str, float | int]:
        """Return the tallies of the run by name: counts as int, other sums as float."""
        return {
            name: float(value) if name in at.MEASURES else int(value)
            for name, value in zip(at.NAMES, self.data.tally, strict=True)
            if name not in at.DEEPEST
        }

    def contact_report(self, model: ContactModel) -> dict[str, Any]:
        """Return the tallies of a contact model, with the names in docs/summary.md."""
        report: dict[str, Any] = self.report()
        overlaps, total = report.pop("overlaps"), report.pop("overlap_sum")
        report["mean_overlap"] = total / overlaps if overlaps else 0.0
        time, person, level, x, y = self.data.tally[at.DEEPEST_TIME :].tolist()
        place = {"time": time, "person": int(person), "level": self._level_name(int(level)), "x": x, "y": y}
        report["greatest_overlap_at"] = place if report["greatest_overlap"] else None
        report["failed_solver"] = ""
        if isinstance(model, SolvedContactModel) and report["failed_solves"]:
            report["failed_solver"] = place_of(self._solvers[model.solver])
        report["energy"] = {key: report.pop(key) for key in ("driving_work", "contact_dissipation", "contact_creation")}
        return report | {"model": model.name, "parameters": model.values()}

    def _place(self) -> str:
        """Describe the body that a failure concerns, with its place."""
        bodies = self.data.bodies
        x, y = bodies.position[bodies.failed]
        level = self._level_name(int(bodies.level[bodies.failed]))
        return f"person {bodies.row[bodies.failed]} at ({x:.2f}, {y:.2f}) on level {level!r}"

    def _level_name(self, level: int) -> str | int:
        return self.levels[level] if self.levels else level


def entries_of_parts(model: ContactModel, forces: Sequence[Force], has_seams: bool) -> dict[str, Entry]:
    """Return the kernels whose addresses `Parts` has in a run, by name, except those of solvers and `separation`."""
    entries: dict[str, Entry] = {} if model.law is None else {"law": model.law}
    if model.memory:
        entries |= {"recall": recall, "retain": retain}
    if has_seams:
        entries["seams"] = reaches
    if any(force.pair is not None for force in forces):
        entries["forces"] = add_forces
    if any(force.body is not None for force in forces):
        entries["body_forces"] = add_body_forces
    return entries


def functions_of(force: Force) -> list[Entry]:
    """Return the compiled functions of a force."""
    functions: list[Entry] = []
    what = f"force {force.name!r}"
    for name, call in (("pair", call_pair_force), ("body", call_body_force)):
        function = getattr(force, name)
        if function is not None:
            call = call_person_force if name == "pair" and is_of_person(function) else call
            call.check(function, f"{what}: {name}", type(force))
            check_indices(function, len(packed_row(force, what)), what)
            functions.append(function)
    if not functions:
        remedy = "define `pair`, decorated with evac.jit.pair_force, or `body`, decorated with evac.jit.body_force"
        raise fault(what, "names no function", remedy, force)
    cutoff_of(force)
    return functions


def load_solver(solver: type[Solver]) -> LoadedSolver:
    """Return a compiled solver as kernels call it."""
    return LoadedSolver(solve=solver.solve.address, is_checked=int(is_foreign(solver)))


def check_solve(solver: type[Solver], what: str) -> None:
    """Check that a solver is a kernel or a static method, with the arguments of solvers."""
    if not isinstance(inspect.getattr_static(solver, "solve", None), staticmethod):
        call_solver.check(getattr(solver, "solve", None), what, solver)
    elif len(inspect.signature(solver.solve).parameters) != len(call_solver.kinds):
        raise fault(what, "takes other arguments", "give it problem, tolerance and limit", solver, "solve")


def solver_of(model: SolvedContactModel, solvers: Mapping[str, type[Solver]], stronger: bool = False) -> type[Solver]:
    """Return the solver of a contact model, or its stronger solver for solves that fail."""
    name = model.solver
    for _ in range(1 + stronger):
        if name not in solvers:
            raise PluginError(f"contact.{model.name}.solver: unknown solver {name!r}; {did_you_mean(name, [*solvers])}")
        solver = solvers[name]
        with plugin_code(f"solver {name!r}", solver):
            check_solve(solver, f"solver {name!r}: solve")
        name = solver.stronger
    return solver
