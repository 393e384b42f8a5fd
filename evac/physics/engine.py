"""The engine: owns the work arrays of the step loop and makes one tick of steps."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.errors import SimulationError, plugin_code
from evac.physics import neighbours, stepping
from evac.physics import tallies as at
from evac.physics.bundles import Bodies, Clock, Contacts, Crowd, Events, Forces, Groups, Lists, Rows, World
from evac.physics.contacts import CONTACTS_FULL, NEAR_WALLS_FULL
from evac.physics.force import Force
from evac.physics.groups import OPEN, ROOM, SPARE
from evac.physics.motion import EVENTS_FULL, NOT_FINITE, TOO_FAST, TOO_STIFF, WALL_CROSSED

if TYPE_CHECKING:
    from evac.physics.contact_model import ContactModel

#: How far neighbour lists look beyond what is needed, so that they last several steps [m].
SKIN = 0.3

_ADVICE = {
    WALL_CROSSED: (
        "would pass through a wall even with the step cut into {parts} parts: the contact is too soft for the load, or"
        " the run started with overlaps; make contacts stiffer (of 'dem': contact.dem.stiffness), or use"
        " contact.model = 'nsm1'"
    ),
    TOO_FAST: (
        "moves too fast for the step even cut into {parts} parts, or faster than {fastest:g} m/s; check speeds, forces,"
        " masses and overlaps; where people are squeezed, percussions of 'nsm2' grow with"
        " contact.nsm2.normal_dissipation: lower it, or use contact.model = 'nsm1'"
    ),
    TOO_STIFF: (
        "has contacts too stiff for the step even cut into {parts} parts; lower contact.dem.stiffness or use a smaller"
        " simulation.step"
    ),
    NOT_FINITE: (
        "has a velocity that is no number; use a smaller simulation.step or softer contact parameters, and look at the"
        " forces and contact models of plugins"
    ),
}


class Engine:
    """Everything the compiled loop needs besides the crowd.

    Parameters
    ----------
    world : World
    people : int
        Number of people in the run.
    forces : sequence of Force
        Those in use.
    full : bool
        Do even what the scene does not need (``evac run --full``).
    levels : sequence of str
        Names of the levels, for messages; without them their numbers are told.
    """

    def __init__(
        self, world: World, people: int, forces: list[Force], full: bool = False, levels: Sequence[str] = ()
    ) -> None:
        self.world = world
        self.levels = levels
        self.bodies = make_bodies(people)
        self.lists = make_lists(people, 8 * people + 64, 8 * people + 64)
        self.contacts = make_contacts(people, 4 * people + 64)
        self.events = make_events(4 * people + 16)
        self.tally = np.zeros((2, len(at.NAMES)))
        self.forces = pack_forces(forces)
        self.cutoff = float(self.forces.cutoff.max(initial=0.0))
        self.full = full

    def advance(
        self, model: "ContactModel", crowd: Crowd, first: int, steps: int, step: float, explicit: bool, report: bool
    ) -> Events:
        """Make `steps` steps from step `first` on and return the crossings of the tick.

        Raises
        ------
        SimulationError
            If a step cannot be made; names time, person and place.
        """
        inside = stepping.gather(self.world, crowd, self.bodies, self.lists, self.contacts)
        self.events.count[0] = 0
        last = first + steps
        if inside:
            while first < last:
                clock = Clock(first, last, step, explicit, report, self.cutoff, self.full)
                with plugin_code(f"t = {first * step:.3f} s: contact model {model.name!r}"):
                    first, status = model.run(self, clock)
                if status != neighbours.OK:
                    self.handle(int(status), first * step)
        self.tally[0, at.STEPS] += steps
        stepping.scatter(crowd, self.bodies)
        return self.events

    def load(self, model: "ContactModel", crowd: Crowd, step: float, explicit: bool) -> None:
        """Load the kernels of a model, or compile them; no step is made."""
        if stepping.gather(self.world, crowd, self.bodies, self.lists, self.contacts):
            with plugin_code(f"contact model {model.name!r}"):
                model.run(self, Clock(0, 0, step, explicit, False, self.cutoff, self.full))
        stepping.scatter(crowd, self.bodies)

    def state(self) -> dict[str, np.ndarray]:
        """Return copies of what the next tick depends on beyond the crowd."""
        return {
            "tally": self.tally.copy(),
            "span": self.lists.span.copy(),
            "room": np.array([len(array) for array in self._rooms()]),
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take up what `state` returned. A step that ran out of room starts cold, so the room counts too."""
        pairs, walls, contacts, events = map(int, state["room"])
        n = len(self.bodies.row)
        self.lists, self.contacts = make_lists(n, pairs, walls), make_contacts(n, contacts)
        self.events = make_events(events)
        self.tally[:] = state["tally"]
        self.lists.span[:] = state["span"]

    def _rooms(self) -> tuple[np.ndarray, ...]:
        """Return the arrays that grow, one of each bundle."""
        return self.lists.pair_body, self.lists.wall_item, self.contacts.body, self.events.row

    def report(self) -> dict[str, float | int]:
        """Return what the run has added up so far, by name: counts as int, the other numbers as float."""
        return {
            name: float(value) if name in at.MEASURES else int(value)
            for name, value in zip(at.NAMES, self.tally[0], strict=True)
            if name not in at.DEEPEST
        }

    def contact_report(self, model: "ContactModel") -> dict[str, Any]:
        """Return what a contact model has come to, by the names that docs/results.md lists."""
        report: dict[str, Any] = self.report()
        overlaps, total = report.pop("overlaps"), report.pop("overlap_sum")
        report["mean_overlap"] = total / overlaps if overlaps else 0.0
        report["greatest_overlap_at"] = self.deepest_overlap()
        report["energy"] = {key: report.pop(key) for key in ("driving_work", "contact_dissipation", "contact_creation")}
        return report | {"model": model.name, "parameters": model.values()}

    def deepest_overlap(self) -> dict[str, Any] | None:
        """Return time [s], person, level and place x, y [m] of the greatest overlap; None where there was none."""
        if not self.tally[0, at.GREATEST_OVERLAP]:
            return None
        _, time, person, level, x, y = self.tally[0, at.DEEPEST_BODY :].tolist()
        return {"time": time, "person": int(person), "level": self._level_name(int(level)), "x": x, "y": y}

    def handle(self, status: int, time: float) -> None:
        """Grow what a status says was full, or raise SimulationError."""
        if status == neighbours.PAIRS_FULL:
            self.lists = self.lists._replace(pair_body=_grown(self.lists.pair_body), stale=np.ones(1, np.uint8))
        elif status == neighbours.WALLS_FULL:
            self.lists = self.lists._replace(wall_item=_grown(self.lists.wall_item), stale=np.ones(1, np.uint8))
        elif status in (CONTACTS_FULL, NEAR_WALLS_FULL):
            if status == NEAR_WALLS_FULL:
                raise SimulationError(
                    f"t = {time:.3f} s: more than {self.contacts.near.shape[0]} walls within one body's reach;"
                    " use a smaller simulation.step or a mesh with fewer, longer walls"
                )
            # The memory for warm starts is empty: the step that ran out of room has been undone.
            self.contacts = make_contacts(len(self.bodies.row), 2 * len(self.contacts.body))
        elif status == EVENTS_FULL:
            self.events = Events(self.events.count, *(_grown(array) for array in self.events[1:]))
        else:
            advice = _ADVICE[status].format(parts=stepping.GREATEST_PARTS, fastest=stepping.FASTEST)
            raise SimulationError(f"t = {time:.3f} s: {self._place()} {advice}")

    def _place(self) -> str:
        """Name the body that the failure is about."""
        i = int(self.bodies.count[1])
        x, y = self.bodies.position[i]
        level = self._level_name(int(self.bodies.level[i]))
        return f"person {self.bodies.row[i]} at ({x:.2f}, {y:.2f}) on level {level!r}"

    def _level_name(self, level: int) -> str | int:
        return self.levels[level] if self.levels else level


