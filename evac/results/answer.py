"""The answer of a run in a few lines: whether it is in time, who is out, when and by which exits, queues, warnings."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray
from evac.base.errors import counted
from evac.contract.hooks import DEFAULT_MOVEMENT

if TYPE_CHECKING:
    from evac.results.results import Results

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
