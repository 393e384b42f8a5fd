"""Cost of the behaviour headway: the same hall without and with it."""

from collections.abc import Iterator

import numpy as np

from evac.evidence.evidence import Evidence, Row
from evac.evidence.scaling.halls import Hall, make_hall
from evac.evidence.scaling.peers.programs import BehaviourWalk
from evac.evidence.scaling.walks import Variant, Walk, cpu_time, make_variant, minimal_cost, start_minimal
from evac.evidence.verdicts import reported

PEOPLE, QUICK_PEOPLE = 10_000, 100

#: People per m2 at the start.
DENSITIES = (2.0, 5.0)

#: Ticks walked before the timing, and ticks timed.
WARM, TIMED = 10, 15


def run(evidence: Evidence, models: tuple[str, ...], step: float) -> None:
    """Add the table to the page."""
    people = QUICK_PEOPLE if evidence.quick else PEOPLE
    rows = evidence.measured("headway", _rows, people, evidence.seed, models, step)
    ratios = [row["with / without"] for row in rows]
    section = "What headway costs and saves"
    text = f"{min(ratios):.2f} to {max(ratios):.2f}"
    evidence.verdict(reported("Time with headway divided by time without", text, "-", section))
    evidence.show("headway", __name__, people=people, rows=rows, section=section)


def _rows(people: int, seed: int, models: tuple[str, ...], step: float) -> Iterator[Row]:
    for density in DENSITIES:
        hall = make_hall(people, density, seed)
        yield from [
            {"start [1/m2]": density, "model": name, **compare(hall, make_variant(name, step))} for name in models
        ]


def compare(hall: Hall, variant: Variant) -> Row:
    """Return the costs without and with headway and of the minimal kernel, taken alternately [ns per person-step]."""
    plain, kept = Walk(hall, variant.step), BehaviourWalk(hall, variant.step, variant.model)
    costs = []
    for tick in range(WARM + TIMED):
        if tick == WARM:
            minimal = start_minimal(plain.crowd, hall.fields.packed, plain.per_tick, plain.step)
        people = [plain.inside, kept.inside, kept.inside]
        spans = [cpu_time(lambda: plain.advance(variant.model))]
        decided = cpu_time(kept.act)
        spans += [cpu_time(kept.step), decided]
        if tick >= WARM:
            least = minimal_cost(minimal, plain.per_tick, plain.step)
            costs.append(1e9 * np.array([*(np.array(spans) / plain.per_tick / np.maximum(people, 1)), least]))
    without, steps, itself, least = np.median(costs, axis=0)
    return {
        "without": float(without),
        "with: steps": float(steps),
        "with: headway itself": float(itself),
        "with / without": float((steps + itself) / without),
        "minimal": float(least),
        "without / minimal": float(without / least),
        "with / minimal": float((steps + itself) / least),
    }
