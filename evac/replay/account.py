"""Data on the replay page other than the motion: people, settings, outcome and warnings of the run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ResultError
from evac.building.model.building import Building
from evac.folder.files import PEOPLE_NAME, SUMMARY_NAME
from evac.folder.reading import checked, read_columns, read_json
from evac.results.ending import DURATION_OVER, FAILED, INTERRUPTED, NO_PROGRESS

if TYPE_CHECKING:
    from evac.results.results import Results
    from evac.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class Account:
    """Description of a run; incomplete for a killed run.

    Attributes
    ----------
    title : str
    facts : sequence of (str, str)
        Names and values, in the order in which they are shown.
    warnings, quality_warnings : sequence of str
    banner : (str, str) or None
        ``"error"`` or ``"notice"``, and a text, for runs that did not end with everybody out.
    groups : sequence of str
    group : (n,) int32
        Index in ``groups`` of each person, -1 for none.
    radius : (n,) float64 [m]
    speed : (n,) float64 [m/s] or None
        Desired speed on the flat.
    response_time : (n,) float64 [s] or None
    exit_used : (n,) int32 or None
        Index of the exit, -1 for people who are inside.
    exit_time : (n,) float64 [s] or None
        NaN for people who are inside.
    """

    title: str
    facts: Sequence[tuple[str, str]]
    warnings: Sequence[str]
    quality_warnings: Sequence[str]
    banner: tuple[str, str] | None
    groups: Sequence[str]
    group: IntArray
    radius: FloatArray
    speed: FloatArray | None = None
    response_time: FloatArray | None = None
    exit_used: IntArray | None = None
    exit_time: FloatArray | None = None


class _Plain(BaseModel):
    """A table of ``summary.json``; keys that the page does not show are left out."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class _Building(_Plain):
    mesh: str = ""


class _Simulation(_Plain):
    step: float | None = None


class _Case(_Plain):
    building: _Building = _Building()
    contact: dict[str, Any] = {}
    forces: dict[str, dict[str, Any] | Literal[False]] = {}
    behaviours: dict[str, dict[str, Any] | Literal[False]] = {}
    simulation: _Simulation = _Simulation()


class _Contact(_Plain):
    model: str


class _Summary(_Plain):
    title: str
    case: _Case
    contact: _Contact
    people: int
    evacuated: int
    last_out: float | None
    ended: str
    simulated_time: float
    seed: int
    versions: dict[str, str]
    warnings: list[str]
    quality_warnings: list[str]


def account_of_run(results: "Results", error: BaseException | None = None) -> Account:
    """Return the account of a run from its results.

    Parameters
    ----------
    results : Results
        For a failed run, the results until the failure.
    error : BaseException, optional
        The error with which the run failed.
    """
    summary = results.summary() | ({} if error is None else {"ended": FAILED})
    crowd = results.crowd
    group = np.full(results.number_of_people, -1, np.int32)
    for index, members in enumerate(results.groups):
        group[members.rows] = index
    return Account(
        **_of_summary(_Summary.model_validate(summary), None if error is None else str(error)),
        groups=[members.name for members in results.groups],
        group=group,
        radius=crowd.radius,
        speed=crowd.speed[:, 0],
        response_time=crowd.start_time,
        exit_used=np.where(np.isfinite(crowd.exit_time), crowd.exit_used, -1).astype(np.int32),
        exit_time=crowd.exit_time,
    )


def account_of_folder(trajectory: "Trajectory") -> Account:
    """Return the account of a run from its result folder.

    Parameters
    ----------
    trajectory : Trajectory
        ``summary.json`` and ``people.csv`` in the same folder are used if they exist; a killed run has none.

    Raises
    ------
    ResultError
        ``summary.json`` or ``people.csv`` cannot be read, or belongs to another run.
    """
    folder, header = trajectory.path.parent, trajectory.header
    known: dict[str, Any] = {"groups": trajectory.groups, "group": trajectory.group, "radius": trajectory.radius}
    path = folder / SUMMARY_NAME
    if path.exists():
        summary = checked(_Summary, read_json(path), path)
        if summary.seed != header.get("seed") or summary.people != trajectory.number_of_people:
            raise ResultError(f"{path}: not of the run of {trajectory.path.name}; remove it, or run the case again")
        account = Account(**_of_summary(summary, None), **known)
    else:
        facts = [("Seed", str(header.get("seed"))), ("Versions", _versions(header.get("versions", {})))]
        text = (
            f"The run was killed or has not ended: the recorded states end at t = {trajectory.time[-1]:g} s. "
            "Exit times are rounded to recorded states."
        )
        account = Account(str(header.get("title", "")), facts, (), (), ("error", text), **known)
    return _with_people(account, folder / PEOPLE_NAME, trajectory.building)


