"""Standard tests of crowds: densities and flows in corridors, at doors and on stairs, and counterflows."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from shapely import box

from evac.analysis.lines import steady_flow
from evac.base.arrays import FloatArray
from evac.building.plan.plan import Plan
from evac.standard import plans
from evac.standard.trial import SELDOM, Check, Outcome, Trial, check, standard_test

#: Densities of the fundamental diagram [1/m2]; bodies of the greatest radius do not fit at RiMEA's 5 and 6.
DENSITIES = (0.5, 1.0, 2.0, 3.0)

#: Accepted deviation from Weidmann's curve: one standard deviation of the free speed, 0.26 of 1.34 m/s.
WEIDMANN_BAND = 0.26 / 1.34

#: The corridor: filled from x1 to x2, seen in [x1, x2] from t1 to t2, free at its end; nothing from its ends arrives.
FILLED = (2.0, 82.0)  # m
SEEN = (58.0, 62.0)  # m
SEEN_FROM, SEEN_UNTIL = 10.0, 40.0  # s

IMO_FLOW = 1.33  #: Greatest flow through the door of 1 m [1/s].

#: Greatest flow per metre up a stair: IMO's and the greatest of SFPE's values by tread [1/s/m].
STAIR_FLOW = (0.88, 1.16)

#: Why the default passes more people through a door than IMO wants.
DOOR = "laboratories measured 1.7 to 2.7 /s through 1 m; --set behaviours.walking.preset=regulation passes it"

#: Percentiles 10 and 90 of speeds in single file [m/s] by density [1/m]: experiments, as RiMEA 16 has them.
SINGLE_FILE = {
    **{0.3: (0.840, 1.473), 0.5: (0.708, 1.389), 0.7: (0.598, 1.305), 0.9: (0.448, 1.101), 1.1: (0.316, 0.840)},
    **{1.3: (0.187, 0.608), 1.5: (0.112, 0.485), 1.7: (0.071, 0.382), 1.9: (0.048, 0.314), 2.1: (0.035, 0.270)},
}

#: Speeds on stairs by density, as RiMEA 13 has them [m/s]: at these densities [1/m2], the fast and the slow.
STAIR_DENSITIES = (0.6, 0.8, 1.0, 1.2, 1.4, 1.5)
STAIR_SPEEDS = {
    "down": ((1.12, 1.00, 0.89, 0.81, 0.76, 0.73), (0.66, 0.60, 0.55, 0.50, 0.48, 0.48)),
    "up": ((1.02, 0.93, 0.86, 0.80, 0.76, 0.74), (0.48, 0.46, 0.46, 0.46, 0.46, 0.46)),
}


def weidmann(density: float) -> float:
    """Return the walking speed of Weidmann's fundamental diagram (1993) at a density [1/m2] in m/s."""
    return float(1.34 * (1.0 - np.exp(-1.913 * (1.0 / density - 1.0 / 5.4))))


def _in_filled_corridor(trial: Trial, density: float, **keys: object) -> tuple[FloatArray, FloatArray]:
    """Return mean density [1/m2] and speed [m/s] of each run far from the ends of a corridor of 2 m."""
    area = box(FILLED[0], 0, FILLED[1], 2)
    plan = plans.one_storey(box(0, 0, 100, 2), exits={"end": plans.across(100, 0, 2)}, areas={"start": area})
    group = {"area": "start", "number": round(area.area * density), "speed": {"uniform": [1.2, 1.4]}, **keys}
    measured = []
    for run in trial.runs(plan, [group], f"{density:g} per m2", simulation={"duration": SEEN_UNTIL}):
        x, speed = run.trajectory.position[..., 0], run.trajectory.velocity[..., 0]
        is_late = run.trajectory.time >= SEEN_FROM
        seen = (x >= SEEN[0]) & (x < SEEN[1]) & is_late[:, None]
        measured.append((run.densities(SEEN[0], 0, SEEN[1], 2)[is_late].mean(), speed[seen].mean()))
    densities, speeds = np.array(measured).T
    return densities, speeds


