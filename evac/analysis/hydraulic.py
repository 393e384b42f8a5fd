"""The hydraulic calculation: what handbooks give for the flow at each exit, door and stair, beside that of a run."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from evac.analysis.lines import LineFlow
from evac.base.arrays import FloatArray
from evac.base.errors import in_order
from evac.building.model.building import Building
from evac.building.options import RAMP

#: Density at which the specific flow S D = k D (1 - a D) is greatest, and the greatest specific flow over k: Gwynne and
#: Rosenbaum, Employing the hydraulic model in assessing emergency movement, SFPE Handbook (5th edition, 2016), ch. 59.
A = 0.266  # [m2]
FLOW_OVER_K = 1.0 / (4.0 * A)  # [1/m2]

#: k of corridors, doors and ramps, and of stairs by riser over tread (7.5/10, 7/11, 6.5/12 and 6.5/13 inches) [m/s]
#: (the same, table 59.2).
LEVEL_K = 1.40
STAIR_K = ((6.5 / 13.0, 1.23), (6.5 / 12.0, 1.16), (7.0 / 11.0, 1.08), (7.5 / 10.0, 1.00))

#: Boundary layer at each side of doors and of stairs between walls [m] (the same, table 59.1).
LAYER = 0.15

#: Width for each person, of level ways and ramps, and of stairs [m]: NFPA 101, Life Safety Code, table 7.3.3.1 (5 mm,
#: or 0.2 inches, and 7.6 mm, or 0.3 inches). It limits the number of people that an exit may serve, and is no flow.
NFPA_LEVEL, NFPA_STAIR = 0.005, 0.0076

#: Greatest specific flow of mixed people through doors in laboratories [1/(m s)]: Daamen and Hoogendoorn (2010).
LABORATORY = 2.8

#: Greatest specific flow on stairs [1/(m s)]: the upper end of the values with which `evac evidence people` compares.
STAIRS = 1.16

#: Greatest capacity of escalators in EN 115-1 [1/(m s)]: 8,200 people an hour on steps of 1 m at 0.75 m/s.
ESCALATORS = 2.28


@dataclass(frozen=True)
class DesignFlow:
    """An exit, a door or a stair with its flow in a run and the hydraulic values."""

    kind: str  # ``"exit"``, ``"door"`` or ``"stair"``
    name: str
    width: float  # clear width [m]
    people: int  # people who passed in the direction of most of them and did not come back, each counted once
    flow: float | None  # flow of the run between the first and the last fifth of them [1/s]
    effective_width: float  # clear width without the boundary layers [m]
    hydraulic_flow: float  # greatest flow of the SFPE Handbook: 0 if nothing is left of the width [1/s]
    laboratory_flow: float | None  # greatest flow of laboratories through a door of this width; None for stairs [1/s]
    capacity: int  # number of people that NFPA 101 permits for this width
    # evacuation time if this place decides it: when the first person passed, the number of people over the hydraulic
    # flow, and the shortest way out from there [s]
    hydraulic_time: float

    @property
    def ratio(self) -> float | None:
        """Flow of the run over that of the handbook; None if few people passed, or nothing is left of the width."""
        return None if self.flow is None or not self.hydraulic_flow else self.flow / self.hydraulic_flow


def design_flows(building: Building, flows: Iterable[LineFlow], exit_time: FloatArray) -> list[DesignFlow]:
    """Return the exits, doors and stairs of a run with their hydraulic values; of stairs, the end with most people."""
    design = [flow for line in flows for flow in _of_line(building, line, exit_time)]
    design = in_order(sorted(design, key=lambda flow: -flow.people))
    design.sort(key=lambda flow: ("exit", "door", "stair").index(flow.kind))
    return [next(same) for _, same in groupby(design, key=lambda flow: (flow.kind, flow.name))]


def hydraulic_time(flows: Iterable[DesignFlow]) -> DesignFlow | None:
    """Return the place that decides the hydraulic evacuation time: that with the longest one; None without any."""
    finite = (flow for flow in flows if math.isfinite(flow.hydraulic_time))
    return max(finite, key=lambda flow: flow.hydraulic_time, default=None)


def stair_k(rise_over_run: float) -> float:
    """Return k of a stair [m/s], between the tabulated stairs by its slope, and that of ramps below `RAMP`.

    >>> stair_k(7.0 / 11.0), stair_k(0.05), stair_k(2.0)
    (1.08, 1.4, 1.0)
    """
    if rise_over_run <= RAMP:
        return LEVEL_K
    slopes, values = zip(*STAIR_K, strict=True)
    return float(np.interp(rise_over_run, slopes, values))


def _of_line(building: Building, line: LineFlow, exit_time: FloatArray) -> Iterator[DesignFlow]:
    """Yield the design flow of an exit, a door or an end of a stair that somebody passed, in its main direction."""
    stairs = [building.levels[index] for index in line.levels if building.levels[index].stair]
    is_end = len({level.title for level in stairs}) == 1 and len(stairs) < len(line.levels)
    if line.kind == "line" or not line.people or (line.kind == "portal" and not is_end):
        return
    slope = max((math.tan(level.slope) for level in stairs), default=0.0) if line.kind == "portal" else 0.0
    kind, name = ("stair", str(stairs[0].stair)) if line.kind == "portal" else (line.kind, line.name)
    passed = line.forward if 2 * line.forward.sum() >= line.people else ~line.forward
    first = np.flatnonzero(passed)[np.unique(line.person[passed], return_index=True)[1]]
    net = np.bincount(line.person, np.where(passed, 1.0, -1.0))  # 0 for those who came back or swayed on the line
    passed = np.isin(np.arange(line.people), first[net[line.person[first]] > 0.0])
    if not passed.any():
        return
    time, person = line.time[passed], line.person[passed]
    effective = max(0.0, line.width - 2.0 * LAYER)
    hydraulic = stair_k(slope) * FLOW_OVER_K * effective
    rest = exit_time[person] - time
    least = float(np.nanmin(rest)) if np.isfinite(rest).any() else 0.0
    yield DesignFlow(
        kind=kind,
        name=name,
        width=line.width,
        people=len(time),
        flow=line.flow_of(passed),
        effective_width=effective,
        hydraulic_flow=hydraulic,
        laboratory_flow=None if kind == "stair" else LABORATORY * line.width,
        capacity=math.floor(line.width / (NFPA_STAIR if slope > RAMP else NFPA_LEVEL) + 1e-9),
        hydraulic_time=float(time[0]) + len(time) / hydraulic + max(0.0, least) if hydraulic > 0.0 else math.inf,
    )
