"""What leaving out saves: each part forced in on scenes that do not need it, and the start-up of each command."""

import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from evac.evidence.models import model_overrides
from evac.evidence.report import Evidence, new_figure, timed
from evac.running import run as run_case
from evac.scenario.loading import load_case
from evac.simulation import Simulation

MODELS = ("DEM", "NSM1 inertial", "NSM2")

#: Arrays of the crowd that must be the same to the last bit, at every tick.
COMPARED = ("position", "velocity", "level", "distance", "exit_time")


@dataclass(frozen=True)
class Part:
    """A part that can be left out: what names it in a case that does not need it."""

    name: str
    overrides: Mapping[str, Any]


#: What ``full`` forces in always, and what it forces in besides if a case names it without needing it.
ALWAYS = Part("unused strategies, all crossing tests", {})
NAMED = (
    Part("social force of strength 0", {"forces.social": {"strength": 0.0}}),
    Part("response time of 0 s", {"behaviours.response_time": {"time": 0.0}}),
    Part("teacher following without teachers", {"behaviours.teacher_following": {}}),
    Part("route choice with one route", {"behaviours.route_choice": {}}),
)

#: Commands whose start-up is measured.
COMMANDS = {
    "python alone": ["-c", "pass"],
    "import evac": ["-c", "import evac"],
    "evac --help": ["-m", "evac", "--help"],
    "evac list": ["-m", "evac", "list"],
    "evac plugins": ["-m", "evac", "plugins"],
    "evac check square_room": ["-m", "evac", "check", "square_room"],
    "evac explain square_room": ["-m", "evac", "explain", "square_room"],
    "evac check primary_school": ["-m", "evac", "check", "primary_school"],
    "evac explain primary_school": ["-m", "evac", "explain", "primary_school"],
}


@dataclass(frozen=True)
class Trial:
    """One run: seconds of set-up and of the loop, and the arrays of every tick."""

    setup: float
    loop: float
    states: list[dict[str, np.ndarray]]


def run(evidence: Evidence) -> None:
    """Compute the page."""
    rounds, school_rounds = (2, 1) if evidence.quick else (25, 5)
    rows = scene_rows("square_room", 10.0, NAMED, rounds)
    rows += scene_rows("primary_school", 2.0 if evidence.quick else 20.0, NAMED[-1:], school_rounds)
    _report_parts(evidence, rows, f"{rounds} rounds for the square room, {school_rounds} for the school")
    _report_output(evidence, rounds)
    _report_commands(evidence)
    evidence.write_page("Leaving out what a scene does not need")


def scene_rows(name: str, duration: float, parts: tuple[Part, ...], rounds: int) -> list[dict[str, Any]]:
    """Return a row for each model and part: what it costs when forced in, and whether every bit is the same.

    Variants run in turns, round after round, and the least time of each counts: what disturbs a run only
    ever makes it slower.
    """
    rows = []
    for model in MODELS:
        shared = {"simulation.duration": duration, "simulation.seed": 1} | model_overrides(model)
        cases = {part.name: load_case(name, {**shared, **part.overrides}) for part in (ALWAYS, *parts)}
        without = [trial(cases[ALWAYS.name], False)]
        forced: dict[str, list[Trial]] = {part: [] for part in cases}
        for _ in range(rounds):
            without.append(trial(cases[ALWAYS.name], False))
            for part, case in cases.items():
                forced[part].append(trial(case, True))
        for part, trials in forced.items():
            before = without if part == ALWAYS.name else forced[ALWAYS.name]
            setup = _least(trials, "setup") - _least(before, "setup")
            loop = _least(trials, "loop") - _least(before, "loop")
            rows.append(
                {
                    "scene": name,
                    "model": model,
                    "part forced in": part,
                    "set-up [ms]": 1e3 * setup,
                    "loop [ms]": 1e3 * loop,
                    "of the lean loop's [ms]": 1e3 * _least(without, "loop"),
                    "loop [%]": 100.0 * loop / _least(without, "loop"),
                    "same bits": "yes" if all(same_bits(without[0], one) for one in trials) else "NO",
                }
            )
    return rows


def _least(trials: list[Trial], phase: str) -> float:
    """Return the least time of a phase [s]."""
    return float(min(getattr(one, phase) for one in trials))


def trial(case: Any, full: bool) -> Trial:
    """Run a case tick by tick, with or without everything forced in."""
    start = time.perf_counter()
    simulation = Simulation(case, full=full)
    ready = time.perf_counter()
    spent, states = 0.0, []
    while not simulation.ended:
        tick = time.perf_counter()
        simulation.advance_tick()
        spent += time.perf_counter() - tick
        crowd = simulation.population.crowd
        states.append({name: getattr(crowd, name).copy() for name in COMPARED})
    return Trial(ready - start, spent, states)


