"""Writing of replay.html: page, style, scripts and data in one file, and a plan without script."""

import base64
import html
import json
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from evac.analysis.lines import LineFlow, Moves, line_flows, recorded_moves
from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change, changes_in_words
from evac.base.defaults import MOST_HEIGHT
from evac.base.distributions import as_text
from evac.base.errors import ResultError
from evac.base.progress import track
from evac.building.model.links import building_at
from evac.folder.files import PEOPLE_NAME, SUMMARY_NAME, replacing
from evac.pictures import palette
from evac.pictures.palette import MAPS, PEOPLE, SERVICES, Scale
from evac.replay.geometry import building_for_page, marks_for_page
from evac.replay.motion import GRAIN, MOMENT, PACE, PART, MotionPacker
from evac.results.ending import FAILED, INTERRUPTED
from evac.results.reading import results_beside
from evac.results.results import Results
from evac.results.verdict import LeastMargin, Verdict, bars, least_margins
from evac.trajectory.trajectory import Trajectory

LARGEST = 1e9  #: Largest time or length that the page gets [s or m]; a response time may be as large as a float can be.

#: Number of states of people beyond which a page has only every second recorded time, every third, ...
MOST_STATES = 800_000

MOST_BARS = 5  #: Greatest number of compartments with a bar, those with the least margins.
PAGE = Path(__file__).with_name("page")  #: Template, style and scripts.

#: Script that decompresses and runs the others, and the last one of these.
LOADER, MAIN = "loader.js", "main.js"
COMMENT = re.compile(r"^ *//.*\n", re.M)  #: Lines that are comments of scripts, which the page has no use for.
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


def write_page(path: Path, motion: MotionPacker, account: Account, changes: Sequence[Change]) -> None:
    """Write the page of a run."""
    if not motion.frames:
        raise ResultError(f"{path}: nothing to replay; the run ended before its first output")
    building, floors = building_for_page(motion.building, motion.origin)
    times = dict.fromkeys([0.0, *(change.time for change in changes)])
    conditions = {time: building_at(motion.building, changes, time) for time in times}
    about = _about(account, len(motion.building.portals)) | {
        "building": building,
        "origin": motion.origin.tolist(),
        "states": [
            {
                "since": time,
                "shut": sorted(at.shut),
                "notes": {at.link_of(way): at.note_on(way) for way in at.exits if at.note_on(way)},
                "marks": marks_for_page(at, motion.origin),
            }
            for time, at in conditions.items()
        ],
        "longest": _longest(motion, account.longest),
        "changes": changes_in_words(changes),
        "cars": cars_for_page(motion, changes),
        "grain": GRAIN,
        "tallest": MOST_HEIGHT,
        "moment": MOMENT,
        "pace": PACE,
        "longest_wait": motion.longest_wait,
        "part": PART,
        "smoke": _smoke(motion, account.visibility),
        "northward": None if motion.building.northward is None else motion.building.northward.tolist(),
    }
    text = json.dumps(about, separators=(",", ":"), allow_nan=False)
    names = sorted(
        (path.relative_to(PAGE).as_posix() for path in PAGE.rglob("*.js")), key=lambda name: (name == MAIN, name)
    )
    scripts = "\n".join(COMMENT.sub("", _read(name)) for name in names if name != LOADER)  # within one function
    streams = {"scripts": zlib.compress(scripts.encode(), 9), "about": zlib.compress(text.encode(), 9)}
    streams |= {"floors": zlib.compress(floors.tobytes(), 9)} | motion.streams()
    title = html.escape(account.title or "Evacuation")
    words = texts(account) | {"title": title, "poster": poster(motion, account.group)}
    head, tail = _template(words).split("<!--data-->")
    with replacing(path, "the replay") as new, new.open("w", encoding="utf-8", errors="backslashreplace") as file:
        file.write(head)
        for name, data in streams.items():
            text = base64.b64encode(data).decode("ascii")
            file.write(f'<script type="text/plain" id="data-{name}">{text}</script>\n')
        file.write(tail)


def replay_run(results: Results, path: Path, error: BaseException | None = None) -> None:
    """Write the replay of a run that has ended, or failed with an error, if its motion is recorded."""
    if results.trajectory:
        write_page(path, packed(results.trajectory), account_of_run(results, error), results.trajectory.changes)


def replay_trajectory(trajectory: Trajectory, path: Path, every: float | None = None) -> int:
    """Write the replay of a trajectory, with what is in its folder; return the number of states.

    `every`: least time between two states [s]; by default all recorded ones are used, of large runs a part of them.
    """
    motion = packed(trajectory, every)
    write_page(path, motion, account_of_folder(trajectory), trajectory.changes)
    return motion.frames


def packed(trajectory: Trajectory, every: float | None = None) -> MotionPacker:
    """Return the motion of a trajectory; `every` as for `replay_trajectory`."""
    if not len(trajectory):
        raise ResultError(f"{trajectory.path}: no frame to replay; the run ended before its first output")
    if every is not None and not 0.0 < every < np.inf:
        raise ResultError(f"every: the time between two states must be greater than 0, got {every:g}")
    has_smoke = palette.SMOKE in [field.name for field in trajectory.level_fields]
    smoke = trajectory.field(palette.SMOKE) if has_smoke else None
    motion = MotionPacker(trajectory.number_of_people, trajectory.building, smoke, trajectory.contrast)
    chosen = _chosen(trajectory, every)
    for k in track("writing the replay", range(len(trajectory)), len(trajectory)):
        motion.add(trajectory[k], k in chosen, trajectory.has_dose, None if smoke is None else smoke.values[k])
    return motion


