"""Allocation of the structs of arrays of the step loop for given numbers of people and contacts."""

from typing import Any, TypeVar

import numpy as np

from evac.jit import Struct
from evac.jit.structs import Array
from evac.physics import tallies as at
from evac.physics.contact.cells import make_cells
from evac.physics.state import (
    Bodies,
    Clock,
    Contacts,
    Events,
    Forces,
    Kept,
    Lists,
    LoadedSolver,
    Parts,
    Problem,
    State,
    Traits,
    World,
)

S = TypeVar("S", bound=Struct)

#: Skin of neighbour lists: additional search distance, so that lists remain valid for several steps [m].
SKIN = 0.3

#: Maximum number of walls within the reach of one body.
NEAR_WALLS = 60


def allocate(struct: type[S], length: int, **given: Any) -> S:
    """Return a struct of zeros with arrays of `length` rows, except for the attributes in `given`."""
    values: dict[str, Any] = {}
    for name, kind in struct.kinds.items():
        if name in given:
            values[name] = given[name]
        elif isinstance(kind, Array):
            values[name] = np.zeros((length, *kind.shape[1:]), kind.dtype)
        else:
            values[name] = 0
    return struct(**values)


def make_state(world: World, people: int, forces: Forces, body_forces: Forces) -> State:
    """Return the state of a run with a given number of people before its first step."""
    return State(
        world=world,
        bodies=allocate(Bodies, people, around=np.zeros((4 * people, 2))),
        lists=make_lists(people, 8 * people + 64, 8 * people + 64, len(world.cosine)),
        contacts=make_contacts(4 * people + 64),
        warm_start=make_kept(4 * people + 64, 1),
        memory=make_kept(0, 0),
        problem=make_problem(0, 0),
        events=allocate(Events, 4 * people + 16),
        clock=allocate(Clock, 0),
        forces=forces,
        body_forces=body_forces,
        traits=allocate(Traits, 0),
        parts=allocate(Parts, 0, parameters=Struct(), solver=no_solver(), stronger=no_solver()),
        tally=np.zeros(len(at.NAMES)),
        tally_before=np.zeros(len(at.NAMES)),
    )


def no_solver() -> LoadedSolver:
    """Return a solver that is not loaded."""
    return LoadedSolver(solve=0, is_checked=0)


def make_lists(people: int, pairs: int, walls: int, levels: int) -> Lists:
    """Return neighbour lists with room for given numbers of pairs and of walls near bodies."""
    return allocate(
        Lists,
        people,
        pair_start=np.zeros(people + 1, np.int32),
        pair_body=np.zeros(pairs, np.int32),
        wall_start=np.zeros(people + 1, np.int32),
        wall_item=np.zeros(walls, np.int32),
        cells=make_cells(people, levels),
        stale=1,
        pair_reach=0.05,
        wall_reach=0.05,
        skin=SKIN,
    )


def make_contacts(capacity: int, width: int = 0) -> Contacts:
    """Return contact arrays for a given number of contacts, with a memory of a given width."""
    return allocate(Contacts, capacity, near=np.zeros((NEAR_WALLS, 6)), memory=np.zeros((capacity + 1, width)))


def make_kept(capacity: int, width: int) -> Kept:
    """Return arrays for what is kept of a given number of contacts, in two halves."""
    return allocate(Kept, 2 * capacity, size=capacity, value=np.zeros((2 * capacity, width)))


def make_problem(people: int, contacts: int) -> Problem:
    """Return a packed problem for given numbers of people and contacts, with two rows for each contact."""
    bodies = ("free", "velocity", "image_a", "image_b", "image_c", "image_d")
    given = {name: np.zeros((people + 1, 2)) for name in bodies}
    return allocate(Problem, 2 * contacts, inverse_root=np.zeros(people + 1), **given)


def make_room_for_contacts(state: State, capacity: int) -> None:
    """Replace contacts, warm start and, if it is used, the packed problem by larger, empty ones; keep the memory."""
    half, width = state.warm_start.half, state.contacts.memory.shape[1]
    state.contacts = make_contacts(capacity, width)
    state.warm_start = make_kept(capacity, 1)
    state.warm_start.half = half
    if width:
        old, state.memory = state.memory, make_kept(capacity, width)
        first, state.memory.number = old.half * old.size, old.number
        for name in ("body", "key", "value"):
            getattr(state.memory, name)[: old.number] = getattr(old, name)[first : first + old.number]
    if len(state.problem.body):
        state.problem = make_problem(len(state.bodies.row), capacity)


def grown(array: np.ndarray) -> np.ndarray:
    """Return a copy with twice the length."""
    return np.concatenate([array, np.zeros_like(array)])
