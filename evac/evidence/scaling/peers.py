"""Time of a step beside JuPedSim, from the same positions, if that package is installed."""

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from evac.behaviour import BehaviourScene
from evac.evidence.models import plugins
from evac.evidence.report import Evidence
from evac.evidence.scaling.halls import DOOR, Hall, make_hall
from evac.evidence.scaling.walks import TICK, Walk, cpu_time, make_variant
from evac.evidence.verdicts import reported
from evac.scene import Scene, make_ground

SIZES, QUICK_SIZES = (1_000, 10_000), (100,)

#: People per m2 at the start.
DENSITIES = {"free": 2.0, "dense": 5.0}

#: Ticks before the timing, and ticks timed.
WARM, TIMED = 5, 9

#: Models of JuPedSim, by what the table calls them.
THEIRS = {"JuPedSim, collision-free speed": "CollisionFreeSpeedModel", "JuPedSim, social force": "SocialForceModel"}

#: Depth of the ground outside the doors, on which JuPedSim has its exits [m].
OUTSIDE = 2.0

SECTION = "Beside JuPedSim"

#: One tick of a program, and the number of people inside.
Program = tuple[Callable[[], Any], Callable[[], int]]


def run(evidence: Evidence, step: float) -> None:
    """Add the table to the page."""
    if evidence.page_only:
        is_measured = "jupedsim" in evidence.conditions()["versions"]
    else:
        is_measured = importlib.util.find_spec("jupedsim") is not None
    if not is_measured:
        return
    sizes = QUICK_SIZES if evidence.quick else SIZES
    rows = evidence.measured("peers", lambda: _rows(sizes, evidence.seed, step))
    for name in THEIRS:
        ratios = [row["times DEM"] for row in rows if row["program"] == name and row["times DEM"] is not None]
        if not ratios:
            continue
        told = f"{min(ratios):.1f} to {max(ratios):.1f}"
        evidence.verdict(reported(f"{name}: time of a person-step over that of DEM", told, "-", SECTION))
    evidence.heading(SECTION)
    evidence.table(
        "peers",
        rows,
        f"""Nanoseconds of CPU time per person-step of {step:g} s on one core, in the same hall, from the same
        positions, with the same radii and desired speeds, in seconds {WARM * TICK:g} to {(WARM + TIMED) * TICK:g}. All
        programs make their ticks in turns; medians over ticks. The models differ: the collision-free speed model and
        the social force look at everybody within 2.5 to 3 m, as headway does, while DEM only acts on contact. cromosim
        is compared on [the accuracy page](../accuracy/README.md#beside-cromosim). A program that cannot make a step has
        no times; its message is in the file. This table is made where JuPedSim is installed.""",
        columns=("people", "start", "program", "ns per person-step", "times DEM"),
    )


def _rows(sizes: tuple[int, ...], seed: int, step: float) -> list[dict[str, Any]]:
    """Return a row for each hall and program."""
    rows = []
    for people in sizes:
        for state, density in DENSITIES.items():
            costs = compare(make_hall(people, density, seed), step)
            base = np.array(costs["evac, DEM"])
            for name, found in costs.items():
                spans = None if isinstance(found, str) else np.array(found)
                rows.append(
                    {
                        "people": people,
                        "start": state,
                        "program": name,
                        "ns per person-step": None if spans is None else 1e9 * float(np.median(spans)),
                        "times DEM": None if spans is None else float(np.median(spans / base)),
                        "message": found if spans is None else "",
                    }
                )
    return rows


def compare(hall: Hall, step: float) -> dict[str, list[float] | str]:
    """Return the time of a person-step [s] of each program in each timed tick, or the message with which it stopped."""
    programs = {
        "evac, DEM": _evac(hall, "DEM", step),
        "evac, NSM1": _evac(hall, "NSM1 inertial", step),
        "evac, DEM with headway": _evac(hall, "DEM", step, keeps_distance=True),
        **{name: _jupedsim(hall, model, step) for name, model in THEIRS.items()},
    }
    spans: dict[str, list[float]] = {name: [] for name in programs}
    stopped: dict[str, str] = {}
    for tick in range(WARM + TIMED):
        for name, (advance, inside) in programs.items():
            if name in stopped:
                continue
            people = max(inside(), 1)
            try:
                span = cpu_time(advance)
            except RuntimeError as error:  # of JuPedSim, such as a person who has been pushed out of the hall
                stopped[name] = str(error)
                continue
            if tick >= WARM:
                spans[name].append(span / people / round(TICK / step))
    return {**spans, **stopped}


def _evac(hall: Hall, name: str, step: float, keeps_distance: bool = False) -> Program:
    """Return a walk of evac, with or without the behaviour headway."""
    walk, variant = Walk(hall, step), make_variant(name, step)
    if not keeps_distance:
        return lambda: walk.advance(variant.model), lambda: walk.inside
    behaviour = plugins().get("behaviour", "headway")()
    scene = Scene(make_ground(hall.building, hall.fields))
    behaviour.prepare(BehaviourScene(walk.crowd, scene, (), np.random.default_rng(0), TICK))

    def advance() -> None:
        walk.crowd.speed_factor[:] = 1.0
        walk.crowd.extra_direction[:] = 0.0
        behaviour.act(walk.crowd, walk.time)
        walk.advance(variant.model)

    return advance, lambda: walk.inside


def _jupedsim(hall: Hall, model: str, step: float) -> Program:
    """Return a simulation of JuPedSim: each person walks to the nearest door."""
    import jupedsim

    doors = np.array([exit_.segments[0] for exit_ in hall.building.exits])  # along y, at x = depth
    grounds = [shapely.box(hall.depth - 0.01, low, hall.depth + OUTSIDE, high) for _, low, _, high in doors]
    area = shapely.union_all([shapely.box(0.0, 0.0, hall.depth, hall.length), *grounds])
    simulation = jupedsim.Simulation(model=getattr(jupedsim, model)(), geometry=area, dt=step)
    stages = [
        simulation.add_exit_stage(shapely.box(hall.depth + 0.5 * DOOR, low, hall.depth + OUTSIDE, high))
        for _, low, _, high in doors
    ]
    journeys = [simulation.add_journey(jupedsim.JourneyDescription([stage])) for stage in stages]
    parameters = getattr(jupedsim, f"{model}AgentParameters")
    middle, crowd = 0.5 * (doors[:, 1] + doors[:, 3]), hall.crowd
    for position, radius, speed in zip(crowd.position, crowd.radius, crowd.speed[:, 0], strict=True):
        door = int(np.abs(middle - position[1]).argmin())
        simulation.add_agent(
            parameters(
                position=(float(position[0]), float(position[1])),
                radius=float(radius),
                desired_speed=float(speed),
                journey_id=journeys[door],
                stage_id=stages[door],
            )
        )
    return lambda: simulation.iterate(round(TICK / step)), lambda: int(simulation.agent_count())
