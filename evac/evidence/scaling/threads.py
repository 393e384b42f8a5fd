"""Time of a step with one thread and with two, by the clock."""

import os
import time
from typing import Any

import numpy as np

from evac.evidence.report import Evidence
from evac.evidence.scaling.halls import make_hall
from evac.evidence.scaling.walks import TICK, Variant, Walk, make_variant
from evac.evidence.verdicts import at_least
from evac.physics.engine import Engine
from evac.physics.world import make_world

SIZES, QUICK_SIZES = (1_000, 10_000, 100_000), (100,)

#: People per m2 at the start.
DENSITY = 2.0

#: Ticks before the timing, and ticks timed.
WARM, TIMED = 10, 15

#: Target for the largest hall: least ratio of the time with one thread to that with two.
LEAST_RATIO = 1.5

SECTION = "Threads"


def run(evidence: Evidence, step: float) -> None:
    """Add the table to the page, where there are two cores."""
    if not evidence.page_only and (os.cpu_count() or 1) < 2:
        return
    sizes = QUICK_SIZES if evidence.quick else SIZES
    rows = evidence.measured("threads", lambda: [compare(people, evidence.seed, step) for people in sizes])
    last = rows[-1]
    what = f"Hall of {last['people']:,} people, DEM: time with one thread divided by that with two"
    evidence.verdict(at_least(what, last["one over two"], LEAST_RATIO, "", SECTION))
    evidence.heading(SECTION)
    evidence.table(
        "threads",
        rows,
        f"""Wall time of a step of DEM at {DENSITY:g} people per m2 with one thread and with two threads, in seconds
        {WARM * TICK:g} to {(WARM + TIMED) * TICK:g} of a walk. Two copies of the same crowd make ticks in turns, with
        identical results; medians over ticks, and the least and greatest ratio of the times of the same tick. Other
        programs that run on the same cores reduce the gain.""",
    )


def compare(people: int, seed: int, step: float) -> dict[str, Any]:
    """Return the times of a step with one thread and with two [ms], and their ratio."""
    hall, variant = make_hall(people, DENSITY, seed), make_variant("DEM", step)
    walks = [Walk(hall, step), Walk(hall, step)]
    walks[1].engine = Engine(make_world(hall.building, hall.fields), people, (), threads=2)
    spans = np.array([[_wall_time(walk, variant) for walk in walks] for _ in range(WARM + TIMED)])[WARM:]
    walks[1].engine.end_threads()
    one, two = 1e3 * np.median(spans, axis=0) / walks[0].per_tick
    ratios = spans[:, 0] / spans[:, 1]
    return {
        "people": people,
        "one thread [ms]": float(one),
        "two threads [ms]": float(two),
        "one over two": float(np.median(ratios)),
        "least": float(ratios.min()),
        "greatest": float(ratios.max()),
    }


def _wall_time(walk: Walk, variant: Variant) -> float:
    start = time.perf_counter()
    walk.advance(variant.model)
    return time.perf_counter() - start
