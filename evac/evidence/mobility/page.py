"""Speeds of people with reduced mobility on the flat and on ramps, and flows of wheelchair users through doors."""

import math

import numpy as np
from shapely import box

from evac.base.arrays import FloatArray
from evac.building.plan.plan import Plan
from evac.case.loading import load_case
from evac.contract.hooks import DEFAULT_MOVEMENT
from evac.evidence.evidence import Evidence, Row
from evac.evidence.people.measures import Line, passing_times
from evac.evidence.people.runs import follow
from evac.evidence.verdicts import all_of, at_most, reported
from evac.simulation.simulation import Simulation
from evac.standard.plans import across, one_storey, straight_stair
from evac.standard.trial import CONTACT_MODEL

#: Mean speeds on the flat [m/s]: Boyce, Shields and Silcock, Fire Technology 35 (1999) 51-67, 10.1023/A:1015339216366,
#: of which all but the last two were read at second hand, as table 3 of Tinaburri (2018) quotes them.
PUBLISHED = {
    "walking_stick": 0.81,
    "crutches": 0.94,
    "walking_frame": 0.57,
    "wheelchair": 0.69,
    "electric_wheelchair": 0.89,
    "pushed_wheelchair": 1.30,
    "accompanied": 0.78,
}

#: Range of the speeds of people with reduced mobility [m/s]: RiMEA guideline 2.2.1, after Weidmann (1993).
RIMEA = (0.46, 0.76)

#: Those who use ramps of 1:12, and the rise of one over `RUN`.
ON_RAMPS = ("walking_frame", "wheelchair", "electric_wheelchair", "pushed_wheelchair")
RUN, RISE = 12.0, 1.0

#: People of a run beside one another, their distance [m], and the lines between which their speed is measured [m].
PEOPLE, APART = 24, 1.6
LINES = (3.0, 9.0)

#: Widths of doors [m]: the first one is the least clear width of an accessible way out, 32 inches (NFPA 101, ADA).
DOORS = (0.815, 0.9, 1.0, 1.2, 1.5)

#: People before a door, and shares of them in a wheelchair.
QUEUE, SHARES = 30, (0.0, 0.1, 1.0)

#: Specific flow through doors per metre of effective width, 0.3 m less than the width [1/s/m]: SFPE handbook.
SFPE_FLOW, SFPE_EDGES = 1.3, 0.3

#: Greatest deviation of a mean speed from the published one [%].
MOST = 10.0


def _simulation(plan: Plan, people: list[Row], seed: int) -> Simulation:
    table = {
        "building": plan,
        "people": [{"name": f"group {number}", **group} for number, group in enumerate(people)],
        "contact": {"model": CONTACT_MODEL},
        "behaviours": {DEFAULT_MOVEMENT: {}},
        "directions": {"spacing": 0.2},
        "simulation": {"seed": seed, "duration": 600.0},
    }
    return Simulation(load_case(table))


def walking_speeds(preset: str, place: str, seed: int) -> FloatArray:
    """Return the speeds (people,) along the slope [m/s] of people of a preset, beside one another: flat, up or down."""
    width, is_down = APART * PEOPLE, place == "down"
    if place == "flat":
        plan, rise = one_storey(box(-3, 0, RUN + 3, width), exits={"up": across(RUN + 3, 0, width)}), 0.0
    else:
        plan, rise = straight_stair(RUN, RISE, 3.0, width), RISE
    start = RUN + 2.0 if is_down else -2.0
    people = {
        "preset": preset,
        "positions": [[start, APART * (k + 0.5)] for k in range(PEOPLE)],
        "z": RISE if is_down else 0.0,
        "exits": ["down" if is_down else "up"],
    }
    lines = [Line(0, RUN - x, -1) if is_down else Line(0, x, 1) for x in LINES]
    track, _ = follow(_simulation(plan, [people], seed), lines[1])
    first, last = (passing_times(track, line) for line in lines)
    return (LINES[1] - LINES[0]) * math.hypot(1.0, rise / RUN) / (last - first)


