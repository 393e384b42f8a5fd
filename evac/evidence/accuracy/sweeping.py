"""Accuracy, part d: an independent solution for directions with clearance from walls, by fast sweeping on a fine grid.

Solves |grad T| = s for the slowness that `build_fields` states, with the method of Zhao, "A fast sweeping method for
eikonal equations" (2005), and differentiates T centrally. Only the slowness is shared with the tested code, but not the
marching, the grid, the distances or the treatment of walls.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy import ndimage
from scipy.ndimage import map_coordinates

from evac.base.arrays import FloatArray
from evac.building.model.building import Building
from evac.directions.build import BEND
from evac.jit import FloatGrid, kernel

#: Spacing of the grid [m].
FINE = 0.00625

#: Sweeps in both directions along both axes end when no time changes by more than this [s].
STILL = 1e-9

#: Two paths meet where the gradient is smaller than this share of the slowness.
MEETING = 0.9


class CleanWays(NamedTuple):
    """Directions, and the distance to places where they are ambiguous."""

    direction: FloatArray  # (p, 2): unit vectors of the directions
    to_meeting: FloatArray  # (p,) [m]: distance to the nearest place where two equally fast paths meet


def clean_ways(building: Building, places: FloatArray, clearance: float, spacing: float = FINE) -> CleanWays:
    """Return the directions at places (p, 2) of a building whose levels do not overlap in plan, with one exit."""
    low, high = (np.array(f(building.vertices[:, :2], axis=0)) for f in (np.min, np.max))
    origin = low - 2.0 * clearance
    number = np.ceil((high + 2.0 * clearance - origin) / spacing).astype(int) + 1
    x, y = np.meshgrid(*(origin[k] + spacing * np.arange(number[k]) for k in (0, 1)), indexing="ij")
    pace = np.full(x.shape, np.inf)
    for level in building.levels:
        shapely.prepare(level.polygon)
        on_level = shapely.intersects_xy(level.polygon, x, y)
        pace[on_level] = np.minimum(pace[on_level], 1.0 / math.cos(level.slope))
    ahead, along = _beside(building.exits[0].segments[0], x, y)
    door = (ahead < 0.0) & (ahead >= -1.5 * clearance) & (along >= 0.0) & (along <= 1.0)
    pace[door] = np.minimum(pace[door], 1.0)
    distance = wall_distances(building.walls, x, y, clearance)
    slowness = pace * (1.0 + BEND * (1.0 - distance / clearance) ** 2)
    # People are out one clearance behind the exit, independent of what is there.
    cost = np.where(door & (ahead <= -clearance), 0.0, np.inf)
    sweep(cost, slowness, spacing)
    return _directions(cost, slowness, (places - origin) / spacing, spacing)


def _beside(line: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far nodes are on the left of a line [m], and how far along it, as a share of its length."""
    (x1, y1, x2, y2) = line
    length = math.hypot(x2 - x1, y2 - y1)
    ahead = ((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1)) / length
    along = ((x2 - x1) * (x - x1) + (y2 - y1) * (y - y1)) / length**2
    return ahead, along


def wall_distances(walls: FloatArray, x: FloatArray, y: FloatArray, reach: float) -> FloatArray:
    """Return the distances of the nodes of a grid to the nearest of walls (w, 4), at most `reach` [m]."""
    distances = np.full(x.shape, reach)
    for x1, y1, x2, y2 in walls:
        i = slice(*np.searchsorted(x[:, 0], [min(x1, x2) - reach, max(x1, x2) + reach]))
        j = slice(*np.searchsorted(y[0], [min(y1, y2) - reach, max(y1, y2) + reach]))
        px, py = x[i, j] - x1, y[i, j] - y1
        dx, dy = x2 - x1, y2 - y1
        share = np.clip((px * dx + py * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        distances[i, j] = np.minimum(distances[i, j], np.hypot(px - share * dx, py - share * dy))
    return distances


@kernel
def sweep(cost: FloatGrid, slowness: FloatGrid, spacing: float) -> None:
    """Lower the costs of a grid (nx, ny) to the solution; slowness is inf where nobody walks."""
    nx, ny = cost.shape
    change = math.inf
    while change > STILL:
        change = 0.0
        for turn in range(4):
            for k in range(nx):
                i = k if turn % 2 == 0 else nx - 1 - k
                for m in range(ny):
                    j = m if turn < 2 else ny - 1 - m
                    if slowness[i, j] == math.inf:
                        continue
                    a = min(cost[i - 1, j] if i > 0 else math.inf, cost[i + 1, j] if i < nx - 1 else math.inf)
                    b = min(cost[i, j - 1] if j > 0 else math.inf, cost[i, j + 1] if j < ny - 1 else math.inf)
                    low, high = min(a, b), max(a, b)
                    if low == math.inf:
                        continue
                    step = slowness[i, j] * spacing
                    new = low + step
                    if new > high:
                        new = 0.5 * (low + high + math.sqrt(2.0 * step * step - (high - low) ** 2))
                    if new < cost[i, j]:
                        change = max(change, min(cost[i, j] - new, 1.0))
                        cost[i, j] = new


def _directions(cost: FloatArray, slowness: FloatArray, cells: FloatArray, spacing: float) -> CleanWays:
    """Return descent directions at places given in cells; nobody stands within a cell of where nobody walks."""
    gradient = np.zeros((2, *cost.shape))
    reached = np.isfinite(cost)
    inner = reached.copy()
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            before, after = np.roll(cost, 1, axis=axis), np.roll(cost, -1, axis=axis)
            gradient[axis] = (after - before) / (2.0 * spacing)
            inner &= np.isfinite(before) & np.isfinite(after)
    gradient[:, ~inner] = 0.0
    meeting = np.zeros_like(inner)
    meeting[inner] = np.hypot(*gradient[:, inner]) < MEETING * slowness[inner]
    away: Any = ndimage.distance_transform_edt(~meeting) if meeting.any() else np.full(cost.shape, np.inf)
    down = -np.stack([map_coordinates(part, cells.T, order=1) for part in gradient], axis=1)
    norm = np.maximum(np.hypot(*down.T), 1e-300)[:, None]
    return CleanWays(down / norm, spacing * map_coordinates(away, cells.T, order=0))
