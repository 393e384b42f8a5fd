"""Maps of a run on a grid of square cells of each level, with densities by a Gaussian kernel."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.analysis.cells import MOST_COVERED, Covered, Densities, Grid, add_bodies
from evac.analysis.measures import FORCE_SPAN, Records, records
from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.building.model.building import Level
from evac.conditions.law import WAITING_SPEED
from evac.trajectory.trajectory import Trajectory

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
    "time_to_clear": Quantity("time to clear", "s", "time at which the last body left the place"),
    "contact_pressure": Quantity(
        "maximum contact pressure", "N/m", f"maximum contact force, mean over {FORCE_SPAN:g} s, over circumference"
    ),
    "usage": Quantity("usage", "people", "number of different people whose bodies were there"),
}


@dataclass(frozen=True)
class LevelMaps:
    """The maps of one level: arrays (ny, nx) of float64, with row 0 at the lowest y, NaN outside the floor.

    The density is rho(x) = sum_i K(x - x_i) / k_i of the people i on the level, with the kernel K(r) = exp(-r^2 / R^2)
    / (pi R^2) of Helbing, Johansson and Al-Abideen (2007), Phys. Rev. E 75, 046109. k_i is the part of the kernel of
    person i that lies on the floor, so that the integral over the level is the number of people on it. Walls inside a
    level do not limit the kernel. Speed and flow are local ones of the same source.

    Means over time use the trapezoidal rule over the recorded times. For `time_to_clear` and `usage`, bodies are
    assumed to move straight between recorded times. For the measurement methods of PedPy see
    `evac.analysis.tables.to_pedpy`.
    """

    level: str
    index: int  #: its index in ``building.levels``
    spacing: float  #: side length of the square cells of the grid [m]
    #: (2,) float64: lower left corner of the grid in plan [m]; a cell is on the floor if its centre is
    origin: FloatArray
    start: float  #: first recorded time used [s]
    end: float  #: last recorded time used [s]
    density: FloatArray  #: mean over time of rho [1/m2]
    max_density: FloatArray  #: greatest rho at a recorded time [1/m2]
    #: sum rho_i v_i / sum rho_i over times and people who have started, with v along the slope [m/s]; NaN where the
    #: density of these people is too low
    speed: FloatArray
    flow: FloatArray  #: net specific flow, the length of the mean over time of sum_i rho_i v_i, v in plan [1/(m s)]
    #: integral over time of the density of the people who wait (`evac.analysis.measures.Measures`) [s/m2]
    waiting: FloatArray
    #: time at which a body last covered the cell, inf if one does at `end`, NaN if none ever did [s]
    time_to_clear: FloatArray
    #: greatest crowd pressure, which is contact force (mean over `evac.analysis.measures.FORCE_SPAN`) over
    #: circumference as in Helbing, Farkas and Vicsek (2000), Nature 407, 487, of the bodies that covered the cell at
    #: recorded times; 0 if there was none [N/m]
    contact_pressure: FloatArray
    usage: FloatArray  #: number of different people whose bodies covered the cell

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
    densities: Mapping[int, Densities] | None = None,
    also: Callable[[Records], None] = lambda part: None,
) -> Mapping[str, LevelMaps]:
    """Compute the maps of levels, given by names or indices, with the cars of lifts that stop there; by default of all.

    `spacing` is the side of the cells [m], `kernel_radius` that of the Gaussian kernel for densities, speeds and flows
    [m]. People slower than `waiting_speed` [m/s] count as waiting. The recorded times are those from `start` to `end`
    [s]; a single one has maps of density, speed and flow. If `densities` of each level
    and these times are given, people are added to them on their grids, see `evac.analysis.congestion.Exceedance`;
    `also` gets what is measured of everybody, see `evac.analysis.queues.QueueSearch`.

    >>> maps = level_maps(evac.read_trajectory("school-result"), ["ground"])["ground"]  # doctest: +SKIP
    >>> maps.density.shape, np.nanmax(maps.max_density)  # doctest: +SKIP
    """
    for name, value in {"spacing": spacing, "kernel_radius": kernel_radius, "waiting_speed": waiting_speed}.items():
        if not 0.0 < value < math.inf:
            raise ResultError(f"{name} of a map must be greater than 0, got {value!r}")
    building = trajectory.building
    chosen = building.levels if levels is None else [one for level in levels for one in building.with_cars(level)]
    first, last = -math.inf if start is None else start, math.inf if end is None else end
    rows = np.flatnonzero((trajectory.time >= first) & (trajectory.time <= last))
    if not rows.size:
        recorded = f"{trajectory.time[0]:g} to {trajectory.time[-1]:g} s" if len(trajectory) else "nothing"
        raise ResultError(f"{trajectory.path}: no frame between {first:g} and {last:g} s; recorded: {recorded}")
    time = trajectory.time[rows]
    if densities is None:
        densities = {level.index: Densities(Grid(level, spacing, kernel_radius), time) for level in chosen}
    sums = {level.index: _Sums(level, densities[level.index], trajectory.radius) for level in chosen}
    for part in records(trajectory, rows.astype(np.int32), waiting_speed):
        also(part)
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

    def __init__(self, level: Level, densities: Densities, radius: FloatArray) -> None:
        self.level = level
        grid = densities.grid
        self._grid, self._time, self._radius, self._densities = grid, densities.time, radius, densities
        self._share = _shares(self._time)
        # All except the greatest density are linear in people, and are smoothed once at the end: density, that of
        # people who have started and their speed, flow along x and y, waiting.
        self._linear = np.zeros((6, *grid.shape))
        self._covered = Covered(
            cells=grid.shape[1],
            spacing=grid.spacing,
            origin=grid.origin,
            on_floor=grid.on_floor.ravel().view(np.uint8),
            last=np.full(grid.on_floor.size, -np.inf),
            pressure=np.zeros(grid.on_floor.size),
            visitor=np.full(grid.on_floor.size, -1, np.int32),
            visits=np.zeros(0, np.int64),
            number=0,
        )
        self._visits = np.zeros(0, np.int64)  # sorted person * cells + cell of all visits
        self._new_visits: list[NDArray[np.int64]] = []
        self._new = 0  # number of visits that are not merged

    def add(self, here: Records) -> None:
        """Add the people on the level at some recorded times."""
        share = self._share[here.frame]
        walking = share * here.started
        flow = share * here.velocity.T
        self._linear += self._grid.gathered(here.position, share, walking, walking * here.speed, *flow, here.waits)
        self._densities.add(here.frame, here.position)
        self._add_bodies(here)

    def _add_bodies(self, here: Records) -> None:
        """Add the cells that bodies cover, also between recorded times, in equal parts of at most a cell."""
        radius, spacing = self._radius[here.person], self._grid.spacing
        way = np.where((here.target == here.level)[:, None], here.after - here.position, 0.0)
        longest = np.zeros(len(self._time))
        np.maximum.at(longest, here.frame, np.linalg.norm(way, axis=1))
        parts = np.where(here.target == here.level, np.ceil(longest / spacing)[here.frame], 0.0).astype(np.int64)
        time, span = np.append(self._time[:-1], np.inf)[here.frame], np.diff(self._time, append=np.inf)[here.frame]
        columns = (
            here.person,
            radius,
            here.contact_force / (2.0 * np.pi * radius),
            here.position,
            way,
            time,
            span,
            parts,
        )
        reach, covered = int(radius.max() / spacing + 0.5), self._covered
        together = max(1, MOST_COVERED // (max(1, int(parts.max())) * (2 * reach + 1) ** 2))
        for first in range(0, len(radius), together):
            some = [np.ascontiguousarray(column[first : first + together]) for column in columns]
            covered.visits = np.empty(len(some[0]) * max(1, int(parts.max())) * (2 * reach + 1) ** 2, np.int64)
            covered.number = 0
            add_bodies(covered, *some)
            self._new_visits.append(covered.visits[: covered.number].copy())
            self._new += covered.number
            if self._new > max(MOST_COVERED, len(self._visits)):  # limits how often all visits are sorted
                self._merge_visits()

    def _merge_visits(self) -> None:
        self._visits = _distinct(np.concatenate([self._visits, *self._new_visits]))
        self._new_visits, self._new = [], 0

    def maps(self) -> LevelMaps:
        """Return the maps after all people have been added."""
        self._merge_visits()
        grid = self._grid
        cells = grid.on_floor.size
        usage = np.bincount(self._visits % cells, minlength=cells).reshape(grid.shape)
        density, started, speeds, flow_x, flow_y, waiting = grid.smoothed(self._linear)
        speed = np.full(grid.shape, np.nan)
        np.divide(speeds, started, out=speed, where=started > FEWEST)
        last = np.where(self._covered.last == -np.inf, np.nan, self._covered.last).reshape(grid.shape)

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
            max_density=on_floor(self._densities.greatest.reshape(grid.shape)),
            speed=on_floor(speed),
            flow=on_floor(np.hypot(flow_x, flow_y)),
            waiting=on_floor(waiting),
            time_to_clear=on_floor(last),
            contact_pressure=on_floor(self._covered.pressure.reshape(grid.shape)),
            usage=on_floor(usage.astype(np.float64)),
        )
