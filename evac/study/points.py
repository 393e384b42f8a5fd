"""The points of a study, each a case with a set of parameters; and the seeds, which are the same at every point."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from evac.base.errors import ScenarioError
from evac.case.case import Case

SEEDS = ("simulation.seed", "simulation.population_seed")  #: Keys that a study sets for each run.

MOST_POINTS = 10_000  #: Greatest number of points of a study.

STEP = "simulation.step"  #: Key of the time step.


@dataclass(frozen=True)
class Point:
    """A point of a study: a case with one set of parameters."""

    index: int
    # the case without these parameters; a callable is called when the case is first needed
    base: Case | Callable[[], Case]
    parameters: Mapping[str, Any]  # values set at this point, by dotted key

    @cached_property
    def case(self) -> Case:
        """The case with these parameters."""
        base = self.base() if callable(self.base) else self.base
        return base.change(self.parameters) if self.parameters else base

    @property
    def label(self) -> str:
        """The parameters in one line."""
        return ", ".join(f"{key} = {value}" for key, value in self.parameters.items())


@dataclass(frozen=True)
class Seeds:
    """The seeds of runs 0, 1, ..., the same at all points (common random numbers)."""

    first: int  # seed of run 0; run k has ``first + k``
    # number of consecutive runs with the same people at other positions and with other random decisions: run k draws
    # the properties of people with the seed ``first + k // repetitions``. With 1 all runs have different people
    repetitions: int = 1

    def changes(self, run: int) -> dict[str, int]:
        """Return the keys of the case that are set for run `run`."""
        changes = {"simulation.seed": self.first + run}
        if self.repetitions > 1:
            changes["simulation.population_seed"] = self.first + self.population(run)
        return changes

    def population(self, run: int) -> int:
        """Return the number of the population of a run."""
        return run // self.repetitions


def single(case: Case) -> tuple[Point, ...]:
    """Return the one point of a study without parameters."""
    return (Point(0, case, {}),)


def halved_steps(case: Case) -> tuple[Point, ...]:
    """Return the points that check the time step of a case: its step, and half of it."""
    step = case.simulation.step
    return chosen(case, [{STEP: value} for value in (step, 0.5 * step)])


def grid(case: Case, parameters: Mapping[str, Sequence[Any]]) -> tuple[Point, ...]:
    """Return a point for each combination of values; those of the last key vary fastest."""
    for key, values in parameters.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or not values:
            raise ScenarioError(f"{case.source}: {key}: a sweep needs a list of values, got {values!r}")
    check_number(math.prod(map(len, parameters.values())))
    combinations = itertools.product(*parameters.values())
    return chosen(case, [dict(zip(parameters, values, strict=True)) for values in combinations])


def check_number(points: int) -> None:
    """Refuse a sweep of too many points, before they are made."""
    if points > MOST_POINTS:
        raise ScenarioError(
            f"a sweep of {points} points; at most {MOST_POINTS} are possible: give fewer values, or divide it into "
            "several sweeps"
        )


def chosen(case: Case, rows: Sequence[Mapping[str, Any]]) -> tuple[Point, ...]:
    """Return a point for each row of values by dotted keys, or raise the error of the first that is not valid."""
    check_number(len(rows))
    points = []
    for index, parameters in enumerate(rows):
        for key in parameters:
            if key in SEEDS:
                raise ScenarioError(f"{key}: cannot be swept, because the study sets it for each run")
            if "." not in key:
                raise ScenarioError(f"{key}: a section cannot be swept; name a key in it, such as contact.model")
        point = Point(index, case, dict(parameters))
        try:
            _ = point.case
        except ScenarioError as error:
            error.add_note(f"at the point {point.label}")
            raise
        points.append(point)
    if not points:
        raise ScenarioError("a study needs at least one point")
    return tuple(points)
