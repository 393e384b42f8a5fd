"""Congestion: places where a crowd is denser than a threshold for longer than a time."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from evac.analysis.cells import Densities, Grid
from evac.analysis.maps import KERNEL_RADIUS, SPACING
from evac.analysis.measures import records
from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.building.model.building import Building, Exit, Level, Portal
from evac.trajectory.trajectory import Trajectory

#: Threshold of the density [1/m2], and share of the evacuation time for which it must be exceeded, from
#: MSC.1/Circ.1533 of the IMO (2016) for advanced analyses.
DENSITY = 4.0
SHARE = 0.1


@dataclass(frozen=True)
class CongestedPlace:
    """A connected part of a level that was congested."""

    level: str
    near: str  # name of the nearest portal or exit of the level, empty if it has none
    x: float  # centre of the cells in which the threshold was exceeded longest [m]
    y: float
    area: float  # area of the cells in which the threshold was exceeded for longer than the least time [m2]
    density: float  # greatest density in these cells [1/m2]
    start: float  # first recorded time at which the threshold was exceeded in one of these cells [s]
    end: float  # the last one [s]
    duration: float  # greatest total time for which it was exceeded in one cell [s]
    longest_spell: float  # greatest uninterrupted time for which it was exceeded in one cell [s]


@dataclass(frozen=True)
class Congestion:
    """Congested places of a run, and the criteria."""

    density: float  # [1/m2]
    least_time: float  # [s]
    places: tuple[CongestedPlace, ...]  # sorted by duration, the longest first
    longest: float  # greatest total time for which the threshold was exceeded in any cell; 0 if it never was [s]
    greatest_density: float  # greatest density at any recorded time [1/m2]


def find_congestion(
    trajectory: Trajectory, density: float = DENSITY, least_time: float | None = None, *, spacing: float = SPACING
) -> Congestion:
    """Find places where the density exceeded a threshold [1/m2] for longer than a time [s], by default `SHARE` of the
    record.

    The density is that of `evac.analysis.maps.LevelMaps` in cells of a spacing [m]. Its value at a recorded time is
    used until the next one. Times may have interruptions, and cells that touch, also at corners, form one place.

    >>> find_congestion(evac.read_trajectory("school-result"), 4.0, 10.0).places  # doctest: +SKIP
    """
    watched = Exceedance(trajectory, density, spacing)
    for part in records(trajectory):
        for index, here in part.by_level():
            watched.densities[index].add(here.frame, here.position)
    return watched.congestion(least_time)


class Exceedance:
    """Where densities exceed a threshold, once people at all times are added to the `densities` of each level."""

    def __init__(self, trajectory: Trajectory, density: float = DENSITY, spacing: float = SPACING) -> None:
        if not 0.0 < density < math.inf:
            raise ResultError(f"the density of congestion must be greater than 0, got {density!r}")
        if not len(trajectory):
            raise ResultError(f"{trajectory.path}: no frame was recorded; the run ended before its first output")
        self.trajectory, self._density = trajectory, density
        self.densities = {
            level.index: Densities(Grid(level, spacing, KERNEL_RADIUS), trajectory.time, density)
            for level in trajectory.building.levels
        }

    def congestion(self, least_time: float | None = None) -> Congestion:
        """Return the places that were congested for longer than a time [s]; see `find_congestion`."""
        if least_time is not None and not 0.0 <= least_time < math.inf:
            raise ResultError(f"the time of congestion must be at least 0, got {least_time!r}")
        if least_time is None:
            least_time = SHARE * float(self.trajectory.time[-1] - self.trajectory.time[0])
        places = [place for level in self.trajectory.building.levels for place in self._places(level, least_time)]
        return Congestion(
            density=self._density,
            least_time=least_time,
            places=tuple(sorted(places, key=lambda place: -place.duration)),
            longest=max(float(level.total.max()) for level in self.densities.values()),
            greatest_density=max(float(level.greatest.max()) for level in self.densities.values()),
        )

    def _places(self, level: Level, least_time: float) -> Iterator[CongestedPlace]:
        """Yield the connected places in which the threshold was exceeded for longer than the least time."""
        from scipy.ndimage import label

        own = self.densities[level.index]
        grid, total = own.grid, own.total.reshape(own.grid.shape)
        parts, count = label(total > least_time, np.ones((3, 3)))
        for part in range(1, count + 1):
            inside = np.flatnonzero(parts == part)
            duration = float(own.total[inside].max())
            row, column = np.nonzero((parts == part) & (total == duration))
            centre = grid.origin + grid.spacing * (np.array([column.mean(), row.mean()]) + 0.5)
            yield CongestedPlace(
                level=level.title,
                near=_nearest(self.trajectory.building, level, centre),
                x=float(centre[0]),
                y=float(centre[1]),
                area=len(inside) * grid.spacing**2,
                density=float(own.greatest[inside].max()),
                start=float(own.time[own.first[inside].min()]),
                end=float(own.end[own.last[inside].max()]),
                duration=duration,
                longest_spell=float(own.longest[inside].max()),
            )


def _nearest(building: Building, level: Level, point: FloatArray) -> str:
    """Return the name of the portal or exit of a level that is nearest to a point, but for portals within a stair."""
    links: list[Portal | Exit] = [*building.portals_of(level.index), *building.exits_of(level.index)]
    links = [link for link in links if len({building.levels[k].title for k in link.levels}) == len(link.levels)]
    place = shapely.Point(point)
    lines = [shapely.multilinestrings([s.reshape(2, 2) for s in link.segments]) for link in links]
    distances = [line.distance(place) for line in lines]
    return links[int(np.argmin(distances))].name if links else ""
