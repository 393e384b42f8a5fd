"""Two surveys used by several tests: flow and speed on stairs, and flow through doors, which may block for good."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evac.analysis.flows import steady_flow
from evac.base.arrays import FloatArray
from evac.evidence.validation.buildings import CROWD_SPEED, across, hall_and_stair, rectangle
from evac.evidence.validation.flows import STAIR_FLOW, passing_times
from evac.evidence.validation.trial import Check, Criterion, Outcome, Trial, mean_interval

STAIR_WIDTHS = (1.0, 1.2, 1.8)  # m
WAYS = ("down", "up")
DOOR_WIDTHS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 2.0)  # m
PEOPLE = 100

#: Column of the table of doors.
AT_EXIT = "exit at the door over ground behind"

#: Greatest difference of the flow with the exit at the door from that with ground behind it, with headway [-].
SAME_FLOW = 0.1

#: Width of the door of IMO 4 and greatest flow through it.
IMO_DOOR = 1.0  # m
IMO_FLOW = 1.33  # 1/s

#: Least and greatest flow measured in laboratories through bottlenecks, by width; whose, the page tells [1/s].
LABORATORY = {
    0.6: (1.12, 1.48),
    0.7: (1.22, 1.25),
    0.8: (1.29, 1.74),
    0.9: (1.53, 2.26),
    1.0: (1.71, 2.77),
    1.2: (2.03, 2.75),
}

#: The room with a door: its length, the thickness of the wall with the door, and the depth of ground behind it [m].
ROOM, WALL, GROUND = 8.0, 0.2, 2.5

#: People faster than this factor times their own stair speed count as pushed [-].
PUSHED = 1.2


@dataclass(frozen=True)
class Stair:
    """Runs on one stair: width [m], way, the steady flow of each [1/s], and all speeds over the own stair speed."""

    trial: Trial
    width: float
    way: str
    flows: FloatArray
    ratios: FloatArray


@dataclass(frozen=True)
class Door:
    """Runs at one door: its width [m], and the flow of each over its whole time [1/s], NaN where it blocked.

    `flows` are those with ground behind the door, `at_exit` those with the exit right at the door.
    """

    trial: Trial
    width: float
    flows: FloatArray
    at_exit: FloatArray


def run_stair(trial: Trial, width: float, way: str) -> Stair:
    """Run a hundred people over the stair of ISO 12, from the hall at its head or at its foot."""
    left, right = (0, 0, 8, 10), (15, 0, 23, 10)
    area = ("hall", left, 3.0) if way == "down" else ("hall", right, 0.0)
    way_out = ("end", across(23, 0, 10), 0.0) if way == "down" else ("end", across(0, 0, 10), 3.0)
    crowd = {"area": "hall", "number": PEOPLE, "speed": CROWD_SPEED}
    runs = trial.runs(hall_and_stair(width), [way_out], [crowd], [area], **{"output.every": 0.1})
    found = [_on_the_flight(outcome, way) for outcome in runs]
    return Stair(
        trial, width, way, np.array([flow for flow, _ in found]), np.concatenate([ratio for _, ratio in found])
    )


def _on_the_flight(outcome: Outcome, way: str) -> tuple[float, FloatArray]:
    """Return the steady flow onto the flight [1/s], and meanwhile all speeds on it over the own stair speed."""
    flight = next(level for level in outcome.results.building.levels if level.kind == "flight")
    times = outcome.first_times(outcome.results.moves.target == flight.index)
    column = {"up": 1, "down": 2}[way]
    own = outcome.results.crowd.speed[:, column]
    trajectory = outcome.trajectory
    begin, end = np.quantile(times, (0.2, 0.8))
    is_steady = (trajectory.time >= begin) & (trajectory.time <= end)
    on_it = (trajectory.level == flight.index) & is_steady[:, None]
    along = np.abs(trajectory.velocity[..., :2] @ flight.uphill) / np.cos(flight.slope)
    return float("nan") if outcome.is_blocked else steady_flow(times), (along / own)[on_it]


def stair_row(stair: Stair) -> dict[str, Any]:
    """Return the row of a stair on the page."""
    flows = stair.flows / stair.width
    low, high = mean_interval(flows) or (None, None)
    return {
        "width [m]": stair.width,
        "way": stair.way,
        "model": stair.trial.name,
        "runs": len(flows),
        "flow per metre [1/s/m]": float(flows.mean()),
        "from": low,
        "to": high,
        "published [1/s/m]": "{:g} to {:g}".format(*STAIR_FLOW),
        "over the greatest published": float(flows.mean()) / STAIR_FLOW[1],
        "speed over own stair speed, median": float(np.median(stair.ratios)),
        f"share above {PUSHED:g}": float((stair.ratios > PUSHED).mean()),
    }


def run_door(trial: Trial, width: float) -> Door:
    """Run a hundred people in a room of 8 x 5 m out of a door in the middle of its short wall (IMO 4)."""
    low, high = 2.5 - width / 2, 2.5 + width / 2
    room, (end, sides) = rectangle(0, 0, ROOM, 5), (ROOM + WALL + GROUND, (0, 5))
    ground = [room, rectangle(ROOM, low, ROOM + WALL, high), rectangle(ROOM + WALL, 0, end, 5)]
    crowd, area = {"area": "room", "number": PEOPLE, "speed": CROWD_SPEED}, ("room", (0, 0, ROOM, 5), 0.0)
    found = []
    for faces, segment in ((ground, across(end, *sides)), ([room], across(ROOM, low, high))):
        runs = trial.runs(faces, [("door", segment, 0.0)], [crowd], [area], **{"output.every": 0.1})
        found.append(np.array([_whole_flow(outcome) for outcome in runs]))
    return Door(trial, width, *found)


def _whole_flow(outcome: Outcome) -> float:
    """Return the flow through the door from the first to the last person [1/s]; NaN if people are left."""
    times = passing_times(outcome, ROOM)
    return float("nan") if outcome.is_blocked else float((len(times) - 1) / (times[-1] - times[0]))


def stair_checks(stairs: Sequence[Stair]) -> list[Check]:
    """ISO 12 and the published flows, from the stairs of one model in ascending width."""
    checks = []
    for way in WAYS:
        own = [stair for stair in stairs if stair.way == way]
        flows = np.array([stair.flows for stair in own])
        check = own[0].trial.check
        widths = ", ".join(f"{stair.width:g}" for stair in own)
        words = f"flow {way}, on a wider stair over on the next narrower, the least ({widths} m)"
        wider = Criterion("ISO 12", words, "ISO 20414", low=1.0)
        checks.append(check(wider, (flows[1:] / flows[:-1]).min(axis=0)))
        words = f"flow {way} a stair of {own[0].width:g} m [1/s/m]"
        checks.append(
            check(Criterion("stair flow (IMO, SFPE)", words, "IMO, SFPE", *STAIR_FLOW), flows[0] / own[0].width)
        )
    return checks


def door_checks(doors: Sequence[Door]) -> list[Check]:
    """IMO 4, from the doors of its width."""
    words = f"flow of {PEOPLE} people through a door of {IMO_DOOR:g} m, whole time [1/s]"
    criterion = Criterion("IMO 4, NIST 5.2, ISO 11", words, "IMO", high=IMO_FLOW)
    return [door.trial.check(criterion, door.flows) for door in doors if door.width == IMO_DOOR]


def door_row(door: Door) -> dict[str, Any]:
    """Return the row of a door on the page."""
    free, at_exit = (flows[~np.isnan(flows)] for flows in (door.flows, door.at_exit))
    low, high = mean_interval(free) or (None, None)
    beside = float(at_exit.mean()) if len(at_exit) else None
    return {
        "width [m]": door.width,
        "model": door.trial.name,
        "runs": len(door.flows),
        "blocked": len(door.flows) - len(free),
        "share blocked": 1.0 - len(free) / len(door.flows),
        "flow [1/s]": float(free.mean()) if len(free) else None,
        "from": low,
        "to": high,
        "flow per metre [1/s/m]": float(free.mean()) / door.width if len(free) else None,
        "exit at the door [1/s]": beside,
        AT_EXIT: beside / float(free.mean()) if beside is not None and len(free) else None,
        "laboratory [1/s]": "{:g} to {:g}".format(*LABORATORY[door.width]) if door.width in LABORATORY else None,
    }
