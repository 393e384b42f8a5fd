"""The points of a study, each a case with a set of parameters; and the seeds, which are the same at every point."""

import csv
import itertools
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from evac.base.errors import ScenarioError
from evac.case.case import Case
from evac.case.loading import load_case, run_plugin_files
from evac.case.overrides import value_of
from evac.contract.registry import Registry

SEEDS = ("simulation.seed", "simulation.population_seed")  #: Keys that a study sets for each run.

#: Greatest number of points of a study, and greatest size of a table of points [bytes].
MOST_POINTS = 10_000
MOST_BYTES = 64 * 2**20

STEP = "simulation.step"  #: Key of the time step.
CASE_COLUMN = "case"  #: Column of a table of cases that names the case of a row.


@dataclass(frozen=True)
class Point:
    """A point of a study: a case with one set of parameters."""

    index: int
    # the case without these parameters; a callable is called when the case is first needed
    base: Case | Callable[[], Case]
    # values set at this point, by dotted key; for a table with several cases also ``case``
    parameters: Mapping[str, Any]

    @cached_property
    def case(self) -> Case:
        """The case with these parameters."""
        base = self.base() if callable(self.base) else self.base
        changes = {key: value for key, value in self.parameters.items() if key != CASE_COLUMN}
        return base.change(changes) if changes else base

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
    return _points((case, {STEP: value}) for value in (step, 0.5 * step))


def grid(case: Case, parameters: Mapping[str, Sequence[Any]]) -> tuple[Point, ...]:
    """Return a point for each combination of values; those of the last key vary fastest."""
    for key, values in parameters.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or not values:
            raise ScenarioError(f"{case.source}: {key}: a sweep needs a list of values, got {values!r}")
    check_number(math.prod(map(len, parameters.values())))
    combinations = itertools.product(*parameters.values())
    return _points((case, dict(zip(parameters, values, strict=True))) for values in combinations)


def from_rows(
    case: Case | None,
    rows: Sequence[Mapping[str, Any]],
    folder: Path,
    registry: Registry | None = None,
    run_files: Callable[[Case], Case] = run_plugin_files,
) -> tuple[Point, ...]:
    """Return a point for each row of a table."""
    check_number(len(rows))
    cases: dict[str, Case] = {}
    rows_with_case: list[tuple[Case, dict[str, Any]]] = []
    for number, row in enumerate(rows, start=1):
        given = {key: value for key, value in row.items() if value is not None}
        name = given.get(CASE_COLUMN)
        if name is not None and name not in cases:
            path = folder / str(name)
            cases[name] = run_files(load_case(path if os.path.exists(path) else str(name), registry=registry))
        base = cases[name] if name is not None else case
        if base is None:
            raise ScenarioError(f"row {number} of the table: no case; fill its column 'case', or give a case to sweep")
        rows_with_case.append((base, given))
    return _points(rows_with_case)


def check_number(points: int) -> None:
    """Refuse a sweep of too many points, before they are made."""
    if points > MOST_POINTS:
        raise ScenarioError(
            f"a sweep of {points} points; at most {MOST_POINTS} are possible: give fewer values, or divide it into "
            "several sweeps"
        )


def read_table(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a CSV file with dotted keys as header; an empty field keeps the value of the case."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"it has more than {MOST_BYTES} bytes")
        lines = csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines(), strict=True, restkey="")
        rows = [{key: value_of(word) if word else None for key, word in line.items()} for line in lines]
    except (OSError, ValueError, csv.Error, TypeError, AttributeError) as error:
        raise ScenarioError(f"{path}: cannot be read as a table of cases: {error}; correct the file") from error
    if not rows or any("" in row for row in rows):
        raise ScenarioError(
            f"{path}: not a table of cases; it needs a header of dotted keys and as many values in each row"
        )
    return rows


def _points(cases: Iterable[tuple[Case, Mapping[str, Any]]]) -> tuple[Point, ...]:
    """Return checked points, or raise the error of the first point that is not valid."""
    points = []
    for index, (case, parameters) in enumerate(cases):
        for key in parameters:
            if key in SEEDS:
                raise ScenarioError(f"{key}: cannot be swept, because the study sets it for each run")
            if "." not in key and key != CASE_COLUMN:
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
