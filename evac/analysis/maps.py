"""Maps of a run: density, speed, flow, waiting, time to clear, contact pressure and usage on a grid of each level."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.analysis.grid import Grid
from evac.analysis.measures import FORCE_SPAN, WAITING_SPEED, Measures, Measuring
from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ResultError
from evac.building.model.building import Level
from evac.building.model.storeys import level_of
from evac.trajectory.trajectory import Frame, Trajectory

#: Distance of grid points [m].
SPACING = 0.2

#: Radius R of the Gaussian kernel exp(-r^2 / R^2) / (pi R^2) [m]: it weighs an area of 2 pi R^2 = 3.1 m2.
KERNEL_RADIUS = 0.7

#: Least kernel density, averaged over time, for a mean speed [1/m2].
FEWEST = 1e-3


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
    "time_to_clear": Quantity("time to clear", "s", "time at which the last body was there"),
    "contact_pressure": Quantity(
        "maximum contact pressure", "N/m", f"maximum contact force, mean over {FORCE_SPAN:g} s, over circumference"
    ),
    "usage": Quantity("usage", "people", "number of different people whose bodies passed"),
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
    `evac.analysis.pedpy_data.to_pedpy`.
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

    Returns
    -------
    mapping of str to LevelMaps
        Maps by the name of the level.

    Raises
    ------
    ResultError
        A level does not exist, `spacing` or another parameter is not positive, or no frame lies between `start` and
        `end`.

    Examples
    --------
    >>> maps = level_maps(evac.read_trajectory("school-result"), ["ground"])["ground"]  # doctest: +SKIP
    >>> maps.density.shape, np.nanmax(maps.max_density)  # doctest: +SKIP
    """
    for name, value in {"spacing": spacing, "kernel_radius": kernel_radius, "waiting_speed": waiting_speed}.items():
        if not 0.0 < value < math.inf:
            raise ResultError(f"{name} of a map must be greater than 0, got {value!r}")
    building = trajectory.building
    chosen = [level_of(building, level) for level in (range(len(building.levels)) if levels is None else levels)]
    first, last = -math.inf if start is None else start, math.inf if end is None else end
    rows = np.flatnonzero((trajectory.time >= first) & (trajectory.time <= last))
    if not rows.size:
        recorded = f"{trajectory.time[0]:g} to {trajectory.time[-1]:g} s" if len(trajectory) else "nothing"
        raise ResultError(f"{trajectory.path}: no frame between {first:g} and {last:g} s; recorded: {recorded}")
    time = trajectory.time[rows]
    sums = {level.index: _Sums(Grid(level, spacing, kernel_radius)) for level in chosen}
    measuring = Measuring(trajectory.number_of_people, waiting_speed)
    for now, after, share in _steps(trajectory, rows.astype(np.int32)):
        found = measuring.add(now["time"], now["person"], now["speed"], now["started"], now["contact_force"])
        for index, total in sums.items():
            total.add_people(now, index, share, found)
            total.add_bodies(now, after, index, trajectory.radius, found.contact_force)
    return {level.name: sums[level.index].maps(level, time) for level in chosen}


def _steps(trajectory: Trajectory, rows: IntArray) -> Iterator[tuple[Frame, Frame | None, float]]:
    """Yield each frame, the next one or None, and its weight in means over time."""
    time = trajectory.time[rows]
    shares = np.ones(1)
    if time[-1] > time[0]:
        edges = np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]])
        shares = np.diff(edges) / (time[-1] - time[0])
    after: Frame | None = None
    later = (trajectory[row] for row in rows.tolist())
    now = next(later)
    for share in shares.tolist():
        after = next(later, None)
        yield now, after, share
        now = after if after is not None else now


