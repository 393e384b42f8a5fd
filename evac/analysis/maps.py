"""Maps of a run on a grid of square cells of each level, with densities by a Gaussian kernel."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.analysis.measures import FORCE_SPAN, Records, records
from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ResultError
from evac.building.model.building import Level
from evac.building.model.cells import Cells
from evac.conditions.law import WAITING_SPEED
from evac.trajectory.trajectory import Trajectory

#: Least side of a cell [m], greatest number of cells of a level, and greatest radius of the kernel [cells].
LEAST_SPACING, MOST_CELLS, MOST_KERNEL = 0.01, 10_000_000, 500

#: Where the kernel ends, in standard deviations.
TRUNCATED = 3.5

#: Number of cells whose densities are computed together.
MOST_TOGETHER = 200_000


class Grid(Cells):
    """Square cells over one level, with sides of `spacing` [m], and the kernel exp(-r^2 / R^2) / (pi R^2).

    Cells whose centre is on the floor are used: `on_floor` (ny, nx).
    """

    def __init__(self, level: Level, spacing: float, kernel_radius: float) -> None:
        _check(level, spacing, kernel_radius)
        super().__init__(level, spacing)
        self._deviation = kernel_radius / math.sqrt(2.0) / spacing  # of the kernel, in cells
        self.on_floor: NDArray[np.bool_] = shapely.contains_xy(level.polygon, *self.centres())
        # Share of the kernel around each cell that lies on the floor.
        self._kept = np.maximum(self._smooth(self.on_floor.astype(np.float64)), 0.05)

    def gathered(self, position: FloatArray, *values: FloatArray) -> FloatArray:
        """Return sum_i values_i / k_i of the points in each cell, (v, ny, nx), for `smoothed`; 1 gives a density."""
        cell = self.cell(position)
        kept = self._kept.ravel()[cell]
        return np.array([np.bincount(cell, value / kept, minlength=self._kept.size) for value in values]).reshape(
            -1, *self.shape
        )

    def smoothed(self, gathered: FloatArray) -> FloatArray:
        """Return sum_i values_i K(x - x_i) / k_i [unit of the values / m2] in every cell, (..., ny, nx); 0 off it."""
        return np.where(self.on_floor, self._smooth(gathered) / self.spacing**2, 0.0)

    def densities(
        self, frame: NDArray[np.int64], position: FloatArray
    ) -> Iterator[tuple[NDArray[np.int64], FloatArray]]:
        """Yield numbers (f,) of recorded times at which somebody is there, and the densities (f, ny, nx) [1/m2] then.

        `frame` (s,): number of the recorded time of each point, ascending; `position` (s, 2) [m].
        """
        frames, cell = np.unique(frame), self.cell(position)
        weight = 1.0 / self._kept.ravel()[cell]
        reach, together = math.ceil(TRUNCATED * self._deviation) + 1, max(1, MOST_TOGETHER // self._kept.size)
        for start in range(0, len(frames), together):
            some = frames[start : start + together]
            first, end = np.searchsorted(frame, [some[0], some[-1] + 1])
            row, column = np.divmod(cell[first:end], self.shape[1])
            # The densities of all other cells are zero.
            low_y, low_x = max(0, int(row.min()) - reach), max(0, int(column.min()) - reach)
            around = np.s_[low_y : int(row.max()) + reach + 1, low_x : int(column.max()) + reach + 1]
            shape = len(some), *self.on_floor[around].shape
            where = np.ravel_multi_index((np.searchsorted(some, frame[first:end]), row - low_y, column - low_x), shape)
            gathered = np.bincount(where, weight[first:end], minlength=math.prod(shape)).reshape(shape)
            densities = np.zeros((len(some), *self.shape))
            smooth = self._smooth(gathered.astype(np.float64, copy=False)) / self.spacing**2
            densities[:, *around] = np.where(self.on_floor[around], smooth, 0.0)
            yield some, densities

    def density_at(self, position: FloatArray) -> FloatArray:
        """Return the density of people at points (s, 2) in the cell of each of them, (s,) [1/m2]."""
        (gathered,) = self.gathered(position, np.ones(len(position)))
        density: FloatArray = self._smooth(gathered) / self.spacing**2
        return density.ravel()[self.cell(position)]  # a cell that is cut by a wall may be off the floor

    def covered(self, position: FloatArray, radius: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of bodies and covered cells of the floor: rows of `position`, and numbers of cells.

        A body covers the cells whose centres are within its `radius` (s,), and the cell that contains its centre.
        """
        ny, nx = self.shape
        # The centre of the k-th neighbour of a cell is no nearer than k - 1/2 cells.
        reach = math.floor(float(radius.max(initial=0.0)) / self.spacing + 0.5)
        steps = np.arange(-reach, reach + 1)
        own = np.floor((position - self.origin) / self.spacing).astype(np.int64)
        column = own[:, :1] + np.repeat(steps[None], steps.size, axis=0).ravel()
        row = own[:, 1:] + np.repeat(steps, steps.size)
        dx = self.origin[0] + self.spacing * (column + 0.5) - position[:, :1]
        dy = self.origin[1] + self.spacing * (row + 0.5) - position[:, 1:]
        within = (dx**2 + dy**2 <= radius[:, None] ** 2) | ((row == own[:, 1:]) & (column == own[:, :1]))
        within &= (row >= 0) & (row < ny) & (column >= 0) & (column < nx)
        which = np.flatnonzero(within)
        cell = row.ravel().take(which) * nx + column.ravel().take(which)
        there = np.flatnonzero(self.on_floor.ravel().take(cell))
        return which.take(there) // len(steps) ** 2, cell.take(there)

    def _smooth(self, values: FloatArray) -> FloatArray:
        from scipy.ndimage import gaussian_filter

        deviation = [0.0] * (values.ndim - 2) + [self._deviation] * 2
        smooth: FloatArray = gaussian_filter(values, deviation, mode="constant", truncate=TRUNCATED)
        return smooth