@standard_test("RiMEA-4", "fundamental diagram in a corridor", runs=2)
def fundamental_diagram(trial: Trial) -> Iterator[Check]:
    """Compare the speed in a long corridor at four densities with Weidmann's."""
    for density in DENSITIES:
        densities, speeds = _in_filled_corridor(trial, density)
        ratios = [speed / weidmann(density) for density, speed in zip(densities, speeds, strict=True)]
        words = f"speed divided by Weidmann's at the measured density, corridor filled with {density:g} /m²"
        source = "Weidmann (1993) ± one standard deviation of the free speed; RiMEA has no bound"
        yield check(words, source, ratios, 1.0 - WEIDMANN_BAND, 1.0 + WEIDMANN_BAND)


@standard_test("IMO-12", "flow falls at high density", runs=2)
def flow_falls_at_high_density(trial: Trial) -> Iterator[Check]:
    """Compare the flows in a corridor at a moderate and at a very high density."""
    moderate, high = (np.prod(_in_filled_corridor(trial, density, radius=0.2), axis=0) for density in (1.75, 4.0))
    yield check("flow at 4 people per m2 divided by that at 1.75", "IMO: smaller", high / moderate, high=1.0)


@standard_test("ISO-13", "speeds in a corridor that fills")
def speeds_in_a_filled_corridor(trial: Trial) -> Iterator[Check]:
    """Time people over the middle 20 m of a corridor of 60 m that is filled more and more densely."""
    numbers, speeds = (60, 120, 240, 360, 480), []
    plan = plans.one_storey(box(0, 0, 60, 2), exits={"end": plans.across(60, 0, 2)}, areas={"start": box(0, 0, 60, 2)})
    for number in numbers:
        group = {"area": "start", "number": number, "speed": 1.0, "radius": 0.2}
        own = []
        for run in trial.runs(plan, [group], f"{number} people"):
            own.append(np.nanmean(20.0 / (run.passing_times(0, 40.0) - run.passing_times(0, 20.0))))
        speeds.append(own)
    means = np.array(speeds)
    yield check(
        "greatest speed divided by the free speed", "ISO 20414: at most the free one", means.max(axis=0), high=1.05
    )
    words = f"speed with more people divided by that with fewer, greatest for {', '.join(map(str, numbers))}"
    yield check(words, "ISO 20414: falls", (means[1:] / means[:-1]).max(axis=0), high=1.0)


@standard_test("RiMEA-16", "fundamental diagram in single file", runs=2)
def single_file(trial: Trial) -> Iterator[Check]:
    """Compare speeds in single file with experiments, at every second and ten densities.

    People walk in a straight corridor of 0.8 m, seen before its ends are felt, instead of round a closed loop.
    """
    length, seen, until = 60.0, (35.0, 41.0), 20.0
    plan = plans.one_storey(box(0, 0, length + 30, 0.8), exits={"end": plans.across(length + 30, 0, 0.8)})
    inside: list[list[float]] = [[] for _ in trial.seeds]
    for density, (low, high) in SINGLE_FILE.items():
        places = np.arange(0.5, length, 1.0 / density)
        speeds = {"normal": [1.34, 0.26], "minimum": 0.7, "maximum": 2.0}
        group = {"positions": [[x, 0.4] for x in places.tolist()], "z": 0.0, "radius": 0.2, "speed": speeds}
        runs = trial.runs(plan, [group], f"{density:g} per m", simulation={"duration": until})
        for own, run in zip(inside, runs, strict=True):
            x, speed = (place[50::10, :, 0] for place in (run.trajectory.position, run.trajectory.velocity))  # from 5 s
            near = (x >= seen[0]) & (x < seen[1])
            means = [speed[k, row].mean() for k, row in enumerate(near) if row.any()]
            own += [low <= mean <= high for mean in means]
    shares = [float(np.mean(own)) for own in inside]
    yield check("share of moments between the percentiles 10 and 90 of experiments", "RiMEA", shares, low=0.75)


