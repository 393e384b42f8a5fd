"""Start positions: random placement of discs in a polygon without overlaps of walls and other discs."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray
from evac.base.errors import ScenarioError
from evac.jit import Bytes, Floats, IntGrid, Ints, Pairs, Quads, Struct, Triples, inner, kernel
from evac.physics.contact.neighbours import segment_distance

ROUNDS = 40  #: Number of rounds of random candidates, with two per person, before the lattice is tried.

#: Maximum number of candidates per round, for polygons that cover little of their bounding box.
MOST_CANDIDATES = 4_000_000

#: Largest share of the ground that discs of one size can cover; discs of different sizes cover hardly more.
DENSEST = 0.95

#: Maximum number of lattice nodes over the bounding box of a polygon, and of cells that discs are sorted into.
MOST_NODES = 10_000_000

MARGIN = 1e-9  #: Gap between a disc and an adjacent wall, so that rounding errors cannot make them overlap [m].


class _Cells(Struct):
    """Discs in square cells as wide as the largest diameter, so that only nine cells are searched."""

    left: float  # corner of the cells [m]
    bottom: float
    size: float  # [m]
    head: IntGrid  # (nx, ny) last disc of each cell, -1 for none
    following: Ints  # (discs,) previous disc in the same cell
    disc: Triples  # (discs, 3) x, y, radius [m]


def place(
    polygon: BaseGeometry,
    radii: FloatArray,
    segments: FloatArray,
    occupied: FloatArray,
    generator: np.random.Generator,
    place_name: str,
    may_start: Callable[[FloatArray], BoolArray],
) -> FloatArray:
    """Place discs of `radii` in a polygon at random, without overlaps with each other, walls and people placed before.

    Discs are placed by random sequential addition, largest first. If this saturates before all discs are placed
    (it covers at most about 54 % of the ground), all discs are placed on a hexagonal lattice with the largest
    possible spacing, with random displacements within the remaining gaps. `segments` (w, 4) are walls, portals and
    exits, `occupied` (m, 3) x, y and radius of the others [m]; `may_start` says which points (k, 2) may be centres.
    """
    reach = float(radii.max())
    fitting = int(DENSEST * polygon.buffer(reach).area / (np.pi * float(np.square(radii).mean())))
    if len(radii) > 2 * fitting:  # no need to try
        raise _too_many(place_name, radii, polygon, fitting)
    low, high = np.reshape(polygon.bounds, (2, 2))
    starts, ends, around = segments[:, :2], segments[:, 2:], 2 * occupied[:, 2].max(initial=0.0)
    is_near = (np.maximum(starts, ends) >= low - 2 * reach) & (np.minimum(starts, ends) <= high + 2 * reach)
    near = np.ascontiguousarray(segments[is_near[:, 0] & is_near[:, 1]])
    there = occupied[((occupied[:, :2] >= low - around) & (occupied[:, :2] <= high + around)).all(axis=1)]
    shapely.prepare(polygon)
    ground = _Ground(polygon, near, there, may_start)
    positions, n_placed = ground.at_random(radii, generator)
    if n_placed == len(radii):
        return positions
    lattice, n_fitting = ground.on_lattice(len(radii), reach, generator)
    if lattice is None:
        raise _too_many(place_name, radii, polygon, max(n_placed, n_fitting))
    return lattice


def _too_many(place_name: str, radii: FloatArray, polygon: BaseGeometry, fitting: int) -> ScenarioError:
    return ScenarioError(
        f"{place_name}: {len(radii)} people of radii up to {radii.max():.2f} m do not fit on {polygon.area:.1f} m2, "
        f"about {fitting} would fit; reduce the number or enlarge the area"
    )


def clearance(positions: FloatArray, segments: FloatArray) -> FloatArray:
    """Return the distance (n,) [m] of points to the nearest segment; inf without segments."""
    lines = shapely.multilinestrings(segments.reshape(-1, 2, 2))
    shapely.prepare(lines)
    distance: FloatArray = shapely.distance(lines, shapely.points(positions))
    return np.nan_to_num(distance, nan=np.inf)


@dataclass(frozen=True)
class _Ground:
    """Where discs are placed."""

    polygon: BaseGeometry
    segments: FloatArray  # (w, 4): walls, portals and exits near it [m]
    occupied: FloatArray  # (m, 3): x, y and radius of people near it who were placed before [m]
    may_start: Callable[[FloatArray], BoolArray]

    def are_inside(self, points: FloatArray) -> BoolArray:
        """Return which points (k, 2) may be centres."""
        inside: BoolArray = shapely.intersects_xy(self.polygon, points[:, 0], points[:, 1])
        inside[inside] = self.may_start(points[inside])
        return inside

    def at_random(self, radii: FloatArray, generator: np.random.Generator) -> tuple[FloatArray, int]:
        """Random sequential addition; return positions and the number of placed discs."""
        n = len(radii)
        order = np.argsort(-radii, kind="stable")
        cells = self.cells(radii, n)
        left, bottom, right, top = self.polygon.bounds
        batch = min(MOST_CANDIDATES, math.ceil(2 * n * (right - left) * (top - bottom) / self.polygon.area) + 100)
        n_placed = 0
        for _ in range(ROUNDS):
            points = generator.uniform((left, bottom), (right, top), (batch, 2))
            inside = np.ascontiguousarray(points[self.are_inside(points)])
            n_placed = add_discs(inside, radii[order], n_placed, len(self.occupied), self.segments, cells)
            if n_placed == n:
                break
        positions = np.empty((n, 2))
        positions[order] = cells.disc[len(self.occupied) :, :2]
        return positions, n_placed

    def on_lattice(self, n: int, radius: float, generator: np.random.Generator) -> tuple[FloatArray | None, int]:
        """Hexagonal lattice; return positions, or None if they do not fit, and the capacity of the densest lattice."""
        cells = self.cells(np.array([radius]), 0)

        def standing(points: FloatArray) -> FloatArray:
            points = points[self.are_inside(points)]
            fits = np.zeros(len(points), dtype=np.bool_)
            _are_clear(np.ascontiguousarray(points), radius, self.segments, cells, fits.view(np.uint8))
            return points[fits]

        closest = 2 * (radius + MARGIN)
        left, bottom, right, top = self.polygon.bounds
        if (right - left) * (top - bottom) > MOST_NODES * closest**2:
            return None, 0
        corner = radius + 2 * MARGIN
        phases = (corner, 0.0, 0.5 * radius)
        frames = list(itertools.product((False, True), phases, phases))
        frame = max(frames, key=lambda frame: len(standing(_nodes(self.polygon, closest, *frame))))
        n_fitting = len(standing(_nodes(self.polygon, closest, *frame)))
        if n_fitting < n:
            return None, n_fitting
        width, too_wide = closest, 2 * closest + math.sqrt(self.polygon.area)
        for _ in range(20):
            middle = (width + too_wide) / 2
            if len(standing(_nodes(self.polygon, middle, *frame))) >= n:
                width = middle
            else:
                too_wide = middle
        points = standing(_nodes(self.polygon, width, *frame))
        points = points[generator.permutation(len(points))[:n]]
        length = (width - closest) / 2 * np.sqrt(generator.random(n))
        angle = 2 * np.pi * generator.random(n)
        moved = points + length[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
        fits = np.zeros(n, dtype=np.bool_)
        _are_clear(moved, radius, self.segments, cells, fits.view(np.uint8))
        fits &= self.are_inside(moved)
        return np.where(fits[:, None], moved, points), n_fitting

    def cells(self, radii: FloatArray, n: int) -> _Cells:
        """Return cells over the polygon with the people placed before and room for `n` more."""
        size = 2 * max(float(radii.max()), float(self.occupied[:, 2].max(initial=0.0)))
        left, bottom, right, top = self.polygon.bounds
        size = max(size, math.sqrt((right - left) * (top - bottom) / MOST_NODES))
        shape = (int((right - left) / size) + 3, int((top - bottom) / size) + 3)
        cells = _Cells(
            left=left - size,
            bottom=bottom - size,
            size=size,
            head=np.full(shape, -1, dtype=np.int32),
            following=np.full(len(self.occupied) + n, -1, dtype=np.int32),
            disc=np.zeros((len(self.occupied) + n, 3)),
        )
        cells.disc[: len(self.occupied)] = self.occupied
        column = np.floor((self.occupied[:, :2] - (cells.left, cells.bottom)) / size).astype(np.int64)
        rows = np.flatnonzero(((column >= 0) & (column < shape)).all(axis=1))  # ignore discs outside the cells
        cell = column[rows, 0] * shape[1] + column[rows, 1]
        order = np.argsort(cell, kind="stable")
        rows, cell = rows[order], cell[order]
        is_last = np.diff(cell, append=-1) != 0
        cells.head.reshape(-1)[cell[is_last]] = rows[is_last]
        cells.following[rows[1:]] = np.where(is_last[:-1], -1, rows[:-1])
        return cells


def _nodes(polygon: BaseGeometry, width: float, turned: bool, first: float, first_row: float) -> FloatArray:
    """Return the nodes (k, 2) of a hexagonal lattice over the bounds of a polygon, rows along x or turned along y."""
    left, bottom, right, top = polygon.bounds
    along, across = (top - bottom, right - left) if turned else (right - left, top - bottom)
    rows = np.arange(int(across / (width * math.sqrt(0.75))) + 1)
    columns = np.arange(int(along / width) + 1)
    x = first + width * (columns[None, :] + 0.5 * (rows[:, None] % 2))
    y = first_row + width * math.sqrt(0.75) * np.broadcast_to(rows[:, None], x.shape)
    plan = (y, x) if turned else (x, y)
    return np.column_stack((left + plan[0].ravel(), bottom + plan[1].ravel()))


@inner
def _is_clear(x: float, y: float, radius: float, segments: Quads, cells: _Cells) -> bool:
    """Return whether a disc overlaps neither a segment nor a disc added so far."""
    ix = math.floor((x - cells.left) / cells.size)
    iy = math.floor((y - cells.bottom) / cells.size)
    for cx in range(max(ix - 1, 0), min(ix + 2, cells.head.shape[0])):
        for cy in range(max(iy - 1, 0), min(iy + 2, cells.head.shape[1])):
            other = cells.head[cx, cy]
            while other >= 0:
                square = (x - cells.disc[other, 0]) ** 2 + (y - cells.disc[other, 1]) ** 2
                if math.sqrt(square) < radius + cells.disc[other, 2] + MARGIN:
                    return False
                other = cells.following[other]
    reach = radius + MARGIN
    for w in range(len(segments)):
        x1, y1, x2, y2 = segments[w, 0], segments[w, 1], segments[w, 2], segments[w, 3]
        if min(x1, x2) - x >= reach or x - max(x1, x2) >= reach or min(y1, y2) - y >= reach or y - max(y1, y2) >= reach:
            continue
        if segment_distance(segments, w, x, y)[0] < reach:
            return False
    return True


@kernel
def _are_clear(points: Pairs, radius: float, segments: Quads, cells: _Cells, fits: Bytes) -> None:
    """Write, for each point, whether a disc there is free of overlaps."""
    for p in range(len(points)):
        fits[p] = 1 if _is_clear(points[p, 0], points[p, 1], radius, segments, cells) else 0


@kernel
def add_discs(points: Pairs, radii: Floats, n_placed: int, n_before: int, segments: Quads, cells: _Cells) -> int:
    """Try points in turn for the next disc to be placed; return the number of placed discs."""
    for p in range(len(points)):
        if n_placed == len(radii):
            break
        x, y, radius = points[p, 0], points[p, 1], radii[n_placed]
        if _is_clear(x, y, radius, segments, cells):
            row = n_before + n_placed
            cells.disc[row, 0], cells.disc[row, 1], cells.disc[row, 2] = x, y, radius
            ix = math.floor((x - cells.left) / cells.size)
            iy = math.floor((y - cells.bottom) / cells.size)
            if 0 <= ix < cells.head.shape[0] and 0 <= iy < cells.head.shape[1]:
                cells.following[row] = cells.head[ix, iy]
                cells.head[ix, iy] = row
            n_placed += 1
    return n_placed
