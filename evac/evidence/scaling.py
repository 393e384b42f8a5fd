"""Time and memory per person-step against the number of people, and where the time goes."""

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from evac.evidence import phases
from evac.evidence.halls import RADIUS, STRETCH, Hall, make_hall
from evac.evidence.models import make_model
from evac.evidence.report import MODEL_COLOURS, Evidence, claim, new_figure, timed
from evac.physics import stepping
from evac.physics.bundles import Clock, Crowd
from evac.physics.contact_model import ContactModel
from evac.physics.engine import Engine
from evac.physics.world import make_world
from evac.scenario.loading import load_case
from evac.simulation import Simulation

MODELS = ("DEM", "NSM1 inertial", "NSM2")
DENSITIES = {"free": 2.0, "jammed": 5.0}  # people per m2

STEP = 0.01  # s
PER_TICK = 10

#: Ticks walked before the timing, and ticks timed, by number of people.
QUICK_SIZES = {20: (10, 5), 100: (10, 5), 1_000: (10, 3)}
FULL_SIZES = {20: (10, 9), 100: (10, 9), 1_000: (10, 9), 10_000: (10, 5), 100_000: (5, 2)}

#: What is asked for.
GREATEST_TIME = 150.0  # ns per person-step, 10,000 people at 2 per m2 under DEM
LEAST_SPEED = 300.0  # times real time, the school
GREATEST_PYTHON = 30.0  # % of the school's loop
GREATEST_WALL = 6.0  # s, evac run primary_school on a warm cache

PHASES = ("lists", "search", "drive", "contact and rest", "move", "sorting")


@dataclass(frozen=True)
class Walk:
    """A crowd after its timed ticks: what remains to be timed apart, and what was measured."""

    engine: Engine
    crowd: Crowd
    model: ContactModel
    step: int
    seconds: float  # median of a step
    per_person: float  # median of a person-step [s]
    spread: float  # greatest over least
    builds: float  # of the lists, per step
    iterations: float  # per step


def run(evidence: Evidence) -> None:
    """Compute the page."""
    sizes = QUICK_SIZES if evidence.quick else FULL_SIZES
    rows = []
    for people, ticks in sizes.items():
        for state, density in DENSITIES.items():
            hall = make_hall(people, density, evidence.seed)
            rows += [_row(hall, state, name, *ticks) for name in MODELS]
    repeats = 1 if evidence.quick else 5
    claims = [_hall_claim(sizes, evidence.seed, repeats), *_school_claims(repeats)]
    met = sum(row["met"] == "yes" for row in claims)
    evidence.text(
        f"""{claims[0]["what"]}: {claims[0]["measured"]:.0f} on one core. Of the {len(claims)} speeds that were asked
        for, {met} are met on this machine."""
    )
    evidence.heading("What was asked for")
    evidence.table("claims", claims, "Asked for and measured; medians.")
    _report_scaling(evidence, rows, sizes)
    evidence.write_page("Time and memory against the number of people")


def walk(hall: Hall, model: ContactModel, warm: int, timed: int) -> Walk:
    """Walk a copy of a hall's crowd and time its last ticks."""
    crowd = Crowd(**{name: array.copy() for name, array in hall.crowd._asdict().items()})
    engine = Engine(make_world(hall.building, hall.fields), len(crowd.level), [])
    spans, per_person, before = [], [], {}
    for tick in range(warm + timed):
        if tick == warm:
            before = engine.report()
        inside = int((crowd.level >= 0).sum())
        start = time.perf_counter()
        engine.advance(model, crowd, tick * PER_TICK, PER_TICK, STEP, False, False)
        span = (time.perf_counter() - start) / PER_TICK
        if tick >= warm:
            spans.append(span)
            per_person.append(span / max(inside, 1))
    after = engine.report()
    steps = timed * PER_TICK
    return Walk(
        engine,
        crowd,
        model,
        (warm + timed) * PER_TICK,
        float(np.median(spans)),
        float(np.median(per_person)),
        max(spans) / min(spans),
        (after["list_builds"] - before["list_builds"]) / steps,
        (after["iterations"] - before["iterations"]) / steps,
    )