@standard_test("IMO-4 NIST-5.2 ISO-11", "greatest flow through a door of 1 m", runs=3, by_design=DOOR)
def door_of_1_m(trial: Trial) -> Iterator[Check]:
    """Let a hundred people out of a room of 8 x 5 m by a door of 1 m, with ground behind it."""
    parts = [box(0, 0, 8, 5), box(8, 2, 8.2, 3), box(8.2, 0, 10.7, 5)]
    plan = plans.one_storey(*parts, exits={"end": plans.across(10.7, 0, 5)}, areas={"start": box(0, 0, 8, 5)})
    flows = []
    for run in trial.runs(plan, [plans.crowd(100)]):
        times = run.passing_times(0, 8.0)
        flows.append(99.0 / np.ptp(times) if not run.is_blocked else np.nan)
    yield check("flow through a door of 1 m, whole time [1/s]", "IMO", flows, high=IMO_FLOW)


@standard_test("RiMEA-9 IMO-9", "1000 people by four doors and by two")
def four_and_two_doors(trial: Trial) -> Iterator[Check]:
    """Let a thousand people out of a hall by four doors of 1 m, and by two."""
    below = {"a": [(4, 0), (5, 0)], "b": [(25, 0), (26, 0)]}
    above = {"c": [(4, 20), (5, 20)], "d": [(25, 20), (26, 20)]}
    times = []
    for label, exits in (("four doors", below | above), ("two doors", below)):
        plan = plans.one_storey(box(0, 0, 30, 20), exits=exits, areas={"start": box(2, 2, 28, 18)})
        times.append([run.last_out() for run in trial.runs(plan, [plans.crowd(1000)], label, output=SELDOM)])
    ratios = np.array(times[1]) / np.array(times[0])
    yield check(
        "evacuation time with two doors divided by that with four",
        "IMO: about 2; band of jpscore's test",
        ratios,
        1.6,
        2.4,
    )


def _cleared(run: Outcome) -> float:
    """Return when the last person left the first room, x < 10 m [s]; NaN if people are left."""
    return float("nan") if run.is_blocked else float(run.passing_times(0, 10.0).max())


@standard_test("RiMEA-12", "bottlenecks: goal, length, two in a row, width", runs=3)
def bottlenecks(trial: Trial) -> Iterator[Check]:
    """Clear a room through bottlenecks: the goal farther away, longer, two in a row, wider."""

    def runs(label: str, widths: Sequence[float] = (1.0,), length: float = 0.2, behind: float = 10.0) -> list[Outcome]:
        return trial.runs(plans.rooms_and_bottlenecks(widths, length, behind), [plans.crowd(150)], label)

    goals = {depth: runs(f"goal {depth:g} m", behind=depth) for depth in (0.0, 1.0, 5.0, 10.0)}
    by_goal = np.array([[_cleared(run) for run in own] for own in goals.values()])
    words = "a: time to clear, goal 0, 1, 5, 10 m behind the bottleneck: greatest decrease to the next [-]"
    decrease = 1.0 - (by_goal[1:] / by_goal[:-1]).min(axis=0)
    yield check(words, "RiMEA: no decrease, within 5 %", decrease, high=0.05)
    long = [_cleared(run) for run in runs("5 m long", length=5.0)]
    words = "b: time to clear with a bottleneck of 5 m length divided by that with 0.2 m"
    yield check(words, "RiMEA", np.array(long) / by_goal[-1], low=1.0)
    peaks = []
    for run in runs("two in a row", widths=(1.0, 1.0)):
        before = [run.densities(x - 3, 3.5, x, 6.5).max() for x in (10.0, 20.2)]
        peaks.append(before[0] / before[1] if not run.is_blocked else np.nan)
    yield check(
        "c: greatest density before the first of two bottlenecks divided by that before the second",
        "RiMEA",
        peaks,
        low=1.0,
    )
    flows = np.array(
        [
            [np.nan if run.is_blocked else steady_flow(np.sort(run.passing_times(0, 10.0))) for run in own]
            for own in (runs("0.8 m wide", widths=(0.8,)), goals[10.0], runs("1.2 m wide", widths=(1.2,)))
        ]
    )
    words = "d: flow at 1.0 divided by that at 0.8 m width, or at 1.2 by 1.0 m, the smaller"
    yield check(words, "RiMEA", (flows[1:] / flows[:-1]).min(axis=0), low=1.0)


