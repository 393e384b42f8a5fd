"""Cost of contact laws written as the force of a single contact, beside the built-in DEM."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.evidence.evidence import Evidence, Row
from evac.evidence.scaling.halls import Hall, make_hall
from evac.evidence.scaling.peers import comparison
from evac.evidence.scaling.peers.programs import EvacWalk, MinimalWalk
from evac.evidence.scenes import make_model
from evac.evidence.verdicts import at_most
from evac.jit import pair_contact
from evac.physics import tallies as at
from evac.physics.contact.model import ContactModel
from evac.physics.contact.pair_contact import PairContact

PEOPLE, QUICK_PEOPLE = 10_000, 100

#: People per m2 at the start.
DENSITIES = {"free": 2.0, "dense": 5.0}

#: Ticks walked before the timing, and ticks timed.
WARM, TIMED = 10, 15

#: Target: greatest ratio of the cost of a law to that of DEM.
MOST_TIMES = 1.1

#: Overlap at which one of the stiffnesses of Hertz's law gives the force of DEM [m].
OVERLAP = 0.05

SECTION = "What a contact law of a few lines costs"


@pair_contact
def spring(gap: float, closing_speed: float, reduced_mass: float, parameters: FloatArray) -> float:
    """Return k D (eq. 3)."""
    stiffness: float = parameters[0]
    return -stiffness * gap


@pair_contact
def hertz(gap: float, closing_speed: float, reduced_mass: float, parameters: FloatArray) -> float:
    """Return K D sqrt(D) + c w with the overlap D and the closing speed w (Hertz, 1882)."""
    stiffness: float = parameters[0]
    damping: float = parameters[1]
    return -stiffness * gap * math.sqrt(-gap) + damping * closing_speed


class Spring(PairContact):
    """A linear spring, as DEM has it."""

    name = "spring"
    pair = spring
    stiffness = Parameter(1.2e5, "stiffness k", unit="kg/s2", above=0.0)


class Hertz(PairContact):
    """Elastic spheres with a damper, as in docs/plugins_contact.md."""

    name = "hertz"
    pair = hertz
    stiffness = Parameter(1e6, "stiffness K", unit="N/m^1.5", above=0.0)
    damping = Parameter(0.0, "damping c", unit="kg/s", minimum=0.0)


def run(evidence: Evidence, step: float) -> None:
    """Add the table to the page."""
    people = QUICK_PEOPLE if evidence.quick else PEOPLE
    rows = evidence.measured("laws", _rows, people, evidence.seed, step)
    for start in DENSITIES:
        ratio = max(row["times DEM"] for row in rows if row["start"] == start and row["law"] != "DEM")
        what = f"Contact laws of a few lines, {start} crowd: greatest time of a person-step over that of DEM"
        evidence.verdict(at_most(what, ratio, MOST_TIMES, "", SECTION))
    evidence.show("laws", __name__, people=people, rows=rows)


def _rows(people: int, seed: int, step: float) -> Iterator[Row]:
    for start, density in DENSITIES.items():
        yield from ({"start": start, **row} for row in compare(make_hall(people, density, seed), step))


def compare(hall: Hall, step: float) -> list[Row]:
    """Return the costs of the laws, taken alternately."""
    laws: dict[str, ContactModel] = {"DEM": make_model("DEM"), "linear spring": Spring()}
    for stiffness in (Spring().stiffness / math.sqrt(OVERLAP), Hertz().stiffness):
        laws[f"Hertz, K = {stiffness:.2g}"] = Hertz(stiffness=stiffness)
    walks = {name: EvacWalk(hall, step, law) for name, law in laws.items()}
    spans: Any = comparison.compare({comparison.LEAST: MinimalWalk(hall, step), **walks}, step, WARM, TIMED)
    rows: list[Row] = []
    for name, program in walks.items():
        tally = program.walk.engine.data.tally
        times = float(np.median(np.divide(spans[name], spans["DEM"])))
        sub_steps = float(tally[at.SUB_STEPS] / tally[at.STEPS])
        rows.append(
            {
                "law": name,
                "ns per person-step": 1e9 * float(np.median(spans[name])),
                "times DEM": times,
                "times minimal": float(np.median(np.divide(spans[name], spans[comparison.LEAST]))),
                "contacts per person": float(tally[at.CONTACTS] / tally[at.SUB_STEPS]) / len(hall.crowd.level),
                "sub-steps per step": sub_steps,
                "times DEM, per sub-step": times * rows[0]["sub-steps per step"] / sub_steps if rows else 1.0,
            }
        )
    return rows