def _check(level: Level, spacing: float, kernel_radius: float) -> None:
    low_x, low_y, high_x, high_y = level.polygon.bounds
    least = max(LEAST_SPACING, math.sqrt((high_x - low_x) * (high_y - low_y) / MOST_CELLS))
    if not spacing >= least:
        what = f"cells of {spacing:g} m are too small or too many for level {level.name!r}"
        raise ResultError(f"spacing: {what}; use {least:.2g} m or more")
    most = MOST_KERNEL * spacing
    if not 0.0 < kernel_radius <= most:
        what = f"must be greater than 0 and at most {most:g} m with cells of {spacing:g} m"
        raise ResultError(f"kernel_radius: {what}, got {kernel_radius:g} m")


#: Distance of grid points [m].
SPACING = 0.2

#: Radius R of the Gaussian kernel exp(-r^2 / R^2) / (pi R^2) [m]: it weighs an area of 2 pi R^2 = 3.1 m2.
KERNEL_RADIUS = 0.7

#: Least kernel density, averaged over time, for a mean speed [1/m2].
FEWEST = 1e-3


#: Gets the densities of a level at recorded times.
Watch = Callable[[int, NDArray[np.int64], FloatArray], None]


class Quantity(NamedTuple):
    """The quantity of a map."""

    label: str
    unit: str
    doc: str  # definition


#: The maps, by the name of the array of `LevelMaps`.
QUANTITIES = {
    "density": Quantity("mean density", "1/m²", "mean over time of the density"),
    "max_density": Quantity("maximum density", "1/m²", "maximum density at any recorded time"),
    "speed": Quantity("mean speed", "m/s", "mean speed of people who have started, along the slope on stairs"),
    "flow": Quantity("specific flow", "1/(m s)", "mean over time of density times velocity, length of the vector"),
    "waiting": Quantity("waiting", "s/m²", f"time below {WAITING_SPEED:g} m/s after the response time, per area"),
    "time_to_clear": Quantity("time to clear", "s", "time at which the last body left the place"),
    "contact_pressure": Quantity(
        "maximum contact pressure", "N/m", f"maximum contact force, mean over {FORCE_SPAN:g} s, over circumference"
    ),
    "usage": Quantity("usage", "people", "number of different people whose bodies were there"),
}