class _Sums:
    """Sums over the frames for the maps of one level."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        cells = grid.shape[0] * grid.shape[1]
        # All except the greatest density are linear in people, and are smoothed once at the end.
        self.density, self.started, self.max_density, self.speed, self.waiting = np.zeros((5, *grid.shape))
        self.flow = np.zeros((2, *grid.shape))
        self.last = np.full(cells, np.nan)
        self.pressure = np.zeros(cells)
        self.visits = np.zeros(0, np.int64)  # sorted person * cells + cell of all visits
        self._new_visits: list[NDArray[np.int64]] = []
        self._new = 0  # number of visits that are not merged

    def add_people(self, frame: Frame, level: int, share: float, found: Measures) -> None:
        """Add one frame to the maps of densities."""
        here = frame["level"] == level
        if not here.any():
            return
        gathered = self.grid.gathered
        position, started = frame["position"][here], found.started[here]
        density = gathered(position)
        np.maximum(self.max_density, self.grid.smoothed(density), out=self.max_density)
        self.density += share * density
        self.started += share * gathered(position[started])
        self.speed += share * gathered(position[started], found.speed[here][started])
        for axis in range(2):
            self.flow[axis] += share * gathered(position, frame["velocity"][here, axis])
        self.waiting += gathered(position, found.waits[here])

    def add_bodies(
        self, now: Frame, after: Frame | None, level: int, radius: FloatArray, contact_force: FloatArray
    ) -> None:
        """Add the cells covered by the bodies in one frame and between it and the next one."""
        here = np.flatnonzero(now["level"] == level)
        if not here.size:
            return
        person, position = now["person"][here], now["position"][here]
        body, cell = self.grid.covered(position, radius[person])
        pressure = contact_force[here] / (2.0 * np.pi * radius[person])
        np.maximum.at(self.pressure, cell, pressure[body])
        self._visit(person[body], cell, np.inf if after is None else now["time"])
        if after is None:
            return
        stays, first, second = np.intersect1d(
            person, after["person"][after["level"] == level], assume_unique=True, return_indices=True
        )
        if not stays.size:
            return
        source, target = position[first], after["position"][after["level"] == level][second]
        parts = math.ceil(float(np.linalg.norm(target - source, axis=1).max()) / self.grid.spacing)
        for part in range(1, parts):
            between = source + (part / parts) * (target - source)
            body, cell = self.grid.covered(between, radius[stays])
            self._visit(stays[body], cell, now["time"] + (part / parts) * (after["time"] - now["time"]))

    def _visit(self, person: IntArray, cell: NDArray[np.int64], time: float) -> None:
        """Record that people cover cells at a time."""
        self.last[cell] = time
        self._new_visits.append(np.unique(person * np.int64(self.last.size) + cell))
        self._new += len(self._new_visits[-1])
        if self._new > max(1_000_000, len(self.visits)):  # limits how often all visits are sorted
            self._merge_visits()

    def _merge_visits(self) -> None:
        self.visits = np.unique(np.concatenate([self.visits, *self._new_visits]))
        self._new_visits, self._new = [], 0

    def maps(self, level: Level, time: FloatArray) -> LevelMaps:
        """Return the maps after all frames have been added; `time` are their times [s]."""
        self._merge_visits()
        grid = self.grid
        usage = np.bincount(self.visits % self.last.size, minlength=self.last.size).reshape(grid.shape)
        started, speed = grid.smoothed(self.started), np.full(grid.shape, np.nan)
        np.divide(grid.smoothed(self.speed), started, out=speed, where=started > FEWEST)

        def on_floor(values: FloatArray) -> FloatArray:
            return np.where(grid.on_floor, values, np.nan)

        return LevelMaps(
            level=level.name,
            index=level.index,
            spacing=grid.spacing,
            origin=grid.origin,
            start=float(time[0]),
            end=float(time[-1]),
            density=on_floor(grid.smoothed(self.density)),
            max_density=on_floor(self.max_density),
            speed=on_floor(speed),
            flow=on_floor(np.hypot(grid.smoothed(self.flow[0]), grid.smoothed(self.flow[1]))),
            waiting=on_floor(grid.smoothed(self.waiting)),
            time_to_clear=on_floor(self.last.reshape(grid.shape)),
            contact_pressure=on_floor(self.pressure.reshape(grid.shape)),
            usage=on_floor(usage.astype(np.float64)),
        )
