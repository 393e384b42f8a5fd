"""The points of a study: a case under each set of parameters; and the seeds, which are the same at every point."""

import csv
import itertools
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.errors import ScenarioError
from evac.scenario.trust import run_plugin_files

if TYPE_CHECKING:
    from evac.registry import Registry
    from evac.scenario.case import Case

#: Keys that the runs of a study differ in by themselves.
SEEDS = ("simulation.seed", "simulation.population_seed")

#: Column of a table of cases that names the case of a row, and the table of a TOML file that holds the rows.
CASE_COLUMN = "case"
ROWS_KEY = "points"


@dataclass(frozen=True)
class Point:
    """One set of parameters.

    Attributes
    ----------
    index : int
    case : Case
        With these parameters.
    parameters : mapping of str to plain value
        What the point sets, by dotted key; of a table with several cases also ``case``.
    """

    index: int
    case: "Case"
    parameters: Mapping[str, Any]

    @property
    def label(self) -> str:
        """The parameters in one line."""
        return ", ".join(f"{key} = {value}" for key, value in self.parameters.items())


@dataclass(frozen=True)
class Seeds:
    """The seeds of runs 0, 1, ...: those of a point do not depend on its parameters (common random numbers).

    Attributes
    ----------
    first : int
        Seed of run 0; run k has ``first + k``.
    repetitions : int
        So many runs in a row have people who are alike, placed and deciding differently: run k takes what people are
        like from the seed ``first + k // repetitions``. With 1 all runs differ in everything.
    """

    first: int
    repetitions: int = 1

    def changes(self, run: int) -> dict[str, int]:
        """Return the keys that run `run` sets."""
        changes = {"simulation.seed": self.first + run}
        if self.repetitions > 1:
            changes["simulation.population_seed"] = self.first + self.population(run)
        return changes

    def population(self, run: int) -> int:
        """Return which population a run is of."""
        return run // self.repetitions


def single(case: "Case") -> tuple[Point, ...]:
    """Return the one point of a study without parameters."""
    return (Point(0, case, {}),)


def grid(case: "Case", parameters: Mapping[str, Sequence[Any]]) -> tuple[Point, ...]:
    """Return a point for each combination of values; those of the last key change fastest.

    Raises
    ------
    ScenarioError
        A key has no values, or the case is not valid with some of them; the message names these.
    """
    for key, values in parameters.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or not values:
            raise ScenarioError(f"{case.source}: {key}: a sweep needs a list of values, got {values!r}")
    combinations = itertools.product(*parameters.values())
    return _points((case, dict(zip(parameters, values, strict=True))) for values in combinations)


def from_rows(
    case: "Case | None", rows: Iterable[Mapping[str, Any]], folder: Path, registry: "Registry | None" = None
) -> tuple[Point, ...]:
    """Return a point for each row of a table.

    Parameters
    ----------
    case : Case, optional
        That of rows without a value in the column ``case``.
    rows : iterable of mapping
        Dotted keys and values; None leaves a key as the case has it.
    folder : Path
        Names of cases in the table are relative to it, where they are paths.
    registry : Registry, optional
        For the cases that the table names.

    Raises
    ------
    ScenarioError
        A row names no case, and none is given; or its case is not valid.
    """
    from evac.scenario.loading import load_case

    cases: dict[str, Case] = {}
    found: list[tuple[Case, dict[str, Any]]] = []
    for number, row in enumerate(rows, start=1):
        given = {key: value for key, value in row.items() if value is not None}
        name = given.get(CASE_COLUMN)
        if name is not None and name not in cases:
            path = folder / str(name)
            cases[name] = run_plugin_files(load_case(path if path.exists() else str(name), registry=registry))
        base = cases[name] if name is not None else case
        if base is None:
            raise ScenarioError(f"row {number} of the table names no case; name one, or fill its column 'case'")
        found.append((base, given))
    return _points(found)


def read_table(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table of cases: a CSV file with dotted keys as its head, or ``[[points]]`` of a TOML file.

    Values of a CSV file are read as TOML, or taken as bare words; an empty field sets nothing.

    Raises
    ------
    ScenarioError
        The file cannot be read, or holds no rows.
    """
    from evac.scenario.overrides import value_of

    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix.lower() == ".toml":
            rows = [_flat(row) for row in tomllib.loads(text).get(ROWS_KEY, [])]
        else:
            lines = csv.DictReader(text.splitlines(), strict=True, restkey="")
            rows = [{key: value_of(word) if word else None for key, word in line.items()} for line in lines]
    except (OSError, ValueError, csv.Error, TypeError, AttributeError) as error:
        raise ScenarioError(f"{path}: cannot be read as a table of cases: {error}; correct the file") from error
    if not rows or any("" in row for row in rows):
        raise ScenarioError(
            f"{path}: no table of cases; it needs a head of dotted keys and as many values in each row (CSV), or "
            f"[[{ROWS_KEY}]] tables (TOML)"
        )
    return rows


def _points(found: Iterable[tuple["Case", Mapping[str, Any]]]) -> tuple[Point, ...]:
    """Return checked points; all faults of all points are not collected, the first is named."""
    points = []
    for index, (case, parameters) in enumerate(found):
        for key in parameters:
            if key in SEEDS:
                raise ScenarioError(f"{key} cannot be swept: each run has a seed of its own, from simulation.seed on")
            if "." not in key and key != CASE_COLUMN:
                raise ScenarioError(f"{key!r} cannot be swept as a whole: name a key in it, such as contact.model")
        changes = {key: value for key, value in parameters.items() if key != CASE_COLUMN}
        try:
            changed = case.change(changes) if changes else case
        except ScenarioError as error:
            error.add_note(f"at the point {', '.join(f'{key} = {value}' for key, value in parameters.items())}")
            raise
        points.append(Point(index, changed, dict(parameters)))
    if not points:
        raise ScenarioError("a study needs at least one point")
    return tuple(points)


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