@dataclass(frozen=True)
class LevelMaps:
    """The maps of one level: arrays (ny, nx), with row 0 at the lowest y, NaN outside the floor.

    Attributes
    ----------
    level : str
    index : int
        Its index in ``building.levels``.
    spacing : float [m]
        Side length of the square cells of the grid.
    origin : (2,) float64 [m]
        Lower left corner of the grid in plan. A cell is on the floor if its centre is.
    start, end : float [s]
        First and last recorded time used.
    density : (ny, nx) float64 [1/m2]
        Mean over time of the density rho(x) = sum_i K(x - x_i) / k_i of the people i on the level, with the kernel
        K(r) = exp(-r^2 / R^2) / (pi R^2) of Helbing, Johansson and Al-Abideen (2007), Phys. Rev. E 75, 046109. k_i is
        the part of the kernel of person i that lies on the floor, so that the integral over the level is the number
        of people on it. Walls inside a level do not limit the kernel.
    max_density : (ny, nx) float64 [1/m2]
        Greatest rho at a recorded time.
    speed : (ny, nx) float64 [m/s]
        sum rho_i v_i / sum rho_i over times and people who have started, the local speed of the same source; v is along
        the slope. NaN where the density of these people is too low.
    flow : (ny, nx) float64 [1/(m s)]
        Length of the mean over time of sum_i rho_i v_i, v in plan: the net specific flow.
    waiting : (ny, nx) float64 [s/m2]
        Integral over time of the density of the people who wait (`evac.analysis.measures.Measures`).
    time_to_clear : (ny, nx) float64 [s]
        Time at which a body last covered the cell: inf if one does at `end`, NaN if none ever did.
    contact_pressure : (ny, nx) float64 [N/m]
        Greatest crowd pressure, which is contact force (mean over `evac.analysis.measures.FORCE_SPAN`) over
        circumference as in Helbing, Farkas and Vicsek (2000), Nature 407, 487, of the bodies that covered the cell at
        recorded times; 0 if there was none.
    usage : (ny, nx) float64
        Number of different people whose bodies covered the cell.

    Notes
    -----
    Means over time use the trapezoidal rule over the recorded times. For `time_to_clear` and `usage`, bodies are
    assumed to move straight between recorded times. For the measurement methods of PedPy see
    `evac.analysis.tables.to_pedpy`.
    """

    level: str
    index: int
    spacing: float
    origin: FloatArray
    start: float
    end: float
    density: FloatArray
    max_density: FloatArray
    speed: FloatArray
    flow: FloatArray
    waiting: FloatArray
    time_to_clear: FloatArray
    contact_pressure: FloatArray
    usage: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells along y and along x."""
        ny, nx = self.density.shape
        return ny, nx

    @property
    def x(self) -> FloatArray:
        """Centres of the columns, (nx,) [m]."""
        return np.asarray(self.origin[0] + self.spacing * (np.arange(self.shape[1]) + 0.5))

    @property
    def y(self) -> FloatArray:
        """Centres of the rows, (ny,) [m]."""
        return np.asarray(self.origin[1] + self.spacing * (np.arange(self.shape[0]) + 0.5))

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top [m], for ``imshow(..., origin="lower", extent=...)``."""
        ny, nx = self.shape
        x, y = self.origin.tolist()
        return x, x + self.spacing * nx, y, y + self.spacing * ny

    def array(self, name: str) -> FloatArray:
        """Return the map of one of the `QUANTITIES` by its name.

        Raises
        ------
        ResultError
            The quantity is unknown.
        """
        if name not in QUANTITIES:
            raise ResultError(f"unknown map {name!r}; use one of {', '.join(QUANTITIES)}")
        values: FloatArray = getattr(self, name)
        return values

    def __repr__(self) -> str:
        ny, nx = self.shape
        return f"LevelMaps({self.level!r}, {ny} x {nx} cells of {self.spacing:g} m, {self.start:g} to {self.end:g} s)"


