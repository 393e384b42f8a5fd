"""The arrays that kernels work on, bundled by owner. float64, int32, uint8; contiguous; checked at the border."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evac.directions.fields import PackedFields

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
LongArray = NDArray[np.int64]
IndexArray = NDArray[np.uint32]
ByteArray = NDArray[np.uint8]


class Crowd(NamedTuple):
    """Everybody; row p is person p and never moves. Who writes what stands in docs/architecture.md.

    Attributes
    ----------
    position, velocity : (n, 2) [m], [m/s], in plan. Written by the contact model only. The velocity is the contact
        model's own; how fast people move is `Simulation.displacement_velocity`.
    level : (n,) int32, -1 once out. Written by the contact model only.
    radius, mass, tau : (n,) [m], [kg], [s]
    speed : (n, 3) desired speeds on the flat, up and down stairs, along the slope [m/s]
    group : (n,) int32
    start_time : (n,) time at which a person sets off [s]; written by behaviours
    route : (n,) int32, row of ``Fields.routes``; written by behaviours
    speed_factor : (n,), set to 1 before each tick's behaviours, which multiply it
    extra_direction : (n, 2), set to 0 before each tick's behaviours, which add to it; the unit
        direction of the field plus this, normalised, is the desired direction
    exit_time : (n,) [s], NaN until out;  exit_used : (n,) int32, -1 until out
    distance : (n,) walked in plan, up to the exit [m]
    contact_force : (n,) sum of contact forces [N], in the last step of the tick before where a behaviour in use reads
        it, else at the last output
    """

    position: FloatArray
    velocity: FloatArray
    level: IntArray
    radius: FloatArray
    mass: FloatArray
    tau: FloatArray
    speed: FloatArray
    group: IntArray
    start_time: FloatArray
    route: IntArray
    speed_factor: FloatArray
    extra_direction: FloatArray
    exit_time: FloatArray
    exit_used: IntArray
    distance: FloatArray
    contact_force: FloatArray


def make_crowd(
    position: ArrayLike,
    velocity: ArrayLike = 0.0,
    *,
    level: ArrayLike = 0,
    radius: ArrayLike = 0.2,
    mass: ArrayLike = 80.0,
    tau: ArrayLike = 0.5,
    speed: ArrayLike = 0.0,
    start_time: ArrayLike = 0.0,
) -> Crowd:
    """Return people as a run starts: of the first group, on the first route, and nothing walked.

    Parameters
    ----------
    position : (n, 2) [m]
    velocity : (n, 2) or one for everybody [m/s]
    level : (n,) or one for everybody
    radius, mass, tau, start_time : (n,) or one for everybody [m], [kg], [s], [s]
    speed : (n, 3), or (n,) or one for the flat and both ways on stairs [m/s]
    """
    place = np.array(position, dtype=np.float64).reshape(-1, 2)
    n = len(place)

    def each(value: ArrayLike) -> FloatArray:
        return np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), n))

    speeds = np.asarray(speed, dtype=np.float64)
    return Crowd(
        position=place,
        velocity=np.array(np.broadcast_to(np.asarray(velocity, dtype=np.float64), (n, 2))),
        level=np.array(np.broadcast_to(np.asarray(level, dtype=np.int32), n)),
        radius=each(radius),
        mass=each(mass),
        tau=each(tau),
        speed=speeds.copy() if speeds.ndim == 2 else np.repeat(each(speeds)[:, None], 3, axis=1),
        group=np.zeros(n, np.int32),
        start_time=each(start_time),
        route=np.zeros(n, np.int32),
        speed_factor=np.ones(n),
        extra_direction=np.zeros((n, 2)),
        exit_time=np.full(n, np.nan),
        exit_used=np.full(n, -1, np.int32),
        distance=np.zeros(n),
        contact_force=np.zeros(n),
    )


class World(NamedTuple):
    """The scene as kernels read it: walls, links (portals and exits), levels, fields.

    A link is a portal (0 .. n_portals-1) or an exit (n_portals + exit index). Each portal segment
    stands here twice, once for each level, oriented with that level's inside on its left.
    """

    wall: FloatArray  # (w, 4)
    wall_level: IntArray  # (w,)
    wall_open: ByteArray  # (w,) 1: not there
    bucket_wall: IntArray  # walls near each bucket of the plan, in rising order
    bucket_start: IntArray  # (buckets + 1,) first of a bucket in bucket_wall
    bucket_shape: IntArray  # (2,) buckets along x and y
    bucket_frame: FloatArray  # (4,) origin x, y, size of a bucket, reach that bucket_wall covers [m]
    link_segment: FloatArray  # (s, 4) sorted by level
    link_start: IntArray  # (levels + 1,) first segment of a level
    link_to: IntArray  # (s,) level behind it, -1 outside
    link_id: IntArray  # (s,)
    link_open: ByteArray  # (portals + exits,) 0: closed, acts as a wall
    uphill: FloatArray  # (levels, 2) unit plan vector, zero on the flat
    cosine: FloatArray  # (levels,) cosine of the slope
    backed: ByteArray  # (levels,) 1: walls of the level stand right behind one of its exits
    linked: ByteArray  # (levels, levels) 1: same level or at most two portals apart
    rounding: float  # what rounding leaves of a length of zero at these coordinates [m]
    fields: PackedFields


def copy_of(crowd: Crowd) -> Crowd:
    """Return a crowd with arrays of its own."""
    arrays: dict[str, Any] = {name: array.copy() for name, array in crowd._asdict().items()}
    return Crowd(**arrays)


class Bodies(NamedTuple):
    """The people still inside, sorted by travel time (row breaking ties) at the start of a tick.

    A body keeps its place until the next tick, so sums and sweeps run in an order that depends on the
    people alone; level -1 marks one that left on the way.
    """

    count: LongArray  # type: ignore[assignment]  # (2,) bodies, and the body that the last failure is about
    row: IntArray  # row in Crowd
    position: FloatArray
    velocity: FloatArray
    free: FloatArray  # velocity after the step if nobody touched
    solved: FloatArray  # velocity after the step
    spare: FloatArray  # scratch of position corrections and force reports
    push: FloatArray  # forces at a distance [N]
    desired: FloatArray  # unit desired direction
    level: IntArray
    radius: FloatArray
    mass: FloatArray
    inverse_mass: FloatArray
    tau: FloatArray
    speed: FloatArray  # (n, 3)
    start_time: FloatArray
    route: IntArray
    speed_factor: FloatArray
    extra_direction: FloatArray
    distance: FloatArray
    contact_force: FloatArray
    old_position: FloatArray
    old_velocity: FloatArray
    old_level: IntArray
    old_distance: FloatArray
    built_position: FloatArray  # where the neighbour lists were built
    wall_distance: FloatArray  # of the centre to the nearest acting wall in reach [m]
    reach: FloatArray  # how far a contact is looked for beyond the body [m]
    taken_up: FloatArray  # share of the gap to the desired velocity that a step takes up, 1 - exp(-h / tau)
    taken_up_in: FloatArray  # (1,) the step h that it holds for [s], 0 after sorting
    near_link: ByteArray  # 1: a portal or exit may be crossed before the lists are rebuilt


class Lists(NamedTuple):
    """Neighbour lists: for each body its walls in reach, and the bodies after it in reach, rising."""

    pair_start: IntArray
    pair_body: IntArray
    wall_start: IntArray
    wall_item: IntArray
    cell_start: IntArray
    cell_body: IntArray
    cell_of: IntArray
    stale: ByteArray  # (1,)
    span: FloatArray  # (3,) reach beyond touching covered for bodies, skin, reach covered for walls [m]


class Groups(NamedTuple):
    """Rows in groups of four that share no body, see `evac.physics.groups`; arrays over lanes are flat."""

    row: IndexArray  # of each lane; as many as there are rows: none
    body: IndexArray  # place of the body's first number in the flat velocities
    other: IndexArray
    data: FloatArray  # of each group, each column of `Rows.data` in turn
    elastic: FloatArray  # likewise
    scale: FloatArray
    percussion: FloatArray
    last: FloatArray  # percussions of the sweep before
    kept: FloatArray  # percussions at the last look
    mask: LongArray  # (n + 1,) a bit for each open group that a body is in
    block: LongArray  # (n + 1,) which open groups the mask is of
    filled: LongArray  # lanes taken in each open group


class Rows(NamedTuple):
    """The contact problem packed for the solvers, see `evac.physics.rows`.

    Places in it are unsigned: compiled code need not ask whether they count from the end.
    """

    rigid: ByteArray  # (1,) 1: every row is rigid and pushes only
    body: IndexArray
    other: IndexArray  # a wall is body number n
    data: FloatArray  # (r, 5)
    elastic: FloatArray  # (r, 3)
    scale: FloatArray  # sqrt(omega) [kg^-1/2]
    percussion: FloatArray  # percussions times scale, x
    branch: IntArray  # of the law
    inverse_root: FloatArray  # (n + 1,) 1/sqrt(m), 0 for the wall
    free: FloatArray  # (n + 1, 2) free velocities times sqrt(m)
    velocity: FloatArray  # (n + 1, 2) velocities times sqrt(m), U
    face: IndexArray  # rows on the face
    face_body: IndexArray
    face_other: IndexArray
    face_data: FloatArray
    work: FloatArray  # (4, r) percussions of earlier iterations, directions
    image: FloatArray  # (4, n + 1, 2) velocities of earlier iterations, velocity images of directions


class Contacts(NamedTuple):
    """The contacts of one step, sorted by body, walls before bodies; the normal points to `body`."""

    count: LongArray  # type: ignore[assignment]  # (3,) contacts now, contacts in the warm-start memory, 1 where parting overlaps failed this tick
    body: IntArray
    other: IntArray  # -1: a wall
    key: IntArray  # other body, or wall - number of walls
    normal: FloatArray  # (c, 2)
    gap: FloatArray
    omega: FloatArray  # 1/m_i + 1/m_j
    bias: FloatArray  # w+ + bias >= 0 is asked for [m/s]
    velocity_before: FloatArray  # normal velocity before the step, w-
    percussion: FloatArray  # normal percussion P [N s]
    friction: FloatArray  # tangential percussion [N s]
    sticky: ByteArray  # 1: the tangential law acts
    old_body: IntArray
    old_key: IntArray
    old_percussion: FloatArray
    work: FloatArray  # (c, 3): 0, 1 normal and tangential percussions set aside, 2 tangential velocity before the step
    rows: Rows
    groups: Groups
    near: FloatArray  # (walls at one body, 6) of the wall search


class Events(NamedTuple):
    """Crossings of the current tick, in order."""

    count: LongArray  # type: ignore[assignment]  # (1,)
    row: IntArray
    kind: IntArray  # 0 portal, 1 exit
    link: IntArray
    time: FloatArray


class Clock(NamedTuple):
    """Which steps to make, and how."""

    first: int  # index of the first step
    last: int  # one past the last
    step: float  # h [s]
    explicit: bool  # drive by explicit Euler (the paper's) instead of the exponential update
    report_force: bool  # contact forces are wanted at the last step
    cutoff: float  # gap beyond which no force at a distance is felt [m]
    full: bool  # do even what the scene does not need


class Forces(NamedTuple):
    """Pair forces as kernels call them, one row each."""

    address: LongArray  # (k,) of the machine code
    cutoff: FloatArray  # (k,) gaps beyond which nobody feels them [m]
    parameters: FloatArray  # (k, p)
