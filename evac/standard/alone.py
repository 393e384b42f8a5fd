"""Standard tests of people who walk alone or without interaction: times, speeds, response times, walls.

A person who starts from rest with desired speed v accelerates as v (1 - exp(-t / tau)) (eq. 33 of the paper), so that
L metres take L / v + tau once exp(-t / tau) has decayed.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy import stats
from shapely import box

from evac.base.arrays import FloatArray
from evac.building.plan.plan import Plan
from evac.standard.plans import CROWD_SPEED, Row, across, crowd, one_storey, straight_stair
from evac.standard.trial import Check, Outcome, Trial, check, standard_test

ONE = {"radius": 0.2, "mass": 80.0, "tau": 0.5}  #: Radius, mass and relaxation time of people with known travel times.
MOVED = 1e-2  #: A displacement of more than this counts as a start or a push [m].

#: Mean walking speed by age [years -> m/s] and its standard deviation: the curve of RiMEA 7.
SPEED_BY_AGE = {20: 1.61, 30: 1.54, 40: 1.48, 50: 1.41, 60: 1.27, 70: 1.07}
DEVIATION = 0.31
PER_AGE = 50

#: Cars act at the beginning of ticks: a time between two of their acts has twice the length of one as error [s].
TWO_TICKS = 0.2 + 1e-6

LANE = 2.0  #: Distance of lanes in which people walk side by side without interaction [m].

#: Response times of NIST 1.1 and ISO 1, with the distribution they are compared with.
RESPONSES = {
    "uniform": ({"uniform": [10.0, 100.0]}, stats.uniform(10.0, 90.0)),
    "normal": ({"normal": [60.0, 20.0], "minimum": 0.0}, stats.truncnorm(-3.0, np.inf, 60.0, 20.0)),
    "lognormal": ({"lognormal": [4.586, 0.967]}, stats.lognorm(0.967, scale=np.exp(4.586))),
    "gamma": ({"gamma": [1.291, 103.901]}, stats.gamma(1.291, scale=103.901)),
    "Weibull": ({"weibull": [1.195, 139.285]}, stats.weibull_min(1.195, scale=139.285)),
}
ASKED = 300

ALPHA = 0.05  #: Significance of the Kolmogorov-Smirnov tests.


def _place(x: float, y: float = 1.0, z: float = 0.0, **keys: Any) -> Row:
    return {**ONE, "positions": [[x, y]], "z": z, **keys}


@standard_test("RiMEA-1", "40 m in a corridor at 1.33 m/s", speed=1.33, low=26.0, high=34.0)
@standard_test("IMO-1", "40 m in a corridor at 1 m/s", speed=1.0, low=39.0, high=41.0)
def corridor(trial: Trial, speed: float, low: float, high: float) -> Iterator[Check]:
    """Time 40 m in a corridor of 2 m, from rest."""
    plan = one_storey(box(-2, 0, 40, 2), exits={"end": across(40, 0, 2)})
    times = [run.last_out() for run in trial.runs(plan, [_place(0.0, speed=speed)])]
    by_hand = 40.0 / speed + ONE["tau"]
    yield check(f"time for 40 m at {speed:g} m/s [s]", "the standard", times, low, high)
    yield check(
        "the same; expected value calculated from rest [s]", "L / v + tau ± h", times, by_hand - 0.01, by_hand + 0.01
    )


@standard_test("NIST-2.1 ISO-2", "speed in a corridor")
def speed_in_corridor(trial: Trial) -> Iterator[Check]:
    """Time 40 m in a corridor at 1 m/s, after 10 m to come up to speed."""
    plan = one_storey(box(-10, 0, 50, 2), exits={"end": across(50, 0, 2)})
    runs = trial.runs(plan, [_place(-9.0, speed=1.0)])
    times = [float(run.passing_times(0, 40.0)[0] - run.passing_times(0, 0.0)[0]) for run in runs]
    yield check("speed over 40 m [m/s]", "NIST TN 1822, ISO 20414", [40.0 / time for time in times], 0.95, 1.05)


@standard_test("RiMEA-2", "10 m up a stair", way="up", speed=0.5)
@standard_test("RiMEA-3", "10 m down a stair", way="down", speed=0.65)
@standard_test("IMO-2", "10 m up a stair at 1 m/s", way="up", speed=1.0, flat=1.0)
@standard_test("IMO-3", "10 m down a stair at 1 m/s", way="down", speed=1.0, flat=1.0)
@standard_test("ISO-3", "10 m of stair at half the speed", way="up", speed=0.5, flat=1.0)
def stair(trial: Trial, way: str, speed: float, length: float = 10.0, flat: float = 1.33) -> Iterator[Check]:
    """Time a stair along its slope, which rises 3 in 5, at a speed of its own."""
    run, rise, up = 0.8 * length, 0.6 * length, way == "up"
    tau, slow = 0.2, 0.8 * speed  # the speed in plan
    start = _place(-1.5, z=0.0) if up else _place(run + 1.5, z=rise)
    person = {**start, "speed": flat, f"speed_{way}": speed, "exits": [way], "tau": tau}
    times = []
    for outcome in trial.runs(straight_stair(run, rise), [person], way):
        enter, leave = outcome.results.crossings[2]
        times.append(float(leave - enter))
    asked, by_hand = length / speed, length / speed - tau * (flat - slow) / slow
    words = f"time for {length:g} m {way} a stair at {speed:g} m/s [s]"
    yield check(words, "the standard, ± 5 %", times, 0.95 * asked, 1.05 * asked)
    words = f"the same; expected value calculated for an entry at {flat:g} m/s [s]"
    yield check(words, "eq. 33, ± 1 %", times, 0.99 * by_hand, 1.01 * by_hand)


@standard_test("NIST-2.2", "100 m on stairs")
def long_stair(trial: Trial) -> Iterator[Check]:
    """Time 100 m up and down at 1 m/s."""
    for way in ("up", "down"):
        yield from stair(trial, way, 1.0, 100.0, 1.0)


@standard_test("ISO-21", "escalators: who stands, who walks, and their direction")
def escalator(trial: Trial, speed: float = 0.5, own: float = 0.6, width: float = 1.0) -> Iterator[Check]:
    """Time people on an escalator of 12 m at 30 degrees, from 2 m behind its beginning; send others beside it down."""
    run, rise = 12.0 * math.cos(math.radians(30.0)), 6.0
    plan = Plan()
    plan.storey("lower", box(-5, 0, 0, 4), 0.0)
    plan.storey("upper", box(run, 0, run + 5, 4), rise)
    for name, y in (("up", 0.5), ("down", 2.5)):
        plan.stair(name, "lower", across(0, y, y + width), "upper", across(run, y, y + width))
    plan.exit("bottom", "lower", across(-5, 0, 4))
    plan.exit("top", "upper", across(run + 5, 0, 4))
    moving = {name: {"speed": speed, "towards": name} for name in ("up", "down")}
    building = {"plan": plan, "moving": moving}
    rider = _place(-1.5, 1.0, speed_up=own, exits=["top"])
    for share, title, fast in ((0.0, "stands", speed), (1.0, "walks", speed + own)):
        riding = {"riding": {"walking": share}}
        runs = trial.runs(plan, [rider], title, building=building, behaviours=riding)
        times = [float(one.passing_times(0, run)[0] - one.passing_times(0, 2.0)[0]) for one in runs]
        by_hand = (run - 2.0) / math.cos(math.radians(30.0)) / fast
        words = f"time along the escalator of one who {title} [s]"
        yield check(words, "L / v or L / (v + own speed), ± 1 %", times, 0.99 * by_hand, 1.01 * by_hand)
    both = [
        {**ONE, "positions": [[x, 1.0 + 0.5 * k] for k in range(4)], "z": z, "exits": [way]}
        for x, z, way in ((-2.0, 0.0, "top"), (run + 2.0, rise, "bottom"))
    ]
    wrong = []
    for one in trial.runs(plan, both, "both", building=building):
        steep = {level.stair: level.index for level in one.results.building.levels if level.stair}
        levels = one.trajectory.level
        wrong.append(float((levels[:, :4] == steep["down"]).sum() + (levels[:, 4:] == steep["up"]).sum()))
    yield check("states of people who go the wrong way", "they must not", wrong, 0.0, 0.0)


@standard_test("NIST-2.7 ISO-20", "a lift: called, ridden and left")
def lift(
    trial: Trial, rise: float = 3.5, speed: float = 1.0, doors: tuple[float, float] = (2.0, 3.0)
) -> Iterator[Check]:
    """Time a person above, whom a car fetches from below; flights and doors by hand, walking at 1 m/s from rest."""
    opening, closing = doors
    operation = {"speed": speed, "acceleration": 0.8, "jerk": 1.0, "start_delay": 0.5}
    operation |= {"opening": opening, "closing": closing, "dwell": 5.0}
    plan = Plan()
    for name, z in (("lower", 0.0), ("upper", rise)):
        plan.storey(name, box(0, 0, 10, 4), z)
    plan.lift("lift", ["lower", "upper"], box(10.2, 1.2, 11.8, 2.8), across(10.2, 1.5, 2.5), operation=operation)
    plan.exit("door", "lower", across(0, 1, 3))
    flight = 0.5 + rise / speed + speed / 0.8 + 0.8 / 1.0  # with the delay of the start; the rated speed is reached
    runs = list(trial.runs(plan, [_place(2.0, 2.0, rise, speed=1.0, lifts="preferred")]))
    times = {row: [float(one.results.changes[row].time) for one in runs] for row in range(8)}
    for first, last, by_hand, words in (
        (0, 2, flight + opening, "from the call to open doors above"),
        (3, 6, closing + flight + opening, "from doors that begin to close above to open doors below"),
    ):
        found = [there - here for here, there in zip(times[first], times[last], strict=True)]
        yield check(f"time {words} [s]", "by hand, ± 2 ticks", found, by_hand - TWO_TICKS, by_hand + TWO_TICKS)
    out = [one.last_out() - opened for one, opened in zip(runs, times[6], strict=True)]
    by_hand = 11.5 + ONE["tau"]  # from the back of the car
    yield check("time from open doors below to the exit [s]", "by hand, ± 5 %", out, 0.95 * by_hand, 1.05 * by_hand)
    people = [float(one.results.lifts[0]["people"]) for one in runs]
    yield check("people carried", "the standard", people, 1.0, 1.0)


@standard_test("RiMEA-5 IMO-5", "response times, and nobody moves before", runs=5)
def response(trial: Trial) -> Iterator[Check]:
    """Start ten people in a room after response times of 10 to 100 s; in places out of the way, and at random."""
    plan = one_storey(box(0, 0, 5, 8), exits={"door": [(2, 8), (3, 8)]}, areas={"room": box(0, 0, 5, 8)})
    late = {"response_time": {"time": {"uniform": [10.0, 100.0]}}}
    apart = {**ONE, "positions": [[0.25 + 0.5 * k, 0.5] for k in range(10)], "z": 0.0, "speed": 1.33}
    favourable = trial.runs(plan, [apart], "far wall", behaviours=late)
    anywhere = trial.runs(plan, [{**ONE, "area": "room", "number": 10, "speed": 1.33}], "random", behaviours=late)
    words = "greatest time from response to first motion, all at the far wall [s]"
    yield check(words, "RiMEA: two frames of 1/8 s", map(_lag, favourable), high=0.25)
    pushed, source = "greatest distance anybody is pushed before the own response, ", "RiMEA: nobody moves before"
    yield check(f"{pushed}all at the far wall [m]", source, map(_way_before_response, favourable), high=MOVED)
    yield check(f"{pushed}random places [m]", source, map(_way_before_response, anywhere), high=MOVED)


def _ways(outcome: Outcome) -> FloatArray:
    """Return how far everybody is from the start in each frame, (frames, people) [m]; NaN once out."""
    away = outcome.trajectory.position - outcome.trajectory.position[0]
    way: FloatArray = np.hypot(away[..., 0], away[..., 1])
    return way


def _lag(outcome: Outcome) -> float:
    time, answer = outcome.trajectory.time, outcome.response_time
    is_off = (_ways(outcome) > MOVED) & (time[:, None] >= answer)
    return float((time[is_off.argmax(axis=0)] - answer).max())


def _way_before_response(outcome: Outcome) -> float:
    waits = outcome.trajectory.time[:, None] < outcome.response_time
    return float(np.where(waits, np.nan_to_num(_ways(outcome)), 0.0).max())


@standard_test("RiMEA-6 IMO-6 NIST-2.3 ISO-4", "twenty people round a corner", runs=3)
def round_a_corner(trial: Trial) -> Iterator[Check]:
    """Lead twenty people round a corner: a leg along x to 12 m, 2 m wide, and one along y from x = 10 to 12 m."""
    exits, areas = {"end": [(10, 12), (12, 12)]}, {"start": box(0, 0, 6, 2)}
    plan = one_storey(box(0, 0, 12, 2), box(10, 0, 12, 12), exits=exits, areas=areas)
    kept, out = [], []
    for outcome in trial.runs(plan, [crowd(20)]):
        x, y = np.moveaxis(outcome.trajectory.position, 2, 0)
        beyond = ((x < 10) & (y > 2)) | (x < 0) | (x > 12) | (y < 0) | (y > 12)
        kept.append(20 - int(beyond.any(axis=0).sum()))
        out.append(outcome.results.evacuated)
    yield check("people who never crossed a wall, of 20", "the standard", kept, low=20, high=20)
    yield check("people who came round the corner, of 20", "the standard", out, low=20, high=20)


def _walked(trial: Trial, groups: Sequence[Row], each: int) -> list[FloatArray]:
    """Return the speeds at which `each` people of groups walk 11 m side by side, a lane each, one array a run [m/s]."""
    width = LANE * each * len(groups)
    lanes = LANE * (np.arange(each * len(groups)) + 0.5).reshape(len(groups), each)
    people = [
        {**ONE, **group, "positions": [[1.0, y] for y in lane.tolist()], "z": 0.0}
        for group, lane in zip(groups, lanes, strict=True)
    ]
    plan = one_storey(box(0, 0, 12, width), exits={"end": across(12, 0, width)})
    return [11.0 / (outcome.exit_time - ONE["tau"]) for outcome in trial.runs(plan, people)]


@standard_test("RiMEA-7", "walking speeds by age")
def speeds_by_age(trial: Trial) -> Iterator[Check]:
    """Compare the speeds that people of six ages walk at with the curve by age."""
    ages = [
        {"name": f"age {age}", "speed": {"normal": [mean, DEVIATION], "minimum": 0.1}}
        for age, mean in SPEED_BY_AGE.items()
    ]
    means = np.repeat(list(SPEED_BY_AGE.values()), PER_AGE)
    distances = [_distance((speeds - means) / DEVIATION, stats.norm()) for speeds in _walked(trial, ages, PER_AGE)]
    words = f"speeds walked at {len(ages)} ages, {len(means)} people: Kolmogorov-Smirnov distance"
    yield check(words, f"RiMEA, curve by age; level {ALPHA}", distances, high=_critical(len(means)))


@standard_test("IMO-7", "walking speeds of a class of people")
def speeds_of_men(trial: Trial) -> Iterator[Check]:
    """Count the men who walk at a speed of their class."""
    low, high = CROWD_SPEED["uniform"]
    number = 50
    runs = _walked(trial, [{"speed": CROWD_SPEED}], number)
    inside = [int(((speeds > low - 1e-3) & (speeds < high + 1e-3)).sum()) for speeds in runs]
    yield check(f"men who walk at {low} to {high} m/s, of {number}", "IMO", inside, low=number, high=number)


@standard_test("NIST-2.4 ISO-5", "assigned walking speeds")
def speeds_of_a_normal_distribution(trial: Trial) -> Iterator[Check]:
    """Compare the speeds that a hundred people walk at with the normal distribution that was given."""
    mean, deviation = 1.2, 0.2
    runs = _walked(trial, [{"speed": {"normal": [mean, deviation], "minimum": 0.1}}], 100)
    source = "NIST TN 1822, ISO 20414: ± 0.05"
    for word, asked, values in (
        ("mean", mean, [speeds.mean() for speeds in runs]),
        ("standard deviation", deviation, [speeds.std(ddof=1) for speeds in runs]),
    ):
        yield check(f"{word} of the speeds walked [m/s]", source, values, asked - 0.05, asked + 0.05)


@standard_test("NIST-1.1 ISO-1", "distributions of response times")
def response_distributions(trial: Trial) -> Iterator[Check]:
    """Compare response times with five distributions."""
    plan = one_storey(box(0, 0, 40, 25), exits={"door": across(40, 12, 13)}, areas={"hall": box(0, 0, 39, 25)})
    group = {"area": "hall", "number": ASKED}
    for name, (settings, distribution) in RESPONSES.items():
        sections: dict[str, dict[str, Any]] = {
            "behaviours": {"response_time": {"time": settings}},
            "simulation": {"duration": 1.0},
        }
        distances = [_distance(run.response_time, distribution) for run in trial.runs(plan, [group], name, **sections)]
        words = f"response times, {name}, {ASKED} people: Kolmogorov-Smirnov distance"
        yield check(words, f"NIST TN 1822, ISO 20414; level {ALPHA}", distances, high=_critical(ASKED))


def _distance(values: FloatArray, distribution: Any) -> float:
    return float(stats.kstest(values, distribution.cdf).statistic)


def _critical(number: int) -> float:
    return float(stats.kstwo.ppf(1.0 - ALPHA, number))


#: Extinction coefficients of NIST 2.5 and ISO 18 [1/m], and the share of the speed that the default law leaves in each:
#: max(0.1, 1 - 0.057 K / 0.706), by hand.
SMOKE = {0.5: 0.9596, 1.0: 0.9193, 3.0: 0.7578, 7.5: 0.3945, 10.0: 0.1926}

#: Desired speed [m/s] and relaxation time [s] of the person in the corridor, and the tick [s].
SPEED, TAU, TICK = 1.25, 0.2, 0.1

#: Mixtures of ISO 19 and NIST 2.6: CO2 [%], CO [ppm], O2 [%], and the time to the dose 1 with the form of FDS [s], as
#: the guide of FDS+Evac (figure 8), computed with FDS, and a port of NIST 2.6 have them. Oxygen at 12 % is 0.134774 of
#: the mass in the deck of FDS.
GASES = (
    (2.0, 1000.0, 15.0, 981.7),
    (0.0, 0.0, 12.000246, 1666.5),
    (0.0, 1000.0, 21.0, 1692.8),
    (3.43, 1000.0, 21.0, 846.5),
    (2.0, 5000.0, 18.0, 208.7),
)

GIVEN = 0.1  #: Deviation of these times that is tolerated [s].


@standard_test("NIST-2.5 ISO-18", "walking speed in smoke")
def corridor_in_smoke(trial: Trial) -> Iterator[Check]:
    """Time 100 m in a corridor of 2 m, in smoke, against the time in clear air."""
    plan = one_storey(box(0, 0, 100, 2), exits={"end": across(100, 0, 2)})
    person = {"positions": [[0.5, 1.0]], "z": 0.0, "speed": SPEED, "tau": TAU, "radius": 0.2}

    def walked(label: str, **air: Any) -> list[Outcome]:
        more = {"simulation": {"duration": 3000.0}, "smoke": {"routes": False}, **air}
        return trial.runs(plan, [person], label, **more)

    clear = walked("clear")
    start = clear[0].last_out()
    for extinction, share in SMOKE.items():
        smoke = {"source": "prescribed", "values": {"extinction": extinction}}
        runs = walked(f"K {extinction:g}", conditions=[smoke])
        pairs = list(zip(runs, clear, strict=True))
        band = (2.0 * TAU * (1.0 - share) + 2.0 * TICK) / start
        words = f"time for 100 m at K = {extinction:g} 1/m divided by that in clear air, times the share of the speed"
        ratios = [run.last_out() / before.last_out() * share for run, before in pairs]
        yield check(words, "ISO 20414, by hand", ratios, 1.0 - band, 1.0 + band)
        words = f"the same from x = 20 to 80 m at K = {extinction:g} 1/m"
        ratios = [_between(run) / _between(before) * share for run, before in pairs]
        yield check(words, "by hand, ± 0.1 %", ratios, 0.999, 1.001)


def _between(run: Outcome) -> float:
    return float(run.passing_times(0, 80.0)[0] - run.passing_times(0, 20.0)[0])


@standard_test("NIST-2.6 ISO-19", "incapacitation by gases")
def stopped_by_gases(trial: Trial) -> Iterator[Check]:
    """Let a person stand in mixtures of gases until the dose stops it."""
    plan = one_storey(box(0, 0, 5, 5), exits={"end": across(5, 2, 3)})
    person = {"positions": [[2.5, 2.5]], "z": 0.0, "radius": 0.2}
    stands = {"response_time": {"time": 3000.0}}
    for number, (co2, co, o2, time) in enumerate(GASES, start=1):
        air = {"source": "prescribed", "values": {"co2": co2, "co": co, "o2": o2}}
        tables = {"conditions": [air], "smoke": {"law": "none"}, "dose": {"heat": "none"}, "behaviours": stands}
        tables |= {"simulation": {"duration": 2000.0}, "output": {"every": 100.0}}
        runs = trial.runs(plan, [person], f"gases {number}", **tables)
        times = [float(run.results.exposure["stopped_at"][0]) for run in runs]
        words = f"time to the dose 1 in {co2:g} % CO2, {co:g} ppm CO, {o2:.8g} % O2 [s]"
        yield check(words, "FDS+Evac guide; NIST TN 1822", times, time - GIVEN, time + GIVEN)