def _grown(array: np.ndarray) -> np.ndarray:
    """Return a copy of twice the length."""
    return np.concatenate([array, np.zeros_like(array)])


def pack_forces(forces: list[Force]) -> Forces:
    """Return addresses and parameters of pair forces; shorter parameter rows are filled with zeros."""
    packed = []
    for force in forces:
        with plugin_code(f"force {force.name!r}"):
            packed.append((force.pair.address, force.cutoff(), force.packed()))
    parameters = np.zeros((len(packed), max((len(row) for _, _, row in packed), default=1)))
    for k, (_, _, row) in enumerate(packed):
        parameters[k, : len(row)] = row
    return Forces(
        address=np.array([address for address, _, _ in packed], dtype=np.int64),
        cutoff=np.array([cutoff for _, cutoff, _ in packed], dtype=np.float64),
        parameters=parameters,
    )


def make_bodies(n: int) -> Bodies:
    """Allocate the work arrays for n people."""
    integers = {"row", "level", "route", "old_level"}
    pairs = {
        "position",
        "velocity",
        "free",
        "solved",
        "spare",
        "push",
        "desired",
        "extra_direction",
        "old_position",
        "old_velocity",
        "built_position",
    }
    arrays: dict[str, Any] = {}
    for name in Bodies._fields:
        if name == "count":
            arrays[name] = np.zeros(2, np.int64)
        elif name == "taken_up_in":
            arrays[name] = np.zeros(1)
        elif name == "near_link":
            arrays[name] = np.zeros(n, np.uint8)
        elif name in integers:
            arrays[name] = np.zeros(n, np.int32)
        elif name == "speed":
            arrays[name] = np.zeros((n, 3))
        else:
            arrays[name] = np.zeros((n, 2) if name in pairs else n)
    return Bodies(**arrays)