def level_maps(
    trajectory: Trajectory,
    levels: Iterable[str | int] | None = None,
    *,
    spacing: float = SPACING,
    kernel_radius: float = KERNEL_RADIUS,
    waiting_speed: float = WAITING_SPEED,
    start: float | None = None,
    end: float | None = None,
    watch: Watch | None = None,
) -> Mapping[str, LevelMaps]:
    """Compute the maps of levels.

    Parameters
    ----------
    trajectory : Trajectory
    levels : iterable of str or int, optional
        Names or indices of levels; by default all.
    spacing : float [m]
        Side length of the cells.
    kernel_radius : float [m]
        Radius R of the Gaussian kernel for densities, speeds and flows.
    waiting_speed : float [m/s]
        People slower than this count as waiting.
    start, end : float [s], optional
        Use only the recorded times from `start` to `end`. With a single recorded time, maps of density, speed and flow
        are those at that time.
    watch : callable, optional
        Gets the index of a level, numbers of recorded times (f,) and the densities then, (f, ny, nx) [1/m2].

    Examples
    --------
    >>> maps = level_maps(evac.read_trajectory("school-result"), ["ground"])["ground"]  # doctest: +SKIP
    >>> maps.density.shape, np.nanmax(maps.max_density)  # doctest: +SKIP
    """
    for name, value in {"spacing": spacing, "kernel_radius": kernel_radius, "waiting_speed": waiting_speed}.items():
        if not 0.0 < value < math.inf:
            raise ResultError(f"{name} of a map must be greater than 0, got {value!r}")
    building = trajectory.building
    chosen = [building.level_at(level) for level in (range(len(building.levels)) if levels is None else levels)]
    first, last = -math.inf if start is None else start, math.inf if end is None else end
    rows = np.flatnonzero((trajectory.time >= first) & (trajectory.time <= last))
    if not rows.size:
        recorded = f"{trajectory.time[0]:g} to {trajectory.time[-1]:g} s" if len(trajectory) else "nothing"
        raise ResultError(f"{trajectory.path}: no frame between {first:g} and {last:g} s; recorded: {recorded}")
    time = trajectory.time[rows]
    sums = {
        level.index: _Sums(Grid(level, spacing, kernel_radius), level, time, trajectory.radius, watch)
        for level in chosen
    }
    for part in records(trajectory, rows.astype(np.int32), waiting_speed):
        for index, here in part.by_level():
            if index in sums:
                sums[index].add(here)
    return {total.level.name: total.maps() for total in sums.values()}


def _shares(time: FloatArray) -> FloatArray:
    """Return the weight of each recorded time in means over time."""
    if time[-1] == time[0]:
        return np.ones(len(time))
    edges = np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]])
    shares: FloatArray = np.diff(edges) / (time[-1] - time[0])
    return shares