def phase_times(done: Walk) -> dict[str, float]:
    """Return the seconds of each phase of a step; ``contact and rest`` is what the others leave of it.

    Each phase is repeated on the crowd as the last step left it: lists (as often as they were built), search
    for contacts, drive, move (with the work sums and what is saved for going back), and sorting the people in
    and out, once a tick.
    """
    engine, model = done.engine, done.model
    world, bodies, lists, contacts = engine.world, engine.bodies, engine.lists, engine.contacts
    events, tally = engine.events, engine.tally
    clock = Clock(done.step, done.step + 1, STEP, False, False, engine.cutoff, False)
    now = done.step * STEP
    old_share = 0.5 if model.midpoint else 0.0
    found = {
        "move": _each(
            lambda repeats: phases.repeat_move(
                world, bodies, lists, contacts, events, clock, tally, now, old_share, repeats
            )
        ),
        "lists": done.builds * _each(lambda repeats: phases.repeat_lists(world, bodies, lists, repeats)),
        "drive": _each(
            lambda repeats: phases.repeat_drive(
                world, bodies, lists, engine.forces, clock, tally, now, model.overdamped, repeats
            )
        ),
        "search": _each(lambda repeats: phases.repeat_search(world, bodies, lists, contacts, tally, repeats)),
    }

    def sort(repeats: int) -> None:
        for _ in range(repeats):
            stepping.gather(world, done.crowd, bodies, lists, contacts)
            stepping.scatter(done.crowd, bodies)

    found["sorting"] = _each(sort) / PER_TICK
    found["contact and rest"] = max(0.0, done.seconds - sum(found.values()))
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


def memory(engine: Engine, crowd: Crowd) -> int:
    """Return the bytes of all arrays that grow with the people."""
    return sum(_bytes(bundle) for bundle in (crowd, engine.bodies, engine.lists, engine.contacts, engine.events))


def _bytes(bundle: Any) -> int:
    """Return the bytes of an array, or of all arrays in a bundle."""
    return int(bundle.nbytes) if isinstance(bundle, np.ndarray) else sum(_bytes(part) for part in bundle)


def _row(hall: Hall, state: str, name: str, warm: int, timed: int) -> dict[str, Any]:
    done = walk(hall, make_model(name), warm, timed)
    people = len(done.crowd.level)
    row = {
        "people": people,
        "state": state,
        "model": name,
        "hall [m]": hall.side,
        "grid [m]": hall.fields.packed.spacing,
        "walked before [s]": warm * PER_TICK * STEP,
        "ns per person-step": 1e9 * done.per_person,
        "spread": done.spread,
        "ms per step": 1e3 * done.seconds,
        "iterations per step": done.iterations,
        "steps per list": 1.0 / done.builds if done.builds else None,
        "bytes per person": memory(done.engine, done.crowd) / people,
        "grid [MB]": 1e-6
        * sum(array.nbytes for array in (hall.fields.packed.direction, hall.fields.packed.travel_time)),
    }
    spent = phase_times(done)
    total = sum(spent.values())
    return row | {f"{phase} [%]": 100.0 * spent[phase] / total for phase in PHASES}


def _hall_claim(sizes: dict[int, tuple[int, int]], seed: int, repeats: int) -> dict[str, Any]:
    """Return the claim on the hall of 10,000, or of the most people that this run has up to that: some walks anew."""
    people = max(size for size in sizes if size <= 10_000)
    hall = make_hall(people, DENSITIES["free"], seed)
    measured = [1e9 * walk(hall, make_model("DEM"), *sizes[people]).per_person for _ in range(repeats + 1)]
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
        f"""A square hall with walls, a door in about every {STRETCH:g} m of one of them and directions by fast
        marching; people of radius {RADIUS[0]} to {RADIUS[1]} m on a jittered hexagonal lattice,
        {DENSITIES["free"]:g} per m2 (free) and {DENSITIES["jammed"]:g} per m2 (jammed), h = {STEP} s. All start at rest
        and walk for the time in the table; then whole ticks of {PER_TICK} steps are timed on one core, Python's part
        included: {ticks}. Medians; spread is the slowest over the fastest tick. Memory counts every array that grows
        with the people; the direction grid, which grows with the area, stands beside it and is coarser for the
        largest halls."""
    )
    columns = [key for key in rows[0] if not key.endswith("[%]")]
    evidence.table(
        "scaling",
        [{key: row[key] for key in columns} for row in rows],
        "Time and memory.",
        {"bytes per person": ".0f", "people": ",", "ns per person-step": ".0f", "spread": ".2f", "grid [m]": "g"},
    )
    figure, axes = new_figure(9.0, 4.0, 1, 2, sharex=True, sharey=True)
    for axis, state in zip(axes, DENSITIES, strict=True):
        for name in MODELS:
            own = [row for row in rows if row["state"] == state and row["model"] == name]
            axis.plot(
                [row["people"] for row in own],
                [row["ns per person-step"] for row in own],
                "o-",
                color=MODEL_COLOURS[name],
                label=name,
            )
        axis.set(xscale="log", yscale="log", xlabel="people", title=f"{state}, {DENSITIES[state]:g} per m2")
    axes[0].set(ylabel="ns per person-step")
    axes[0].legend(frameon=False)
    evidence.plot("scaling", figure, "Time per person-step against the number of people.")
    _report_shares(evidence, rows)


def _report_shares(evidence: Evidence, rows: list[dict[str, Any]]) -> None:
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
    axis.legend(frameon=False, ncols=len(PHASES), loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8)
    evidence.plot("phases", figure, "Shares of a step in the largest hall.")
