"""Strategies with lifts, stairs and bridges in twin towers, and flows of escalators beside the published capacities."""

import math

import numpy as np
from shapely import box, union_all

from evac.analysis.lines import steady_flow
from evac.building.plan.plan import Plan
from evac.case.loading import load_case
from evac.contract.hooks import DEFAULT_MOVEMENT
from evac.evidence.evidence import Evidence, Row
from evac.evidence.people.measures import Line, passing_times
from evac.evidence.people.runs import follow
from evac.evidence.verdicts import at_least, at_most
from evac.simulation.simulation import Simulation
from evac.standard.plans import across
from evac.standard.trial import CONTACT_MODEL

#: Storeys of each tower, their height [m], those with a bridge, the cars of each tower, and people of a storey above
#: the ground.
STOREYS, QUICK_STOREYS, HEIGHT, CARS, PEOPLE = 24, 6, 3.5, 6, 12
BRIDGES = (1.0 / 3.0, 2.0 / 3.0)

#: Number of storeys above and below a bridge from which people take it where the strategy says so.
NEAR_BRIDGE = 2

#: Motion of the cars.
OPERATION = {"speed": 5.0, "acceleration": 1.0, "jerk": 1.2, "capacity": 13}

STAIRS, BOTH, LIFTS, BRIDGED = "stairs alone", "stairs and lifts", "lifts alone", "lifts and bridges"

#: The strategies: how people use lifts, and whether those near a bridge leave through the other tower.
STRATEGIES = {
    STAIRS: ("", False),
    "stairs and bridges": ("", True),
    BOTH: ("weighed", False),
    LIFTS: ("preferred", False),
    BRIDGED: ("preferred", True),
}

#: Capacities of escalators in EN 115-1 [1/h], by the width of the steps [m] and the speed [m/s].
CAPACITY = {
    0.6: {0.5: 3600, 0.65: 4400, 0.75: 4900},
    0.8: {0.5: 4800, 0.65: 5900, 0.75: 6600},
    1.0: {0.5: 6000, 0.65: 7300, 0.75: 8200},
}

#: People before an escalator, its height [m] and slope [degrees], and shares of them who walk on it.
QUEUE, RISE, SLOPE, SHARES = 80, 5.0, 30.0, (0.0, 0.25)


def towers(storeys: int) -> Plan:
    """Return two towers of some storeys, each with two stairs, a bank of cars and two exits; bridges join them."""
    plan, names = Plan(), [f"storey {number}" for number in range(storeys)]
    bridges = [round(share * (storeys - 1)) for share in BRIDGES]
    for number, name in enumerate(names):
        parts = [box(0, 0, 18, 12), box(30, 0, 48, 12)]
        parts += [box(18, 5, 30, 7)] if number in bridges else []
        plan.storey(name, union_all(parts), z=HEIGHT * number)
        plan.area(f"office {number}", name, box(0.1, 0.1, 17.9, 11.9))
    for tower, x in (("near", 0.0), ("far", 30.0)):
        for side, start, end, y in (("south", 5.2, 4.0, 0.0), ("north", 12.8, 14.0, 12.0)):
            edge, out = [(x + start, y), (x + end, y)], (0.0, -1.0 if y == 0.0 else 1.0)
            plan.shaft(f"{tower} {side}", names[0], names[-1], edge, direction=out, length=3.0, turn="left")
        plan.exit(tower, names[0], [(x + 7, 0), (x + 9, 0)])
        for car in range(CARS):
            left = x + 0.2 + 1.95 * car
            ground, door = box(left, 12.2, left + 1.8, 13.9), [(left + 0.35, 12.2), (left + 1.45, 12.2)]
            plan.lift(f"{tower} {car}", names, ground, door, operation={**OPERATION, "bank": tower})
    return plan


