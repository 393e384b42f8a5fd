"""Writing of replay.html: page, style, scripts and data in one file."""

import base64
import html
import json
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evac.analysis.queues import Queue
from evac.base.arrays import FloatArray
from evac.base.change import Change, changes_in_words
from evac.base.defaults import MOST_HEIGHT
from evac.base.errors import ResultError
from evac.base.phases import told
from evac.building.model.links import building_at
from evac.folder.files import replacing
from evac.pictures import palette
from evac.pictures.scales import MAPS, PEOPLE, SERVICES, Scale
from evac.replay.account import Account, account_of_folder, account_of_run, poster, texts
from evac.replay.geometry import building_for_page, marks_for_page
from evac.replay.motion import GRAIN, MOMENT, PACE, PART, MotionPacker
from evac.results.results import Results
from evac.results.verdict import bars
from evac.trajectory.trajectory import Trajectory

LARGEST = 1e9  #: Largest time or length that the page gets [s or m]; a response time may be as large as a float can be.

#: Number of states of people beyond which a page has only every second recorded time, every third, ...
MOST_STATES = 800_000

MOST_BARS = 5  #: Greatest number of compartments with a bar, those with the least margins.
PAGE = Path(__file__).with_name("page")  #: Template, style and scripts.

#: Script that decompresses and runs the others, and the last one of these.
LOADER, MAIN = "loader.js", "main.js"
COMMENT = re.compile(r"^ *//.*\n", re.M)  #: Lines that are comments of scripts, which the page has no use for.


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
    for k in told("writing the replay", range(len(trajectory)), len(trajectory)):
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
        "stops": palette.STOPS[palette.MAPS[scale.colours]],
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