def _with_people(account: Account, path: Path, building: Building) -> Account:
    """Return an account with the data of the table of people, if it exists."""
    if not path.exists():
        return account
    exits = {"": -1} | {exit_.name: exit_.index for exit_ in building.exits}
    columns = read_columns(path, ("speed", "response_time", "exit", "exit_time"))
    if len(columns["exit"]) != len(account.radius):
        raise ResultError(f"{path}: has {len(columns['exit'])} people, not {len(account.radius)}; run the case again")
    for name in columns["exit"]:
        if name not in exits:
            raise ResultError(f"{path}: column 'exit': the building has no exit {name!r:.80}; run the case again")

    def numbers(column: str) -> FloatArray:
        try:
            found = np.array([float(text or "nan") for text in columns[column]])
        except ValueError as error:
            raise ResultError(f"{path}: column {column!r}: {error}; run the case again") from error
        if (found < 0.0).any():
            raise ResultError(f"{path}: column {column!r}: {found.min():g} is negative; run the case again")
        return found

    return replace(
        account,
        speed=numbers("speed"),
        response_time=numbers("response_time"),
        exit_used=np.array([exits[name] for name in columns["exit"]], np.int32),
        exit_time=numbers("exit_time"),
    )


def _of_summary(summary: _Summary, error: str | None) -> dict[str, Any]:
    """Return the fields of an account from the content of ``summary.json``."""
    case, model, step = summary.case, summary.contact.model, summary.case.simulation.step
    parameters = case.contact.get(model, {})
    last = summary.last_out
    left = summary.people - summary.evacuated
    facts = [
        ("Building", case.building.mesh),
        ("People", f"{summary.people}, of whom {summary.evacuated} got out"),
        ("Last person out", "nobody" if last is None else f"{last:.2f} s"),
        ("Ended", f"{summary.ended}, after {summary.simulated_time:g} s"),
        ("Contact model", _with_parameters(model, parameters if isinstance(parameters, Mapping) else {})),
        ("Forces", _plugins(case.forces)),
        ("Behaviours", _plugins(case.behaviours)),
        ("Time step", "" if step is None else f"{step:g} s"),
        ("Seed", str(summary.seed)),
        ("Versions", _versions(summary.versions)),
    ]
    return {
        "title": summary.title,
        "facts": [(name, value) for name, value in facts if value],
        "warnings": summary.warnings,
        "quality_warnings": summary.quality_warnings,
        "banner": _banner(summary.ended, summary.simulated_time, left, summary.people, error),
    }


def _banner(ended: str, time: float, left: int, people: int, error: str | None) -> tuple[str, str] | None:
    inside = f"{left} of {people} people were still inside."
    if ended == FAILED:
        why = f" ({error})" if error else ""
        return "error", f"This run failed at t = {time:.2f} s{why}. Until then, {people - left} of {people} got out."
    if ended == INTERRUPTED:
        return "error", f"This run was interrupted at t = {time:.2f} s, when {inside}"
    if ended == NO_PROGRESS:
        return "notice", f"The run ended at t = {time:.2f} s because nobody made progress: {inside}"
    if ended == DURATION_OVER:
        return "notice", f"The duration of the run was over at t = {time:.2f} s: {inside}"
    return None


def _plugins(tables: Mapping[str, Any]) -> str:
    used = [_with_parameters(name, values) for name, values in tables.items() if values is not False]
    return "; ".join(used) or "none"


def _with_parameters(name: str, values: Mapping[str, Any]) -> str:
    given = ", ".join(f"{key} = {_value(value)}" for key, value in values.items())
    return f"{name} ({given})" if given else name


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_value(item)}" for key, item in value.items())
    if isinstance(value, list):
        return " to ".join(map(_value, value)) if len(value) == 2 else f"{len(value)} values"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _versions(versions: Any) -> str:
    if not isinstance(versions, Mapping):
        return ""
    return ", ".join(f"{name} {version}" for name, version in versions.items())