def make_lists(n: int, pairs: int, walls: int) -> Lists:
    """Allocate neighbour lists for n people."""
    return Lists(
        pair_start=np.zeros(n + 1, np.int32),
        pair_body=np.zeros(pairs, np.int32),
        wall_start=np.zeros(n + 1, np.int32),
        wall_item=np.zeros(walls, np.int32),
        cell_start=np.zeros(4 * n + 1025, np.int32),
        cell_body=np.zeros(n, np.int32),
        cell_of=np.zeros(n, np.int32),
        stale=np.ones(1, np.uint8),
        span=np.array([0.05, SKIN, 0.05]),
    )


def make_contacts(n: int, capacity: int) -> Contacts:
    """Allocate room for `capacity` contacts among n people."""
    whole = {"body", "other", "key", "old_body", "old_key"}
    special: dict[str, Any] = {
        "count": np.zeros(3, np.int64),
        "normal": np.zeros((capacity, 2)),
        "sticky": np.zeros(capacity, np.uint8),
        "work": np.zeros((capacity, 3)),
        "rows": make_rows(n, 2 * capacity),
        "groups": make_groups(n, 2 * capacity),
        "near": np.zeros((60, 6)),
    }
    arrays: dict[str, Any] = {
        name: special[name] if name in special else np.zeros(capacity, np.int32 if name in whole else np.float64)
        for name in Contacts._fields
    }
    return Contacts(**arrays)


def make_rows(n: int, capacity: int) -> Rows:
    """Allocate the packed contact problem of n people; each contact may take two rows."""
    special: dict[str, Any] = {
        "rigid": np.zeros(1, np.uint8),
        **{name: np.zeros(capacity, np.uint32) for name in ("body", "other", "face", "face_body", "face_other")},
        "branch": np.zeros(capacity, np.int32),
        "data": np.zeros((capacity, 5)),
        "elastic": np.zeros((capacity, 3)),
        "face_data": np.zeros((capacity, 7)),
        "work": np.zeros((4, capacity)),
        "inverse_root": np.zeros(n + 1),
        "free": np.zeros((n + 1, 2)),
        "velocity": np.zeros((n + 1, 2)),
        "image": np.zeros((4, n + 1, 2)),
    }
    arrays: dict[str, Any] = {name: special[name] if name in special else np.zeros(capacity) for name in Rows._fields}
    return Rows(**arrays)


def make_groups(n: int, capacity: int) -> Groups:
    """Allocate groups for so many rows, with as many lanes free as there may be."""
    lanes = int(ROOM * capacity) + SPARE
    special: dict[str, Any] = {
        **{name: np.zeros(lanes, np.uint32) for name in ("row", "body", "other")},
        "data": np.zeros(5 * lanes),
        "elastic": np.zeros(3 * lanes),
        "mask": np.zeros(n + 1, np.int64),
        "block": np.zeros(n + 1, np.int64),
        "filled": np.zeros(OPEN, np.int64),
    }
    arrays: dict[str, Any] = {name: special[name] if name in special else np.zeros(lanes) for name in Groups._fields}
    return Groups(**arrays)


def make_events(capacity: int) -> Events:
    """Allocate room for `capacity` crossings."""
    return Events(
        np.zeros(1, np.int64),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros(capacity),
    )
