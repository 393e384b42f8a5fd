"""The measured values of people, the targets of the default movement model, and the results of runs beside them.

Sources: PedPy's demonstration data (bottleneck 040_c_56_h-, corridor uo-ENTRANCE-180-EXIT, two-way corridor
bi_corr_400_b_03); doors of Seyfried et al. (2009), Kretz et al. (2006) and Duesseldorf (2006), from the data files of
jpscore's validation tests; flows and speeds on stairs that are used to check other models.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.evidence.evidence import Row
from evac.evidence.people import scenes
from evac.evidence.people.measures import COUNTED, DENSITIES, frames_column, speed_column
from evac.evidence.people.runs import LEFT, MODELS
from evac.evidence.verdicts import MET, NOT_MET, REPORTED
from evac.standard.plans import COUNTERS
from evac.study.statistics import estimate

#: Flow per metre through doors [1/s/m]: Seyfried, Kretz (means of repetitions) and Duesseldorf, the last from 1.4 m on.
DOOR_FLOWS = {
    **{0.6: (1.87,), 0.7: (1.77,), 0.8: (1.61, 1.78), 1.0: (1.90, 1.85, 1.83)},
    **{1.2: (1.97, 1.79, 1.93), 2.0: (1.77,), 2.5: (2.05,)},
}

#: Flow through doors with a neck of 2.8 m [1/s] by width, Seyfried et al. (2009).
LONG_NECK_FLOWS = {0.8: 1.288, 1.0: 1.900, 1.2: 2.364}

#: Distances in single file [m], in the order of `FILE_SPEEDS`: 0.36 m + 1.06 s u, Seyfried et al. (2005).
FILE_DISTANCES = (0.62, 0.89, 1.20)

#: Greatest time of two crossing streams over that of one alone, in the order of `CROSSING_DENSITIES`: wanted.
CROSSING_TIMES = (1.7, 2.0)

#: Exit times at the door of 0.5 m [s], in the order of `COUNTED`.
EXIT_TIMES = (7.3, 31.8, 65.0)

#: Density [1/m2], speed [m/s] and flow [1/s] in the corridor, in the order of `CORRIDOR_ENDS`.
CORRIDOR = (
    *((0.50, 1.33, 1.26), (0.67, 1.34, 1.63), (1.14, 1.19, 2.48), (1.56, 0.99, 2.79)),
    *((1.68, 0.95, 2.89), (2.06, 0.64, 2.39), (2.46, 0.41, 1.82), (3.05, 0.30, 1.71)),
)

#: Speed in the corridor at moments of the densities between `DENSITIES` [m/s].
CORRIDOR_SPEEDS = (1.34, 1.11, 0.84, 0.59, 0.39, 0.31)

#: Held out of the choice of parameters: doors by width [m], and other scenes.
HELD_DOORS = (0.7,)
HELD_SCENES = (scenes.STAIR_UP, scenes.TWO_WAY_2, *map(scenes.imo_8_name, COUNTERS))

#: Last arrivals of IMO 8 by FDS+Evac [s], in the order of `COUNTERS`: another model, so not a target.
FDS_EVAC = (50.0, 75.0, 107.0, 136.0)

#: Time of the paper's model in the bend, and capacity bound of the two exits [s].
BEND_TIME, CAPACITY_TIME = 39.0, 36.0

#: Greatest deviation of speeds in the corridor on average [-].
SHARE_ON_AVERAGE = 0.10

OPEN = (-math.inf, math.inf)


@dataclass(frozen=True)
class Value:
    """A measured value, and where a run has it."""

    # scenes whose runs with the same seed make one value: their mean, weighted by the column `weight` if it has any
    scenes: tuple[str, ...]
    column: str
    measured: float | None = None  # what people did; None if no experiment is known
    share: float | None = None  # the target is the measured value within this share of it
    bounds: tuple[float, float] = OPEN  # (low, high): the target if there is no share; infinite where it is open
    question: str = ""  # values with the same question are judged together at the head of the page
    is_held_out: bool = False  # whether it was never used for choosing parameters
    weight: str = ""

    @property
    def target(self) -> tuple[float, float]:
        """The least and the greatest value wanted."""
        if self.measured is None or self.share is None:
            return self.bounds
        return self.measured * (1.0 - self.share), self.measured * (1.0 + self.share)

    @property
    def name(self) -> str:
        """What was measured, with its unit."""
        return f"{self.scenes[0] if len(self.scenes) == 1 else 'corridor'}: {self.column}"

    @property
    def wanted(self) -> str | None:
        """The target in words."""
        low, high = self.target
        if math.isinf(low):
            return None if math.isinf(high) else f"at most {high:.3g}"
        return f"at least {low:.3g}" if math.isinf(high) else f"{low:.3g} to {high:.3g}"

    def verdict(self, mean: float | None, interval: tuple[float, float] | None, blocked: int) -> str:
        """Return whether a mean lies in the target and no run is blocked."""
        if self.target == OPEN:
            return REPORTED
        if blocked or mean is None:
            return f"{NOT_MET}: {'blocked' if blocked else 'no measurement'}"
        is_certain = interval is not None and not any(interval[0] < bound < interval[1] for bound in self.target)
        is_met = self.target[0] <= mean <= self.target[1]
        return f"{MET if is_met else NOT_MET}{'' if is_certain else ', not certain'}"


def _value(scene: str, column: str, measured: float | None = None, is_held_out: bool = False, **target: Any) -> Value:
    return Value((scene,), column, measured, is_held_out=is_held_out or scene in HELD_SCENES, **target)


def _doors() -> Iterator[Value]:
    narrow = scenes.NARROW_DOOR
    yield _value(narrow, "flow [1/s]", 1.148, share=0.10, question=f"{narrow}, flow")
    for count, time in zip(COUNTED, EXIT_TIMES, strict=True):
        yield _value(narrow, f"{count} out [s]", time, share=0.15, question=f"{narrow}, exit times")
    yield _value(narrow, "nearest neighbour [m]", 0.32)
    yield _value(narrow, "heading rms [deg]", 19.0, bounds=(9.0, 38.0), question=f"{narrow}, headings")
    for width, flows in DOOR_FLOWS.items():
        share, which = (0.15, "0.6 and 0.7 m") if width < 0.8 else (0.10, "0.8 m and more")
        target = {"share": share, "question": f"doors of {which}, flows"}
        mean, is_held_out = float(np.mean(flows)), width in HELD_DOORS
        yield _value(scenes.door_name(width), "flow per metre [1/s/m]", mean, is_held_out, **target)


def _necks() -> Iterator[Value]:
    column = "flow per metre [1/s/m]"
    for neck in scenes.NECKS:
        for width in scenes.NECK_WIDTHS:
            is_long = neck > scenes.NECK
            measured = LONG_NECK_FLOWS[width] / width if is_long else float(np.mean(DOOR_FLOWS[width]))
            target: dict[str, Any] = {"share": 0.12 if is_long else 0.10, "question": f"necks of {neck:g} m, flows"}
            yield _value(scenes.neck_name(width, neck), column, measured, **target)


def _meetings() -> Iterator[Value]:
    for width in scenes.CORNER_WIDTHS:
        column, bounds = "beside the straight corridor [-]", (0.9, 1.1)
        yield _value(scenes.corner_name(width), column, bounds=bounds, question="corners, flows")
    for density, most in zip(scenes.CROSSING_DENSITIES, CROSSING_TIMES, strict=True):
        name, bounds = scenes.crossing_name(density), (-math.inf, most)
        yield _value(name, "beside one stream alone [-]", bounds=bounds, question="crossing streams, times")
    yield _value(scenes.JUNCTION, "share from the left [-]", bounds=(0.48, 0.52), question=f"{scenes.JUNCTION}, shares")
    for speed, distance in zip(scenes.FILE_SPEEDS, FILE_DISTANCES, strict=True):
        yield _value(scenes.file_name(speed), "distance [m]", distance, share=0.15, question="single file, distances")


def _corridors() -> Iterator[Value]:
    names = tuple(scenes.corridor_name(*ends) for ends in scenes.CORRIDOR_ENDS)
    for ends, speed in zip(pairwise(DENSITIES), CORRIDOR_SPEEDS, strict=True):
        question, weight = "corridor, speeds by density", frames_column(*ends)
        yield Value(names, speed_column(*ends), speed, 0.15, OPEN, question, weight=weight)
    for name, (_, way_out), measured in zip(names, scenes.CORRIDOR_ENDS, CORRIDOR, strict=True):
        for column, value in zip(("density [1/m2]", "speed [m/s]", "flow [1/s]"), measured, strict=True):
            has_target = column.startswith("flow") and way_out < 1.8
            target: dict[str, Any] = {"share": 0.2, "question": "corridor, flows at narrow exits"} if has_target else {}
            yield _value(name, column, value, **target)


def _ways() -> Iterator[Value]:
    for name in (scenes.STAIR_DOWN, scenes.STAIR_UP):
        for column, mean, bounds in (
            ("flow per metre [1/s/m]", 1.02, (0.88, 1.16)),
            ("speed [m/s]", 0.44, (0.25, 0.63)),
        ):
            yield _value(name, column, mean, bounds=bounds, question="stairs, flows and speeds")
    yield _value(scenes.TWO_WAY_4, "speed [m/s]", 1.0, share=0.15, question=f"{scenes.TWO_WAY_4}, speed")
    yield _value(scenes.TWO_WAY_4, "flow per metre [1/s/m]", 1.0)
    yield from (_value(name, "density [1/m2]") for name in (scenes.TWO_WAY_4, scenes.TWO_WAY_2))
    yield _value(scenes.TWO_WAY_2, "speed [m/s]")
    for counter, time in zip(COUNTERS, FDS_EVAC, strict=True):
        yield _value(scenes.imo_8_name(counter), "last out [s]", time)
    for column, bounds in (("last out [s]", (-math.inf, 1.3 * BEND_TIME)), ("from inner corner [m]", (1.0, math.inf))):
        yield _value(scenes.BEND, column, bounds=bounds, question=scenes.BEND)
    yield _value(scenes.TWO_EXITS, "last out [s]", CAPACITY_TIME, share=0.15, question=scenes.TWO_EXITS)


#: All measured values, in the order of the page.
VALUES: Sequence[Value] = (*_doors(), *_corridors(), *_ways(), *_necks(), *_meetings())


def outcome(value: Value, setting: str, model: str, runs: Sequence[Row]) -> Row:
    """Return what was found for a measured value in the runs of one setting and contact model.

    A run is blocked if people are left. Such runs have no value, and every mean stands beside their share.
    """
    own = [run for run in runs if run["scene"] in value.scenes and (run["setting"], run["model"]) == (setting, model)]
    blocked = sum(run[LEFT] > 0 for run in own)
    estimated = estimate("mean", by_seed(value, own))
    mean = estimated.value if estimated.runs else None
    interval = (estimated.low, estimated.high) if estimated.has_interval else None
    low, high = interval or (None, None)
    return {
        **{"value": value.name, "setting": setting, "model": model, "measured": value.measured, "target": value.wanted},
        "held out": "yes" if value.is_held_out or model != MODELS[0] else "no",
        **{"runs": len(own), "blocked": blocked, "share blocked": blocked / len(own) if own else None},
        **{"mean": mean, "from": low, "to": high},
        "deviation [%]": None if mean is None or value.measured is None else 100.0 * (mean / value.measured - 1.0),
        "verdict": value.verdict(mean, interval, blocked),
    }


def by_seed(value: Value, runs: Sequence[Row]) -> FloatArray:
    """Return one value for each seed that has any, (seeds,)."""
    means = []
    for seed in sorted({run["seed"] for run in runs}):
        own = [run for run in runs if run["seed"] == seed and run[value.column] is not None]
        if own:
            weights = [run[value.weight] if value.weight else 1 for run in own]
            means.append(float(np.average([run[value.column] for run in own], weights=weights)))
    return np.array(means)
