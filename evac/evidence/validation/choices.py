"""Tests of route and exit choice, and of relative evacuation times: exits, routes, rooms in a row."""

import numpy as np

from evac.case.loading import load_case
from evac.evidence.validation.buildings import (
    CROWD_SPEED,
    across,
    rectangle,
    rooms_along_a_corridor,
    two_rooms,
    two_ways,
)
from evac.evidence.validation.trial import Check, Criterion, Outcome, Trial

#: How long a crowd of a thousand may take [s].
LONG = 900.0


def faster_people(trial: Trial) -> list[Check]:
    """RiMEA 8: the faster people are, the sooner a building of three storeys is empty; here the shipped school."""
    case = load_case("primary_school")
    names = [group.name for group in case.people]
    times = np.array(
        [
            [
                outcome.last_out
                for outcome in trial.run_case(case.change({f"people.{name}.speed": speed for name in names}))
            ]
            for speed in (0.75, 1.0, 1.25)
        ]
    )
    criterion = Criterion(
        "RiMEA 8",
        "school, last out at 0.75 over 1.0, or 1.0 over 1.25 m/s, the lesser",
        "RiMEA, annex 1 (direction); the shipped school for its building",
        low=1.0,
    )
    return [trial.check(criterion, (times[:-1] / times[1:]).min(axis=0))]


def four_and_two_doors(trial: Trial) -> list[Check]:
    """RiMEA 9 and IMO 9: a thousand people, four doors and two."""
    below = [("a", [[4, 0], [5, 0]], 0.0), ("b", [[25, 0], [26, 0]], 0.0)]
    above = [("c", [[4, 20], [5, 20]], 0.0), ("d", [[25, 20], [26, 20]], 0.0)]
    group = {"area": "room", "number": 1000, "speed": CROWD_SPEED}
    four, two = (
        [
            outcome.last_out
            for outcome in trial.runs(
                [rectangle(0, 0, 30, 20)],
                exits,
                [group],
                [("room", (2, 2, 28, 18), 0.0)],
                **{"simulation.duration": LONG},
            )
        ]
        for exits in (below + above, below)
    )
    criterion = Criterion(
        "RiMEA 9, IMO 9",
        "1000 people, last out by two doors over by four",
        "IMO: about 2; band of jpscore's test",
        low=1.6,
        high=2.4,
    )
    return [trial.check(criterion, np.array(two) / np.array(four))]


def assigned_exits(trial: Trial) -> list[Check]:
    """RiMEA 10 and IMO 10: twelve rooms, 23 people, each with an exit of its own."""
    faces, exits, rooms = rooms_along_a_corridor()
    areas, people = [], []
    for number, (x1, y1, x2, y2) in enumerate(rooms):
        areas.append((f"room {number}", (x1, y1, x2, y2), 0.0))
        people.append(
            {
                "area": f"room {number}",
                "number": 1 if number == 8 else 2,
                "speed": CROWD_SPEED,
                "exits": ["main" if number % 6 < 4 else "secondary"],
            }
        )
    by_main, as_told = [], []
    for outcome in trial.runs(faces, exits, people, areas):
        used = outcome.results.people["exit"].fillna("").tolist()
        routes = outcome.results.people["route"]
        by_main.append(used.count("main"))
        as_told.append(sum(name != "" and route.endswith(name) for name, route in zip(used, routes, strict=True)))
    source = "RiMEA, annex 1; IMO"
    return [
        trial.check(
            Criterion("RiMEA 10, IMO 10", "people who left by the exit assigned, of 23", source, low=23, high=23),
            as_told,
        ),
        trial.check(
            Criterion("RiMEA 10, IMO 10", "people who left by the main exit, of 23", source, low=15, high=15), by_main
        ),
    ]


def nearer_exit(trial: Trial) -> list[Check]:
    """RiMEA 11: two exits in one wall; most take the nearer one, some the other, to avoid the queue."""
    exits = [("near", [[21, 0], [22, 0]], 0.0), ("far", [[27, 0], [28, 0]], 0.0)]
    group = {"area": "left half", "number": 1000, "speed": CROWD_SPEED}
    far = [
        float("nan") if outcome.is_blocked else int((outcome.results.people["exit"] == "far").sum())
        for outcome in trial.runs(
            [rectangle(0, 0, 30, 20)],
            exits,
            [group],
            [("left half", (2, 2, 15.5, 18), 0.0)],
            **{"simulation.duration": LONG, "behaviours.route_choice": {"exits": ["near", "far"], "every": 1.0}},
        )
    ]
    criterion = Criterion(
        "RiMEA 11", "people who took the farther exit, of 1000, with route_choice", "RiMEA, annex 1", low=1, high=499
    )
    return [trial.check(criterion, far)]