def _chosen(trajectory: Trajectory, every: float | None) -> set[int]:
    """Return the frames to show: the first, the last, and those nearest to the multiples of `every`."""
    time = trajectory.time
    if every is None:
        states = sum(len(rows.person) for rows in trajectory.rows)
        return {*range(0, len(time), max(1, math.ceil(states / MOST_STATES))), len(time) - 1}
    wanted, middles = np.arange(time[0], time[-1], every), 0.5 * (time[1:] + time[:-1])
    return {*np.searchsorted(middles, wanted, side="right").tolist(), len(time) - 1}


def _about(account: Account, portals: int) -> dict[str, Any]:
    """Return the account as plain JSON: times in hundredths of a second, lengths in millimetres."""
    moves = account.moves
    leaves = (moves.target < 0) & (moves.link >= portals)

    def whole(values: FloatArray | None, scale: float) -> list[int] | None:
        if values is None:
            return None
        scaled = np.where(np.isfinite(values), np.rint(np.minimum(np.nan_to_num(values), LARGEST) * scale), -1)
        return [int(value) for value in scaled.tolist()]

    return {
        "title": account.title,
        "quality_warnings": account.quality_warnings,
        "margins": [
            {
                "person": one.person,
                "time": one.time,
                "text": f"{one.margin:.1f} s: person {one.person} on {one.level.title!r}",
            }
            for one in account.margins
        ],
        "safety": bars(account.safety)[:MOST_BARS],
        "groups": account.groups,
        "colours": {
            "groups": palette.group_looks(len(account.groups)),
            "marks": palette.MARKS,
            "nothing": palette.NOTHING,
            "exit": palette.EXIT,
            "closed": palette.CLOSED,
            "places": palette.PLACES,
            "car": palette.CAR,
        },
        "people_scales": {scale.label: _scale(scale) for scale in PEOPLE.values()},
        "map_scales": {scale.label: _scale(scale) for scale in MAPS.values()},
        "services": {name: service._asdict() for name, service in SERVICES.items()},
        "group": account.group.tolist(),
        "radius": whole(account.radius, 1000.0),
        "height": whole(account.height, 1000.0),
        "speed": whole(account.speed, 100.0),
        "response_time": whole(account.response_time, 100.0),
        "lines": [
            {"name": line.name, "width": line.width, "times": np.round(line.time, 2).tolist()} for line in account.lines
        ],
        "moves": {
            "start": moves.start.tolist(),
            "person": moves.row.tolist(),
            "target": np.where(leaves, portals - 2 - moves.link, moves.target).tolist(),  # by exit k: -2 - k
            "time": np.diff(np.rint(100.0 * moves.time).astype(np.int64), prepend=0).tolist(),  # since the one before
        },
    }


def cars_for_page(motion: MotionPacker, changes: Sequence[Change]) -> list[dict[str, Any]]:
    """Return the lifts, with the level and the rise above it [cm] of the car, and whether it is open, at each time."""
    building = motion.building
    if not building.lifts:
        return []
    from evac.building.model.lifts import CAR_HEIGHT, cars_at

    states = [cars_at(building, changes, time) for time in motion.times]
    return [
        {
            "name": lift.name,
            "capacity": lift.operation.capacity,
            "tall": CAR_HEIGHT,
            "states": [[car.level, round(car.rise / GRAIN), int(car.is_open)] for car in own],
        }
        for lift, own in zip(building.lifts, zip(*states, strict=True), strict=True)
    ]


def _longest(motion: MotionPacker, queue: Queue | None) -> dict[str, Any] | None:
    """Return when and where the longest queue was longest."""
    level = None if queue is None else motion.building.level_named(queue.level)
    if queue is None or level is None:
        return None
    x, y = ([queue.x, queue.y] - motion.origin).tolist()
    text = f"longest queue, {queue.cause}: {queue.most} wait"
    return {"time": queue.time, "text": text, "at": {"level": level.index, "x": x, "y": y}}


def _smoke(motion: MotionPacker, limit: float | None) -> dict[str, Any] | None:
    """Return the cells of the field of smoke, left and lower edge [m] and numbers of each level, and a limit [m]."""
    if motion.field is None:
        return None
    grids = [[*(cells.origin - motion.origin).tolist(), *cells.shape[::-1]] for cells in motion.field.cells]
    about = {"depth": palette.DEPTH, "contrast": motion.contrast, "limit": limit}
    return {"size": motion.field.spacing, "grids": grids, **about}


def _scale(scale: Scale) -> dict[str, Any]:
    """Return a scale as plain JSON."""
    return {
        "unit": scale.unit,
        "top": scale.top,
        "stops": palette.STOPS[palette.RAMPS[scale.colours]],
        "isVeiled": scale.is_veiled,
        "least": scale.least,
        "isLogarithmic": scale.is_logarithmic,
        "below": scale.below,
    }


def _template(words: Mapping[str, str]) -> str:
    """Return the page without its data, with texts, which are escaped, at their places."""
    page = _read("template.html").replace("/*style*/", _read("style.css")).replace("/*loader*/", _read(LOADER))
    for name, text in words.items():
        page = page.replace(f"<!--{name}-->", text)
    return page


def _read(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")
