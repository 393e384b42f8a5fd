"""Standard tests of choices: exits, routes, and people who stay together."""

from collections.abc import Iterator

import numpy as np
from shapely import box
from shapely.geometry.base import BaseGeometry

from evac.case.loading import load_case
from evac.results.results import Results
from evac.standard.plans import Row, across, cabins, crowd, detour_and_stairs, one_storey, ring_and_bridge
from evac.standard.trial import SELDOM, Check, Trial, check, standard_test


@standard_test("RiMEA-8", "faster people leave a building earlier")
def faster_people(trial: Trial) -> Iterator[Check]:
    """Empty the shipped school of three storeys at three walking speeds."""
    case, times = load_case("primary_school", plugin_files=trial.plugin_files), []
    for speed in (0.75, 1.0, 1.25):
        changed = case.change({f"people.{group.name}.speed": speed for group in case.people})
        times.append([run.last_out() for run in trial.run_case(trial.changed(changed), f"{speed:g} m per s")])
    last = np.array(times)
    words = "evacuation time at 0.75 divided by that at 1.0 m/s, or at 1.0 by 1.25 m/s, the smaller"
    yield check(words, "RiMEA; the shipped school for its building", (last[:-1] / last[1:]).min(axis=0), low=1.0)


@standard_test("RiMEA-10 IMO-10 NIST-3.1 ISO-8", "exits assigned to rooms", runs=3)
def assigned_exits(trial: Trial) -> Iterator[Check]:
    """Send 23 people from twelve rooms to the exits that are theirs."""
    plan, rooms = cabins()
    mains = [number % 6 < 4 for number in range(len(rooms))]
    people = [
        crowd(1 if number == 8 else 2, room, exits=["main" if mains[number] else "secondary"])
        for number, room in enumerate(rooms)
    ]
    by_main, as_told = [], []
    for run in trial.runs(plan, people):
        wanted = np.array([mains[group] for group in run.results.crowd.group])
        by_main.append(run.out_by("main").sum())
        as_told.append((run.out_by("main") & wanted).sum() + (run.out_by("secondary") & ~wanted).sum())
    yield check("people who left by the assigned exit, of 23", "the standard", as_told, low=23, high=23)
    yield check("people who left by the main exit, of 23", "the standard", by_main, low=15, high=15)


@standard_test("RiMEA-11", "the nearer and the emptier of two exits")
def nearer_exit(trial: Trial) -> Iterator[Check]:
    """Offer a thousand people two exits in one wall, of which one is nearer to all of them."""
    exits = {"near": [(21, 0), (22, 0)], "far": [(27, 0), (28, 0)]}
    plan = one_storey(box(0, 0, 30, 20), exits=exits, areas={"start": box(2, 2, 15.5, 18)})
    runs = trial.runs(plan, [crowd(1000, strategy="quickest")], output=SELDOM)
    far = [np.nan if run.is_blocked else run.out_by("far").sum() for run in runs]
    words = 'people who took the farther exit, of 1000, strategy "quickest"'
    yield check(words, "RiMEA: some, and fewer than the others", far, low=1, high=499)


@standard_test("RiMEA-14", "a short way over stairs or a detour")
def detour_or_stairs(trial: Trial) -> Iterator[Check]:
    """Offer a short way over two stairs, and one of 34 m on the storey, at least 3 m longer, by strategy."""
    speeds = {"speed": 1.0, "speed_up": 0.5, "speed_down": 0.65}
    for strategy, expected in (("shortest", 100), ("comfortable", 0)):
        runs = trial.runs(detour_and_stairs(), [crowd(100, strategy=strategy) | speeds], strategy)
        below = [_ever_on(run.results, "lower") for run in runs]
        words = f'people who took the stairs, of 100, strategy "{strategy}"'
        yield check(words, "RiMEA: configurable", below, low=expected, high=expected)


@standard_test("ISO-17", "the shorter way over storeys")
def shorter_over_storeys(trial: Trial) -> Iterator[Check]:
    """Offer a long way on the storey and a short one over a bridge upstairs."""
    group = crowd(10, strategy="shortest") | {"speed": 1.2}
    above = [_ever_on(run.results, "bridge") for run in trial.runs(ring_and_bridge(), [group])]
    yield check("people who took the shorter way, over the bridge, of 10", "ISO 20414", above, low=10, high=10)


def _ever_on(results: Results, storey: str) -> int:
    levels = [level.index for level in results.building.levels if level.name == storey]
    return results.moves.occupancy(levels)["people"]


@standard_test("NIST-2.9", "a group with a slow member", runs=3)
def mixed_group(trial: Trial) -> Iterator[Check]:
    """Lead four people at 1.25 m/s with one at 0.5 m/s, and ten at 0.2 m/s apart from them."""
    people = [*_together(0.5, 1.25), {"name": "others", "area": "others", "number": 10, "speed": 0.2}]
    spreads = _spreads(trial, people, box(8, 4, 12, 8))
    yield check("spread of the arrivals of five, with teacher_following [s]", "NIST TN 1822", spreads, high=10.0)


