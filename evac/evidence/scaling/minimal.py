"""A minimal step of DEM, as a lower bound of its time: neighbour half lists, bilinear directions, springs, no walls.

Compiled as evac's kernels are. Those also have walls, portals and exits, check and undo steps, and sum for the summary.
"""

import math

import numpy as np

from evac.directions.fields import PackedFields
from evac.evidence.scenes import MODELS
from evac.jit import Floats, Ints, Pairs, Struct, inner, kernel
from evac.physics.state import SKIN, Crowd, allocate

#: Room in the lists for each person; beyond that neighbours are left out.
ROOM = 40


class Minimal(Struct):
    """People sorted by their cells at the start, their lists, and the directions of a single level and route."""

    fields: PackedFields
    position: Pairs
    velocity: Pairs
    radius: Floats
    inverse_mass: Floats
    speed: Floats  # desired [m/s]
    taken_up: Floats  # share of the gap to the desired velocity that a step takes up
    stiffness: float  # [kg/s2]
    cell: float  # side of a cell [m]
    rows: int  # cells along y; those at the border of the grid stay empty
    cell_of: Ints
    cell_start: Ints
    cell_body: Ints
    pair_start: Ints
    pair_body: Ints
    listed_position: Pairs  # where the lists were built
    stale: int  # 1: the lists must be built again


def make_minimal(crowd: Crowd, fields: PackedFields, step: float) -> Minimal:
    """Return those of a crowd who are inside, as they stand, for steps of a length [s]."""
    cell = 2.0 * float(crowd.radius.max()) + SKIN
    columns, rows = (int(fields.spacing * nodes / cell) + 3 for nodes in fields.shape[0].tolist())
    people = np.flatnonzero(crowd.level >= 0)
    column, row = ((crowd.position[people] - fields.origin[0]) / cell).astype(int).T
    people = people[np.lexsort((row, column))]
    return allocate(
        Minimal,
        len(people),
        fields=fields,
        position=crowd.position[people],
        velocity=crowd.velocity[people],
        radius=crowd.radius[people],
        inverse_mass=1.0 / crowd.mass[people],
        speed=np.ascontiguousarray(crowd.speed[people, 0]),
        taken_up=-np.expm1(-step / crowd.tau[people]),
        stiffness=MODELS["DEM"][1]["stiffness"],
        cell=cell,
        rows=rows,
        cell_start=np.zeros(columns * rows + 1, np.int32),
        pair_start=np.zeros(len(people) + 1, np.int32),
        pair_body=np.zeros(ROOM * len(people), np.int32),
        stale=1,
    )


@kernel
def walk_minimal(own: Minimal, steps: int, step: float) -> None:
    """Make so many steps of a length [s]."""
    for _ in range(steps):
        if own.stale:
            _list_neighbours(own)
        _drive(own)
        _push(own, step)
        _move(own, step)


@inner
def _list_neighbours(own):
    """Sort people into cells by counting, and list for each who is near, of each two the one in one list."""
    start, cell_of, rows, size = own.cell_start, own.cell_of, own.rows, own.cell
    left, bottom = own.fields.origin[0, 0], own.fields.origin[0, 1]
    last = (start.shape[0] - 1) // rows - 2
    for c in range(start.shape[0]):
        start[c] = 0
    for i in range(len(own.radius)):
        column = min(max(int((own.position[i, 0] - left) / size) + 1, 1), last)
        cell_of[i] = column * rows + min(max(int((own.position[i, 1] - bottom) / size) + 1, 1), rows - 2)
        start[cell_of[i]] += 1
    for c in range(start.shape[0] - 1):
        start[c + 1] += start[c]
    for i in range(len(own.radius) - 1, -1, -1):
        start[cell_of[i]] -= 1
        own.cell_body[start[cell_of[i]]] = i
    used = 0
    for i in range(len(own.radius)):
        x, y, c = own.position[i, 0], own.position[i, 1], cell_of[i]
        own.listed_position[i, 0], own.listed_position[i, 1] = x, y
        # Who stands behind in this cell or in the next one of the column, and in three cells of the next column.
        for first, end in ((start[c], start[c + 2]), (start[c + rows - 1], start[c + rows + 2])):
            for slot in range(first, end):
                j = own.cell_body[slot]
                dx, dy, limit = own.position[j, 0] - x, own.position[j, 1] - y, own.radius[i] + own.radius[j] + SKIN
                if dx * dx + dy * dy < limit * limit and (j > i or cell_of[j] != c) and used < len(own.pair_body):
                    own.pair_body[used] = j
                    used += 1
        own.pair_start[i + 1] = used
    own.stale = 0


@inner
def _drive(own):
    direction, velocity, spacing = own.fields.direction, own.velocity, own.fields.spacing
    left, bottom = own.fields.origin[0, 0], own.fields.origin[0, 1]
    nx, ny = own.fields.shape[0, 0], own.fields.shape[0, 1]
    for i in range(len(own.radius)):
        x = min(max((own.position[i, 0] - left) / spacing, 0.0), nx - 1.001)
        y = min(max((own.position[i, 1] - bottom) / spacing, 0.0), ny - 1.001)
        low = int(x) * ny + int(y)
        far, fx, fy = low + ny, x - int(x), y - int(y)
        gx, gy = 1.0 - fx, 1.0 - fy
        ex = gy * (gx * direction[low, 0] + fx * direction[far, 0])
        ex += fy * (gx * direction[low + 1, 0] + fx * direction[far + 1, 0])
        ey = gy * (gx * direction[low, 1] + fx * direction[far, 1])
        ey += fy * (gx * direction[low + 1, 1] + fx * direction[far + 1, 1])
        pace = own.speed[i] / max(math.sqrt(ex * ex + ey * ey), 1e-9)
        velocity[i, 0] += own.taken_up[i] * (pace * ex - velocity[i, 0])
        velocity[i, 1] += own.taken_up[i] * (pace * ey - velocity[i, 1])


@inner
def _push(own, step):
    position, velocity, inverse_mass, stiffness = own.position, own.velocity, own.inverse_mass, own.stiffness
    for i in range(len(own.radius)):
        for slot in range(own.pair_start[i], own.pair_start[i + 1]):
            j = own.pair_body[slot]
            dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            touching, square = own.radius[i] + own.radius[j], dx * dx + dy * dy
            if 0.0 < square < touching * touching:
                percussion = step * stiffness * (touching / math.sqrt(square) - 1.0)
                velocity[i, 0] += inverse_mass[i] * percussion * dx
                velocity[i, 1] += inverse_mass[i] * percussion * dy
                velocity[j, 0] -= inverse_mass[j] * percussion * dx
                velocity[j, 1] -= inverse_mass[j] * percussion * dy


@inner
def _move(own, step):
    """Move everybody, and note when somebody has gone half of what the lists look beyond touching."""
    farthest = 0.0
    for i in range(len(own.radius)):
        own.position[i, 0] += step * own.velocity[i, 0]
        own.position[i, 1] += step * own.velocity[i, 1]
        dx = own.position[i, 0] - own.listed_position[i, 0]
        dy = own.position[i, 1] - own.listed_position[i, 1]
        farthest = max(farthest, dx * dx + dy * dy)
    if farthest > (0.5 * SKIN) ** 2:
        own.stale = 1
