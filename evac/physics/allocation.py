"""WarmStart for the step loop: structs of arrays, made for so many people and contacts."""

from typing import Any, TypeVar

import numpy as np

from evac.jit import Struct
from evac.jit.layout import Array
from evac.physics import tallies as at
from evac.physics.pieces import CHUNK
from evac.physics.state import (
    Bodies,
    Clock,
    Contacts,
    Events,
    Forces,
    Lists,
    Parts,
    Problem,
    State,
    Team,
    Traits,
    WarmStart,
    World,
)

S = TypeVar("S", bound=Struct)

#: How far neighbour lists look beyond what is needed, so that they last several steps [m].
SKIN = 0.3

#: Walls that may be within one body's reach.
NEAR_WALLS = 60


def allocate(struct: type[S], length: int, **given: Any) -> S:
    """Return a struct of zeros, its arrays of `length` rows where nothing else is given."""
    values: dict[str, Any] = {}
    for name, kind in struct.kinds.items():
        if name in given:
            values[name] = given[name]
        elif isinstance(kind, Array):
            values[name] = np.zeros((length, *kind.shape[1:]), kind.dtype)
        else:
            values[name] = 0
    return struct(**values)


def make_state(world: World, people: int, forces: Forces) -> State:
    """Return the state of a run of so many people before its first step."""
    return State(
        world=world,
        bodies=allocate(Bodies, people, around=np.zeros((4 * people, 2)), work=np.zeros(people // CHUNK + 1)),
        lists=make_lists(people, 8 * people + 64, 8 * people + 64),
        contacts=make_contacts(4 * people + 64),
        warm_start=make_warm_start(4 * people + 64),
        problem=make_problem(0, 0),
        events=allocate(Events, 4 * people + 16),
        clock=allocate(Clock, 0),
        forces=forces,
        traits=allocate(Traits, 0),
        parts=allocate(Parts, 0, parameters=Struct()),
        team=allocate(Team, 0),
        tally=np.zeros(len(at.NAMES)),
        tally_before=np.zeros(len(at.NAMES)),
    )


def make_lists(people: int, pairs: int, walls: int) -> Lists:
    """Return neighbour lists with room for so many pairs and walls at bodies."""
    return allocate(
        Lists,
        people,
        pair_start=np.zeros(people + 1, np.int32),
        pair_body=np.zeros(pairs, np.int32),
        wall_start=np.zeros(people + 1, np.int32),
        wall_item=np.zeros(walls, np.int32),
        cell_start=np.zeros(4 * people + 1025, np.int32),
        stale=1,
        pair_reach=0.05,
        wall_reach=0.05,
        skin=SKIN,
    )


def make_contacts(capacity: int) -> Contacts:
    """Return room for so many contacts."""
    return allocate(Contacts, capacity, near=np.zeros((NEAR_WALLS, 6)))


def make_warm_start(capacity: int) -> WarmStart:
    """Return room for the percussions of so many contacts, in two halves."""
    return allocate(WarmStart, 2 * capacity, size=capacity)


def make_problem(people: int, contacts: int) -> Problem:
    """Return room for the packed problem of so many people and contacts, each of which may take two rows."""
    bodies = ("free", "velocity", "image_a", "image_b", "image_c", "image_d")
    given: dict[str, Any] = {name: np.zeros((people + 1, 2)) for name in bodies}
    return allocate(Problem, 2 * contacts, inverse_root=np.zeros(people + 1), **given)


def make_room_for_contacts(state: State, capacity: int) -> None:
    """Replace the contacts, the remembered percussions, and the problem where it is solved, by larger ones, empty."""
    half = state.warm_start.half
    state.contacts = make_contacts(capacity)
    state.warm_start = make_warm_start(capacity)
    state.warm_start.half = half
    if len(state.problem.body):
        state.problem = make_problem(len(state.bodies.row), capacity)


def grown(array: np.ndarray) -> np.ndarray:
    """Return a copy of twice the length."""
    return np.concatenate([array, np.zeros_like(array)])
