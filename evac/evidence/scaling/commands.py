"""Whole commands on buildings as users have them: towers, studies, reports and imports, each in its own process."""

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from evac.base.errors import ResultError
from evac.case.loading import load_case
from evac.evidence.evidence import Evidence, Row
from evac.evidence.verdicts import reported

SECTION = "Whole commands"

#: Storeys of towers with the same number of people, people in towers of the same height, runs, rooms of a map, and
#: exits, routes and classes of bodies of a tower.
SIZES = (4, 8, 16, 32, 60), (250, 500, 1_000), (5, 10, 20), (24, 96, 384), (2, 4, 8)
QUICK = (2, 3), (20, 40), (2, 3), (4, 8), (2, 3)

#: Length of a tower and of an office, and depths of offices and corridor [m].
LENGTH, OFFICE, DEPTH, CORRIDOR = 36.0, 6.0, 6.0, 3.0

#: Runs the command line, and prints its CPU time [s], with that of its processes, and its peak memory [bytes].
SCRIPT = """import os, sys
from evac.__main__ import program
status = program()
spent = sum(os.times()[:4])
from evac.evidence.scaling.large import peak_memory
print(spent, peak_memory())
sys.exit(status)
"""

#: How people move in the tower, by name in the table.
MOVEMENTS: dict[str, dict[str, Any]] = {
    "as in the paper": {},
    "walking": {"walking": {}},
    "walking, quickest": {"walking": {}, "route_choice": {"strategies": ["quickest"]}},
}


def run(evidence: Evidence) -> None:
    """Add the table to the page."""
    sizes = QUICK if evidence.quick else SIZES
    rows = evidence.measured("commands", command_rows, *sizes)
    for what in dict.fromkeys(row["command"] for row in rows):
        own = [row for row in rows if row["command"] == what]
        text = ", ".join(f"{row['CPU [s]']:.1f} s ({row['size']})" for row in own)
        text += f"; growth {own[-1]['growth']:.2f}" if own[-1]["growth"] is not None else ""
        evidence.verdict(reported(f"`{what}`: CPU time (size)", text, "-", SECTION))
    evidence.show("commands", __name__, rows=rows)


