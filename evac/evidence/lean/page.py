"""Time saved by leaving out parts: each is included in scenes that do not need it; and start-up times of commands."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evac.case.loading import load_case
from evac.contract.registry import Registry
from evac.directions.routes import STRATEGIES
from evac.evidence.evidence import Evidence, Row
from evac.evidence.lean import unused_route
from evac.evidence.lean.commands import report_commands, report_output
from evac.evidence.lean.kernels import KernelCase, report_kernels
from evac.evidence.scenes import model_overrides
from evac.evidence.verdicts import all_of, reported
from evac.physics.contact.percussions import separate
from evac.physics.engine import CompiledEngine, load_solver
from evac.physics.seams import reaches
from evac.simulation.simulation import Simulation

MODELS = ("DEM", "NSM1 inertial", "NSM2")

#: Arrays of the crowd that must be the same to the last bit, at every tick.
COMPARED = ("position", "velocity", "level", "distance", "exit_time")

#: K_T [kg] with which NSM2 needs its tangential law, so that the crossing tests can be included alone.
TANGENTIAL = 1.0


@dataclass(frozen=True)
class Part:
    """An optional part, and how it is included."""

    name: str  # as `evac explain` lists it
    overrides: Mapping[str, Any] = field(default_factory=dict)  # overrides that name it in a case that does not need it
    full: bool = False  # whether unused fields, forces and behaviours are included (``evac run --full``)
    # parts included in the step loop: kernels, by their attributes of `evac.physics.state.Parts`, and ``"tests"``,
    # unnecessary tests
    loop: tuple[str, ...] = ()
    # the part whose run it is compared with, which has everything else; None for no comparison
    base: "Part | None" = None


LEAN = Part("nothing")
FIELDS = Part("fields: all unused strategies", full=True, base=LEAN)

#: Names in `evac explain` of the optional kernels of the step loop, by their attributes of `Parts`.
LOOP = {"seams": "contacts across portals", "stronger": "for solves that fail", "separation": "separation of overlaps"}

#: Parts that a case can name without needing them.
NAMED = (
    Part("force: social, of strength 0", {"forces.social": {"strength": 0.0}}, full=True, base=FIELDS),
    Part("behaviour: response_time, of 0 s", {"behaviours.response_time": {"time": 0.0}}, full=True, base=FIELDS),
    Part("behaviour: teacher_following, no teachers", {"behaviours.teacher_following": {}}, full=True, base=FIELDS),
    Part("behaviour: route_choice, one route", {"behaviours.route_choice": {}}, full=True, base=FIELDS),
)


def parts_of(name: str, model: str, named: Sequence[Part] = NAMED) -> list[Part]:
    """Return the parts that can be included in a shipped case with a model that needs none of them."""
    simulation = Simulation(load_case(name, model_overrides(model)))
    used = {route.strategy for route in simulation.fields.routes}
    parts = [
        Part(f"fields: {strategy}", {"behaviours.unused_route": {"strategy": strategy}}, base=LEAN)
        for strategy in STRATEGIES
        if strategy not in used
    ]
    parts.append(FIELDS)
    for label, is_in, _ in simulation.engine.explain(simulation.contact):
        if not is_in:
            part = next(part for part, words in LOOP.items() if words in label)
            parts.append(Part(label, loop=(part,), base=LEAN))
    tests = "portals: tests for walls, portals and exits"
    if model == "NSM2":
        sticky = Part("tangential law", {"contact.nsm2.tangential_dissipation": TANGENTIAL})
        parts.append(Part(tests, sticky.overrides, loop=("tests",), base=sticky))
        parts.append(Part("tangential contact, with these tests", loop=("tests",), base=LEAN))
    else:
        parts.append(Part(tests, loop=("tests",), base=LEAN))
    return [*parts, *named]


@dataclass(frozen=True)
class Trial:
    """One run: CPU time of set-up and of the loop [s], and the arrays of every tick."""

    setup: float
    loop: float
    states: list[dict[str, np.ndarray]]


PARTS = "Included parts"


def run(evidence: Evidence) -> None:
    """Measure and write the page."""
    rounds, school_rounds = (2, 1) if evidence.quick else (25, 5)
    rows = evidence.measured(
        "parts",
        lambda: (
            *scene_rows("square_room", 10.0, NAMED, rounds),
            *scene_rows("primary_school", 2.0 if evidence.quick else 20.0, NAMED[-1:], school_rounds),
        ),
    )
    same = sum(row["same bits"] == "yes" for row in rows)
    evidence.verdict(all_of("Parts whose inclusion changes no bit of any trajectory", same, len(rows), PARTS))
    for scene in dict.fromkeys(row["scene"] for row in rows):
        for column in ("loop [%]", "set-up [ms]"):
            most = max((row for row in rows if row["scene"] == scene), key=lambda row: row[column])
            text = f"{most[column]:+.0f} ({most['part included']}, {most['model']})"
            evidence.verdict(reported(f"{scene}: most expensive part, {column}", text, "-", PARTS))
    evidence.show("parts", __name__, rows=rows, rounds=rounds, school_rounds=school_rounds)
    report_kernels(evidence, _kernel_cases(evidence.quick))
    report_output(evidence, rounds)
    report_commands(evidence)
    evidence.write_page(__name__)


def _kernel_cases(quick: bool) -> list[KernelCase]:
    everything = {key: value for part in NAMED for key, value in part.overrides.items()}
    cases = [
        KernelCase(scene, model, model_overrides(model), named)
        for scene, named in (("square_room", everything), ("primary_school", dict(NAMED[-1].overrides)))
        for model in MODELS
    ]
    return cases[:1] if quick else cases


def scene_rows(name: str, duration: float, named: Sequence[Part], rounds: int) -> Iterator[Row]:
    """Return a row for each model and part: its cost when included, and whether the results are bitwise the same.

    All variants run alternately in rounds; a cost is the difference to the part's base in the same round.
    """
    registry = Registry([unused_route.__file__])
    for model in MODELS:
        shared = {"simulation.duration": duration, "simulation.seed": 1} | model_overrides(model)
        parts = parts_of(name, model, named)
        variants = {part.name: part for part in [LEAN, *(part.base for part in parts if part.base), *parts]}
        cases = {key: load_case(name, {**shared, **part.overrides}, (), registry) for key, part in variants.items()}
        # The first round is not counted: it loads the kernels.
        trials = [{key: trial(cases[key], part) for key, part in variants.items()} for _ in range(rounds + 1)][1:]
        for part in parts:
            yield {"scene": name, "model": model} | _part_row(part, trials)


def _part_row(part: Part, trials: Sequence[Mapping[str, Trial]]) -> Row:
    assert part.base is not None
    pairs = [(trial[part.name], trial[part.base.name]) for trial in trials]
    setup = [1e3 * (forced.setup - base.setup) for forced, base in pairs]
    loop = [100.0 * (forced.loop - base.loop) / base.loop for forced, base in pairs]
    row: Row = {"part included": part.name}
    row |= {
        "set-up [ms]": float(np.median(setup)),
        "set-up, least [ms]": min(setup),
        "set-up, greatest [ms]": max(setup),
    }
    row["loop without it [ms]"] = 1e3 * float(np.median([base.loop for _, base in pairs]))
    row |= {"loop [%]": float(np.median(loop)), "loop, least [%]": min(loop), "loop, greatest [%]": max(loop)}
    return row | {"same bits": "yes" if all(same_bits(*pair) for pair in pairs) else "NO"}


def trial(case: Any, part: Part) -> Trial:
    """Run a case tick by tick with a part included."""
    start = time.process_time()
    simulation = Simulation(case, full=part.full)
    force(simulation, part.loop)
    ready = time.process_time()
    spent, states = 0.0, []
    while not simulation.ended:
        tick = time.process_time()
        simulation.advance_tick()
        spent += time.process_time() - tick
        crowd = simulation.population.crowd
        states.append({name: getattr(crowd, name).copy() for name in COMPARED})
    return Trial(ready - start, spent, states)


def force(simulation: Simulation, loop: Sequence[str]) -> None:
    """Load the parts of the step loop that the scene needs, and those that are included, see `Part`."""
    engine, model = simulation.engine, simulation.contact
    assert isinstance(engine, CompiledEngine)
    engine.full = False
    engine.load(model)
    parts, solvers = engine.data.parts, simulation.registry.solvers
    if "seams" in loop:
        parts.seams = reaches.address
    if "stronger" in loop:
        parts.stronger = load_solver(solvers[solvers[model.values()["solver"]].stronger])
    if "separation" in loop:
        parts.separation = separate.address
    engine.full = "tests" in loop


def same_bits(one: Trial, other: Trial) -> bool:
    """Return whether two runs have the same ticks with bitwise the same arrays."""
    return len(one.states) == len(other.states) and all(
        a[name].tobytes() == b[name].tobytes()
        for a, b in zip(one.states, other.states, strict=True)
        for name in COMPARED
    )