def strategy_run(strategy: str, storeys: int, seed: int) -> Row:
    """Return when the people of one tower are out with a strategy."""
    lifts, bridged = STRATEGIES[strategy]
    bridges = [round(share * (storeys - 1)) for share in BRIDGES]
    people = []
    for number in range(1, storeys):
        crosses = bridged and min(abs(number - bridge) for bridge in bridges) <= NEAR_BRIDGE
        own = "weighed" if crosses and lifts else lifts  # who prefers lifts takes no stairs to a bridge
        group = {"name": f"office {number}", "area": f"office {number}", "number": PEOPLE, "lifts": own}
        people.append({**group, "exits": ["far" if crosses else "near"], "strategy": "quickest"})
    simulation = _simulation(towers(storeys), people, seed, duration=3600.0)
    lifts_used = simulation.run().lifts
    exit_time = simulation.population.crowd.exit_time
    return {
        "strategy": strategy,
        "seed": seed,
        "last out [s]": float(exit_time.max()),
        "mean exit time [s]": float(exit_time.mean()),
        "by lift": sum(lift["people"] for lift in lifts_used),
        "people": len(exit_time),
    }


def escalator_flow(width: float, speed: float, share: float, seed: int) -> float:
    """Return the steady flow at the top of an escalator [1/h], with a share of people who walk on it."""
    run, half = RISE / math.tan(math.radians(SLOPE)), 0.5 * width
    plan = Plan()
    plan.storey("lower", box(-8, 0, 0, 8), z=0.0)
    plan.storey("upper", box(run, 0, run + 10, 8), z=RISE)
    plan.stair("up", "lower", across(0, 4 - half, 4 + half), "upper", across(run, 4 - half, 4 + half))
    plan.exit("end", "upper", across(run + 10, 0, 8))
    people = [{"name": "queue", "level": "lower", "number": QUEUE}]
    moving = {"up": {"speed": speed, "towards": "up"}}
    simulation = _simulation(plan, people, seed, moving, riding={"walking": share})
    line = Line(0, run, 1)
    times = passing_times(follow(simulation, line)[0], line)
    return 3600.0 * steady_flow(np.sort(times[np.isfinite(times)]))


def _simulation(
    plan: Plan, people: list[Row], seed: int, moving: Row | None = None, duration: float = 600.0, **behaviours: Row
) -> Simulation:
    table = {
        "building": {"plan": plan, "moving": moving or {}},
        "people": people,
        "contact": {"model": CONTACT_MODEL},
        "behaviours": {DEFAULT_MOVEMENT: {}, **behaviours},
        "simulation": {"seed": seed, "duration": duration},
    }
    return Simulation(load_case(table))


def run(evidence: Evidence) -> None:
    """Make the runs, and write the page."""
    storeys = QUICK_STOREYS if evidence.quick else STOREYS
    jobs = [(strategy, storeys, evidence.seed) for strategy in STRATEGIES]
    rows = evidence.measured("strategies", lambda: evidence.map(strategy_run, jobs))
    widths, shares = (tuple(CAPACITY)[-1:], SHARES[:1]) if evidence.quick else (tuple(CAPACITY), SHARES)
    riders = [(width, speed, share, evidence.seed) for width in widths for speed in CAPACITY[width] for share in shares]

    def flows() -> list[Row]:
        found = dict(zip([job[:3] for job in riders], evidence.map(escalator_flow, riders), strict=True))
        return [_flow_row(*key, flow) for key, flow in found.items()]

    escalators = evidence.measured("escalators", flows)
    evidence.show("page", __name__, storeys=storeys, rows=rows, escalators=escalators)
    last = {row["strategy"]: row["last out [s]"] for row in rows}
    for faster, slower in ((LIFTS, STAIRS), (LIFTS, BOTH), (BRIDGED, STAIRS), (BRIDGED, BOTH)):
        question = f"{faster}: time of {slower} that the last one needs"
        evidence.verdict(at_most(question, 100.0 * last[faster] / last[slower], 100.0, "%", "Strategies"))
    stand = [row["of the capacity [%]"] for row in escalators if row["walk [%]"] == 0]
    evidence.verdict(at_least("least flow with nobody walking", min(stand), 60.0, "% of the capacity", "Escalators"))
    evidence.verdict(at_most("greatest flow with nobody walking", max(stand), 100.0, "% of the capacity", "Escalators"))
    evidence.write_page(__name__)


def _flow_row(width: float, speed: float, share: float, flow: float) -> Row:
    capacity = CAPACITY[width][speed]
    return {
        "width [m]": width,
        "speed [m/s]": speed,
        "walk [%]": round(100 * share),
        "flow [1/h]": round(flow),
        "capacity [1/h]": capacity,
        "of the capacity [%]": 100.0 * flow / capacity,
    }
