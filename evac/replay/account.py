"""Data on the replay page other than the motion: people, settings, outcome and warnings of the run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.analysis.lines import LineFlow, line_flows
from evac.analysis.occupancy import Moves, recorded_moves
from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray, IntArray
from evac.base.distributions import as_text
from evac.folder.files import PEOPLE_NAME, SUMMARY_NAME
from evac.results.ending import DURATION_OVER, FAILED, INTERRUPTED, NO_PROGRESS
from evac.results.reading import results_beside
from evac.results.results import Results
from evac.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class Account:
    """Description of a run; without the arrays that are None for a killed run."""

    title: str
    answer: Sequence[str]  # lines that open the page
    facts: Sequence[tuple[str, str]]  # names and values, in order
    warnings: Sequence[str]
    quality_warnings: Sequence[str]
    banner: tuple[str, str] | None  # "error" or "notice", and a text, for runs that did not end with everybody out
    groups: Sequence[str]
    group: IntArray  # index in `groups` of each person, -1 for none
    radius: FloatArray  # [m]
    height: FloatArray  # of the body [m]
    moves: Moves
    lines: Sequence[LineFlow]  # of the case
    speed: FloatArray | None = None  # desired speed on the flat [m/s]
    response_time: FloatArray | None = None  # [s]
    longest: Queue | None = None


def account_of_run(results: Results, error: BaseException | None = None) -> Account:
    """Return the account of a run from its results."""
    crowd, answer = results.crowd, results.answer
    group = np.full(results.number_of_people, -1, np.int32)
    for index, members in enumerate(results.groups):
        group[members.rows] = index
    return Account(
        answer=[line for line in (answer.verdict, answer.times, *answer.exits, answer.queue, answer.warnings) if line],
        **_of_summary(results, error),
        groups=[members.name for members in results.groups],
        group=group,
        radius=crowd.radius,
        height=crowd.height,
        moves=results.moves,
        lines=[flow for flow in results.flows if flow.kind == "line"],
        speed=crowd.speed[:, 0],
        response_time=crowd.start_time,
        longest=results.queues[0] if results.queues else None,
    )


def account_of_folder(trajectory: Trajectory) -> Account:
    """Return the account of a run from its result folder."""
    folder, header = trajectory.path.parent, trajectory.header
    known: dict[str, Any] = {name: getattr(trajectory, name) for name in ("groups", "group", "radius", "height")}
    known["moves"] = recorded_moves(trajectory)
    known["lines"] = [flow for flow in line_flows(trajectory).values() if flow.kind == "line"]
    if not (folder / SUMMARY_NAME).exists():
        facts = [("Seed", str(header.get("seed"))), ("Versions", _versions(header.get("versions", {})))]
        text = (
            f"The run was killed or has not ended: the recorded states end at t = {trajectory.time[-1]:g} s. "
            "Exit times are rounded to recorded states."
        )
        return Account(str(header.get("title", "")), (), facts, (), (), ("error", text), **known)
    if (folder / PEOPLE_NAME).exists():
        return account_of_run(results_beside(trajectory, folder))
    return Account(answer=(), **_of_summary(results_beside(trajectory, folder, with_people=False), None), **known)


def _of_summary(results: Results, error: BaseException | None) -> dict[str, Any]:
    """Return the fields of an account from the content of ``summary.json``, and the error of a run that failed."""
    case, last, people = results.case_table, results.last_out, results.number_of_people
    left = people - results.evacuated - sum(len(place.people) for place in results.places)
    ended = results.ended if error is None else FAILED
    step = case.simulation.get("step")
    facts = [
        ("Building", case.building.mesh),
        ("People", f"{people}, of whom {results.evacuated} got out"),
        *((f"At {place}", str(len(place.people))) for place in results.places),
        *(("Note", note) for note in results.notes),
        ("Last person out", "nobody" if last is None else f"{last:.2f} s"),
        ("Ended", f"{ended}, after {results.time:g} s"),
        ("Contact model", _with_parameters(case.model, case.model_parameters)),
        ("Forces", _plugins(case.forces)),
        ("Behaviours", _plugins(case.behaviours)),
        ("Time step", f"{step:g} s" if isinstance(step, float) else ""),
        ("Seed", str(results.seed)),
        ("Versions", _versions(results.versions)),
    ]
    return {
        "title": results.title,
        "facts": [(name, value) for name, value in facts if value],
        "warnings": results.warnings,
        "quality_warnings": results.quality_warnings,
        "banner": _banner(ended, results.time, left, people, error),
    }


def _banner(ended: str, time: float, left: int, people: int, error: BaseException | None) -> tuple[str, str] | None:
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
    return f"{name} ({as_text(values)})" if values else name


def _versions(versions: Any) -> str:
    if not isinstance(versions, Mapping):
        return ""
    return ", ".join(f"{name} {version}" for name, version in versions.items())