@standard_test("IMO-11 NIST-5.1 ISO-10", "congestion before a corridor and a stair", runs=2)
def congestion(trial: Trial) -> Iterator[Check]:
    """Lead 150 people through a corridor up a stair that cannot take what the corridor brings."""
    speeds = {"speed": {"uniform": [1.26, 1.34]}, "speed_up": {"uniform": [0.635, 0.715]}}
    gains, door, foot = [], [], []
    for run in trial.runs(plans.room_corridor_stair(), [plans.crowd(150) | speeds]):
        entered, climbed = (np.sort(run.passing_times(0, x)) for x in (5.0, 17.0))
        gains.append(np.nan if run.is_blocked else steady_flow(entered) / steady_flow(climbed))
        inside = run.densities(10.0, 3.0, 12.0, 5.0).max()
        door.append(run.densities(4.0, 3.0, 5.0, 5.0).max() / inside)
        foot.append(run.densities(16.0, 3.0, 17.0, 5.0).max() / inside)
    words = "flow into the corridor divided by the flow onto the stair (jam at its foot)"
    yield check(words, "RiMEA, IMO, ISO 20414", gains, low=1.0)
    words = "greatest density {} divided by that in the corridor"
    yield check(words.format("at the exit of the room"), "IMO, NIST TN 1822, ISO 20414", door, low=1.0)
    yield check(words.format("at the foot of the stair"), "IMO, ISO 20414", foot, low=1.0)


@standard_test("RiMEA-13", "fundamental diagram on a stair", runs=3)
def speeds_on_a_stair(trial: Trial) -> Iterator[Check]:
    """Compare speeds on a stair of 5 x 2 m in plan, 3 m high, with those of experiments at the same density.

    Those of cases without stair speeds would be the same up and down, so that people have the stair speeds of their
    class, too.
    """
    people = [plans.crowd(100, preset="imo_male_30_to_50")]
    run, width, means = 5.0, 2.0, {}  # mean speeds by the number of people on the stair, one row per run
    for way in ("up", "down"):
        fast, slow = (np.array(speeds) for speeds in STAIR_SPEEDS[way])
        shares, rows = [], []
        for outcome in trial.runs(plans.halls_and_stair(way, width, run, 3.0), people, way):
            x, speed = outcome.trajectory.position[::10, :, 0], outcome.trajectory.speed[::10]
            on_it = (x >= 0.0) & (x < run)
            number = on_it.sum(axis=1)
            density = number / (run * width)
            asked = (density >= STAIR_DENSITIES[0]) & (density <= STAIR_DENSITIES[-1])
            mean = np.array([speed[k, on_it[k]].mean() for k in np.flatnonzero(asked)])
            band = [np.interp(density[asked], STAIR_DENSITIES, speeds) for speeds in (slow, fast)]
            shares.append(float(((mean >= band[0]) & (mean <= band[1])).mean()) if len(mean) else np.nan)
            rows.append([mean[number[asked] == n].mean() if n in number[asked] else np.nan for n in range(16)])
        words = (
            f"{way}: share of moments at {STAIR_DENSITIES[0]:g} to {STAIR_DENSITIES[-1]:g} /m² with a speed in the band"
        )
        yield check(words, "RiMEA: band of experiments; here most moments", shares, low=0.5)
        means[way] = np.array(rows)
    ratios = [np.nan if np.isnan(row).all() else np.nanmean(row) for row in means["down"] / means["up"]]
    yield check("speed down divided by speed up, mean at equal densities", "RiMEA: faster down", ratios, low=1.0)


@standard_test("ISO-12", "flow over stairs of five widths")
def wider_stairs(trial: Trial) -> Iterator[Check]:
    """Lead a hundred people over flights of 4.24 m and five widths, down and up."""
    widths = (1.0, 1.2, 1.4, 1.6, 1.8)
    for way in ("down", "up"):
        flows = []
        for width in widths:
            runs = trial.runs(plans.halls_and_stair(way, width, 3.0, 3.0), [plans.crowd(100)], f"{way} {width:g} m")
            flows.append([np.nan if run.is_blocked else steady_flow(_onto_the_flight(run)) for run in runs])
        by_width = np.array(flows)
        words = f"flow {way} a stair of {widths[-1]:g} m divided by that of {widths[0]:g} m"
        yield check(words, "ISO 20414: increases", by_width[-1] / by_width[0], low=1.0)
        slopes = [float(np.polyfit(widths, own, 1)[0]) for own in by_width.T]
        yield check(f"increase of the flow {way} by width [1/s/m]", "ISO 20414: increases", slopes, low=0.0)
        yield check(f"flow {way} a stair of 1 m [1/s]", "IMO, SFPE", by_width[0], *STAIR_FLOW)


