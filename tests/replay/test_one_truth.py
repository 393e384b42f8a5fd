"""Numbers of a run, wherever they are shown, against code that reads its files with nothing of evac."""

import csv
import json
import math
from collections import Counter
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

import evac
from evac.cli.outcome import show_answer
from evac.pictures.colouring import colouring
from evac.pictures.palette import NOTHING, rgb
from evac.pictures.scales import PEOPLE
from evac.report.of_run import main_results

CASES = ("primary_school", "square_room")


@pytest.fixture(scope="module", params=CASES)
def run(request, tmp_path_factory):
    """A run of a case: its folder, and what was recorded of it."""
    folder = tmp_path_factory.mktemp("truth") / "result"
    changes = {"output.picture": False, "output.animation": False, "simulation.seed": 3}
    evac.run(evac.load(request.param, changes), folder)
    table = pa.ipc.open_stream((folder / "trajectory.evac").read_bytes()).read_all()
    header = json.loads(table.schema.metadata[b"evac.trajectory"])
    return SimpleNamespace(
        folder=folder,
        header=header,
        frames=list(zip(table["time"].to_pylist(), table["people"].to_pylist(), strict=True)),
        people=rows_of(folder / "people.csv"),
        crossings=rows_of(folder / "crossings.csv"),
        summary=json.loads((folder / "summary.json").read_text()),
    )


def rows_of(path):
    """Rows of a table; none if there is no such file."""
    return list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []


def times_of_levels(run):
    """When each person is on which level: (from, to, person, level), from the tables alone."""
    levels = {portal: use["levels"] for portal, use in run.summary["portals"].items()}
    for number, person in enumerate(run.people):
        since, level = 0.0, person["start_level"]
        for crossing in run.crossings:
            if int(crossing["person"]) == number:
                yield since, float(crossing["time"]), number, level
                first, second = levels[crossing["portal"]]
                since, level = float(crossing["time"]), second if level == first else first
        yield since, float(person["exit_time"] or np.inf), number, level


def speed_of(run, one):
    """Speed along the slope."""
    level = run.header["building"]["levels"][one["level"]]
    velocity = np.array(one["motion"][2:4])
    return float(np.hypot(np.hypot(*velocity), np.tan(level["slope"]) * (velocity @ level["uphill"])))


def waited_until(run, last):
    """Time waited by each person until a frame."""
    waited = np.zeros(len(run.people))
    for (before, there), (time, here) in zip(run.frames[:last], run.frames[1 : last + 1], strict=True):
        ready = {one["person"] for one in there if float(run.people[one["person"]]["response_time"]) <= before}
        for one in here:
            if one["person"] in ready and speed_of(run, one) < 0.2:
                waited[one["person"]] += time - before
    return waited


def table_of(browser, name):
    """Cells of a table of the page, by the first one of each row."""
    return browser.run(
        f"""Object.fromEntries([...document.querySelectorAll('#{name} tbody tr')].map(
              ({{ cells: [first, ...others] }}) => [first.innerText, others.map((cell) => cell.innerText)]))"""
    )


def test_numbers_of_the_replay_are_those_of_the_run(browser, run):
    browser.open(run.folder / "replay.html")
    stays = list(times_of_levels(run))
    levels_of = [(level["stair"], level["name"]) for level in run.header["building"]["levels"]]
    stairs = {name: {level for stair, level in levels_of if stair == name} for name in run.summary["stairs"]}
    for k in np.linspace(0, len(run.frames) - 2, 6).astype(int).tolist():
        time = run.frames[k][0] + 0.123  # nobody is told apart by rounding
        browser.run(f"replay.act.seek({time})")
        browser.settle()
        there = [(person, level) for since, until, person, level in stays if since <= time < until]
        assert browser.text("#inside") == str(len(there))
        assert browser.text("#outside") == str(len(run.people) - len(there))
        shown = table_of(browser, "stairs")
        for name, levels in stairs.items():
            entered = {person for since, _, person, level in stays if since <= time and level in levels}
            assert shown[name] == [str(len(entered)), str(sum(level in levels for _, level in there))]
        storeys = table_of(browser, "storeys")
        if len(storeys) > 1:
            assert sum(int(count) for (count,) in storeys.values()) + sum(
                int(count) for _, count in shown.values()
            ) == len(there)
        for name, (out, _) in table_of(browser, "exits").items():
            left = [one for one in run.people if one["exit"] == name and float(one["exit_time"]) <= time]
            assert out == str(len(left))


