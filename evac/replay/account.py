"""Data on the replay page other than the motion: people, settings, outcome, warnings, and a plan without script."""

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from evac.analysis.lines import LineFlow, Moves, line_flows, recorded_moves
from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray, IntArray
from evac.base.distributions import as_text
from evac.folder.files import PEOPLE_NAME, SUMMARY_NAME
from evac.pictures import palette
from evac.replay.motion import GRAIN, MotionPacker
from evac.results.ending import FAILED, INTERRUPTED
from evac.results.reading import results_beside
from evac.results.results import Results
from evac.results.verdict import LeastMargin, Verdict, least_margins
from evac.trajectory.trajectory import Trajectory

MOST_MARGINS = 10  #: Greatest number of people with the least margins that are listed.


@dataclass(frozen=True)
class Account:
    """Description of a run; without the arrays that are None for a killed run."""

    title: str
    answer: Sequence[str]  # lines that open the page
    facts: Sequence[tuple[str, str]]  # names and values, in order
    warnings: Sequence[str]
    quality_warnings: Sequence[str]
    banner: str  # of a run that was killed, failed or was interrupted
    groups: Sequence[str]
    group: IntArray  # index in `groups` of each person, -1 for none
    radius: FloatArray  # [m]
    height: FloatArray  # of the body [m]
    moves: Moves
    lines: Sequence[LineFlow]  # of the case
    speed: FloatArray | None = None  # desired speed on the flat [m/s]
    response_time: FloatArray | None = None  # [s]
    longest: Queue | None = None
    verdict: Verdict | None = None
    safety: Mapping[str, Any] | None = None  # as summary.json has it
    margins: Sequence[LeastMargin] = ()  # the least ones
    visibility: float | None = None  # of the criteria of the case, the greatest [m]


def account_of_run(results: Results, error: BaseException | None = None) -> Account:
    """Return the account of a run from its results."""
    crowd, answer = results.crowd, results.answer
    group = np.full(results.number_of_people, -1, np.int32)
    for index, members in enumerate(results.groups):
        group[members.rows] = index
    return Account(
        answer=[one for one in (answer.outcome, answer.times, *answer.exits, answer.queue, answer.warnings) if one],
        **_of_summary(results, error),
        groups=[members.name for members in results.groups],
        group=group,
        radius=crowd.radius,
        height=crowd.height,
        moves=results.moves,
        lines=[flow for flow in results.flows if flow.kind == "line"],
        speed=crowd.speed[:, 0],
        response_time=crowd.start_time,
        longest=results.hold_up,
        margins=least_margins(results.margins, results.trajectory, MOST_MARGINS) if results.trajectory else (),
    )


def account_of_folder(trajectory: Trajectory) -> Account:
    """Return the account of a run from its result folder."""
    folder, header = trajectory.path.parent, trajectory.header
    if all((folder / name).exists() for name in (SUMMARY_NAME, PEOPLE_NAME)):
        return account_of_run(results_beside(trajectory, folder))
    known: dict[str, Any] = {name: getattr(trajectory, name) for name in ("groups", "group", "radius", "height")}
    known["moves"] = recorded_moves(trajectory)
    known["lines"] = [flow for flow in line_flows(trajectory) if flow.kind == "line"]
    if not (folder / SUMMARY_NAME).exists():
        facts = [("Seed", str(header.get("seed"))), ("Versions", _versions(header.get("versions", {})))]
        text = (
            f"The run was killed or has not ended: the recorded states end at t = {trajectory.time[-1]:g} s. "
            "Exit times are rounded to recorded states."
        )
        return Account(str(header.get("title", "")), (), facts, (), (), text, **known)
    return Account(answer=(), **_of_summary(results_beside(trajectory, folder, with_people=False), None), **known)


def _of_summary(results: Results, error: BaseException | None) -> dict[str, Any]:
    """Return the fields of an account from the content of ``summary.json``, and the error of a run that failed."""
    case, last, people = results.case_table, results.last_out, results.number_of_people
    left = people - results.evacuated - sum(len(place.people) for place in results.places)
    ended = results.ended if error is None else FAILED
    step = case.simulation.get("step")
    criteria = (results.settings.get("safety") or {}, *results.settings.get("compartment", ()))
    limits = [one["visibility"] for one in criteria if one.get("visibility")]
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
        "verdict": results.verdict,
        "safety": results.safety,
        "visibility": max(limits, default=None),
        "banner": _banner(ended, results.time, left, people, error),
    }