def _onto_the_flight(run: Outcome) -> FloatArray:
    flight = next(level.index for level in run.results.building.levels if level.kind == "flight")
    moves = run.results.moves
    is_on = moves.target == flight
    _, first = np.unique(moves.row[is_on], return_index=True)  # moves are in order of time
    return np.sort(moves.time[is_on][first])


@standard_test("IMO-8 NIST-2.8 ISO-6", "people who come towards each other", runs=3)
def counterflow(trial: Trial) -> Iterator[Check]:
    """Send a hundred people through a corridor against 0, 10, 50 and 100 others."""
    times = []
    for number in plans.COUNTERS:
        plan, groups = plans.rooms_and_corridor(number)
        people = [{**group, "speed": plans.CROWD_SPEED} for group in groups]
        times.append([run.last_out(0) for run in trial.runs(plan, people, f"against {number}")])
    last = np.array(times)
    for k, (fewer, more) in enumerate(pairwise(plans.COUNTERS)):
        words = f"last arrival of 100 people against {more} divided by that against {fewer}"
        yield check(words, "IMO, NIST TN 1822, ISO 20414", last[k + 1] / last[k], low=1.0)


@standard_test("RiMEA-15", "a crowd round a corner")
def corner_of_a_crowd(trial: Trial) -> Iterator[Check]:
    """Lead 500 people 44 m, 75.4 m, and round a corner whose ways lie between these."""
    group = plans.crowd(500) | {"speed": 1.34, "strategy": "quickest"}
    start = {"start": box(0, 0, 6, 20)}
    straight = {
        f"{length:g} m": plans.one_storey(
            box(0, 0, length, 20), exits={"end": plans.across(length, 0, 20)}, areas=start
        )
        for length in (44.0, 75.4)
    }
    bend = plans.one_storey(box(0, 0, 54, 20), box(34, 20, 54, 40), exits={"end": [(34, 40), (54, 40)]}, areas=start)
    short, long, turned = (
        np.array([run.last_out() for run in trial.runs(plan, [group], label, output=SELDOM)])
        for label, plan in (straight | {"corner": bend}).items()
    )
    yield check("evacuation time round the corner divided by that on 44 m", "RiMEA", turned / short, low=1.0)
    yield check("evacuation time round the corner divided by that on 75.4 m", "RiMEA", turned / long, high=1.0)


@standard_test("NIST-2.10 ISO-7", "a slow and wide person among others", runs=5)
def slow_and_wide(trial: Trial) -> Iterator[Check]:
    """Lead 25 people from room to room over a ramp of 1.5 m, with and without a slow and wide one among them."""
    plan = Plan()
    plan.storey("lower", box(0, 0, 5, 4), 0.0)
    plan.storey("upper", box(9, 0, 14, 4), 1.0)
    plan.stair("ramp", "lower", plans.across(5, 1.25, 2.75), "upper", plans.across(9, 1.25, 2.75))
    plan.exit("end", "upper", plans.across(14, 1.5, 2.5))
    plan.area("start", "lower", box(0, 0, 3.5, 4))
    able = {"speed": 1.25, "speed_up": 1.25, "radius": 0.2}
    times = []
    for label, person in (("slow", {"speed": 0.8, "speed_up": 0.8, "radius": 0.4}), ("control", able)):
        people = [{"area": "start", "number": 24, **able}, {"positions": [[4.3, 2.0]], "z": 0.0, **person}]
        times.append([run.last_out() for run in trial.runs(plan, people, label)])
    words = "evacuation time of 25 people with a slow and wide one divided by that without"
    yield check(words, "NIST TN 1822, ISO 20414", np.array(times[0]) / np.array(times[1]), low=1.0)
