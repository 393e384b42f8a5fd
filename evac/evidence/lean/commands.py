"""Time of picture and animation, and start-up time of each command."""

import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

import numpy as np

from evac.case.loading import load_case
from evac.evidence.evidence import Evidence, Row, in_fresh_process, timed
from evac.evidence.verdicts import reported
from evac.simulation.running import run as run_case

FRESH, AGAIN = "fresh process, with imports [ms]", "afterwards [ms]"


def report_output(evidence: Evidence, repeats: int) -> None:
    """Add the time of picture and animation: the first in a new process, and repeated."""
    fresh = 1 if evidence.quick else 5
    rows = evidence.measured("output", _output_rows, fresh, repeats)
    section = "Picture and animation"
    for row in rows[1:]:
        what = "picture" if row["picture"] == "in" else "animation"
        text = f"{row[FRESH]:.0f} ms, then {row[AGAIN]:.0f} ms"
        evidence.verdict(reported(f"Square room: {what}, in a new process and again", text, "-", section))
    evidence.show("output", __name__, fresh=fresh, repeats=repeats, rows=rows, section=section)


def _output_rows(fresh: int, repeats: int) -> Iterator[Row]:
    for picture, animation in ((False, False), (True, False), (False, True)):
        switches = {"output.picture": picture, "output.animation": animation}
        yield {
            "picture": "in" if picture else "out",
            "animation": "in" if animation else "out",
            FRESH: 1e3 * float(np.median([in_fresh_process(output_time, switches) for _ in range(fresh)])),
            AGAIN: 1e3 * float(np.median([output_time(switches) for _ in range(repeats + 1)][1:])),
        }


def output_time(switches: dict[str, bool]) -> float:
    """Return the time of the output of a run of the square room [s]."""
    with TemporaryDirectory() as folder:
        return run_case(load_case("square_room", switches), Path(folder) / "result").phases["output"]


#: Commands whose times are in the verdicts of the page.
SHOWN = ("evac --help", "evac check primary_school", "evac run square_room")


def commands(folder: Path) -> dict[str, list[str]]:
    """Return the timed commands, in order: arguments of Python, by name in the table; results go to a folder."""
    result = str(folder / "result")
    more = {
        "evac --help": [],
        "evac list": [],
        "evac plugins": [],
        "evac cache": [],
        "evac check square_room": [],
        "evac explain square_room": [],
        "evac run square_room": ["--out", result],
        "evac resume --help": [],
        "evac repeat square_room --runs 2 --jobs 1": ["--out", str(folder / "runs")],
        "evac sweep --help": [],
        "evac compare --help": [],
        "evac conditions deck office_fire": [],
        "evac replay": [result, "--out", str(folder / "replay.html")],
        "evac map": [result, "--of", "density"],
        "evac export": [result],
        "evac report": [result, "--out", str(folder / "report.html"), "--maps", "none"],
        "evac render": [result, "--out", str(folder / "picture.png")],
        "evac import --help": [],
        "evac new": [str(folder / "new")],
        "evac verify": [],
        "evac evidence --help": [],
        "evac check primary_school": [],
        "evac explain primary_school": [],
    }
    commands = {"python alone": ["-c", "pass"], "import evac": ["-c", "import evac"]}
    return commands | {name: ["-m", *name.split(), *words] for name, words in more.items()}


def report_commands(evidence: Evidence) -> None:
    """Add the start-up time of each command."""
    repeats = 1 if evidence.quick else 9
    rows = evidence.measured("commands", _command_rows, evidence.quick, repeats)
    section = "Start-up of each command"
    for row in rows:
        if row["command"] in SHOWN:
            evidence.verdict(reported(f"`{row['command']}`", f"{row['median [s]']:.2f} s", "-", section))
    evidence.show("commands", __name__, repeats=repeats, rows=rows, section=section)


def _command_rows(quick: bool, repeats: int) -> list[Row]:
    rows: list[Row] = []
    with TemporaryDirectory() as folder:
        for name, arguments in commands(Path(folder)).items():
            if quick and "primary_school" in arguments:
                continue
            start = partial(subprocess.run, [sys.executable, *arguments], check=True, capture_output=True)
            timing = timed(start, repeats, partial(rmtree, Path(folder) / "new", ignore_errors=True))
            row = {
                "command": name,
                "median [s]": timing.median,
                "least [s]": timing.least,
                "greatest [s]": timing.greatest,
            }
            row["without python itself [s]"] = timing.median - rows[0]["median [s]"] if rows else None
            rows.append(row | {"reference run [ms]": 1e3 * timing.reference})
    return rows
