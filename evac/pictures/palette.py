"""Colours of all pictures and of the replay: groups, exits, walls, and scales of quantities of people and of maps."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.analysis.cells import Grid
from evac.analysis.maps import KERNEL_RADIUS, QUANTITIES, SPACING
from evac.analysis.measures import Measuring
from evac.base.arrays import FloatArray
from evac.base.errors import ResultError, in_order
from evac.base.parameters import did_you_mean
from evac.trajectory.trajectory import Frame, Trajectory

#: Colours of groups in their order, distinguished with any kind of colour vision: those of Okabe and Ito (2008,
#: https://jfly.uni-koeln.de/color), without yellow and black, which have too little contrast to floors and walls; then
#: a dark blue and a dark red.
GROUPS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7", "#004a75", "#7a0019")

#: Colours of heads and of belts that distinguish groups of one colour.
MARKS = ("#ffffff", "#000000")
NO_GROUP = "#6b7280"

#: Colour of people of whom a logarithmic scale has no value, because there is less than its lower end.
NOTHING = "#a9b2bd"

LEVELS = {"floor": "#e7ebf0", "flight": "#f3cf95", "landing": "#f7e2bf", "car": "#d3dcf2"}
WALL, EDGE, TEXT, FURNITURE = "#c3cad3", "#6b7785", "#1f2933", "#d9bf9b"
EXIT, CLOSED, PORTAL = "#0b7a3c", "#b3261e", "#6b7785"

#: Colours of the places of a case, by their kinds.
PLACES = {"refuge": "#1f5fa8", "assembly": EXIT, "sign": EXIT, "line": "#7a3b9c", "fire": "#c2410c"}


#: Colour of the cars of lifts.
CAR = "#1f5fa8"

#: Colours of verdicts, by their status.
VERDICTS = {"green": "#0b6b35", "amber": "#9a6700", "red": CLOSED, "none": EDGE}

#: Colour map of each quantity. All are perceptually uniform and suitable for colour-blind people.
RAMPS = {
    "speed": "viridis",
    "density": "plasma",
    "contact force": "plasma",
    "waiting time": "cividis",
    "smoke": "greys",
}


#: Name of the field of smoke that a trajectory may have; and depth of smoke through which a floor is seen [m]: the veil
#: hides 1 - exp(-K depth) of it.
SMOKE, DEPTH = "extinction", 0.5

#: Colours at equal distances along each map, to be interpolated (from matplotlib).
STOPS = {
    "viridis": ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"],
    "cividis": ["#00224e", "#1a386f", "#434e6c", "#61656f", "#7d7c78", "#9b9476", "#bcae6c", "#dec958", "#fee838"],
    "greys": ["#d9d4cd", "#24211e"],
    "plasma": ["#0d0887", "#4c02a1", "#7e03a8", "#aa2395", "#cc4778", "#e66c5c", "#f89540", "#fdc527", "#f0f921"],
}


def ramp_of(quantity: str) -> FloatArray:
    """Return one of the colour maps `RAMPS`, (256, 3) with numbers from 0 to 1."""
    stops = np.array(rgb(STOPS[RAMPS[quantity]])) / 255.0
    at = np.linspace(0.0, len(stops) - 1.0, 256)
    return np.column_stack([np.interp(at, np.arange(len(stops)), channel) for channel in stops.T])


class Look(NamedTuple):
    """Colours of the body, the head and the belt of people."""

    body: str
    head: str
    belt: str


def group_looks(count: int) -> list[Look]:
    """Return the looks of `count` groups, of which the first 72 differ, and last that of people without group."""
    kinds = len(MARKS) + 1

    def look(k: int) -> Look:
        body, turn = GROUPS[k % len(GROUPS)], k // len(GROUPS)
        own = (body, *MARKS)
        return Look(body, own[turn % kinds], own[turn // kinds % kinds])

    return [*map(look, range(count)), Look(NO_GROUP, NO_GROUP, NO_GROUP)]


def group_colours(count: int) -> list[str]:
    """Return the colour of the body for each of `count` groups, and last that of people without group."""
    return [look.body for look in group_looks(count)]


def rgb(colours: Sequence[str]) -> list[tuple[int, int, int]]:
    """Convert colours ``#rrggbb`` to numbers from 0 to 255."""
    return [(int(c[1:3], 16), int(c[3:5], 16), int(c[5:7], 16)) for c in colours]


