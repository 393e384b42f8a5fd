"""Colours of people in pictures: by group, or by a quantity on a colour scale."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from evac.analysis.grid import Grid
from evac.analysis.maps import KERNEL_RADIUS, SPACING
from evac.analysis.measures import Measuring
from evac.base.arrays import FloatArray
from evac.base.errors import ResultError, in_order
from evac.base.parameters import did_you_mean
from evac.pictures import palette
from evac.pictures.scales import PEOPLE, Scale
from evac.trajectory.trajectory import Frame, Trajectory

#: What people can be coloured by.
COLOURINGS = ("group", *PEOPLE)

#: Extinction coefficient of air that is as good as clear [1/m].
CLEAR = 1e-6

#: Maximum number of groups in a legend.
LEGEND_GROUPS = 24


@dataclass(frozen=True)
class Colouring:
    """Colours of people in every frame."""

    of: Callable[[Frame], NDArray[np.uint8]]  # colours (c, 3, 3) of body, head and belt of the people in a frame
    legend: tuple[tuple[str, palette.Look], ...] = ()  # groups; empty for quantities, a single group and alike ones
    scale: Scale | None = None  # None for groups
    top: float = 0.0  # upper end of the scale

    @property
    def has_legend(self) -> bool:
        """Whether there are entries for a legend in a picture, and not too many."""
        return self.scale is not None or 0 < len(self.legend) <= LEGEND_GROUPS


def colouring(trajectory: Trajectory, colour_by: str, service: str = "") -> Colouring:
    """Return the colouring of people by a quantity."""
    if colour_by not in COLOURINGS:
        raise ResultError(f"unknown colouring {colour_by!r}; {did_you_mean(colour_by, COLOURINGS)}")
    if colour_by == "group":
        looks = palette.group_looks(len(trajectory.groups))
        table = np.array([palette.rgb(look) for look in looks], np.uint8)
        is_told = 1 < len(trajectory.groups) == len({*looks[:-1]})
        legend = in_order(zip(trajectory.groups, looks, strict=False), itemgetter(0)) if is_told else ()
        return Colouring(lambda frame: table[trajectory.group[frame["person"]]], tuple(legend))
    scale = PEOPLE[colour_by].with_service(service)
    quantity, most = _quantity(trajectory, colour_by)
    top = scale.end(most)

    def of(frame: Frame) -> NDArray[np.uint8]:
        return np.repeat(scale.colours_of(quantity(frame), top)[:, None], 3, axis=1)

    return Colouring(of, scale=scale, top=top)


def _quantity(trajectory: Trajectory, name: str) -> tuple[Callable[[Frame], FloatArray], float]:
    """Return a function that gives a quantity of the people of a frame, and the greatest value of those without end."""
    if name == "dose":
        return lambda frame: frame["dose"], 0.0
    if name == "density":
        return _density(trajectory), 0.0
    if name in (palette.SMOKE, "visibility"):
        smoke, greatest = _smoke(trajectory)
        if name == "visibility":
            return lambda frame: trajectory.contrast / np.maximum(smoke(frame), CLEAR), 0.0
        return smoke, greatest
    measuring, column = Measuring(trajectory.number_of_people), {"waiting": "waited"}.get(name, name)
    found: list[FloatArray] = []
    for frame in (trajectory[k] for k in range(len(trajectory))):
        given = frame["time"], frame["person"], frame["speed"], frame["started"], frame["contact_force"]
        found.append(getattr(measuring.add(*given), column))
    most = max((float(values.max(initial=0.0)) for values in found), default=0.0)
    return lambda frame: found[trajectory.nearest(frame["time"])], most


def _density(trajectory: Trajectory) -> Callable[[Frame], FloatArray]:
    @cache
    def grid(level: int) -> Grid:
        return Grid(trajectory.building.levels[level], SPACING, KERNEL_RADIUS)

    def of(frame: Frame) -> FloatArray:
        values = np.zeros(len(frame["person"]))
        for level in np.unique(frame["level"]).tolist():
            here = frame["level"] == level
            values[here] = grid(level).density_at(frame["position"][here])
        return values

    return of


def _smoke(trajectory: Trajectory) -> tuple[Callable[[Frame], FloatArray], float]:
    """Return a function that gives the recorded extinction coefficient where people are; 0 if none was recorded."""
    if palette.SMOKE not in [field.name for field in trajectory.level_fields]:
        return lambda frame: np.zeros(len(frame["person"])), 0.0
    greatest = float(trajectory.field(palette.SMOKE).values.max(initial=0.0))
    return partial(trajectory.field_at_people, palette.SMOKE), greatest
