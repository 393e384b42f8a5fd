"""Time and memory per person-step against the number of people, and where the time goes."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from evac.base.errors import SimulationError
from evac.case.loading import load_case
from evac.evidence.evidence import MODEL_COLOURS, Evidence, Row, new_figure, timed
from evac.evidence.scaling import commands, headway, large, laws, phases
from evac.evidence.scaling.halls import Hall, make_hall
from evac.evidence.scaling.minimal import make_minimal
from evac.evidence.scaling.peers import comparison
from evac.evidence.scaling.walks import Cost, Variant, Walk, bytes_of, make_variant, memory, time_ticks
from evac.evidence.scenes import MODELS as PARAMETERS
from evac.evidence.verdicts import all_of, at_least, at_most, reported
from evac.simulation.simulation import Simulation

MODELS = ("DEM", "NSM1 inertial", "NSM2")
DENSITIES = {"free": 2.0, "jammed": 5.0}  # people per m2

STEP = 0.01  # s

#: Greatest depth of the hall of a jammed crowd [m], because the jam in a deeper hall takes longer to develop.
DEEPEST = 50.0

#: DEM's jam is also measured with stiffer contacts, at a step at which they are stable, up to this number of people.
STIFFER, FINER, STIFFEST_PEOPLE = 10.0, 4, 10_000
STIFF_NAME = f"DEM, {STIFFER:g} times stiffer"

#: Ticks that free crowds walk before the timing, and ticks timed, by number of people.
QUICK_SIZES = {20: (10, 5), 100: (10, 5), 1_000: (10, 3)}
FULL_SIZES = {20: (10, 9), 100: (10, 9), 1_000: (10, 9), 10_000: (10, 5), 100_000: (5, 2)}

#: The targets, in the order of the table: ns per person-step of 10,000 people at 2 per m2 under DEM; of the school,
#: times real time, % of the loop, and s of `evac run primary_school` on a warm cache.
TARGETS = ((at_most, 150.0), (at_least, 300.0), (at_most, 30.0), (at_most, 6.0))

#: Phases that are repeated alone, and all of them in the order of the page.
REPEATED = ("lists", "drive", "search", "move")
PHASES = ("lists", "search", "drive", "contact and rest", "move", "sorting")

#: Headings of the page.
HALLS, SHARES = "Halls from small to large", "Where the time goes"


def run(evidence: Evidence) -> None:
    """Measure and write the page."""
    sizes = QUICK_SIZES if evidence.quick else FULL_SIZES
    rows = evidence.measured("scaling", _hall_rows, sizes, evidence.seed)
    repeats = 1 if evidence.quick else 5
    claims = evidence.measured("claims", lambda: [_hall_claim(sizes, evidence.seed, repeats), *_school_claims(repeats)])
    for (judge, bound), row in zip(TARGETS, claims, strict=False):
        evidence.verdict(judge(row["what"], row["measured"], bound))
    _judge_halls(evidence, rows)
    ticks = [f"{timed} for {people:,} people" for people, (_, timed) in sizes.items()]
    timed = [row for row in rows if row["ns per person-step"] is not None]
    shares = [f"{phase} [%]" for phase in PHASES]
    evidence.show("halls", __name__, rows=rows, ticks=ticks, timed=timed, shares=shares)
    large.run(evidence)
    headway.run(evidence, MODELS, STEP)
    laws.run(evidence, STEP)
    comparison.run(evidence, STEP)
    commands.run(evidence)
    evidence.show("claims", __name__, claims=claims)
    evidence.write_page(__name__)


def _hall_rows(sizes: dict[int, tuple[int, int]], seed: int) -> Iterator[Row]:
    for people, ticks in sizes.items():
        for state, density in DENSITIES.items():
            hall = make_hall(people, density, seed, DEEPEST if state == "jammed" else np.inf)
            yield from [_row(hall, state, variant, *ticks) for variant in _variants(state, people)]


def _judge_halls(evidence: Evidence, rows: list[Row]) -> None:
    largest = max(row["people"] for row in rows)
    for state in DENSITIES:
        for name in MODELS:
            costs = {
                row["people"]: (row["ns per person-step"], row["times minimal"])
                for row in rows
                if (row["state"], row["model"]) == (state, name) and row["ns per person-step"] is not None
            }
            last = list(costs.items())[-3:]
            text = "; ".join(f"{cost:.0f}, {ratio:.1f} times ({people:,})" for people, (cost, ratio) in last)
            what = f"{name}, {state} [ns per person-step], times the minimal kernel (people)"
            evidence.verdict(reported(what, text or "refused", "-", HALLS))
    memory_used = max(row["bytes per person"] for row in rows if row["people"] == largest)
    evidence.verdict(reported(f"Memory, {largest:,} people [bytes per person]", f"{memory_used:.0f}", "-", HALLS))
    walked = sum(row["ns per person-step"] is not None for row in rows)
    evidence.verdict(all_of("Walks that ended without an error", walked, len(rows), HALLS))


def _variants(state: str, people: int) -> Iterator[Variant]:
    for name in MODELS:
        yield make_variant(name, STEP)
        if name == "DEM" and state == "jammed" and people <= STIFFEST_PEOPLE:
            stiffness = STIFFER * PARAMETERS["DEM"][1]["stiffness"]
            yield make_variant("DEM", STEP / FINER, STIFF_NAME, stiffness=stiffness)


def phase_times(walk: Walk, variant: Variant, cost: Cost) -> dict[str, float]:
    """Return the time of each phase of a step [s]; ``contact and rest`` is the remainder.

    Each phase is repeated on the crowd after the last step: lists (as often as they were built), search for
    contacts, drive, move (with sums of work and copies for undoing the step), and sorting of people, once per tick,
    by a tick without steps.
    """
    state = walk.engine.data
    times = {name: _each(partial(getattr(phases, f"repeat_{name}"), state)) for name in REPEATED}
    times["lists"] *= cost.builds

    def sort(repeats: int) -> None:
        for _ in range(repeats):
            walk.engine.advance(variant.model, walk.crowd, walk.made, 0, walk.step, False, False)

    times["sorting"] = _each(sort) / walk.per_tick
    times["contact and rest"] = max(0.0, cost.seconds - sum(times.values()))
    return {name: times[name] for name in PHASES}


def _each(call: Callable[[int], Any]) -> float:
    """Return the median CPU time of one repeat [s], over five calls of at least a millisecond."""
    call(1)
    start = time.process_time()
    call(1)
    repeats = max(1, int(1e-3 / max(time.process_time() - start, 1e-7)))
    spans = []
    for _ in range(5):
        start = time.process_time()
        call(repeats)
        spans.append((time.process_time() - start) / repeats)
    return float(np.median(spans))


def _row(hall: Hall, state: str, variant: Variant, warm: int, timed: int) -> Row:
    walk = Walk(hall, variant.step)
    cost, pace, walked = None, None, None
    try:
        if state == "jammed":
            ended = walk.into_a_jam(variant)
        else:
            walk.advance(variant.model, warm)
            ended = "time"
        walked, pace = walk.time, walk.pace
        cost = time_ticks(walk, variant.model, timed)
    except SimulationError as refusal:
        ended, before = f"refused at {str(refusal).partition(':')[0]}", walk.made // walk.per_tick - timed
        if before > 0:  # time the last ticks before it
            walk = Walk(hall, variant.step)
            walk.advance(variant.rough, before)
            walked, pace = walk.time, walk.pace
            cost = time_ticks(walk, variant.model, timed)
    people, used = len(walk.crowd.level), memory(walk, variant.model)
    overlap = walk.engine.report()["greatest_overlap"]
    row = {
        "people": people,
        "state": state,
        "model": variant.name,
        "h [s]": variant.step,
        "hall [m]": f"{hall.depth:.1f} x {hall.length:.1f}",
        "grid [m]": hall.fields.packed.spacing,
        "walk ended by": ended,
        "walked [s]": walked,
        "median speed [% of desired]": None if pace is None else 100.0 * pace,
        "greatest overlap [m]": overlap,
        "greatest load [kN]": 1e-3 * overlap * getattr(variant.model, "stiffness", np.nan),
        "ns per person-step": 1e9 * cost.per_person if cost else None,
        "minimal [ns]": 1e9 * cost.minimal if cost else None,
        "times minimal": cost.ratio if cost else None,
        "spread": cost.spread if cost else None,
        "ms per step": 1e3 * cost.seconds if cost else None,
        "iterations per step": cost.iterations if cost else None,
        "steps per list": 1.0 / cost.builds if cost and cost.builds else None,
        "bytes per person": used / people,
        "bytes, times minimal": used / bytes_of(make_minimal(hall.crowd, hall.fields.packed, walk.step)),
        "grid [MB]": 1e-6
        * sum(array.nbytes for array in (hall.fields.packed.direction, hall.fields.packed.travel_time)),
    }
    spent = phase_times(walk, variant, cost) if cost else {}
    total = sum(spent.values())
    return row | {f"{phase} [%]": 100.0 * spent[phase] / total if cost else None for phase in PHASES}


def _hall_claim(sizes: dict[int, tuple[int, int]], seed: int, repeats: int) -> Row:
    people = max(size for size in sizes if size <= 10_000)
    hall = make_hall(people, DENSITIES["free"], seed)
    warm, timed = sizes[people]
    measured, ratios = [], []
    for _ in range(repeats + 1):
        walk, variant = Walk(hall, STEP), make_variant("DEM", STEP)
        walk.advance(variant.model, warm)
        cost = time_ticks(walk, variant.model, timed)
        measured.append(1e9 * cost.per_person)
        ratios.append(cost.ratio)
    what = f"Hall of {people:,} people at {DENSITIES['free']:g} per m2, DEM [ns per person-step]"
    return {"what": what, "measured": _middle(measured), "times minimal": _middle(ratios)}


def _school_claims(repeats: int) -> list[Row]:
    speeds, shares = [], []
    case = load_case("primary_school")
    for _ in range(repeats + 1):
        simulation = Simulation(case)
        results = simulation.run()
        compiled = results.phases["physics"]
        loop = sum(results.phases[name] for name in ("behaviours", "physics", "recording"))
        speeds.append(results.time / loop)
        shares.append(100.0 * (loop - compiled) / loop)
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "evac", "run", "primary_school", "--out", str(Path(folder) / "result")]
        whole = timed(lambda: subprocess.run(command, check=True, capture_output=True), repeats)
    claims = {
        "School, simulated time over wall time of the loop": _middle(speeds),
        "School, share of the loop outside the compiled tick [%]": _middle(shares),
        "evac run primary_school, whole command [s]": whole.median,
    }
    return [{"what": what, "measured": measured, "times minimal": None} for what, measured in claims.items()]


def _middle(values: list[float]) -> float:
    return float(np.median(values[1:]))


def _draw_halls(rows: list[Row]) -> Any:
    colours = {**MODEL_COLOURS, STIFF_NAME: "#56B4E9"}
    figure, axes = new_figure(9.0, 4.0, 1, 2, sharex=True, sharey=True)
    for axis, state in zip(axes, DENSITIES, strict=True):
        for name in dict.fromkeys(row["model"] for row in rows if row["state"] == state):
            own = [row for row in rows if row["state"] == state and row["model"] == name]
            people, costs = ([row[key] for row in own] for key in ("people", "ns per person-step"))
            axis.plot(people, [cost or np.nan for cost in costs], "o-", color=colours[name], label=name)
        axis.set(xscale="log", yscale="log", xlabel="people", title=f"{state}, {DENSITIES[state]:g} per m2")
        axis.legend(frameon=False)
    axes[0].set(ylabel="ns per person-step")
    return figure