MOST_VALUES = 0.99  #: Share of the values of a map that the upper end of its scale is above, if the table has none.


class Service(NamedTuple):
    """Levels of service: densities at which one ends and the next begins [1/m2], and their letters."""

    source: str
    edges: tuple[float, ...]
    letters: str


#: Levels of service of walkways. Those of Fruin are areas of 35, 25, 15, 10 and 5 square feet per person.
SERVICES = {
    "fruin": Service(
        "Fruin (1971), walkways", tuple(round(1.0 / (0.3048**2 * area), 2) for area in (35, 25, 15, 10, 5)), "ABCDEF"
    ),
    "weidmann": Service("Weidmann (1993)", (0.1, 0.3, 0.45, 0.6, 0.75, 1.0, 1.5, 2.0), "ABCDEFGHI"),
}

DENSITY_TOP = 5.0  #: Upper end of scales of densities [1/m2].


@dataclass(frozen=True)
class Scale:
    """A colour scale, from 0, or from `least` if it is logarithmic; values below `least` have a neutral colour."""

    label: str
    unit: str
    colours: str  # name of the colour map
    top: float | None = None  # upper end; None: a round number, from the values
    is_veiled: bool = False  # whether low values let the floor show through
    is_logarithmic: bool = False
    least: float = 0.0
    service: str = ""  # name of the levels of service that replace its colours

    def with_service(self, service: str) -> "Scale":
        """Return the scale of a density with levels of service, and other scales as they are."""
        if service and service not in SERVICES:
            raise ResultError(f"unknown levels of service {service!r}; {did_you_mean(service, list(SERVICES))}")
        if self.unit != "1/m²" or not service:
            return self
        return Scale(self.label, self.unit, self.colours, DENSITY_TOP, service=service)

    def end(self, most: float) -> float:
        """Return the upper end of the scale for values of which `most` is the greatest, or a high one."""
        return self.top or round_up(most)

    def share(self, values: FloatArray, top: float) -> FloatArray:
        """Return where values are on the scale, from 0 to 1."""
        if self.is_logarithmic:
            values = np.log(np.maximum(values, self.least) / self.least)
            top = math.log(top / self.least)
        return np.clip(values / top, 0.0, 1.0)

    def ramp(self) -> FloatArray:
        """Return the colours of the scale, (256, 3) with numbers from 0 to 1."""
        colours = ramp_of(self.colours)
        if not self.service:
            return colours
        edges = SERVICES[self.service].edges
        band = np.searchsorted(edges, np.linspace(0.0, DENSITY_TOP, 256), "right")
        bands: FloatArray = colours[np.rint(255.0 * band / len(edges)).astype(int)]
        return bands

    def colours_of(self, values: FloatArray, top: float) -> NDArray[np.uint8]:
        """Return the colours of values, (n, 3); those below `least` have a neutral one."""
        colours = (255.0 * self.ramp()).round().astype(np.uint8)[(255.0 * self.share(values, top)).astype(np.int64)]
        colours[values < self.least] = rgb([NOTHING])[0]
        return colours

    @property
    def below(self) -> str:
        """What the neutral colour means, empty without one."""
        return f"below {self.least:g} {self.unit}".strip() if self.least else ""

    def ticks(self, top: float) -> list[tuple[float, str]]:
        """Return where ticks are, from 0 to 1, and their texts."""
        if self.service:
            service = SERVICES[self.service]
            lower = (0.0, *service.edges)
            return [(edge / top, f"{letter} {edge:g}") for letter, edge in zip(service.letters, lower, strict=True)]
        if self.is_logarithmic:
            decades = math.floor(math.log10(top / self.least) + 1e-9)
            values = [self.least * 10.0**k for k in range(decades + 1)]
        else:
            step = 10.0 ** math.floor(math.log10(top / 3.0))
            step = next(step * k for k in (1.0, 2.0, 5.0, 10.0) if top / (step * k) <= 6.0)
            step = max(1.0, step) if self.unit == "people" else step
            values = [step * k for k in range(int(top / step + 1e-9) + 1)]
        return list(zip(self.share(np.array(values), top).tolist(), (f"{value:g}" for value in values), strict=True))


