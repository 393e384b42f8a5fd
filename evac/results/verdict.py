"""The verdict on a run or a study, where the margin is least, and the answer of a run in a few lines."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from typing_extensions import TypedDict

from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray
from evac.base.errors import counted
from evac.contract.hooks import DEFAULT_MOVEMENT

if TYPE_CHECKING:
    from evac.building.model.building import Level
    from evac.results.results import Results
    from evac.trajectory.trajectory import Trajectory

NO_LIMIT = "No limit set: a table [safety] in the case sets one"  #: What is said where no limit is set.

#: Criteria in words, by their keys in a case.
BY = {
    "available": "given",
    "visibility": "visibility",
    "temperature": "temperature",
    "fic": "irritants",
    "layer": "layer of smoke",
    "fed": "dose",
}


class Verdict(TypedDict):
    """Whether people leave in time, at the compartment whose margin with the safety factor is least.

    ``status`` is "green" if the required time with the safety factor is available, "amber" if it is without, "red" if
    it is not, and "none" without a limit. Times in s are null where there is no limit, and ``required`` and the margins
    also where people have not left. ``text`` says all that in a sentence.
    """

    status: Literal["green", "amber", "red", "none"]
    text: str
    compartment: str | None
    required: float | None
    available: float | None
    margin: float | None
    margin_with_factor: float | None


def verdict_of(safety: Mapping[str, Any] | None) -> Verdict:
    """Return the verdict on what summary.json has as ``safety``; a study has percentiles as required times."""
    rows = [] if safety is None else sorted(judged(safety), key=lambda row: row["margin_with_factor"])
    if safety is None or not rows:
        nobody = "No limit applies: nobody belongs to a compartment of the case"
        return Verdict(
            status="none",
            text=NO_LIMIT if safety is None else nobody,
            compartment=None,
            required=None,
            available=None,
            margin=None,
            margin_with_factor=None,
        )
    worst, factor = rows[0], safety["factor"]
    said = {"green": "In time", "amber": "In time, but not with the safety factor", "red": "NOT in time"}
    words = "no margin" if worst["required"] is None else f"margin {worst['margin']:.1f} s"
    if factor != 1.0 and worst["required"] is not None:
        words += f", {worst['margin_with_factor']:.1f} s with the factor {factor:g}"
    margins = (worst["margin"], worst["margin_with_factor"]) if worst["required"] is not None else (None, None)
    return Verdict(
        status=worst["status"],
        text=f"{said[worst['status']]}: {worst['text']}: {words}",
        compartment=worst["name"],
        required=worst["required"],
        available=worst["limit"],
        margin=margins[0],
        margin_with_factor=margins[1],
    )


def rank(verdict: Verdict) -> tuple[int, float]:
    """Return what orders verdicts, from the worst one; those without limits come first, because nothing is known."""
    margin = verdict["margin_with_factor"]
    return ["none", "red", "amber", "green"].index(verdict["status"]), -math.inf if margin is None else margin


def judged(safety: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the compartments to which people belong with ``status``, ``limit`` and ``margin``s [s], and a ``text``.

    The limit is the least available time that is known. The margins are -inf where people have not left.
    """
    for row in safety["compartments"]:
        if not row["people"]:
            continue
        limit, required = row["until"] if row["available"] is None else row["available"], row["required"]
        margins = [-math.inf if required is None else limit - factor * required for factor in (1.0, safety["factor"])]
        status = "green" if margins[1] >= 0.0 else "amber" if margins[0] >= 0.0 else "red"
        left = "not left by everybody" if required is None else f"left after {required:.1f} s{row.get('spread', '')}"
        how = "at least " * (row["available"] is None) + f"{limit:.1f} s"
        why = "" if row["available"] is None else f" ({BY[row['criterion']]})"
        text = f"{row['name']!r} is {left}, available for {how}{why}"
        yield {
            **row,
            "status": status,
            "limit": limit,
            "margin": margins[0],
            "margin_with_factor": margins[1],
            "text": text,
        }


