"""State of the step loop: structs of named arrays and numbers, which kernels take by reference."""

from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evac.directions.fields import PackedFields
from evac.jit import ByteGrid, Bytes, FloatGrid, Floats, Indices, Ints, Longs, Pairs, Quads, Struct, Triples
from evac.jit.kernels import Array
from evac.physics import tallies as at

FIRM = 1e6  #: Firmness of people who stand firm, whom the push of others does not move.

#: Rows of the packed contact problem, see `evac.physics.contact.rows`.
RowData = Annotated[NDArray[np.float64], Array("float64", (None, 5))]
FaceData = Annotated[NDArray[np.float64], Array("float64", (None, 7))]
NearWalls = Annotated[NDArray[np.float64], Array("float64", (None, 6))]


class Crowd(Struct):
    """The arrays of all people; row p is always person p. docs/architecture.md lists the writer of each array."""

    position: Pairs  #: (n, 2) in plan [m]; of people inside only the contact model writes it
    #: (n, 2) in plan [m/s], that of the contact model, which writes it of people inside; the velocity of motion is
    #: `Simulation.displacement_velocity`
    velocity: Pairs
    level: Ints  #: (n,) int32, -1 once out; of people inside written by the contact model and by lifts only
    radius: Floats  #: (n,) [m]
    #: (n,): radius of the body that touches others and fits through gaps, at most ``radius`` [m]; see
    #: `Behaviour.contact_radius`
    contact_radius: Floats
    height: Floats  #: (n,) [m]
    mass: Floats  #: (n,) [kg]
    tau: Floats  #: (n,): relaxation time [s]
    speed: Triples  #: (n, 3): desired speeds on the flat, up and down stairs, along the slope [m/s]
    group: Ints  #: (n,) int32
    #: (n,): time at which a person starts to walk [s]; of people who have not come, from their arrival on; written by
    #: behaviours
    start_time: Floats
    route: Ints  #: (n,) int32: row of ``Fields.routes``; written by behaviours
    speed_factor: Floats  #: (n,): set to 1 before each tick's behaviours, which multiply it
    #: (n, 2): set to 0 before each tick's behaviours, which add to it; the unit direction of the field plus this,
    #: normalised, is the desired direction
    extra_direction: Pairs
    exit_time: Floats  #: (n,) [s], NaN until out
    exit_used: Ints  #: (n,) int32, -1 until out
    distance: Floats  #: (n,): path length walked in plan, up to the exit [m]
    #: (n,): greatest overlap with another body or a wall at the start of the sub-steps of the previous tick [m];
    #: written by the contact model
    overlap: Floats
    #: (n,) uint8: 1 for those who have overlapped since the start by more than half the smallest radius, who may
    #: pass through each other; written by the contact model
    mingled: Bytes
    #: (n,): sum of contact forces [N] in the last step of the previous tick if a behaviour reads it, otherwise at the
    #: last output
    contact_force: Floats
    #: (n,): time at which a person came into the building [s], 0 for those who were there from the start, NaN for those
    #: who have not come; written by the population
    arrival_time: Floats
    #: (n,) int32: link that lets a person through although it is closed, because the body is on its line; -1 for none;
    #: written by the scene, and by the contact model for people who pass a link of one direction
    passing: Ints
    #: (n, 2): unit desired direction of people whom a link lets through, instead of that of their route, until they
    #: have left its line; zero for others; written by the scene
    ahead: Pairs
    #: (n,): factor of the mass with which a person resists contacts and forces: 1, and `FIRM` for people who stand
    #: firm, since gases or heat have stopped them, they are at a refuge or were brought to a place, or they do not
    #: leave; written by `Deciding`
    firmness: Floats

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to replace an array, since other holders of the crowd would keep the old one.

        Raises
        ------
        AttributeError
        """
        if name in self.kinds and self.__dict__.get(name, value) is not value:
            raise AttributeError(f"crowd.{name} cannot be replaced; write into the array, as in crowd.{name}[:] = ...")
        super().__setattr__(name, value)

    def ways(self, rows: Any, route: Any = None) -> tuple[Any, Any, Any, Any]:
        """Return what methods of `Fields` take for people: level, position, route (their own if None) and radius."""
        own = self.route[rows] if route is None else route
        return self.level[rows], self.position[rows], own, self.contact_radius[rows]


def make_crowd(
    position: ArrayLike,
    velocity: ArrayLike = 0.0,
    *,
    level: ArrayLike = 0,
    radius: ArrayLike = 0.2,
    contact_radius: ArrayLike | None = None,
    height: ArrayLike = 1.7,
    mass: ArrayLike = 80.0,
    tau: ArrayLike = 0.5,
    speed: ArrayLike = 0.0,
    start_time: ArrayLike = 0.0,
) -> Crowd:
    """Return a crowd at the start of a run: all people in the first group, on the first route, with zero distance.

    Positions are (n, 2) [m]; all else, in SI units, is given for each person or for all. Speeds are (n, 3) for flat, up
    and down, or one for all three; the contact radius is the radius by default.
    """
    place = np.array(position, dtype=np.float64).reshape(-1, 2)
    speeds = np.asarray(speed, dtype=np.float64)
    given: dict[str, ArrayLike] = {
        "position": place,
        "velocity": velocity,
        "level": level,
        "radius": radius,
        "contact_radius": radius if contact_radius is None else contact_radius,
        "height": height,
        "mass": mass,
        "tau": tau,
        "speed": speeds[:, None] if speeds.ndim == 1 else speeds,
        "start_time": start_time,
        "speed_factor": 1.0,
        "exit_time": np.nan,
        "exit_used": -1,
        "passing": -1,
        "firmness": 1.0,
    }
    kinds: dict[str, Any] = dict(Crowd.kinds)
    arrays = {name: np.zeros((len(place), *kind.shape[1:]), kind.dtype) for name, kind in kinds.items()}
    for name, value in given.items():
        arrays[name][...] = value
    return Crowd(**arrays)


def copy_of(crowd: Crowd) -> Crowd:
    """Return a deep copy of a crowd."""
    return Crowd(**{name: array.copy() for name, array in crowd.values().items()})


class World(Struct):
    """The scene for kernels: walls, links (portals and exits), levels, fields.

    A link is a portal (0 .. n_portals-1) or an exit (n_portals + exit index). Each portal segment
    is contained twice, once for each level, oriented with the inside of that level on its left.
    """

    wall: Quads  # (w, 4)
    wall_level: Ints  # (w,)
    wall_open: Bytes  # (w,) 0: acts, 1: absent, as at an open link, 2: absent for those whom the link lets through
    bucket_wall: Ints  # walls of each level near each of its buckets, and all of them in a last one, in ascending order
    bucket_start: Ints  # (buckets + 1,) first of a bucket in bucket_wall
    bucket_first: Ints  # (levels,) first bucket of each level
    bucket_column: Ints  # (levels,) first column and row of its buckets in the plan
    bucket_row: Ints
    bucket_columns: Ints  # (levels,) numbers of its columns and rows
    bucket_rows: Ints
    bucket_x: float  # corner of the plan [m]
    bucket_y: float
    bucket_size: float  # [m]
    bucket_reach: float  # distance from a bucket within which bucket_wall lists all walls [m]
    link_segment: Quads  # (s, 4) sorted by level
    link_start: Ints  # (levels + 1,) first segment of a level
    link_to: Ints  # (s,) level behind it, -1 outside
    link_id: Ints  # (s,)
    doors: int  # number of doors between rooms; they are walls before those of links, and numbered after the links
    # (portals + exits + doors,) 0: closed, acts as a wall, 1: open, 2: open for those whom it lets through
    link_open: Bytes
    link_from: Ints  # (portals + exits + doors,) level from which a link in state 2 lets everybody through, -1 for none
    uphill: Pairs  # (levels, 2) unit plan vector, zero on the flat
    cosine: Floats  # (levels,) cosine of the slope
    carry: Pairs  # (levels, 2) velocity of the ground in plan, as of escalators [m/s]
    backed: Bytes  # (levels,) 1: the level has walls right behind one of its exits
    linked: ByteGrid  # (levels, levels) 1: same level or at most two portals apart
    linked_start: Ints  # (levels + 1,) first of a level in linked_level
    linked_level: Ints  # the levels linked with each level, its own first
    rounding: float  # rounding error of positions at these coordinates [m]
    fields: PackedFields


class Bodies(Struct):
    """The people still inside, in the order of `evac.physics.engine` at the start of a tick.

    A body keeps its row until the next tick, so the order of sums and sweeps depends only on the people.
    The level is -1 for bodies that have left during the tick.
    """

    inside: int  # number of bodies
    failed: int  # body that the last failure concerns
    other_failed: int  # the other body, of two whose centres would pass each other
    smallest: float  # smallest contact radius [m]
    lightest: float  # smallest mass [kg]
    fastest: float  # largest free speed in the sub-step [m/s]
    reach_floor: float  # smallest reach [m]
    farthest_reach: float  # largest reach, if a law requests another search [m]
    outrun: int  # 1: a body moves farther than the contact search reached
    row: Ints  # row in Crowd
    position: Pairs
    velocity: Pairs
    free: Pairs  # velocity after the step without contacts
    solved: Pairs  # velocity after the step
    spare: Pairs  # scratch for position corrections and force reports
    push: Pairs  # forces at a distance [N]
    desired: Pairs  # unit desired direction
    node: Longs  # lower node of the cell that `around` holds, -1: none
    picked: Ints  # scratch: bodies that a loop has picked for the next one
    around: Pairs  # (4 n, 2) directions at the nodes of each body's cell, beside one another
    level: Ints
    group: Ints
    contact_radius: Floats
    mass: Floats
    inverse_mass: Floats
    tau: Floats
    speed: Triples
    start_time: Floats
    column: Ints  # of the fields: the route, for a body of this width
    speed_factor: Floats
    extra_direction: Pairs
    distance: Floats
    overlap: Floats
    mingled: Bytes
    contact_force: Floats
    passing: Ints
    ahead: Pairs
    firmness: Floats
    old_position: Pairs
    old_velocity: Pairs
    old_level: Ints
    old_distance: Floats
    built_position: Pairs  # positions at which the neighbour lists were built
    wall_distance: Floats  # distance of the centre to the nearest closed wall in reach [m]
    reach: Floats  # search distance for contacts beyond the body [m]
    relaxation: Floats  # share of the difference to the desired velocity closed in a step, 1 - exp(-h / tau)
    relaxation_step: float  # step h that `relaxation` was computed for [s], 0 after sorting
    near_link: Bytes  # NEAR: a portal or exit may be crossed before the lists are rebuilt, CROSSED: one has been


class Cells(Struct):
    """People in the square cells of their levels.

    A level has cells for the rectangle that its people are in. If there is no room for all, as where a person is far
    away, `wraps` is 1 and its columns and rows are used again and again: cells then also contain people from elsewhere.
    """

    size: float  # [m]
    low_column: Ints  # (levels,) first column and row of the rectangle, counted from the origin of the plan
    low_row: Ints
    columns: Ints  # (levels,) numbers of columns and rows of cells
    rows: Ints
    wraps: Bytes  # (levels,)
    first: Ints  # (levels,) first cell; cell (column, row) is column * rows + row cells behind it
    start: Ints  # first of each cell in slots
    cell_of: Ints  # (n,) -1 for people on no level
    slots: Ints  # (n,) people of each cell, in ascending order


class Lists(Struct):
    """Neighbour lists: for each body, the walls in reach and the bodies in reach with a greater index, ascending."""

    pair_start: Ints
    pair_body: Ints
    wall_start: Ints
    wall_item: Ints
    cells: Cells
    greatest: float  # radius of the largest body [m]
    stale: int  # 1: must be rebuilt
    pair_reach: float  # reach of the list of bodies, beyond touching [m]
    wall_reach: float  # reach of the list of walls, beyond touching [m]
    skin: float  # additional reach, so that lists remain valid for several steps [m]


class Problem(Struct):
    """The contact problem packed for solvers, one row for each unknown percussion, see `evac.physics.contact.rows`.

    A solver changes percussions and velocities consistently; arrays with ``work`` and ``image`` in their names are
    scratch. Walls are represented by one body of infinite mass behind the people.
    """

    size: int  # number of rows
    bodies: int
    ends: int  # number of bodies and of the wall behind them
    row: Ints  # row of each unknown, in the order of contacts
    rigid: int  # 1: every row is rigid and pushes only
    residual: float  # residual of the percussions, set by the solver [m/s]
    iterations: int  # iterations made, including those of a second solve
    retried: int  # 1: solved again by the stronger solver
    missing: int  # 1: the stronger solver is needed but not loaded
    body: Indices
    other: Indices
    data: RowData
    elastic: Triples
    scale: Floats  # sqrt(omega) [kg^-1/2]
    percussion: Floats  # percussions times scale, x
    inverse_root: Floats  # (n + 1,) 1/sqrt(m), 0 for the wall
    free: Pairs  # (n + 1, 2) free velocities times sqrt(m)
    velocity: Pairs  # (n + 1, 2) velocities times sqrt(m), U
    work_a: Floats
    work_b: Floats
    work_c: Floats
    work_d: Floats
    image_a: Pairs
    image_b: Pairs
    image_c: Pairs
    image_d: Pairs
    branch: Ints
    face: Indices
    face_body: Indices
    face_other: Indices
    face_data: FaceData


class Contacts(Struct):
    """The contacts of one step, sorted by body, walls before bodies; the normal points to `body`."""

    number: int
    body: Ints
    other: Ints  # -1: a wall
    key: Ints  # other body, or wall - number of walls
    normal: Pairs
    gap: Floats
    omega: Floats  # 1/m_i + 1/m_j
    bias: Floats  # b in the condition w+ + b >= 0 [m/s]
    velocity_before: Floats  # normal velocity before the step, w-
    slide_before: Floats  # tangential velocity before the step, of sticky contacts [m/s]
    percussion: Floats  # normal percussion P [N s]
    friction: Floats  # tangential percussion [N s]
    kept_percussion: Floats  # saved percussions
    kept_friction: Floats
    sticky: Bytes  # 1: the tangential law acts
    memory: FloatGrid  # (contacts + 1, width) what the law keeps, see `evac.physics.contact.contacts`; a row for trials
    picked: Ints  # scratch: bodies in reach of one
    near: NearWalls  # scratch for the wall search: distance, normal, wall, nearest point
    deepest: float  # largest overlap at the start of the sub-step [m]
    separation_tolerance: float  # overlap that the law allows [m]
    separation_iterations: int
    separation_failed: int  # 1: overlaps could not be separated in this tick
    failed_before: int  # its value at the start of the step


class Kept(Struct):
    """Numbers of the contacts of the last sub-step, in two halves; one keeps those at the start of the step."""

    size: int  # of a half
    half: int  # half that the next search reads
    number: int  # number of contacts in that half
    half_before: int  # both values at the start of the step
    number_before: int
    body: Ints
    key: Ints
    value: FloatGrid


class Events(Struct):
    """Crossings of the current tick, in order."""

    number: int
    number_before: int  # at the start of the step
    row: Ints
    kind: Ints  # 0 portal, 1 exit
    link: Ints
    time: Floats


class Clock(Struct):
    """The steps to make and their settings."""

    now: int  # index of the step
    last: int  # one past the last
    parts: int  # initial number of parts of the step; greater than 1 if a subdivided step had to be repeated
    length: float  # of a step [s]
    time: float  # at the start of the sub-step [s]
    h: float  # length of the sub-step [s]
    h_before: float  # of the previous one [s], 0: none
    h_before_step: float  # its value at the start of the step [s]
    explicit: int  # 1: drive by explicit Euler, as in the paper, instead of the exponential update
    report_force: int  # 1: contact forces are requested for the last sub-step
    reports: int  # 1: this is that sub-step
    full: int  # 1: include parts that the scene does not need
    attempt: int  # number of previous calls of the law in this sub-step
    searched: int  # number of contact searches in this sub-step after the first


class Forces(Struct):
    """Forces between two people or on one person, for kernels, one row each."""

    number: int
    address: Longs  # of the machine code
    cutoff: Floats  # gaps beyond which they are neglected [m]
    parameters: FloatGrid
    of_person: Bytes  # 1: it takes what `evac.jit.call_person_force` passes
    farthest: float  # greatest cutoff [m]
    spare_waiting: int  # 1: they do not act on people before their response time


class Traits(Struct):
    """Properties of a contact model that the step loop uses, as returned by `ContactModel.traits`."""

    overdamped: int  # 1: the free velocity equals the desired one, without inertia
    old_share: float  # share of the old velocity in the velocity of motion
    reach_share: float  # search distance for contacts: share of the free paths of both bodies,
    reach_fastest: float  # at least this share of the free path of the fastest body,
    reach_floor: float  # and at least this distance [m]
    longest_path: float  # maximum free path in a sub-step, in units of the smallest radius
    remembers: int  # 1: starts from the percussions of the previous sub-step
    reports_percussions: int  # 1: contact forces are the percussions divided by h; 0: the law reports them


class LoadedSolver(Struct):
    """A solver as kernels call it, see `evac.physics.contact.rows`."""

    solve: int  # address, 0: not loaded
    is_checked: int  # 1: it is not part of evac, so that its results are checked


class Parts(Struct):
    """Addresses of parts that are compiled and loaded only if needed; 0 if a part is not loaded."""

    law: int
    parameters: Struct  # of the law
    solver: LoadedSolver
    stronger: LoadedSolver  # for solves that fail
    separation: int
    forces: int
    body_forces: int
    seams: int
    recall: int  # and `retain`: the memory of contacts
    retain: int


class State(Struct):
    """All data that a step of a run reads and writes."""

    world: World
    bodies: Bodies
    lists: Lists
    contacts: Contacts
    warm_start: Kept  # percussions
    memory: Kept  # what the law keeps
    problem: Problem
    events: Events
    clock: Clock
    forces: Forces  # between two people
    body_forces: Forces  # on one
    traits: Traits
    parts: Parts
    tally: Floats  # sums over the run, named in `evac.physics.tallies`
    tally_before: Floats  # at the start of the step


# Allocation for given numbers of people and contacts

S = TypeVar("S", bound=Struct)

#: Room for cells: a number for each person, and one for each level.
CELLS_PER_PERSON = 4
CELLS_PER_LEVEL = 1024

SKIN = 0.3  #: Skin of neighbour lists: additional search distance, so that lists remain valid for several steps [m].
NEAR_WALLS = 60  #: Maximum number of walls within the reach of one body.


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


def make_cells(people: int, levels: int) -> Cells:
    """Return empty cells for numbers of people and levels."""
    return Cells(
        size=1.0,
        **{name: np.zeros(levels, np.int32) for name in ("low_column", "low_row", "columns", "rows", "first")},
        wraps=np.zeros(levels, np.uint8),
        start=np.zeros(CELLS_PER_PERSON * people + CELLS_PER_LEVEL * levels + 1, np.int32),
        cell_of=np.zeros(people, np.int32),
        slots=np.zeros(people, np.int32),
    )


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