def _distinct(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the distinct ones of values >= 0, sorted; ten times faster than `numpy.unique`, which hashes them."""
    ordered = np.sort(values)
    return ordered.take(np.flatnonzero(np.diff(ordered, prepend=-1)))


class _Sums:
    """Sums over the recorded times for the maps of one level."""

    def __init__(self, grid: Grid, level: Level, time: FloatArray, radius: FloatArray, watch: Watch | None) -> None:
        self.level = level
        self._grid, self._time, self._radius, self._watch = grid, time, radius, watch
        self._share = _shares(time)
        # All except the greatest density are linear in people, and are smoothed once at the end: density, that of
        # people who have started and their speed, flow along x and y, waiting.
        self._linear = np.zeros((6, *grid.shape))
        self._max_density = np.zeros(grid.shape)
        self._last = np.full(grid.on_floor.size, -np.inf)
        self._pressure = np.zeros(grid.on_floor.size)
        self._visits = np.zeros(0, np.int64)  # sorted person * cells + cell of all visits
        self._new_visits: list[NDArray[np.int64]] = []
        self._new = 0  # number of visits that are not merged

    def add(self, here: Records) -> None:
        """Add the people on the level at some recorded times."""
        share = self._share[here.frame]
        walking = share * here.started
        flow = share * here.velocity.T
        self._linear += self._grid.gathered(here.position, share, walking, walking * here.speed, *flow, here.waits)
        for frames, densities in self._grid.densities(here.frame, here.position):
            np.maximum(self._max_density, densities.max(axis=0), out=self._max_density)
            if self._watch is not None:
                self._watch(self.level.index, frames, densities)
        body, cell = self._grid.covered(here.position, self._radius[here.person])
        pressure = here.contact_force / (2.0 * np.pi * self._radius[here.person])
        np.maximum.at(self._pressure, cell, pressure[body])
        time = np.append(self._time[:-1], np.inf)[here.frame]
        self._visit(here.person[body], cell, time[body])
        self._add_ways(here)

    def _add_ways(self, here: Records) -> None:
        """Add the cells that bodies covered between recorded times, in equal parts of at most a cell."""
        rows = np.flatnonzero(here.target == here.level)
        if not rows.size:
            return
        frame, person, start = here.frame[rows], here.person[rows], here.position.take(rows, 0)
        way = here.after.take(rows, 0) - start
        longest = np.zeros(len(self._time))
        np.maximum.at(longest, frame, np.linalg.norm(way, axis=1))
        parts = np.ceil(longest / self._grid.spacing)[frame]
        span = np.diff(self._time, append=np.inf)[frame]
        for part in range(1, int(parts.max())):
            moves = np.flatnonzero(parts > part)
            share = part / parts[moves]
            body, cell = self._grid.covered(
                start.take(moves, 0) + share[:, None] * way.take(moves, 0), self._radius[person[moves]]
            )
            time = self._time[frame[moves]] + share * span[moves]
            self._visit(person[moves][body], cell, time[body])

    def _visit(self, person: IntArray, cell: NDArray[np.int64], time: FloatArray) -> None:
        """Record that people cover cells at times."""
        np.maximum.at(self._last, cell, time)
        self._new_visits.append(_distinct(person * np.int64(self._last.size) + cell))
        self._new += len(self._new_visits[-1])
        if self._new > max(1_000_000, len(self._visits)):  # limits how often all visits are sorted
            self._merge_visits()

    def _merge_visits(self) -> None:
        self._visits = _distinct(np.concatenate([self._visits, *self._new_visits]))
        self._new_visits, self._new = [], 0

    def maps(self) -> LevelMaps:
        """Return the maps after all people have been added."""
        self._merge_visits()
        grid = self._grid
        usage = np.bincount(self._visits % self._last.size, minlength=self._last.size).reshape(grid.shape)
        density, started, speeds, flow_x, flow_y, waiting = grid.smoothed(self._linear)
        speed = np.full(grid.shape, np.nan)
        np.divide(speeds, started, out=speed, where=started > FEWEST)
        last = np.where(self._last == -np.inf, np.nan, self._last).reshape(grid.shape)

        def on_floor(values: FloatArray) -> FloatArray:
            return np.where(grid.on_floor, values, np.nan)

        return LevelMaps(
            level=self.level.name,
            index=self.level.index,
            spacing=grid.spacing,
            origin=grid.origin,
            start=float(self._time[0]),
            end=float(self._time[-1]),
            density=on_floor(density),
            max_density=on_floor(self._max_density),
            speed=on_floor(speed),
            flow=on_floor(np.hypot(flow_x, flow_y)),
            waiting=on_floor(waiting),
            time_to_clear=on_floor(last),
            contact_pressure=on_floor(self._pressure.reshape(grid.shape)),
            usage=on_floor(usage.astype(np.float64)),
        )
