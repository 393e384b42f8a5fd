"""Time and memory per person-step against the number of people, and where the time goes."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from evac.errors import SimulationError
from evac.evidence.models import COARSE
from evac.evidence.models import MODELS as PARAMETERS
from evac.evidence.report import MODEL_COLOURS, Evidence, claim, new_figure, timed
from evac.evidence.scaling import headway, phases
from evac.evidence.scaling.halls import RADIUS, STRETCH, Hall, make_hall
from evac.evidence.scaling.walks import (
    JAMMED,
    LONGEST,
    SETTLING,
    STARTED,
    TICK,
    WALKED_OUT,
    Cost,
    Variant,
    Walk,
    make_variant,
    memory,
    time_ticks,
)
from evac.physics import stepping
from evac.physics.state import Clock
from evac.scenario.loading import load_case
from evac.simulation import Simulation

MODELS = ("DEM", "NSM1 inertial", "NSM2")
DENSITIES = {"free": 2.0, "jammed": 5.0}  # people per m2

STEP = 0.01  # s

#: A crowd that jams is at most so far from the doors [m]: the jam of a deeper hall takes longer to grow.
DEEPEST = 50.0

#: DEM's jam is measured with stiffer contacts too, at a step that they are stable at, up to so many people.
STIFFER, FINER, STIFFEST_PEOPLE = 10.0, 4, 10_000
STIFF_NAME = f"DEM, {STIFFER:g} times stiffer"

#: Ticks that free crowds walk before the timing, and ticks timed, by number of people.
QUICK_SIZES = {20: (10, 5), 100: (10, 5), 1_000: (10, 3)}
FULL_SIZES = {20: (10, 9), 100: (10, 9), 1_000: (10, 9), 10_000: (10, 5), 100_000: (5, 2)}

#: The targets.
GREATEST_TIME = 150.0  # ns per person-step, 10,000 people at 2 per m2 under DEM
LEAST_SPEED = 300.0  # times real time, the school
GREATEST_PYTHON = 30.0  # % of the school's loop
GREATEST_WALL = 6.0  # s, evac run primary_school on a warm cache

PHASES = ("lists", "search", "drive", "contact and rest", "move", "sorting")


def run(evidence: Evidence) -> None:
    """Compute the page."""
    sizes = QUICK_SIZES if evidence.quick else FULL_SIZES
    rows = []
    for people, ticks in sizes.items():
        for state, density in DENSITIES.items():
            deepest = DEEPEST if state == "jammed" else np.inf
            hall = make_hall(people, density, evidence.seed, deepest)
            rows += [_row(hall, state, variant, *ticks) for variant in _variants(state, people)]
    repeats = 1 if evidence.quick else 5
    claims = [_hall_claim(sizes, evidence.seed, repeats), *_school_claims(repeats)]
    met = sum(row["met"] == "yes" for row in claims)
    evidence.text(
        f"""{claims[0]["what"]}: {claims[0]["measured"]:.0f} on one core. {met} of {len(claims)} targets are met on this
        machine."""
    )
    evidence.heading("Targets")
    evidence.table("claims", claims, "Target and measured; medians.")
    _report_scaling(evidence, rows, sizes)
    headway.run(evidence, MODELS, STEP)
    evidence.write_page("Time and memory against the number of people")


def _variants(state: str, people: int) -> Iterator[Variant]:
    """Yield what walks in a hall: the models, and a stiffer DEM where it may have to bear the load of a jam."""
    for name in MODELS:
        yield make_variant(name, STEP)
        if name == "DEM" and state == "jammed" and people <= STIFFEST_PEOPLE:
            stiffness = STIFFER * PARAMETERS["DEM"][1]["stiffness"]
            yield make_variant("DEM", STEP / FINER, STIFF_NAME, stiffness=stiffness)


def phase_times(walk: Walk, variant: Variant, cost: Cost) -> dict[str, float]:
    """Return the seconds of each phase of a step; ``contact and rest`` is what the others leave of it.

    Each phase is repeated on the crowd as the last step left it: lists (as often as they were built), search
    for contacts, drive, move (with the work sums and what is saved for going back), and sorting the people in
    and out, once a tick.
    """
    engine, model = walk.engine, variant.model
    world, bodies, lists, contacts = engine.world, engine.bodies, engine.lists, engine.contacts
    events, tally = engine.events, engine.tally
    clock = Clock(walk.made, walk.made + 1, walk.step, False, False, engine.cutoff, False)
    now = walk.time
    old_share = 0.5 if model.midpoint else 0.0
    found = {
        "move": _each(
            lambda repeats: phases.repeat_move(
                world, bodies, lists, contacts, events, clock, tally, now, old_share, repeats
            )
        ),
        "lists": cost.builds * _each(lambda repeats: phases.repeat_lists(world, bodies, lists, repeats)),
        "drive": _each(
            lambda repeats: phases.repeat_drive(
                world, bodies, lists, engine.forces, clock, tally, now, model.overdamped, repeats
            )
        ),
        "search": _each(lambda repeats: phases.repeat_search(world, bodies, lists, contacts, tally, repeats)),
    }

    def sort(repeats: int) -> None:
        for _ in range(repeats):
            stepping.gather(world, walk.crowd, bodies, lists, contacts)
            stepping.scatter(walk.crowd, bodies)

    found["sorting"] = _each(sort) / walk.per_tick
    found["contact and rest"] = max(0.0, cost.seconds - sum(found.values()))
    return {name: found[name] for name in PHASES}


def _each(call: Callable[[int], Any]) -> float:
    """Return the median time of one repeat [s], over five calls of at least a millisecond."""
    call(1)
    start = time.perf_counter()
    call(1)
    repeats = max(1, int(1e-3 / max(time.perf_counter() - start, 1e-7)))
    spans = []
    for _ in range(5):
        start = time.perf_counter()
        call(repeats)
        spans.append((time.perf_counter() - start) / repeats)
    return float(np.median(spans))


def _row(hall: Hall, state: str, variant: Variant, warm: int, timed: int) -> dict[str, Any]:
    """Return the row of a walk; of one that the model refuses to go on with, without what was not measured."""
    walk = Walk(hall, variant.step)
    cost, pace, walked = None, None, None
    try:
        ended = walk.into_a_jam(variant) if state == "jammed" else walk.freely(variant, warm)
        walked, pace = walk.time, walk.pace
        cost = time_ticks(walk, variant.model, timed)
    except SimulationError as refusal:
        ended = f"refused at {str(refusal).partition(':')[0]}"
    people = len(walk.crowd.level)
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
        "greatest overlap [m]": walk.engine.report()["greatest_overlap"],
        "ns per person-step": 1e9 * cost.per_person if cost else None,
        "spread": cost.spread if cost else None,
        "ms per step": 1e3 * cost.seconds if cost else None,
        "iterations per step": cost.iterations if cost else None,
        "steps per list": 1.0 / cost.builds if cost and cost.builds else None,
        "bytes per person": memory(walk) / people,
        "grid [MB]": 1e-6
        * sum(array.nbytes for array in (hall.fields.packed.direction, hall.fields.packed.travel_time)),
    }
    spent = phase_times(walk, variant, cost) if cost else {}
    total = sum(spent.values())
    return row | {f"{phase} [%]": 100.0 * spent[phase] / total if cost else None for phase in PHASES}


def _hall_claim(sizes: dict[int, tuple[int, int]], seed: int, repeats: int) -> dict[str, Any]:
    """Return the claim on the hall of 10,000, or of the most people that this run has up to that: some walks anew."""
    people = max(size for size in sizes if size <= 10_000)
    hall = make_hall(people, DENSITIES["free"], seed)
    warm, timed = sizes[people]
    measured = []
    for _ in range(repeats + 1):
        walk, variant = Walk(hall, STEP), make_variant("DEM", STEP)
        walk.freely(variant, warm)
        measured.append(1e9 * time_ticks(walk, variant.model, timed).per_person)
    what = f"Hall of {people:,} people at {DENSITIES['free']:g} per m2, DEM [ns per person-step]"
    return claim(what, "at most", GREATEST_TIME, _middle(measured))


def _school_claims(repeats: int) -> list[dict[str, Any]]:
    """Return the claims on the school: speed of the loop, share of Python, the whole command."""
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
    return [
        claim("School, simulated time over wall time of the loop", "at least", LEAST_SPEED, _middle(speeds)),
        claim("School, share of the loop outside the compiled tick [%]", "at most", GREATEST_PYTHON, _middle(shares)),
        claim("evac run primary_school, whole command [s]", "at most", GREATEST_WALL, whole.median),
    ]


def _middle(values: list[float]) -> float:
    """Return the median without the first, which warms up."""
    return float(np.median(values[1:]))


def _report_scaling(evidence: Evidence, rows: list[dict[str, Any]], sizes: dict[int, tuple[int, int]]) -> None:
    """Add the table, the chart and the shares."""
    ticks = ", ".join(f"{timed} for {people:,} people" for people, (_, timed) in sizes.items())
    evidence.heading("Halls from small to large")
    evidence.text(
        f"""A hall with walls, a door in about every {STRETCH:g} m of one of them, directions by fast marching; people
        of radius {RADIUS[0]} to {RADIUS[1]} m on a jittered hexagonal lattice, {DENSITIES["free"]:g} per m2 (free) and
        {DENSITIES["jammed"]:g} per m2 (jammed). Halls are square, those of the jammed at most {DEEPEST:g} m deep. All
        start at rest. The free walk for the time in the table; the jammed walk until half of them are slower than
        {100.0 * JAMMED:.0f} % of the speed they want, from {STARTED:g} s on, but no longer than {LONGEST:g} s and until
        {100.0 * WALKED_OUT:.0f} % are out, and {SETTLING * TICK:g} s more. To there NSM1 is solved to
        {COARSE["gap_tolerance"]:g} m only, for its time's sake; these last {SETTLING * TICK:g} s and what is timed are
        solved as shipped. Then ticks of {TICK:g} s are timed on one core, Python's part included: {ticks}. Medians;
        spread is the slowest over the fastest tick. Memory counts every array that grows with the people; the direction
        grid, which grows with the area, stands beside it and is coarser for the largest halls."""
    )
    evidence.text(_jams(rows))
    columns = [key for key in rows[0] if key not in {f"{phase} [%]" for phase in PHASES}]
    formats = {"bytes per person": ".0f", "people": ",", "ns per person-step": ",.0f", "spread": ".2f", "grid [m]": "g"}
    formats |= {"h [s]": "g", "median speed [% of desired]": ".0f", "walked [s]": ".1f"}
    evidence.table("scaling", [{key: row[key] for key in columns} for row in rows], "Time and memory.", formats)
    _plot_scaling(evidence, rows)
    _report_shares(evidence, [row for row in rows if row["ns per person-step"] is not None])


def _jams(rows: list[dict[str, Any]]) -> str:
    """Return which crowds have jammed, and which not and why."""
    jammed = [row for row in rows if row["state"] == "jammed"]
    told = []
    for name in dict.fromkeys(row["model"] for row in jammed):
        ends = [f"{row['people']:,} ({row['walk ended by']})" for row in jammed if row["model"] == name]
        told.append(f"{name}: {', '.join(ends)}")
    return (
        f"What ended the walk into the jam: {'; '.join(told)}. A crowd that has not jammed in time is one whose bodies "
        "give way, as the greatest overlap says: its numbers are those of people pressed into each other. Refused is "
        "what the model cannot go on with. DEM's contacts harden at large overlap: its steps are then cut into parts, "
        f"whose time is that of the step. The stiffer DEM has {STIFFER:g} times the stiffness and 1/{FINER} of the "
        "step, and shows DEM's cost where linear contacts bear the load."
    )


def _plot_scaling(evidence: Evidence, rows: list[dict[str, Any]]) -> None:
    """Draw the time per person-step; a refusal is a gap."""
    colours = {**MODEL_COLOURS, STIFF_NAME: "#56B4E9"}
    figure, axes = new_figure(9.0, 4.0, 1, 2, sharex=True, sharey=True)
    for axis, state in zip(axes, DENSITIES, strict=True):
        for name in dict.fromkeys(row["model"] for row in rows if row["state"] == state):
            own = [row for row in rows if row["state"] == state and row["model"] == name]
            axis.plot(
                [row["people"] for row in own],
                [row["ns per person-step"] or np.nan for row in own],
                "o-",
                color=colours[name],
                label=name,
            )
        axis.set(xscale="log", yscale="log", xlabel="people", title=f"{state}, {DENSITIES[state]:g} per m2")
        axis.legend(frameon=False)
    axes[0].set(ylabel="ns per person-step")
    evidence.plot("scaling", figure, "Time per person-step against the number of people; a refusal has no point.")


def _report_shares(evidence: Evidence, rows: list[dict[str, Any]]) -> None:
    """Add where the time of a step goes, of the walks that were timed."""
    evidence.heading("Where the time goes")
    evidence.text(
        """The phases of a compiled step cannot be timed while it runs. So each is repeated alone on the crowd as the
        last step left it: building neighbour lists (times how often that happened), searching contacts, drive, move
        (with the work sums and what is saved to go back a step), and sorting the people in and out once a tick. Contact
        and rest is what they leave of the whole step: the contact law or solve, NSM1's second searches and removal of
        overlaps, checks and counts, Python's part of a tick, and the error of the other five, which run on warmer
        caches here than in a step."""
    )
    shown = ["people", "state", "model", *(f"{phase} [%]" for phase in PHASES)]
    formats = {f"{phase} [%]": ".0f" for phase in PHASES} | {"people": ","}
    evidence.table("phases", [{key: row[key] for key in shown} for row in rows], "Shares of a step.", formats)
    largest = max(row["people"] for row in rows)
    chosen = [row for row in rows if row["people"] == largest]
    figure, axis = new_figure(8.0, 3.2)
    place = np.arange(len(chosen))[::-1]
    left = np.zeros(len(chosen))
    colours = ("#56B4E9", "#0072B2", "#009E73", "#D55E00", "#E69F00", "#999999")
    for phase, colour in zip(PHASES, colours, strict=True):
        width = np.array([row[f"{phase} [%]"] for row in chosen])
        axis.barh(place, width, left=left, color=colour, label=phase)
        left += width
    axis.set_yticks(place, [f"{row['model']}, {row['state']}" for row in chosen])
    axis.set(xlabel=f"share of a step, {largest:,} people [%]", xlim=(0.0, 100.0))
    figure.legend(frameon=False, ncols=len(PHASES), loc="outside upper center", fontsize=8)
    evidence.plot("phases", figure, "Shares of a step in the largest hall.")