def test_people_of_the_replay_and_of_pictures_have_the_measures_of_the_trajectory(browser, run):
    browser.open(run.folder / "replay.html")
    trajectory = evac.read_trajectory(run.folder)
    colours = {name: colouring(trajectory, name) for name in ("speed", "contact_force", "waiting")}
    random = np.random.default_rng(1)
    for k in random.choice(len(run.frames) - 1, 7, replace=False).tolist():
        time, there = run.frames[k]
        if not there:
            continue
        one = there[int(random.integers(len(there)))]
        person, waited = one["person"], waited_until(run, k)
        recent = [
            other["motion"][4]
            for then, people in run.frames[: k + 1]
            for other in people
            if other["person"] == person and then > time - 1.0 + 1e-9
        ]
        force = float(f"{np.mean(recent):.2g}")
        browser.run(f"replay.act.seek({time}); replay.act.select({person})")
        browser.settle()
        facts = browser.run(
            "Object.fromEntries([...document.querySelectorAll('#person-facts dt')].map((name) => "
            "[name.innerText, name.nextSibling.innerText.replaceAll('\\u202f', '')]))"
        )
        assert facts["Speed"] == f"{speed_of(run, one):.2f} m/s"
        assert facts["Waited so far"] == f"{waited[person]:.1f} s"
        assert facts["Contact force"] == (f"{force:g} N" if force >= 10 else "below 10 N")
        assert facts["Level"] == run.header["building"]["levels"][one["level"]]["name"]
        assert facts["Exit time"] == f"{float(run.people[person]['exit_time']):.2f} s"
        row = [other["person"] for other in there].index(person)
        expected = {"speed": speed_of(run, one), "contact_force": float(np.mean(recent)), "waiting": waited[person]}
        for name, value in expected.items():
            scale, top = PEOPLE[name], colours[name].top
            ramp = np.round(255 * scale.ramp()).astype(np.uint8)
            shade = ramp[int(255 * scale.share(np.array(value), top) + 1e-6)].tolist()
            if name == "contact_force" and value < 10:
                shade = list(rgb([NOTHING])[0])
            assert colours[name].of(trajectory[k])[row].tolist() == [shade] * 3


def test_waiting_of_maps_is_the_time_that_people_waited(run):
    waited = waited_until(run, len(run.frames) - 1)
    maps = evac.read_trajectory(run.folder).maps().values()
    assert sum(float(np.nansum(one.waiting)) * one.spacing**2 for one in maps) == pytest.approx(waited.sum(), rel=0.03)
    assert waited.sum() > 1.0


def jams(run):
    """When ten people wait at once on the floors of a storey or on a stair for the first time, and how many do."""
    levels, found = run.header["building"]["levels"], {}
    for (before, there), (time, here) in pairwise(run.frames):
        ready = {one["person"] for one in there if float(run.people[one["person"]]["response_time"]) <= before}
        waiting = [one["level"] for one in here if one["person"] in ready and speed_of(run, one) < 0.2]
        places = Counter(levels[level]["stair"] or levels[level]["name"] for level in waiting)
        for place, count in places.items():
            if count >= 10:
                found.setdefault(place, (time, f"{place}: jam, {count} people wait"))
    return set(found.values())


