"""The section of the page that compares evac with other programs, from the same positions."""

import importlib.util
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from evac.base.errors import SimulationError
from evac.evidence.evidence import Evidence, Row
from evac.evidence.scaling.halls import Hall, make_hall
from evac.evidence.scaling.peers import programs
from evac.evidence.scaling.walks import TICK
from evac.evidence.scenes import make_model
from evac.evidence.verdicts import reported

SIZES, QUICK_SIZES = (1_000, 10_000), (100,)

#: People per m2 at the start.
DENSITIES = {"free": 2.0, "dense": 5.0}

#: Ticks before the timing, and ticks timed.
WARM, TIMED = 5, 9

#: What a program raises when it cannot make a step.
FAILURES = (SimulationError, RuntimeError, ArithmeticError, IndexError)

BASE, LEAST = "evac, DEM", "minimal kernel"

SECTION = "Comparison with other programs"


class Program(Protocol):
    """A program that walks a copy of the crowd of a hall."""

    @property
    def inside(self) -> int:
        """Number of people for whom a step is made."""

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""


#: From a hall and the length of a step [s].
Maker = Callable[[Hall, float], Program]


def _own(model: str, behaviour: str = "") -> Maker:
    """Return the maker of a walk with a model of evac, and with a behaviour if one is named."""
    if behaviour:
        return lambda hall, step: programs.BehaviourWalk(hall, step, make_model(model), behaviour)
    return lambda hall, step: programs.EvacWalk(hall, step, make_model(model))


OWN: Mapping[str, Maker] = {
    LEAST: programs.MinimalWalk,
    BASE: _own("DEM"),
    "evac, NSM1": _own("NSM1 inertial"),
    "evac, NSM1 overdamped": _own("NSM1 overdamped"),
    "evac, DEM with headway": _own("DEM", "headway"),
    "evac, DEM with walking": _own("DEM", "walking"),
    "evac, NSM2 with walking": _own("NSM2", "walking"),
}


@dataclass(frozen=True)
class Peer:
    """Another program, which is compared if its package is installed."""

    name: str
    package: str  # as it is imported
    models: Mapping[str, Maker]  # by their names in the table
    most: float = math.inf  # people; larger halls are skipped
    same: Mapping[str, str] = field(default_factory=dict)  # models of evac with the same law, by the peer's models


#: Most people whom cromosim is given.
FEW = 1_000

JUPEDSIM = {
    "collision-free speed": "CollisionFreeSpeedModel",
    "anticipation velocity": "AnticipationVelocityModel",
    "social force": "SocialForceModel",
}

PEERS = (
    Peer(
        "JuPedSim",
        "jupedsim",
        {f"JuPedSim, {name}": partial(programs.JupedsimWalk, model=model) for name, model in JUPEDSIM.items()},
    ),
    Peer("RVO2", "pyrvo", {"ORCA (RVO2)": programs.OrcaWalk}),
    Peer(
        "cromosim",
        "cromosim",
        {
            "cromosim, overdamped": partial(programs.CromosimWalk, is_inertial=False),
            "cromosim, inertial": partial(programs.CromosimWalk, is_inertial=True),
        },
        most=FEW,
        same={"cromosim, overdamped": "evac, NSM1 overdamped", "cromosim, inertial": "evac, NSM1"},
    ),
)


def run(evidence: Evidence, step: float) -> None:
    """Add the section to the page, if a package of another program is installed."""
    if evidence.page_only:
        versions = evidence.conditions()["versions"]
        peers = [peer for peer in PEERS if f"{peer.package} " in versions]
    else:
        peers = [peer for peer in PEERS if importlib.util.find_spec(peer.package) is not None]
    if not peers:
        return
    sizes = QUICK_SIZES if evidence.quick else SIZES
    rows = evidence.measured("peers", _rows, peers, sizes, evidence.seed, step)
    text = "; ".join(_told(peer, rows) for peer in peers)
    evidence.verdict(reported("Time of a person-step of other programs divided by that of evac", text, "-", SECTION))
    missing = ", ".join(peer.name for peer in PEERS if peer not in peers) or "none"
    evidence.show("comparison", __name__, step=step, peers=peers, missing=missing, rows=rows)


def _told(peer: Peer, rows: list[Row]) -> str:
    """Return the range of the times of a program divided by those of evac, of the same model where evac has it."""
    times = {(row["people"], row["start"], row["program"]): row["times DEM"] for row in rows}
    ratios = []
    for (people, start, name), theirs in times.items():
        own = times.get((people, start, peer.same.get(name, BASE)))
        if name in peer.models and theirs and own:
            ratios.append(theirs / own)
    text = f"{min(ratios):.1f} to {max(ratios):.1f}" if ratios else "no step made"
    return f"{peer.name} {text} ({'the same model' if peer.same else 'DEM'})"


def _rows(peers: Iterable[Peer], sizes: tuple[int, ...], seed: int, step: float) -> Iterator[Row]:
    for people in sizes:
        makers = dict(OWN)
        for peer in peers:
            makers |= peer.models if people <= peer.most else {}
        for state, density in DENSITIES.items():
            hall = make_hall(people, density, seed)
            costs = compare({name: make(hall, step) for name, make in makers.items()}, step)
            yield from [{"people": people, "start": state, **_row(name, costs)} for name in costs]


def _row(name: str, costs: Mapping[str, list[float] | str]) -> Row:
    row: dict[str, Any] = {"program": name, "ns per person-step": None, "times DEM": None, "times minimal": None}
    cost = costs[name]
    if isinstance(cost, str):
        return {**row, "message": cost}
    row["ns per person-step"] = 1e9 * float(np.median(cost))
    for column, base in (("times DEM", BASE), ("times minimal", LEAST)):
        row[column] = float(np.median(np.divide(cost, costs[base])))
    return {**row, "message": ""}


def compare(
    programs: Mapping[str, Program], step: float, warm: int = WARM, timed: int = TIMED
) -> dict[str, list[float] | str]:
    """Return the time of a person-step [s] of each program in each timed tick, or the message with which it stopped."""
    costs: dict[str, list[float] | str] = {}
    spans: dict[str, list[float]] = {name: [] for name in programs}
    for tick in range(warm + timed):
        for name, program in programs.items():
            if name in costs:
                continue
            people = max(program.inside, 1)
            try:
                span = program.advance()
            except FAILURES as failure:
                costs[name] = str(failure)
                continue
            if tick >= warm:
                spans[name].append(span / people / round(TICK / step))
    return {**spans, **costs}