def _banner(ended: str, time: float, left: int, people: int, error: BaseException | None) -> str:
    """Return what opens the page of a run that failed or was interrupted."""
    if ended not in (FAILED, INTERRUPTED):
        return ""
    why = f" ({error})" if error else ""
    return f"This run {ended} at t = {time:.2f} s{why}, with {left} of {people} people inside."


def _plugins(tables: Mapping[str, Any]) -> str:
    used = [_with_parameters(name, values) for name, values in tables.items() if values is not False]
    return "; ".join(used) or "none"


def _with_parameters(name: str, values: Mapping[str, Any]) -> str:
    return f"{name} ({as_text(values)})" if values else name


def _versions(versions: Any) -> str:
    if not isinstance(versions, Mapping):
        return ""
    return ", ".join(f"{name} {version}" for name, version in versions.items())


TOLERANCE = 0.05  #: Lines of floors are drawn with this tolerance [m], which keeps the picture small.
MOST_PEOPLE = 1500  #: At most so many people are drawn.


def texts(account: Account) -> dict[str, str]:
    """Return the parts of the page that tell about the run, as HTML, by their places in the template."""
    goes = {line: account.longest for line in account.answer if account.longest and str(account.longest) in line}
    facts = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in account.facts)
    warnings = _list("Quality warnings", account.quality_warnings)
    verdict, judged = "", account.verdict
    if judged is not None:
        verdict = f'<p class="{judged["status"]}">{html.escape(judged["text"])}</p>'
    warnings += _list("Warnings about building and people", account.warnings)
    return {
        "banner": f'<p id="banner" role="alert"{"" if account.banner else " hidden"}>{html.escape(account.banner)}</p>',
        "answer": verdict + "".join(f"<p>{html.escape(line)}{_show(goes.get(line))}</p>" for line in account.answer),
        "facts": facts,
        "warnings": warnings or "<h3>No warnings</h3>",
    }


def poster(motion: MotionPacker, group: IntArray) -> str:
    """Return a picture of all storeys in plan side by side, with the first state of people (n,) by group, as SVG."""
    building = motion.building
    low, high = np.array(shapely.total_bounds([level.polygon for level in building.levels])).reshape(2, 2)
    gap = 0.1 * float((high - low).max()) + 1.0
    cell = high - low + gap
    columns = max(1, round(math.sqrt(1.6 * len(building.storeys) * cell[1] / cell[0])))  # about as wide as a screen
    width, height = cell * [min(columns, len(building.storeys)), math.ceil(len(building.storeys) / columns)]
    person, on, position = motion.first_state()
    every = math.ceil(max(len(person), 1) / MOST_PEOPLE)
    colours = palette.group_colours(int(group.max(initial=-1)) + 1)
    parts = []
    for number, (name, levels) in enumerate(building.storeys):
        x, y = cell * divmod(number, columns)[::-1]
        rows = [level.index for level in levels]
        size = min(0.6 * gap, width / 40.0)
        parts.append(f'<text x="{x:.2f}" y="{y - 0.2 * gap:.2f}" font-size="{size:.2f}">{html.escape(name)}</text>')
        parts.append(f'<g transform="translate({x - low[0]:.2f} {y + high[1]:.2f}) scale(1 -1)">')
        for level in levels:
            floor = shapely.set_precision(level.polygon.simplify(TOLERANCE), GRAIN)
            parts.append(floor.svg(0.001 * width, palette.LEVELS[level.kind], 1.0))
        for exit_ in building.exits:
            if exit_.level in rows:
                ends = "".join(f"M{a:.2f} {b:.2f}L{c:.2f} {d:.2f}" for a, b, c, d in exit_.segments)
                parts.append(f'<path class="exit" d="{ends}"/>')
        here = np.flatnonzero(np.isin(on, rows))[::every]
        for own in np.unique(group[person[here]]):
            dots = "".join(f"M{a:.2f} {b:.2f}h0" for a, b in position[here[group[person[here]] == own]])
            style = f'class="people" stroke="{colours[own]}" stroke-width="{width / 200.0:.2f}"'
            parts.append(f'<path {style} d="{dots}"/>')
        parts.append("</g>")
    label = "All storeys in plan, from the lowest, with the people at the start"
    box = f"-0.5 {-gap:.2f} {width:.2f} {height + 0.5:.2f}"
    return f'<svg viewBox="{box}" role="img" aria-label="{label}">{"".join(parts)}</svg><p>{label}</p>'


def _show(queue: Queue | None) -> str:
    return "" if queue is None else f' <button type="button" value="{queue.time!r}">Show</button>'


def _list(title: str, lines: Sequence[str]) -> str:
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<h3>{title}</h3><ul>{items}</ul>" if items else ""