def flow_through(width: float, share: float, seed: int) -> Row:
    """Return what came of a run of people, a share of them in wheelchairs, through a door of a width [m]."""
    half = 0.5 * width
    plan = one_storey(
        *(box(0, 0, 8, 8), box(8, 4 - half, 8.3, 4 + half), box(8.3, 0, 12, 8)),
        exits={"end": across(12, 0, 8)},
        areas={"start": box(0.5, 0.5, 7.5, 7.5)},
    )
    number = round(share * QUEUE)
    people = [{"area": "start", "number": QUEUE - number}] if number < QUEUE else []
    people += [{"area": "start", "number": number, "preset": "wheelchair", "mass": 95.0}] if number else []
    track, left = follow(_simulation(plan, people, seed), Line(0, 8.3, 1))
    times = track.time[(track.position[:, :, 0] >= 8.3).argmax(axis=0)]
    return {
        "door [m]": width,
        "in wheelchairs [%]": round(100 * share),
        "seed": seed,
        "flow [1/s]": None if left else (QUEUE - 1) / float(np.ptp(times)),
        "left": left,
    }


def run(evidence: Evidence) -> None:
    """Measure speeds and flows, and write the page."""
    seeds = range(evidence.seed, evidence.seed + (1 if evidence.quick else 5))
    walks = [(preset, "flat", seed) for preset in PUBLISHED for seed in seeds]
    walks += [(preset, way, seed) for preset in ON_RAMPS for way in ("up", "down") for seed in seeds]
    doors = [(width, share, seed) for width in DOORS for share in SHARES for seed in seeds]

    def speeds() -> list[Row]:
        found: dict[tuple[str, str], list[FloatArray]] = {}
        for (preset, place, _), each in zip(walks, evidence.map(walking_speeds, walks), strict=True):
            found.setdefault((preset, place), []).append(each)
        return [_speed_row(*key, np.concatenate(each)) for key, each in found.items()]

    rows = evidence.measured("speeds", speeds)
    slow = [row["preset"] for row in rows if row["place"] == "flat" and RIMEA[0] <= row["mean [m/s]"] <= RIMEA[1]]
    for row in rows:
        if row["place"] == "flat":
            question = f"{row['preset']}, flat: deviation of the mean speed"
            evidence.verdict(at_most(question, abs(row["deviation [%]"]), MOST, "%", "Speeds"))
    flows = evidence.measured("flows", lambda: evidence.map(flow_through, doors))
    shown = {(width, share): _door_row(flows, width, share) for width in DOORS for share in SHARES}
    evidence.show("page", __name__, rows=rows, slow=slow, seeds=seeds, doors=list(shown.values()))
    through = [row["left"] == 0 for row in flows if row["in wheelchairs [%]"]]
    question = "runs with wheelchairs in which everybody passes the door"
    evidence.verdict(all_of(question, sum(through), len(through), "Doors"))
    for width in DOORS:
        alone, mixed, only = (shown[width, share] for share in SHARES)
        text = f"{_told(mixed['flow [1/s]'])}, {_told(only['flow [1/s]'])} /s"
        question = f"door of {width:g} m: flow with {100 * SHARES[1]:g} % and with wheelchairs alone"
        evidence.verdict(reported(question, text, f"without: {_told(alone['flow [1/s]'])} /s", "Doors"))
    evidence.write_page(__name__)


def _speed_row(preset: str, place: str, speeds: FloatArray) -> Row:
    published = PUBLISHED[preset] if place == "flat" else None
    mean = float(speeds.mean())
    return {
        "preset": preset,
        "place": place,
        "people": len(speeds),
        "mean [m/s]": mean,
        "standard deviation [m/s]": float(speeds.std(ddof=1)),
        "published mean [m/s]": published,
        "deviation [%]": None if published is None else 100.0 * (mean / published - 1.0),
    }


def _door_row(flows: list[Row], width: float, share: float) -> Row:
    own = [row for row in flows if (row["door [m]"], row["in wheelchairs [%]"]) == (width, round(100 * share))]
    known = [row["flow [1/s]"] for row in own if row["flow [1/s]"] is not None]
    mean = float(np.mean(known)) if known else None
    return {
        "door [m]": width,
        "in wheelchairs [%]": round(100 * share),
        "flow [1/s]": mean,
        "per metre [1/s/m]": None if mean is None else mean / width,
        "SFPE [1/s]": SFPE_FLOW * (width - SFPE_EDGES) if share == 0.0 else None,
        "blocked runs": f"{len(own) - len(known)} of {len(own)}",
    }


def _told(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
