"""Attacks on the tables of a result: edited ones are shown by replay and report, or refused in one line.

`cases` yields cases, `run` runs one and raises AssertionError where it does not do what is promised.
"""

import csv
import json
import random
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import evac
from evac.base.errors import ResultError
from evac.folder.files import PEOPLE_NAME, SUMMARY_NAME
from evac.replay.writer import replay_trajectory
from evac.report.of_run import run_report
from evac.report.sections import Places
from tests.attacks.checkpoints import HALL, ODD, places, table
from tests.attacks.seeded import Case, in_turn

#: Cells of a table of people.
CELLS = ("", "x", "-1", "nan", "inf", "-1e308", "1e308", "1e999", "\ud800", "\x00", '"', "=1+1", "é" * 200_000, "front")


def run(case: Case, folder: Path) -> str:
    """Run one case in an empty folder; return which of replay and report were ``refused`` or ``shown``."""
    shutil.copytree(_result(), folder / "r")
    path, generator = folder / "r" / case.kind, random.Random(f"{case}")
    (_edit_summary if case.kind == SUMMARY_NAME else _edit_people)(path, generator)
    trajectory = evac.read_trajectory(folder / "r")
    replay = _outcome(path, lambda: replay_trajectory(trajectory, folder / "replay.html"))
    report = _outcome(path, lambda: run_report(folder / "r", places=Places(4.0, maps=())))
    return f"replay {replay}, report {report}"


def _outcome(path: Path, act: Any) -> str:
    refusal = None
    try:
        act()
    except ResultError as error:
        refusal = str(error)
    if refusal is None:
        return "shown"
    assert path.name in refusal, refusal
    assert "\n" not in refusal, refusal
    return "refused"


@cache
def _result() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="evac-attack-result-"))
    mesh = folder / "hall.obj"
    mesh.write_text("v 0 0 0\nv 5 0 0\nv 5 4 0\nv 0 4 0\nf 1 2 3 4\n", encoding="utf-8")
    evac.run({**HALL, "building": {**HALL["building"], "mesh": str(mesh)}}, folder / "r", progress=False)
    return folder / "r"


def _edit_summary(path: Path, generator: random.Random) -> None:
    text = path.read_text(encoding="utf-8")
    summary = json.loads(text)
    place = generator.choice([place for place in places(summary) if len(place) <= generator.choice((1, 2, 4))])
    deep: Any = json.loads("[" * 900 + "]" * 900)
    value = generator.choice((*ODD, "\ud800", deep, {"a": {"b": deep}}, {"type": "x", "simulation": []}))
    if generator.random() < 0.2:
        del table(summary, place)[place[-1]]
    else:
        table(summary, place)[place[-1]] = value
    path.write_text(generator.choice((json.dumps(summary),) * 9 + (text[: len(text) // 2],)), encoding="utf-8")


def _edit_people(path: Path, generator: random.Random) -> None:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    row, column = generator.randrange(len(rows)), generator.randrange(len(rows[0]))
    change = generator.randrange(8)
    if change == 0:
        del rows[row]
    elif change == 1:
        rows.insert(row, rows[-1])
    elif change == 2:
        del rows[row][column]
    else:
        rows[row][column] = generator.choice(CELLS)
    text = "\n".join(",".join(cells) for cells in rows)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))


#: Cases of a number and a seed.
cases = in_turn((SUMMARY_NAME, PEOPLE_NAME))