#: Scales of people, by quantity.
PEOPLE = {
    "speed": Scale("speed", "m/s", "speed", 2.0),
    "density": Scale("density", "1/m²", "density", DENSITY_TOP),
    "contact_force": Scale("contact force", "N", "contact force", 10_000.0, is_logarithmic=True, least=10.0),
    "waiting": Scale("waited so far", "s", "waiting time", least=1.0),
    "dose": Scale("dose", "", "contact force", 1.0, least=0.01),
    "extinction": Scale("smoke at heads", "1/m", "smoke"),
    "visibility": Scale("visibility", "m", "speed", 30.0),
}


def _of_map(name: str, colours: str, top: float | None = None, **kind: Any) -> Scale:
    return Scale(QUANTITIES[name].label, QUANTITIES[name].unit, colours, top, **kind)


#: Scales of maps, by quantity.
MAPS = {
    "density": _of_map("density", "density", is_veiled=True),
    "max_density": _of_map("max_density", "density", DENSITY_TOP, is_veiled=True),
    "speed": _of_map("speed", "speed", 2.0),
    "flow": _of_map("flow", "density", is_veiled=True),
    "waiting": _of_map("waiting", "waiting time", is_veiled=True),
    "time_to_clear": _of_map("time_to_clear", "waiting time"),
    "contact_pressure": _of_map("contact_pressure", "contact force", 10_000.0, is_logarithmic=True, least=10.0),
    "usage": _of_map("usage", "density"),
}


def high_value(grids: Sequence[FloatArray]) -> float:
    """Return the value that `MOST_VALUES` of the positive, finite values of maps are below; 0 if there are none."""
    values = np.concatenate([grid[np.isfinite(grid) & (np.nan_to_num(grid) > 0.0)] for grid in grids])
    return float(np.quantile(values, MOST_VALUES, method="lower")) if values.size else 0.0


def round_up(value: float) -> float:
    """Return the round number at or above a value, which ends a scale; 1 for 0.

    >>> round_up(0.37), round_up(41.0), round_up(8.0)
    (0.4, 50.0, 8.0)
    """
    if value <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    end = next(
        k * power for k in (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0) if k * power >= value * 0.999
    )
    return float(f"{end:.2g}")


COLOURINGS = ("group", *PEOPLE)  #: What people can be coloured by.
CLEAR = 1e-6  #: Extinction coefficient of air that is as good as clear [1/m].
LEGEND_GROUPS = 24  #: Maximum number of groups in a legend.


@dataclass(frozen=True)
class Colouring:
    """Colours of people in every frame."""

    of: Callable[[Frame], NDArray[np.uint8]]  # colours (c, 3, 3) of body, head and belt of the people in a frame
    legend: tuple[tuple[str, Look], ...] = ()  # groups; empty for quantities, a single group and alike ones
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
        looks = group_looks(len(trajectory.groups))
        table = np.array([rgb(look) for look in looks], np.uint8)
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
    if name in (SMOKE, "visibility"):
        smoke, greatest = _smoke(trajectory)
        if name == "visibility":
            return lambda frame: trajectory.contrast / np.maximum(smoke(frame), CLEAR), 0.0
        return smoke, greatest
    measuring, column = Measuring(trajectory.number_of_people), {"waiting": "waited"}.get(name, name)
    by_frame: list[FloatArray] = []
    for frame in (trajectory[k] for k in range(len(trajectory))):
        given = frame["time"], frame["person"], frame["speed"], frame["started"], frame["contact_force"]
        by_frame.append(getattr(measuring.add(*given), column))
    most = max((float(values.max(initial=0.0)) for values in by_frame), default=0.0)
    return lambda frame: by_frame[trajectory.nearest(frame["time"])], most


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
    if SMOKE not in [field.name for field in trajectory.level_fields]:
        return lambda frame: np.zeros(len(frame["person"])), 0.0
    greatest = float(trajectory.field(SMOKE).values.max(initial=0.0))
    return partial(trajectory.field_at_people, SMOKE), greatest
