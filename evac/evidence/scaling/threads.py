"""Time of a step with one thread and with two, by the clock."""

import os
import time

import numpy as np

from evac.evidence.evidence import Evidence, Row
from evac.evidence.scaling.halls import make_hall
from evac.evidence.scaling.walks import Variant, Walk, make_variant
from evac.evidence.scenes import plugins
from evac.evidence.verdicts import at_least, reported
from evac.physics.engine import CompiledEngine
from evac.physics.world import make_world

#: Numbers of people and models for each start.
CROWDS = (
    *((people, "free", "DEM") for people in (1_000, 10_000, 100_000)),
    (10_000, "dense", "DEM"),
)
QUICK_CROWDS = ((100, "free", "DEM"),)

#: People per m2 at the start.
DENSITIES = {"free": 2.0, "dense": 5.0}

#: Ticks before the timing, and ticks timed.
WARM, TIMED = 10, 15

#: Target for the largest hall: least ratio of the time with one thread to that with two.
LEAST_RATIO = 1.5

SECTION = "Threads"


def run(evidence: Evidence, step: float) -> None:
    """Add the table to the page, where there are two cores."""
    if not evidence.page_only and (os.cpu_count() or 1) < 2:
        return
    crowds = QUICK_CROWDS if evidence.quick else CROWDS
    rows = evidence.measured("threads", lambda: [compare(*crowd, evidence.seed, step) for crowd in crowds])
    free = [row for row in rows if row["model"] == "DEM" and row["start"] == "free"]
    judged = max(free, key=lambda row: row["people"])
    what = f"Hall of {judged['people']:,} people, DEM: time with one thread divided by that with two"
    evidence.verdict(at_least(what, judged["one over two"], LEAST_RATIO, "", SECTION))
    dense = [row for row in rows if row["start"] == "dense"]
    if dense:
        told = "; ".join(f"{row['one over two']:.2f} ({row['model']}, {row['people']:,} people)" for row in dense)
        evidence.verdict(reported("Dense halls: time with one thread divided by that with two", told, "-", SECTION))
    evidence.show("threads", __name__, rows=rows)


def compare(people: int, start: str, model: str, seed: int, step: float) -> Row:
    """Return the times of a step with one thread and with two [ms], and their ratio."""
    hall, variant = make_hall(people, DENSITIES[start], seed), make_variant(model, step)
    walks = [Walk(hall, step), Walk(hall, step)]
    world = make_world(hall.building, hall.fields)
    walks[1].engine = CompiledEngine(world, people, (), solvers=plugins().solvers, threads=2)
    for walk in walks:
        walk.advance(variant.rough, WARM)
    spans = np.array([[_wall_time(walk, variant) for walk in walks] for _ in range(TIMED)])
    walks[1].engine.close()
    one, two = 1e3 * np.median(spans, axis=0) / walks[0].per_tick
    ratios = spans[:, 0] / spans[:, 1]
    head = {"people": people, "start": start, "model": model}
    times = {"one thread [ms]": float(one), "two threads [ms]": float(two)}
    ends = {"least": float(ratios.min()), "greatest": float(ratios.max())}
    return {**head, **times, "one over two": float(np.median(ratios)), **ends}


def _wall_time(walk: Walk, variant: Variant) -> float:
    start = time.perf_counter()
    walk.advance(variant.model)
    return time.perf_counter() - start
