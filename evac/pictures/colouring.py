"""Colours of people in pictures: by group, or by a quantity on a colour scale."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evac.analysis.grid import Grid
from evac.analysis.maps import KERNEL_RADIUS, SPACING, WAITING_SPEED
from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.base.parameters import did_you_mean
from evac.pictures import palette
from evac.trajectory.trajectory import Frame, Trajectory

#: Quantities by which people can be coloured: labels of their scales, and names of their colours in the palette.
COLOURINGS = {
    "group": ("group", ""),
    "speed": ("speed\n[m/s]", "speed"),
    "density": ("density\n[1/m²]", "density"),
    "contact_force": ("contact force\n[kN]", "contact force"),
    "waiting": ("waited so far\n[s]", "waiting time"),
}

#: Maximum number of groups in a legend.
LEGEND_GROUPS = 24

#: Maximum number of frames that determine the top of a scale.
SAMPLES = 40


@dataclass(frozen=True)
class Colouring:
    """Colours of people in every frame."""

    of: Callable[[Frame], NDArray[np.uint8]]  # returns the colours (c, 3) uint8 of the people in a frame
    # names, colours: legend of groups; empty for quantities, for a single group and for too many
    names: tuple[str, ...]
    colours: tuple[str, ...]
    top: float | None  # upper end of the colour scale, which begins at 0; None for groups
    label: str
    scale: NDArray[np.uint8]  # (256, 3) uint8: colours of the scale; none for groups

    @property
    def has_legend(self) -> bool:
        """Whether there are entries for a legend."""
        return self.top is not None or len(self.names) > 0


def colouring(trajectory: Trajectory, colour_by: str) -> Colouring:
    """Return the colouring of people by a quantity.

    Parameters
    ----------
    trajectory : Trajectory
    colour_by : str
        One of `COLOURINGS`. Density is that of the maps at the person's position, see `evac.analysis.maps.LevelMaps`;
        waiting is the time so far at a speed below `WAITING_SPEED`.

    Raises
    ------
    ResultError
        The quantity is unknown.
    """
    if colour_by not in COLOURINGS:
        raise ResultError(f"unknown colouring {colour_by!r}; {did_you_mean(colour_by, list(COLOURINGS))}")
    label, colours = COLOURINGS[colour_by]
    if colour_by == "group":
        shades = palette.group_colours(len(trajectory.groups))
        table = np.array(palette.rgb(shades), np.uint8)
        is_told = 1 < len(trajectory.groups) <= LEGEND_GROUPS
        names = trajectory.groups if is_told else ()
        of_group = lambda frame: table[trajectory.group[frame["person"]]]  # noqa: E731
        return Colouring(of_group, names, tuple(shades[: len(names)]), None, label, table[:0])
    quantity = QUANTITIES[colour_by](trajectory)
    chosen = np.unique(np.linspace(0, len(trajectory) - 1, SAMPLES).astype(int))
    values = np.concatenate([quantity(trajectory[k]) for k in chosen.tolist()])
    top = _round_up(float(np.percentile(values, 99.0)) if values.size else 0.0)
    scale = (255.0 * palette.scale(colours)).round().astype(np.uint8)

    def of(frame: Frame) -> NDArray[np.uint8]:
        return scale[np.clip(255.0 * quantity(frame) / top, 0.0, 255.0).astype(np.int64)]

    return Colouring(of, (), (), top, label, scale)


def _speed(trajectory: Trajectory) -> Callable[[Frame], FloatArray]:
    return lambda frame: frame["speed"]


def _contact_force(trajectory: Trajectory) -> Callable[[Frame], FloatArray]:
    return lambda frame: frame["contact_force"] / 1000.0


def _density(trajectory: Trajectory) -> Callable[[Frame], FloatArray]:
    grids: dict[int, Grid] = {}

    def of(frame: Frame) -> FloatArray:
        values = np.zeros(len(frame["person"]))
        for index in np.unique(frame["level"]).tolist():
            if index not in grids:
                grids[index] = Grid(trajectory.building.levels[index], SPACING, KERNEL_RADIUS)
            here = frame["level"] == index
            position = frame["position"][here]
            values[here] = grids[index].density(position).ravel()[grids[index].cell(position)]
        return values

    return of


def _waiting(trajectory: Trajectory) -> Callable[[Frame], FloatArray]:
    waited = np.zeros((len(trajectory), trajectory.number_of_people))
    for k in range(1, len(trajectory)):
        frame = trajectory[k]
        slow = frame["person"][frame["speed"] < WAITING_SPEED]
        waited[k] = waited[k - 1]
        waited[k, slow] += trajectory.time[k] - trajectory.time[k - 1]
    return lambda frame: waited[trajectory.nearest(frame["time"]), frame["person"]]


QUANTITIES: dict[str, Callable[[Trajectory], Callable[[Frame], FloatArray]]] = {
    "speed": _speed,
    "density": _density,
    "contact_force": _contact_force,
    "waiting": _waiting,
}


def _round_up(value: float) -> float:
    """Round up to one or two significant digits, for the top of a scale."""
    if value <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return power * math.ceil(2.0 * value / power - 1e-9) / 2.0