def rooms_in_a_row(trial: Trial) -> list[Check]:
    """RiMEA 12b: a long bottleneck between two rooms takes longer than a short one."""
    short, long = (_clearing_times(trial, length) for length in (0.2, 5.0))
    criterion = Criterion(
        "RiMEA 12b", "time to clear a room through 1 m, bottleneck 5 m over 0.2 m long", "RiMEA, annex 1", low=1.0
    )
    return [trial.check(criterion, np.array(long) / np.array(short))]


def _clearing_times(trial: Trial, length: float) -> list[float]:
    """Return when the last of 150 people left the first of two rooms, a run each [s]."""
    faces, way_out = two_rooms(1.0, length, 1.0)
    group = {"area": "start", "number": 150, "speed": CROWD_SPEED}
    runs = trial.runs(faces, [("end", way_out, 0.0)], [group], [("start", (0, 0, 5, 10), 0.0)], **{"output.every": 0.1})
    return [_clearing_time(outcome) for outcome in runs]


def _clearing_time(outcome: Outcome) -> float:
    if outcome.is_blocked:
        return float("nan")
    is_in_first = (outcome.trajectory.position[..., 0] < 10.0).any(axis=1)
    return float(outcome.trajectory.time[is_in_first][-1])


def route(trial: Trial) -> list[Check]:
    """RiMEA 14: a short way over two stairs and a long one on the floor, by strategy.

    All start where the way over the stairs is at least 3 m shorter than the other, 34 m.
    """
    checks = []
    for strategy, expected in (("shortest", 100), ("comfortable", 0)):
        group = {
            "area": "start",
            "number": 100,
            "speed": 1.0,
            "speed_up": 0.5,
            "speed_down": 0.65,
            "strategy": strategy,
        }
        below = []
        for outcome in trial.runs(
            two_ways(), [("end", [[27, 0], [29, 0]], 0.0)], [group], [("start", (0, 0, 4.7, 12), 0.0)]
        ):
            lower = [level.index for level in outcome.results.building.levels if level.z_max < -4.0]
            below.append(outcome.results.moves.occupancy(lower).people)
        words = f'people who took the short way over the stairs, of 100, strategy "{strategy}"'
        criterion = Criterion("RiMEA 14", words, "RiMEA, annex 1: configurable", low=expected, high=expected)
        checks.append(trial.check(criterion, below))
    return checks


def corner_of_a_crowd(trial: Trial) -> list[Check]:
    """RiMEA 15: 500 people on 44 m, on 75.4 m, and round a corner whose ways lie between these."""
    group = {"area": "start", "number": 500, "speed": 1.34}
    start = [("start", (0, 0, 6, 20), 0.0)]
    buildings = {
        "44 m": ([rectangle(0, 0, 44, 20)], across(44, 0, 20)),
        "corner": (
            [rectangle(0, 0, 34, 20), rectangle(34, 0, 54, 20), rectangle(34, 20, 54, 40)],
            [[34, 40], [54, 40]],
        ),
        "75.4 m": ([rectangle(0, 0, 75.4, 20)], across(75.4, 0, 20)),
    }
    short, turned, long = (
        np.array([outcome.last_out for outcome in trial.runs(faces, [("end", way_out, 0.0)], [group], start)])
        for faces, way_out in buildings.values()
    )
    source = "RiMEA, annex 1"
    return [
        trial.check(
            Criterion("RiMEA 15", "500 people, last out round the corner over on 44 m", source, low=1.0),
            turned / short,
        ),
        trial.check(
            Criterion("RiMEA 15", "500 people, last out round the corner over on 75.4 m", source, high=1.0),
            turned / long,
        ),
    ]


def group(trial: Trial) -> list[Check]:
    """NIST 2.9: four people at 1.25 m/s who follow one at 0.5 m/s arrive with it."""
    slow = {"name": "slow", "positions": [[4.5, 2.2]], "z": 0.0, "speed": 0.5}
    rest = {
        "name": "rest",
        "positions": [[1.0 + 0.8 * k, 0.8] for k in range(4)],
        "z": 0.0,
        "speed": 1.25,
        "behaviours": {"teacher_following": {"teacher": "slow"}},
    }
    spread = [
        float(np.ptp(outcome.exit_times))
        for outcome in trial.runs(
            [rectangle(0, 0, 60, 3)],
            [("end", across(60, 0, 3), 0.0)],
            [slow, rest],
            **{"behaviours.teacher_following": {}},
        )
    ]
    criterion = Criterion(
        "NIST 2.9", "spread of the arrivals of five, with teacher_following [s]", "NIST TN 1822", high=10.0
    )
    return [trial.check(criterion, spread)]