@standard_test("ISO-14", "a fast group among slow people", runs=5)
def fast_group(trial: Trial) -> Iterator[Check]:
    """Lead five people at 1.25 m/s past ten at 0.5 m/s."""
    people = [*_together(1.25, 1.25), {"name": "others", "area": "others", "number": 10, "speed": 0.5}]
    spreads = _spreads(trial, people, box(10, 0, 14, 8))
    yield check("spread of the arrivals of five, with teacher_following [s]", "ISO 20414", spreads, high=10.0)


def _together(first: float, speed: float) -> list[Row]:
    places = [[1.0 + 0.8 * k, 0.8] for k in range(4)]
    follow = {"teacher_following": {"teacher": "first"}}
    return [
        {"name": "first", "positions": [[4.5, 2.2]], "z": 0.0, "speed": first},
        {"name": "followers", "positions": places, "z": 0.0, "speed": speed, "behaviours": follow},
    ]


def _spreads(trial: Trial, people: list[Row], others: BaseGeometry) -> list[float]:
    """Return the time between the first and the last of a group of five at a door of 1 m, a run each [s]."""
    plan = one_storey(box(0, 0, 30, 8), exits={"end": across(30, 3.5, 4.5)}, areas={"others": others})
    runs = trial.runs(plan, people, behaviours={"teacher_following": {}})
    five = [[row for group in run.results.groups if group.name != "others" for row in group.rows] for run in runs]
    return [float(np.ptp(run.exit_time[rows])) for run, rows in zip(runs, five, strict=True)]


@standard_test("NIST-3.2 ISO-15", "social influence on exits", runs=3)
def follow_others(trial: Trial) -> Iterator[Check]:
    """Offer a person who is nearer to exit 1 another exit, by which nine others leave."""
    exits = {"1": [(0.5, 12), (1.5, 12)], "2": [(8.5, 12), (9.5, 12)]}
    plan = one_storey(box(0, 0, 10, 12), exits=exits, areas={"others": box(2, 4, 8, 7)})
    person = {"name": "person", "positions": [[4.8, 2.0]], "z": 0.0, "speed": 1.2}
    others = {"name": "others", "area": "others", "number": 9, "exits": ["2"], "speed": 1.0}
    knows = {"main": ["1", "2"], "influence": 0.5}
    used = {}
    for label, people in (("alone", [person]), ("others", [person, others])):
        runs = trial.runs(plan, people, label, behaviours={"familiarity": knows})
        rows = [next(group.rows for group in run.results.groups if group.name == "person") for run in runs]
        used[label] = [run.out_by("2")[own].sum() for run, own in zip(runs, rows, strict=True)]
    source = "NIST TN 1822, ISO 20414"
    yield check("people who leave by exit 2, of 1, without others", "by hand: exit 1 is nearer", used["alone"], high=0)
    yield check("people who leave by exit 2, of 1, if others do, with familiarity", source, used["others"], low=1)


@standard_test("NIST-3.3 ISO-16", "familiar exits", runs=5)
def familiar_exit(trial: Trial) -> Iterator[Check]:
    """Offer two exits at the same distance: to people who know both, and to others of whom 80 % know one alone."""
    exits = {"1": [(0.5, 12), (1.5, 12)], "2": [(8.5, 12), (9.5, 12)]}
    plan = one_storey(box(0, 0, 10, 12), exits=exits, areas={"start": box(0.5, 0, 9.5, 4)})
    shares = {}
    for label, people in (("both", [crowd(50)]), ("one", [crowd(10, exits=["1"]), crowd(40, exits=["2"])])):
        shares[label] = np.array([run.out_by("2").mean() for run in trial.runs(plan, people, label)])
    source = "NIST TN 1822, ISO 20414"
    yield check("share of exit 2 if people know both", source, shares["both"], 0.4, 0.6)
    yield check(
        "share of exit 2 if 80 % know only exit 2; divided by that if people know both",
        source,
        shares["one"] / shares["both"],
        low=1.0,
    )


@standard_test("NIST-4.1 ISO-9", "an exit that becomes unavailable")
def closing_exit(trial: Trial) -> Iterator[Check]:
    """Send a person at 1 m/s to the nearer of two exits, which closes after 1 s."""
    exits = {"1": across(0, 12, 13), "2": across(10, 12, 13)}
    person = {"positions": [[4.5, 2.0]], "z": 0.0, "speed": 1.0}
    closes = 1.0
    closing = {"time": closes, "kind": "close", "target": "1"}
    runs = trial.runs(one_storey(box(0, 0, 10, 15), exits=exits), [person], event=[closing])
    towards = []
    for run in runs:
        x = run.trajectory.position[run.trajectory.time <= closes, 0, 0]
        towards.append(float(np.all(np.diff(x) < 0.0)))
    yield check("people who walk towards exit 1 until it closes, of 1", "by hand: it is nearer", towards, low=1, high=1)
    used = [run.out_by("2").sum() for run in runs]
    yield check("people who leave by exit 2, of 1", "NIST TN 1822, ISO 20414", used, low=1, high=1)