def same_bits(one: Trial, other: Trial) -> bool:
    """Say whether two runs have the same ticks and in each the same arrays, to the last bit."""
    return len(one.states) == len(other.states) and all(
        a[name].tobytes() == b[name].tobytes()
        for a, b in zip(one.states, other.states, strict=True)
        for name in COMPARED
    )


def _report_parts(evidence: Evidence, rows: list[dict[str, Any]], rounds: str) -> None:
    """Add what the parts cost."""
    same = sum(row["same bits"] == "yes" for row in rows)
    always = [row for row in rows if row["part forced in"] == ALWAYS.name]
    costs = [
        f"{row['loop [%]']:+.0f} % and {row['set-up [ms]']:+.0f} ms ({row['scene']}, {row['model']})" for row in always
    ]
    told = f"What every scene can leave out costs, in the loop and in the set-up: {'; '.join(costs)}."
    if evidence.quick:
        told = "A quick run is too short to tell what it costs."
    evidence.text(
        f"""Forcing in what a scene does not need leaves the trajectories the same to the last bit in {same} of
        {len(rows)} comparisons. {told}"""
    )
    evidence.heading("Parts forced in")
    evidence.text(
        f"""The same people run with and without the switch `--full`, in turns; the least time of all rounds counts
        ({rounds}), and after every tick {", ".join(COMPARED)} of everybody are compared byte by byte with the lean run.
        The switch forces in everything at once. The first row of a scene has the parts that every case can leave out:
        directions for the strategies that nobody takes (set-up), and in the loop the test of every body in every step
        for walls, portals and exits on its path, with NSM2 also the tangential law at K_T = 0; the switch cannot tell
        these apart. Each further row adds one part that the case names without needing it, and shows what is added to
        the first row. Not measured is what no switch forces in: a contact solve in a step without contacts."""
    )
    evidence.table("parts", rows, "What each part adds when forced in.", {"loop [%]": "+.1f"})
    figure, axis = new_figure(8.0, 0.6 + 0.26 * len(rows))
    place = np.arange(len(rows))[::-1]
    colours = ["#0072B2" if row["scene"] == "square_room" else "#009E73" for row in rows]
    axis.barh(place, [row["loop [%]"] for row in rows], color=colours)
    axis.set_yticks(place, [f"{row['model']}: {row['part forced in']}" for row in rows], fontsize=7)
    axis.axvline(0.0, color="0.3", linewidth=0.8)
    axis.set(xlabel="added to the lean loop [%]")
    evidence.plot("parts", figure, "What each part adds to the loop: square room (blue), school (green).")


def _report_output(evidence: Evidence, repeats: int) -> None:
    """Add what picture and animation cost."""
    rows: list[dict[str, Any]] = []
    for picture, animation in ((False, False), (True, False), (False, True)):
        switches = {"output.picture": picture, "output.animation": animation}
        case = load_case("square_room", switches)
        spans = []
        for _ in range(repeats + 1):
            with TemporaryDirectory() as folder:
                spans.append(run_case(case, Path(folder) / "result").phases["output"])
        rows.append(
            {
                "picture": "in" if picture else "out",
                "animation": "in" if animation else "out",
                "first time, with imports [ms]": 1e3 * spans[0],
                "afterwards [ms]": 1e3 * float(np.median(spans[1:])),
            }
        )
    evidence.heading("Picture and animation")
    evidence.table("output", rows, "Time of the output of the square room; matplotlib and VTK are loaded when needed.")


def _report_commands(evidence: Evidence) -> None:
    """Add the start-up time of each command; a quick run leaves out the school."""
    repeats = 1 if evidence.quick else 9
    rows: list[dict[str, Any]] = []
    for name, arguments in COMMANDS.items():
        if evidence.quick and "primary_school" in arguments:
            continue
        start = partial(subprocess.run, [sys.executable, *arguments], check=True, capture_output=True)
        timing = timed(start, repeats)
        rows.append(
            {
                "command": name,
                "median [s]": timing.median,
                "least [s]": timing.least,
                "greatest [s]": timing.greatest,
                "without python itself [s]": timing.median - rows[0]["median [s]"] if rows else None,
                "reference run [ms]": 1e3 * timing.reference,
            }
        )
    evidence.heading("Start-up of each command")
    evidence.table(
        "commands", rows, f"Wall time of a whole process on a warm cache, {repeats} runs beside a reference run."
    )
