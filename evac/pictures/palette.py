"""Colours of all pictures and of the replay: groups, exits, walls and quantities have the same ones in each of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from evac.base.arrays import FloatArray

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
MAPS = {"speed": "viridis", "density": "plasma", "contact force": "plasma", "waiting time": "cividis", "smoke": "greys"}


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


def scale(quantity: str) -> FloatArray:
    """Return one of the colour maps `MAPS`, (256, 3) with numbers from 0 to 1."""
    stops = np.array(rgb(STOPS[MAPS[quantity]])) / 255.0
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
