"""What a report is made of: the files of a result folder, checked once."""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from evac.base.arrays import FloatArray
from evac.base.errors import ResultError
from evac.folder.files import EGRESS_NAME, PEOPLE_NAME, SUMMARY_NAME, TRAJECTORY_NAME
from evac.folder.reading import checked, read_columns, read_json
from evac.trajectory.trajectory import Trajectory, read_trajectory


class _Plain(BaseModel):
    """Checked data of a JSON file; keys that no report needs are left out."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class ExitUse(_Plain):
    """How an exit was used, see docs/results.md."""

    people: int
    last_out: float | None
    width: float
    flow: float | None
    flow_per_metre: float | None


class PlaceUse(_Plain):
    """How a level or a stair was used."""

    people: int
    greatest_number: int
    last_left: float | None


class StuckPlace(_Plain):
    """Where somebody was who no longer made progress."""

    person: int
    level: str
    x: float
    y: float


class GroupTable(BaseModel):
    """A group of people of a case; distributions as the case has them."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str
    number: int | None = None
    area: str | None = None
    level: str | None = None
    z: float | None = None
    positions: list[list[float]] | None = None
    exits: list[str] = []
    strategy: str = ""
    behaviours: dict[str, Any] = {}


class BuildingTable(_Plain):
    """What a report names of the building's keys."""

    mesh: str | None = None
    closed: list[str] = []


class CaseTable(_Plain):
    """The parts of a case that a report names one by one."""

    title: str = ""
    building: BuildingTable
    directions: dict[str, Any]
    people: list[GroupTable]
    contact: dict[str, Any]
    forces: dict[str, Any] = {}
    behaviours: dict[str, Any] = {}
    simulation: dict[str, Any]
    output: dict[str, Any]
    plugins: dict[str, Any] = {}

    @property
    def model(self) -> str:
        """Name of the contact model."""
        return str(self.contact.get("model", ""))

    @property
    def model_parameters(self) -> dict[str, Any]:
        """Parameters of the contact model in use."""
        found = self.contact.get(self.model, {})
        return found if isinstance(found, dict) else {}


class Summary(_Plain):
    """The summary of a run, see docs/results.md."""

    title: str
    people: int
    evacuated: int
    last_out: float | None
    ended: str
    stuck: list[StuckPlace]
    warnings: list[str]
    quality_warnings: list[str]
    simulated_time: float
    steps: int
    exits: dict[str, ExitUse]
    left_by_other_exits: int
    levels: dict[str, PlaceUse]
    stairs: dict[str, PlaceUse]
    contact: dict[str, Any]
    wall_time: dict[str, float]
    metrics: dict[str, Any] = {}
    resumed: list[dict[str, Any]] = []
    seed: int
    plugins: list[str]
    versions: dict[str, str]
    keeps_distance: list[str]
    table: CaseTable = Field(alias="case")


@dataclass(frozen=True)
class Run:
    """The files of one run.

    Attributes
    ----------
    folder : Path
    summary : Summary
    case : dict
        The case as ``summary.json`` has it, every key.
    people : mapping of str to list of str
        Columns of ``people.csv``, as written.
    trajectory : Trajectory or None
        None where the run recorded none.
    files : tuple of (str, int, str)
        Name, length [bytes] and SHA-256 of each file that was read.
    """

    folder: Path
    summary: Summary
    case: dict[str, Any]
    people: dict[str, list[str]]
    trajectory: Trajectory | None
    files: tuple[tuple[str, int, str], ...]

    @property
    def is_complete(self) -> bool:
        """Whether everybody is out."""
        return self.summary.evacuated == self.summary.people

    def numbers(self, column: str) -> FloatArray:
        """Return a column of ``people.csv`` as numbers, NaN where a field is empty."""
        return np.array([float(text) if text else math.nan for text in self.people[column]])

    def rows_of(self, group: str) -> np.ndarray:
        """Return the rows of the people of a group."""
        return np.flatnonzero(np.array(self.people["group"], dtype=object) == group)


#: Columns of people.csv that a report needs.
COLUMNS = ("group", "radius", "mass", "tau", "speed", "speed_up", "speed_down", "response_time", "exit", "exit_time")


def read_run(folder: Path) -> Run:
    """Read and check the files of a result folder.

    Raises
    ------
    ResultError
        A file is missing or damaged; names it, and its key or column.
    """
    data = read_json(folder / SUMMARY_NAME)
    summary = checked(Summary, data, folder / SUMMARY_NAME)
    people = read_columns(folder / PEOPLE_NAME, COLUMNS)
    if len(people["group"]) != summary.people:
        raise ResultError(
            f"{folder / PEOPLE_NAME}: {len(people['group'])} people, but {SUMMARY_NAME} has {summary.people}; the "
            "files are not of one run: run the case again"
        )
    recorded = folder / TRAJECTORY_NAME
    trajectory = read_trajectory(recorded) if recorded.is_file() else None
    if trajectory is not None and trajectory.number_of_people != summary.people:
        raise ResultError(
            f"{recorded}: {trajectory.number_of_people} people, but {SUMMARY_NAME} has {summary.people}; the files are "
            "not of one run: run the case again"
        )
    names = (SUMMARY_NAME, PEOPLE_NAME, EGRESS_NAME, TRAJECTORY_NAME)
    run = Run(folder, summary, data["case"], people, trajectory, digests(folder, names))
    for column in COLUMNS[1:-2] + COLUMNS[-1:]:
        try:
            run.numbers(column)
        except ValueError as error:
            raise ResultError(f"{folder / PEOPLE_NAME}: column {column!r}: {error}; run the case again") from error
    return run


def digests(folder: Path, names: tuple[str, ...]) -> tuple[tuple[str, int, str], ...]:
    """Return name, length and SHA-256 of the files that are there."""

    def found() -> Iterator[tuple[str, int, str]]:
        for name in names:
            path = folder / name
            if path.is_file():
                with path.open("rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                yield name, path.stat().st_size, digest

    return tuple(found())