def tower_case(
    storeys: int, people: int, behaviours: dict[str, Any], exits: int = 2, routes: int = 1, classes: int = 1
) -> Row:
    """Return the content of a case: a tower of offices along corridors, with two stairs at the ends of these.

    There are more exits in the long wall of the ground floor. Of several routes, each has its own exit; of several
    classes of bodies, all except the narrowest are too wide for gaps between offices.
    """
    names = ["ground", *(f"storey {k}" for k in range(1, storeys))]
    own = {"storey": names[1]}
    middle = DEPTH + CORRIDOR
    rooms = [{"name": "corridor", "polygon": _box(0.0, DEPTH, LENGTH, middle), **own}]
    doors = []
    for k in range(2 * int(LENGTH / OFFICE)):
        x, y = OFFICE * (k // 2), (0.0, middle)[k % 2]
        rooms.append({"name": f"office {k}", "polygon": _box(x, y, x + OFFICE, y + DEPTH), **own})
        segment = {"rooms": ["corridor", f"office {k}"], "at": OFFICE / 2, "width": 0.9}
        doors.append({"name": f"door {k}", "segment": segment, **own})
    rest = [{"name": name, "z": 3.2 * (k + 2), "like": names[1]} for k, name in enumerate(names[2:])]
    ground = {"name": "ground", "z": 0.0, "polygons": [_box(0.0, 0.0, LENGTH, middle + DEPTH)]}
    ends = {"west": (0.0, middle - 1.4, middle - 0.2, -1.0), "east": (LENGTH, DEPTH + 1.4, DEPTH + 0.2, 1.0)}
    shafts = [
        {"name": name, "lower": "ground", "upper": names[-1], "lower_edge": [[x, low], [x, high]], "length": 3.0}
        | {"direction": [away, 0.0], "turn": "left"}
        for name, (x, low, high, away) in ends.items()
    ]
    ways_out = [
        {"name": f"{name} door", "storey": "ground", "segment": [[x, 1.0], [x, 3.0]]} for name, (x, *_) in ends.items()
    ]
    for k in range(exits - len(ends)):
        side = {"segment": [[OFFICE * k + 1.0, 0.0], [OFFICE * k + 3.0, 0.0]]}
        ways_out.append({"name": f"side door {k}", "storey": "ground", **side})
    for k in range(classes - 1):
        segment = {"rooms": [f"office {k}", f"office {k + 2}"], "at": DEPTH / 2, "width": 0.42 + 0.02 * k}
        doors.append({"name": f"gap {k}", "segment": segment, **own})
    storeys_of_plan = [ground, {"name": names[1], "z": 3.2, "wall": 0.2}, *rest]
    plan = {"storeys": storeys_of_plan, "rooms": rooms, "doors": doors, "shafts": shafts, "exits": ways_out}
    numbers = [people // storeys + (k < people % storeys) for k in range(storeys)]
    return {
        "title": f"A tower of {storeys} storeys and {people} people",
        "building": {"plan": plan},
        "people": [
            {"name": name, "level": name, "number": number}
            | ({"exits": [ways_out[k % routes]["name"]]} if routes > 1 else {})
            | ({"radius": {"uniform": [0.2, 0.3]}} if classes > 1 else {})
            for k, (name, number) in enumerate(zip(names, numbers, strict=True))
        ],
        "contact": {"model": "nsm2"},
        "behaviours": {"response_time": {"time": {"uniform": [0.0, 60.0]}, "per": "person"}} | behaviours,
        "simulation": {"duration": 3600.0},
    }


def _box(x1: float, y1: float, x2: float, y2: float) -> list[list[float]]:
    return [[x1, y1], [x2, y1], [x2, y2], [x1, y2]]


def command_rows(
    storeys: tuple[int, ...],
    people: tuple[int, ...],
    runs: tuple[int, ...],
    rooms: tuple[int, ...],
    sides: tuple[int, ...],
) -> Iterator[Row]:
    """Yield a row for each command and size; the second number of storeys and of people is that of comparisons."""
    most, middle = storeys[1], people[1]
    with TemporaryDirectory() as name:
        folder = Path(name)

        def written(storeys: int, people: int, movement: str = "walking", **more: int) -> list[str]:
            case = folder / f"{storeys} {people} {movement} {more}" / "case.toml"
            case.parent.mkdir(exist_ok=True)
            load_case(tower_case(storeys, people, MOVEMENTS[movement], **more)).write(case)
            return [str(case)]

        result = ["--out", str(folder / "result")]
        _spent("run", *written(storeys[0], people[0]), *result)  # compiles kernels
        towers = [(f"{number} storeys", [*written(number, middle), *result]) for number in storeys]
        yield from _grown("evac check (storeys)", "check", storeys, [(size, words[:1]) for size, words in towers])
        yield from _grown(f"evac run ({middle} people)", "run", storeys, towers)
        for what in ("exits", "routes", "classes"):
            # People who keep distances are narrower than the gaps.
            movement = "as in the paper" if what == "classes" else "walking"
            exits = sides[-1] if what == "routes" else 2
            cases = [written(most, middle, movement, **{"exits": exits, what: number}) for number in sides]
            sizes = [(f"{number} {what}", words) for number, words in zip(sides, cases, strict=True)]
            yield from _grown(f"evac check ({what})", "check", sides, sizes)
        for movement in MOVEMENTS:
            words = [*written(most, middle, movement), *result]
            yield from _grown(f"evac run, {movement}", "run", (1,), [(f"{most} storeys, {middle} people", words)])
        reports: list[Row] = []
        for number in people:
            size = f"{number} people"
            yield from _grown("evac run", "run", (number,), [(size, [*written(most, number), *result])], reports)
            page = ["--out", str(folder / "report.html")]
            yield from _grown("evac report", "report", (number,), [(size, [str(folder / "result"), *page])], reports)
        study = [*written(storeys[0], people[0]), "--jobs", "1", "--out", str(folder / "study")]
        yield from _grown("evac repeat", "repeat", runs, [(f"{k} runs", [*study, "--runs", f"{k}"]) for k in runs])
        maps = []
        for number in rooms:
            path = folder / f"{number}.geojson"
            path.write_text(json.dumps(_map(number)), encoding="utf-8")
            maps.append(
                (f"{number} rooms", [str(path), "--option", "wall=0.2", "--out", str(folder / f"map {number}")])
            )
        yield from _grown("evac import", "import", rooms, maps)


def _grown(
    what: str, command: str, sizes: tuple[int, ...], tasks: list[tuple[str, list[str]]], before: list[Row] | None = None
) -> Iterator[Row]:
    """Yield a row for each size; growth is the exponent of the CPU time between this size and the one before."""
    before = [] if before is None else before
    for number, (size, words) in zip(sizes, tasks, strict=True):
        seconds, memory = _spent(command, *words)
        last = next((row for row in reversed(before) if row["command"] == what), None)
        growth = math.log(seconds / last["CPU [s]"]) / math.log(number / last["number"]) if last else None
        row = {"command": what, "size": size, "number": number, "CPU [s]": seconds, "peak memory [MB]": memory}
        before.append(row | {"growth": growth})
        yield before[-1]


def _spent(*words: str) -> tuple[float, float]:
    """Return CPU time [s] and peak memory [MB] of a command of evac."""
    done = subprocess.run([sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):  # 3: not everybody is out
        raise ResultError(f"evac {' '.join(words)} ended with status {done.returncode}: {done.stderr}")
    seconds, memory = done.stdout.splitlines()[-1].split()
    return float(seconds), 1e-6 * float(memory)


def _map(rooms: int) -> Row:
    """Return an indoor map in GeoJSON: rooms on both sides of a corridor, each with a door, and an exit."""
    length = OFFICE * (rooms // 2)
    features: list[tuple[Row, str, Any]] = [
        ({"name": "corridor"}, "Polygon", [_ring(0.0, DEPTH, length, DEPTH + CORRIDOR)])
    ]
    for k in range(rooms):
        x, y = OFFICE * (k // 2), (0.0, DEPTH + CORRIDOR)[k % 2]
        wall = (DEPTH, DEPTH + CORRIDOR)[k % 2]
        features.append(({"name": f"room {k}"}, "Polygon", [_ring(x, y, x + OFFICE, y + DEPTH)]))
        features.append(({"name": f"door {k}", "kind": "door"}, "LineString", [[x + 2.5, wall], [x + 3.5, wall]]))
    features.append(({"name": "exit", "kind": "exit"}, "LineString", [[0.0, DEPTH + 1.0], [0.0, DEPTH + 2.0]]))
    return {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": properties, "geometry": {"type": shape, "coordinates": places}}
            for properties, shape, places in features
        ],
    }


def _ring(x1: float, y1: float, x2: float, y2: float) -> list[list[float]]:
    ring = _box(x1, y1, x2, y2)
    return [*ring, ring[0]]
