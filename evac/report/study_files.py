"""The files of a study, checked once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.folder.files import EGRESS_NAME, RUNS_NAME, STATISTICS_NAME, SUMMARY_NAME
from evac.folder.reading import checked, read_columns, read_json
from evac.results.ending import FAILED
from evac.results.record import CaseTable
from evac.results.results import Results

#: Columns of runs.csv that a report needs, and the ends of those that tell of an exit.
COLUMNS = ("point", "run", "seed", "ended", "blocked", "time", "people", "out", "last_out", "quality_warnings")
EXIT_PEOPLE, EXIT_LAST = ": people", ": last_out"


class _Plain(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class EstimateTable(_Plain):
    """A statistic of the evacuation time with its interval [s]; None where there is none."""

    name: str
    value: float | None
    low: float | None
    high: float | None
    runs: int
    note: str = ""


class StatisticsTable(_Plain):
    """Statistics of the runs of a point."""

    runs: int
    blocked: int
    failed: int = 0
    blocked_share: float | None
    blocked_low: float
    blocked_high: float
    least: float | None
    greatest: float | None
    standard_deviation: float | None
    mean: EstimateTable
    percentiles: list[EstimateTable]


class PointTable(_Plain):
    """A point of a study: its parameters and statistics."""

    parameters: dict[str, Any]
    statistics: StatisticsTable
    settled: dict[str, int | None] = {}


class RuleTable(_Plain):
    """How many runs were to be made."""

    least: int
    most: int
    until: float | None = None
    statistic: str = "mean"
    repetitions: int = 1


class StudySummary(_Plain):
    """The summary of a study, see docs/studies.md."""

    title: str
    runs: int
    blocked: int
    failed: int = 0
    first_seed: int
    rule: RuleTable
    points: list[PointTable] = Field(min_length=1)
    step_change: EstimateTable | None = None
    plugins: list[str]
    versions: dict[str, str]
    keeps_distance: list[str]
    table: CaseTable = Field(alias="case")


@dataclass(frozen=True)
class StudyFiles:
    """The files of a study.

    Attributes
    ----------
    folder : Path
    summary : StudySummary
    case : dict
        As ``summary.json`` has it.
    runs : dict of str to list of str
        Columns of ``runs.csv``.
    egress : dict of str to (k,) float64
        Columns of ``egress.csv``.
    """

    folder: Path
    summary: StudySummary
    case: dict[str, Any]
    runs: dict[str, list[str]]
    egress: dict[str, FloatArray]

    def rows(self, point: int) -> list[int]:
        """Return the rows of ``runs.csv`` of a point."""
        return [row for row, value in enumerate(self.runs["point"]) if value == str(point)]

    def finished(self, point: int) -> list[int]:
        """Return the rows of a point that are in its statistics, which are those of runs that did not fail."""
        return [row for row in self.rows(point) if self.runs["ended"][row] != FAILED]


def is_study(folder: Path) -> bool:
    """Return whether a folder is that of a study."""
    return (folder / STATISTICS_NAME).is_file() and (folder / RUNS_NAME).is_file()


def read_study(folder: Path) -> StudyFiles:
    """Read and check the files of a study.

    Raises
    ------
    ResultError
        A file is missing or damaged; names it, and its key or column.
    """
    data = read_json(folder / SUMMARY_NAME)
    summary = checked(StudySummary, data, folder / SUMMARY_NAME)
    runs = read_columns(folder / RUNS_NAME, COLUMNS)
    if len(runs["run"]) != summary.runs:
        raise ResultError(
            f"{folder / RUNS_NAME}: {len(runs['run'])} runs, but {SUMMARY_NAME} has {summary.runs}; the files are not"
            " of one study: make it again"
        )
    columns = read_columns(folder / EGRESS_NAME, ("time", "mean_over_runs"))
    try:
        for name in ("seed", "people", "out"):
            [int(text) for text in runs[name]]
        numeric = [name for name in runs if name in ("time", "last_out") or name.endswith((EXIT_PEOPLE, EXIT_LAST))]
        for name in numeric:
            numbers(runs[name])
        egress = {name: numbers(column) for name, column in columns.items()}
    except ValueError as error:
        raise ResultError(f"{folder}: a table of the study holds a field that is no number: {error}") from error
    return StudyFiles(folder, summary, data["case"], runs, egress)


def numbers(column: Sequence[str]) -> FloatArray:
    """Return a column as numbers, NaN where a field is empty."""
    return np.array([float(text) if text else math.nan for text in column])


def check_member(study: StudyFiles, run: Results) -> None:
    """Refuse a run that is none of the first point of a study."""
    seeds = {study.runs["seed"][row]: row for row in study.rows(0)}
    row = seeds.get(str(run.seed))
    place = f"{run.folder}: is no run of {study.folder}"
    if row is None:
        raise ResultError(f"{place}: its seed {run.seed} is none of those of the first point")
    for key in ("people", "building", "contact", "forces", "behaviours", "directions"):
        if run.settings.get(key) != study.case.get(key):
            raise ResultError(f"{place}: [{key}] of its case differs; run the case of the study with that seed")
    found, expected = run.last_out if run.is_complete else None, study.runs["last_out"][row]
    if (None if not expected else float(expected)) != found:
        raise ResultError(
            f"{place}: with seed {run.seed} the last person leaves at {expected or 'no time'} there and at"
            f" {found} s here"
        )