def test_events_on_the_time_line_are_those_of_the_run(browser, run):
    browser.open(run.folder / "replay.html")
    shown = browser.run(
        "[...document.querySelectorAll('#events button')].map(({ innerText }) => innerText.split('\\n'))"
    )
    out = sorted(float(one["exit_time"]) for one in run.people)
    expected = {(out[0], "first person out"), (out[-1], "last person out"), *jams(run)}
    floors = [level["name"] for level in run.header["building"]["levels"] if level["kind"] == "floor"]
    stays = list(times_of_levels(run))
    if len(floors) > 1:
        expected |= {(max(until for _, until, _, on in stays if on == name), f"{name}: nobody left") for name in floors}
    told = [(float(text.removesuffix(" s")), what) for _, text, what in shown]
    assert sorted(told) == sorted((round(time + 1e-9, 1), what) for time, what in expected)
    assert [time for time, _ in told] == sorted(time for time, _ in told)
    browser.run("document.querySelectorAll('#events button')[1].click()")
    browser.settle()
    assert browser.run("replay.state.time") == pytest.approx(told[1][0], abs=0.051)
    assert browser.run("document.querySelectorAll('#marks button').length") == len(told)


def distance_to(segment, point):
    """Distance of a point from a segment."""
    first, along = np.array(segment[:2]), np.array(segment[2:]) - segment[:2]
    share = np.clip((point - first) @ along / (along @ along), 0.0, 1.0)
    return float(np.linalg.norm(point - first - share * along))


def longest_queue(run):
    """Words of the queue with the longest waiting in total, from recorded positions."""
    building, origin = run.header["building"], np.array(run.header["origin"])
    stair_of = [level["stair"] for level in building["levels"]]
    waits = {}  # place and level: list of (person, time, duration, position, level)
    for (before, there), (time, here) in zip(run.frames[:-1], run.frames[1:], strict=True):
        ready = {one["person"] for one in there if float(run.people[one["person"]]["response_time"]) <= before}
        for one in here:
            if one["person"] not in ready or speed_of(run, one) >= 0.2:
                continue
            at, level = np.array(one["motion"][:2]) + origin, one["level"]
            ways = [(f"before exit {way['name']!r}", way) for way in building["exits"] if way["level"] == level]
            for way in building["portals"]:
                if level in way["levels"]:
                    other = stair_of[sum(way["levels"]) - level]
                    name = building["levels"][sum(way["levels"]) - level]["name"]
                    ways.append((f"before stair {other!r}" if other else f"before level {name!r}", way))
            near = min(ways, key=lambda way: min(distance_to(part, at) for part in way[1]["segments"]))[0]
            place = (f"on stair {stair_of[level]!r}", -1) if stair_of[level] else (near, level)
            waits.setdefault(place, []).append((one["person"], time, time - before, at, level))
    (place, _), rows = max(waits.items(), key=lambda item: sum(row[2] for row in item[1]))
    people = len({row[0] for row in rows})
    times = sorted({row[1] for row in rows})
    most = max(sum(row[1] == time for row in rows) for time in times)
    peak = next(time for time in times if sum(row[1] == time for row in rows) == most)
    x, y = np.mean([row[3] for row in rows if row[1] == peak], axis=0)
    level = building["levels"][max(row[4] for row in rows if row[1] == peak)]["name"]
    mean = sum(row[2] for row in rows) / people
    return (
        f"Longest queue, {place}: {people} people waited {mean:.1f} s on average, {most} at once at {peak:.1f} s "
        f"around ({x:.1f}, {y:.1f}) on {level!r}"
    )


def steady(times):
    """Flow between the first and the last fifth."""
    first, last = int(0.2 * len(times)), int(0.8 * len(times))
    return (last - first) / (times[last] - times[first])


def test_the_terminal_and_the_report_say_what_the_tables_say(run, capsys):
    times = sorted(float(one["exit_time"]) for one in run.people)
    (name,) = run.summary["exits"]
    width = float(run.header["building"]["exits"][0]["width"])
    expected = [
        f"Everybody out: {len(times)} of {len(times)} people out",
        f"Evacuation time: the last is out after {times[-1]:.2f} s, "
        f"95 % of the people after {times[math.ceil(0.95 * len(times)) - 1]:.2f} s",
        f"Exit {name!r}: {len(times)} people, the last after {times[-1]:.2f} s, "
        f"{steady(times):.2f} /s ({steady(times) / width:.2f} /s/m)",
        longest_queue(run),
    ]
    results = evac.read_results(run.folder)
    show_answer(results)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:5] == expected
    head = main_results(results)
    assert [head[key] for key in ("Answer", "Evacuation", "Exits", "Queues")] == expected


