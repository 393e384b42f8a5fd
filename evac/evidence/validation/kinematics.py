"""Tests of people who walk alone or without interaction: times, speeds, response times, walls.

A person who starts from rest with desired speed v accelerates as v (1 - exp(-t / tau)) (eq. 33 of the paper), so that
L metres take L / v + tau once exp(-t / tau) has decayed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from evac.base.arrays import FloatArray
from evac.evidence.validation.buildings import CROWD_SPEED, across, corner, rectangle, straight_stair
from evac.evidence.validation.trial import Check, Criterion, Outcome, Trial

#: Radius, mass and relaxation time of people with known travel times.
ONE = {"radius": 0.2, "mass": 80.0, "tau": 0.5}

#: A displacement of more than this counts as a start or a push [m].
MOVED = 1e-2

#: Mean walking speed by age [years -> m/s] and its standard deviation: the curve of RiMEA 7.
SPEED_BY_AGE = {20: 1.61, 30: 1.54, 40: 1.48, 50: 1.41, 60: 1.27, 70: 1.07}
DEVIATION = 0.31
PER_AGE = 50

#: Distance at which people do not interact, also with headway [m].
LANE = 1.2

#: Response times of NIST test 1.1 and ISO test 1, with the distribution they are compared with.
RESPONSES = {
    "uniform": ({"uniform": [10.0, 100.0]}, stats.uniform(10.0, 90.0)),
    "normal": ({"normal": [60.0, 20.0], "minimum": 0.0}, stats.truncnorm(-3.0, np.inf, 60.0, 20.0)),
    "lognormal": ({"lognormal": [4.586, 0.967]}, stats.lognorm(0.967, scale=np.exp(4.586))),
    "gamma": ({"gamma": [1.291, 103.901]}, stats.gamma(1.291, scale=103.901)),
    "Weibull": ({"weibull": [1.195, 139.285]}, stats.weibull_min(1.195, scale=139.285)),
}
ASKED = 300

#: Significance of the Kolmogorov-Smirnov tests.
ALPHA = 0.05


def corridor(trial: Trial) -> list[Check]:
    """RiMEA 1: 40 m at 1.33 m/s."""
    person = {**ONE, "positions": [[0.0, 1.0]], "z": 0.0, "speed": 1.33}
    runs = trial.runs([rectangle(-2, 0, 40, 2)], [("end", across(40, 0, 2), 0.0)], [person])
    times = [outcome.last_out for outcome in runs]
    by_hand = 40.0 / 1.33 + 0.5
    return [
        trial.check(
            Criterion("RiMEA 1", "time for 40 m at 1.33 m/s [s]", "RiMEA, annex 1", low=26.0, high=34.0), times
        ),
        trial.check(
            Criterion(
                "RiMEA 1", "the same, from rest by hand [s]", "L / v + tau ± h", low=by_hand - 0.01, high=by_hand + 0.01
            ),
            times,
        ),
    ]


def stairs(trial: Trial) -> list[Check]:
    """RiMEA 2 and 3: 10 m along a stair, up at 0.5 m/s and down at 0.65 m/s."""
    checks = []
    for test, way, speed in (("RiMEA 2", "up", 0.5), ("RiMEA 3", "down", 0.65)):
        up = way == "up"
        start = {"positions": [[-1.5, 1.0]], "z": 0.0} if up else {"positions": [[9.5, 1.0]], "z": 6.0}
        end = ("end", across(10, 0, 2), 6.0) if up else ("end", across(-2, 0, 2), 0.0)
        person = {**ONE, **start, "speed": 1.33, f"speed_{way}": speed, "tau": 0.2}
        times = []
        for outcome in trial.runs(straight_stair(), [end], [person]):
            enter, leave = outcome.results.crossings[2]
            times.append(float(leave - enter))
        slow = 0.8 * speed  # in plan: the stair rises 3 in 4
        by_hand = 10.0 / speed - 0.2 * (1.33 - slow) / slow
        what = f"time for 10 m {way} a stair at {speed} m/s [s]"
        asked = 10.0 / speed
        checks.append(
            trial.check(Criterion(test, what, "RiMEA, annex 1, ± 5 %", low=0.95 * asked, high=1.05 * asked), times)
        )
        hand = Criterion(
            test, "the same, entered at 1.33 m/s, by hand [s]", "eq. 33, ± 1 %", low=0.99 * by_hand, high=1.01 * by_hand
        )
        checks.append(trial.check(hand, times))
    return checks


def response(trial: Trial) -> list[Check]:
    """RiMEA 5: ten people in a room, response times of 10 to 100 s; in places out of the way, and at random."""
    settings: dict[str, Any] = {
        "behaviours.response_time": {"time": {"uniform": [10.0, 100.0]}},
        "output.every": 0.1,
    }
    faces, exits = [rectangle(0, 0, 5, 8)], [("door", [[2, 8], [3, 8]], 0.0)]
    apart = {**ONE, "positions": [[0.25 + 0.5 * k, 0.5] for k in range(10)], "z": 0.0, "speed": 1.33}
    random = {**ONE, "area": "room", "number": 10, "speed": 1.33}
    favourable = trial.runs(faces, exits, [apart], **settings)
    anywhere = trial.runs(faces, exits, [random], [("room", (0, 0, 5, 8), 0.0)], **settings)
    late = Criterion(
        "RiMEA 5",
        "greatest time from response to first motion, all at the far wall [s]",
        "RiMEA, annex 1: two frames of 1/8 s",
        high=0.25,
    )
    pushed = "greatest way anybody is pushed before the own response, "
    return [
        trial.check(late, [_lag(outcome) for outcome in favourable]),
        *(
            trial.check(Criterion("RiMEA 5", pushed + where, "RiMEA, annex 1: nobody moves before", high=MOVED), ways)
            for where, ways in (
                ("all at the far wall [m]", [_way_before_response(outcome) for outcome in favourable]),
                ("random places [m]", [_way_before_response(outcome) for outcome in anywhere]),
            )
        ),
    ]


def _ways(outcome: Outcome) -> FloatArray:
    """Return how far everybody is from the start in each frame, (frames, people) [m]; NaN once out."""
    away = outcome.trajectory.position - outcome.trajectory.position[0]
    way: FloatArray = np.hypot(away[..., 0], away[..., 1])
    return way


def _lag(outcome: Outcome) -> float:
    """Return the greatest time between a response and the first motion after it [s]."""
    time, answer = outcome.trajectory.time, outcome.numbers("response_time")
    is_off = (_ways(outcome) > MOVED) & (time[:, None] >= answer)
    return float((time[is_off.argmax(axis=0)] - answer).max())


def _way_before_response(outcome: Outcome) -> float:
    """Return the greatest displacement of a person before its response [m]."""
    waits = outcome.trajectory.time[:, None] < outcome.numbers("response_time")
    return float(np.where(waits, np.nan_to_num(_ways(outcome)), 0.0).max())


def round_a_corner(trial: Trial) -> list[Check]:
    """RiMEA 6: twenty people round a corner."""
    kept, out = [], []
    exits = [("end", [[10, 12], [12, 12]], 0.0)]
    group = {"area": "start", "number": 20, "speed": CROWD_SPEED}
    for outcome in trial.runs(corner(), exits, [group], [("start", (0, 0, 6, 2), 0.0)], **{"output.every": 0.1}):
        x, y = np.moveaxis(outcome.trajectory.position, 2, 0)
        beyond = ((x < 10) & (y > 2)) | (x < 0) | (x > 12) | (y < 0) | (y > 12)
        kept.append(20 - int(beyond.any(axis=0).sum()))
        out.append(outcome.results.evacuated)
    source = "RiMEA, annex 1"
    return [
        trial.check(Criterion("RiMEA 6", "people who never were beyond a wall, of 20", source, low=20, high=20), kept),
        trial.check(Criterion("RiMEA 6", "people who came round the corner, of 20", source, low=20, high=20), out),
    ]


def _walked(trial: Trial, groups: Sequence[Mapping[str, Any]]) -> list[FloatArray]:
    """Return the speeds at which people of `groups` walk 11 m side by side, a lane each, a run each [m/s]."""
    people, lane = [], 0
    for group in groups:
        places = [[1.0, LANE * (0.5 + lane + k)] for k in range(PER_AGE)]
        people.append({**ONE, **group, "positions": places, "z": 0.0})
        lane += PER_AGE
    width = LANE * lane
    found = trial.runs([rectangle(0, 0, 12, width)], [("end", across(12, 0, width), 0.0)], people)
    return [11.0 / (outcome.numbers("exit_time") - ONE["tau"]) for outcome in found]


def speeds_by_age(trial: Trial) -> list[Check]:
    """RiMEA 7 and IMO 7: the speeds people walk at are those of their distribution."""
    ages = [
        {"name": f"age {age}", "speed": {"normal": [mean, DEVIATION], "minimum": 0.1}}
        for age, mean in SPEED_BY_AGE.items()
    ]
    means = np.repeat(list(SPEED_BY_AGE.values()), PER_AGE)
    distances = [_distance((speeds - means) / DEVIATION, stats.norm()) for speeds in _walked(trial, ages)]
    men = _walked(trial, [{"speed": CROWD_SPEED}])
    low, high = CROWD_SPEED["uniform"]
    inside = [int(((speeds > low - 1e-3) & (speeds < high + 1e-3)).sum()) for speeds in men]
    return [
        trial.check(
            Criterion(
                "RiMEA 7",
                f"speeds walked at {len(SPEED_BY_AGE)} ages, {len(means)} people: Kolmogorov-Smirnov distance",
                f"RiMEA, annex 1, curve by age; level {ALPHA}",
                high=_critical(len(means)),
            ),
            distances,
        ),
        trial.check(
            Criterion(
                "IMO 7",
                f"men of 30 to 50 years who walk at {low} to {high} m/s, of {PER_AGE}",
                "IMO",
                low=PER_AGE,
                high=PER_AGE,
            ),
            inside,
        ),
    ]


def response_distributions(trial: Trial) -> list[Check]:
    """NIST 1.1 and ISO 1: response times drawn from five distributions, each by the same quantiles for a seed."""
    checks = []
    for name, (settings, distribution) in RESPONSES.items():
        distances = [
            _distance(outcome.numbers("response_time"), distribution)
            for outcome in trial.runs(
                [rectangle(0, 0, 40, 25)],
                [("door", across(40, 12, 13), 0.0)],
                [{"area": "hall", "number": ASKED}],
                [("hall", (0, 0, 39, 25), 0.0)],
                **{"behaviours.response_time": {"time": settings}, "simulation.duration": 1.0},
            )
        ]
        criterion = Criterion(
            "NIST 1.1, ISO 1",
            f"response times, {name}, {ASKED} people: Kolmogorov-Smirnov distance",
            f"NIST TN 1822, ISO 20414; level {ALPHA}",
            high=_critical(ASKED),
        )
        checks.append(trial.check(criterion, distances))
    return checks


def _distance(values: FloatArray, distribution: Any) -> float:
    """Return the Kolmogorov-Smirnov distance of values from a distribution."""
    return float(stats.kstest(values, distribution.cdf).statistic)


def _critical(number: int) -> float:
    """Return the distance that `number` values exceed with probability `ALPHA`."""
    return float(stats.kstwo.ppf(1.0 - ALPHA, number))