def bars(safety: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Return what bars over time show of compartments: name, status, text, limit and required time; the worst first."""
    rows = [] if safety is None else sorted(judged(safety), key=lambda row: row["margin_with_factor"])
    return [{name: row[name] for name in ("name", "status", "text", "limit", "required")} for row in rows]


class LeastMargin(NamedTuple):
    """The least margin of a person on its way [s], when, and where: a level and a place in plan [m]."""

    person: int
    margin: float
    time: float
    level: "Level"
    x: float
    y: float


def least_margins(
    margins: Mapping[str, FloatArray], trajectory: "Trajectory", most: int | None = None
) -> list[LeastMargin]:
    """Return the least margins of people (`Results.margins`), worst first, with the last places recorded by then."""
    if not margins:
        return []
    least, at = margins["least_margin"], margins["least_margin_at"]
    worst_first = []
    for person in np.argsort(least, kind="stable")[: np.isfinite(least).sum()][:most].tolist():
        rows = trajectory.rows[max(int(np.searchsorted(trajectory.time, at[person] + 1e-9)) - 1, 0)]
        own = np.flatnonzero(rows.person == person)
        if len(own):  # who leaves soon after it came may be in no recorded state
            x, y = (rows.motion[own[0], :2].astype(np.float64) + trajectory.origin).tolist()
            level = trajectory.building.levels[rows.level[own[0]]]
            worst_first.append(LeastMargin(person, float(least[person]), float(at[person]), level, x, y))
    return worst_first


MOST = 95.0  #: Share of the people whose time is stated besides that of the last one [%].
MOST_EXITS = 4  #: Number of exits that are named, those used most.
SECOND = 0.1  #: Least share of all waiting with which a second queue is named.


class Answer(NamedTuple):
    """The answer of a run; each field is complete sentences without the last full stop, or empty."""

    verdict: str
    outcome: str
    times: str
    exits: tuple[str, ...]
    queue: str
    movement: str
    remarks: tuple[str, ...]
    warnings: str

    def lines(self) -> list[str]:
        """Return all lines that are not empty."""
        return [line for part in self for line in (part if isinstance(part, tuple) else (part,)) if line]


def answer_of(results: "Results") -> Answer:
    """Return the answer of a run, from its results and, where there is one, its trajectory."""
    queue = "" if results.trajectory is None else _queues(results)
    said = results.verdict["text"], _outcome(results), _times(results), _exits(results), queue
    return Answer(*said, movement_of(results.keeps_distance), results.remarks, _warnings(results))


def movement_of(keepers: Sequence[str]) -> str:
    """Return whether people keep distances, by the behaviours in use with which they do."""
    if keepers:
        return f"People keep distances ({', '.join(keepers)})"
    return f"People do not keep distances; to change this, set behaviours.{DEFAULT_MOVEMENT}={{}}"


def time_of_share(exit_time: FloatArray, percent: float) -> float | None:
    """Return when so many per cent of people (n,) were out [s], NaN: never; None if that many never were."""
    rank = max(math.ceil(percent / 100.0 * exit_time.size), 1)
    out = np.sort(exit_time[np.isfinite(exit_time)])
    return float(out[rank - 1]) if rank <= out.size else None


def _outcome(results: "Results") -> str:
    out = f"{results.evacuated} of {counted(results.number_of_people, 'person', 'people')} out"
    if results.at_places:
        out += f", {results.at_places} at a safe place"
    if results.staying:
        out += f", {results.staying} who do not leave"
    if results.spare:
        out += f", {results.spare} of a reserve who were not added"
    if len(results.stopped):
        out += f", {len(results.stopped)} stopped by gases or heat"
    if results.is_complete:
        return f"{results.ended.capitalize()}: {out}" if results.ended.startswith("everybody") else f"Complete: {out}"
    return f"NOT everybody is out after {results.time:.2f} s ({results.ended}): {out}"


def _times(results: "Results") -> str:
    if results.last_out is None:
        return ""
    most = time_of_share(results.crowd.exit_time[results.leaving], MOST)
    share = f"{MOST:g} % are out after {most:.2f} s" if most is not None else f"fewer than {MOST:g} % got out"
    if results.is_complete:
        return f"Evacuation time {results.last_out:.2f} s; {share}"
    return f"Last out after {results.last_out:.2f} s; {share}"


def _exits(results: "Results") -> tuple[str, ...]:
    used = sorted(results.exits.items(), key=lambda item: -item[1]["people"])
    building, lines = results.building_or_none, list[str]()
    notes: dict[str, object] = {}
    if building is not None:
        notes = {
            one.name: building.controlled.get(building.link_of(one)) or building.note_on(one) for one in building.exits
        }
    for name, use in used[: MOST_EXITS if len(used) <= MOST_EXITS else MOST_EXITS - 1]:
        last = "" if use["last_out"] is None else f" by {use['last_out']:.2f} s"
        flow = "" if use["flow"] is None else f", middle fifths {use['flow']:.2f}/s ({use['flow_per_metre']:.2f}/s/m)"
        note = f" ({notes[name]})" if notes.get(name) else ""
        lines.append(f"Exit {name!r}{note}: {counted(use['people'], 'person', 'people')}{last}{flow}")
    if others := used[len(lines) :]:
        people = sum(use["people"] for _, use in others)
        lines.append(f"{len(others)} other exits: {counted(people, 'person', 'people')}")
    return tuple(lines)


def _queues(results: "Results") -> str:
    if results.hold_up is None:
        waited = sum(queue.waited for queue in results.queues)
        return f"Little waiting, {waited:.1f} s of all people together" if waited else "Nobody had to wait"
    others = [one for one in results.queues if one.share >= SECOND and not one.is_little and one != results.hold_up]
    return "; next is ".join([f"What holds up most is {results.hold_up}", *map(Queue.brief, others[:1])])


def _warnings(results: "Results") -> str:
    kinds = list(dict.fromkeys(line.partition(":")[0] for line in results.quality_warnings))
    parts = [f"{counted(len(results.quality_warnings), 'quality warning')} ({'; '.join(kinds)})"] if kinds else []
    if results.warnings:
        parts.append(counted(len(results.warnings), "warning") + " about building and people")
    return ", ".join(parts)