def test_tables_of_the_summary_are_those_of_the_crossings(run):
    stays = list(times_of_levels(run))
    members = {name: {name} for name in run.summary["levels"]} | {
        stair: {level["name"] for level in run.header["building"]["levels"] if level["stair"] == stair}
        for stair in run.summary["stairs"]
    }
    for name, use in (run.summary["levels"] | run.summary["stairs"]).items():
        own = [(since, until, person) for since, until, person, level in stays if level in members[name]]
        assert use["people"] == len({person for _, _, person in own})
        if own:
            assert use["last_left"] == max(until for _, until, _ in own)
            moments = sorted({since for since, _, _ in own})
            at_once = [len({person for since, until, person in own if since <= time < until}) for time in moments]
            assert use["greatest_number"] == max(at_once)
    for use in run.summary["flows"]:
        if use["kind"] == "portal":
            passed = [float(one["time"]) for one in run.crossings if one["portal"] == use["name"]]
            both = [other for other in run.summary["flows"] if other["name"] == use["name"]]
            assert sum(other["people"] for other in both) == len(passed)
            assert min(other["first"] for other in both) == passed[0]


def test_densities_of_maps_are_sums_of_kernels(run):
    trajectory = evac.read_trajectory(run.folder)
    times = np.array([time for time, _ in run.frames])
    shares = np.diff(np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])) / (times[-1] - times[0])
    kernel = np.exp(-((0.2 * np.arange(-9, 10)) ** 2) / 0.7**2)
    kernel /= kernel.sum()
    random, origin = np.random.default_rng(2), np.array(run.header["origin"])
    levels = [level["name"] for level in run.header["building"]["levels"]]
    bodies = [
        (frame, body["level"], *(np.array(body["motion"][:2]) + origin))
        for frame, (_, people) in enumerate(run.frames)
        for body in people
    ]
    bodies = np.array(bodies)

    def spread(cells, cell):
        steps = np.abs(cells - cell)
        return np.where(steps.max(axis=1) <= 9, kernel[np.minimum(9 + steps, 18)].prod(axis=1), 0.0)

    for name, one in trajectory.maps().items():
        floor = np.argwhere(np.isfinite(one.density))
        here = bodies[bodies[:, 1] == levels.index(name)]
        cells = np.floor((here[:, [3, 2]] - one.origin[::-1]) / 0.2).astype(int)
        for cell in random.permutation(floor)[:4]:
            weight = spread(cells, cell)
            near = np.flatnonzero(weight)
            kept = np.array([max(0.05, spread(floor, own).sum()) for own in cells[near]])
            density = np.zeros(len(run.frames))
            np.add.at(density, here[near, 0].astype(int), weight[near] / kept / 0.04)
            assert f"{one.density[tuple(cell)]:.4g}" == f"{(shares * density).sum():.4g}"
            assert f"{one.max_density[tuple(cell)]:.4g}" == f"{density.max():.4g}"


def test_people_who_come_are_drawn_and_counted_from_then_on(browser, tmp_path):
    arrive = {"rate": 1.0, "from": 0.0, "to": 6.0}
    people = [{"name": "early", "level": "room", "number": 4}, {"name": "late", "level": "room", "arrive": arrive}]
    quiet = {"output.animation": False, "output.picture": False}
    results = evac.run(evac.load("square_room", {"people": people, **quiet}), tmp_path / "result")
    browser.open(tmp_path / "result" / "replay.html")
    crowd = results.crowd
    for time in np.linspace(0.0, results.time, 40)[:-1] + 0.0037:
        inside = int(((crowd.arrival_time <= time) & (crowd.exit_time > time)).sum())
        shown = browser.run(f"[replay.series.inside.at({time}), replay.record.at({time}).count]")
        assert shown == [inside, inside]
