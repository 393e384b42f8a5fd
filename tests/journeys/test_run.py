"""Numbers of a run, wherever they are shown, against code that reads its files with nothing of evac."""

import json
import re
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest
import pyvista

import evac
from evac.cli.main import main
from evac.cli.run import show_answer, show_results
from evac.export.vtk import CELL_KINDS
from evac.pictures.palette import NOTHING, PEOPLE, colouring, rgb
from evac.report.of_run import run_report
from evac.report.sections import PlaceSettings
from evac.results.ending import Stopped
from tests.journeys.cases import JOURNEYS, SHIPPED
from tests.journeys.recount import Map, Recount, distance_to, fixed, rows_of, steady, time_of
from tests.report.conftest import Page

#: Fewest numbers of each kind that are compared in each run.
PICKS = 40

#: A browser rounds ties away from zero.
TIE = 1e-9


@pytest.fixture(scope="module", params=[*JOURNEYS, *(pytest.param(name, marks=pytest.mark.slow) for name in SHIPPED)])
def run(request, tmp_path_factory):
    """A journey: what was recorded of it."""
    folder = tmp_path_factory.mktemp("journey") / "result"
    changes = {"output.picture": False, "output.animation": True, "simulation.seed": 3}
    case = evac.load(JOURNEYS.get(request.param) or SHIPPED[request.param], changes)
    results = evac.run(case, folder)
    journey = Recount(folder)
    journey.name, journey.case, journey.results = request.param, case, results
    return journey


def assert_agree(shown, computed, fewest=PICKS):
    """Assert that numbers are those of the recount, and so many that they can be believed."""
    assert shown.keys() == computed.keys()
    assert {key: (shown[key], computed[key]) for key in computed if shown[key] != computed[key]} == {}
    assert len(computed) >= fewest


def table_of(browser, name):
    """Cells of a table of the page, by the first one of each row."""
    return browser.run(
        f"""Object.fromEntries([...document.querySelectorAll('#{name} tbody tr')].map(
              ({{ cells: [first, ...others] }}) => [first.innerText, others.map((cell) => cell.innerText)]))"""
    )


def counted_at(run, time):
    """Numbers of the replay at a time, by table and row."""
    there = run.there(time)
    start = max(run.frames[0][0], time - 5.0)

    def passed(times):
        flow = sum(start < one <= time for one in times) / (time - start) if time - start > 0.5 else 0.0
        return str(sum(one <= time for one in times)), flow

    found = {
        "inside": str(len(there)),
        "outside": str(len(run.exit_times()) and sum(t <= time for t in run.exit_times())),
    }
    for name in (way["name"] for way in run.building["exits"]):
        out, flow = passed(run.exit_times(name))
        found["exits", name] = [out, f"{flow + TIE:.1f}"]
    for name, levels in run.stairs.items():
        entered = {person for since, _, person, level in run.stays if since <= time and level in levels}
        found["stairs", name] = [str(len(entered)), str(sum(level in levels for _, level in there))]
    floors = [level["name"] for level in run.levels if level["kind"] == "floor"]
    for name in floors if len(floors) > 1 else ():
        found["storeys", name] = [str(sum(level == name for _, level in there))]
    for name, width in run.lines.items():
        ways = [times for (kind, own, _), (times, _) in run.passages.items() if (kind, own) == ("line", name)]
        number, flow = passed([time for times in ways for time in times])
        found["lines", name] = [number, f"{flow + TIE:.1f}", f"{flow / width + TIE:.2f}"]
    return found


def test_numbers_of_the_replay_are_those_of_the_run(browser, run):
    browser.show(run.folder / "replay.html")
    shown, computed = {}, {}
    for k in np.linspace(0, len(run.frames) - 2, 8).astype(int).tolist():
        time = run.frames[k][0] + 0.125  # the page has hundredths: nobody is told apart by rounding
        browser.run(f"replay.act.seek({time})")
        browser.settle()
        tables = {name: table_of(browser, name) for name in ("exits", "stairs", "storeys", "lines")}
        for what, numbers in counted_at(run, time).items():
            computed[k, what] = numbers
            shown[k, what] = browser.text(f"#{what}") if isinstance(what, str) else tables[what[0]][what[1]]
    assert_agree(shown, computed, 8)
    assert sum(len(numbers) for numbers in computed.values()) >= PICKS


def test_people_of_the_replay_and_of_pictures_have_the_measures_of_the_trajectory(browser, run):
    browser.show(run.folder / "replay.html")
    trajectory = evac.read_trajectory(run.folder)
    colours = {name: colouring(trajectory, name) for name in ("speed", "contact_force", "waiting")}
    random, shown, computed = np.random.default_rng(1), {}, {}
    crowded = [k for k in range(len(run.frames) - 1) if run.frames[k][1]]
    for k in random.choice(crowded, 6, replace=False).tolist():
        time, there = run.frames[k]
        row = int(random.integers(len(there)))
        one, person = there[row], there[row]["person"]
        waited, force = run.waited(person, k), run.force(person, k)
        browser.run(f"replay.act.seek({time}); replay.act.select({person})")
        browser.settle()
        facts = browser.run(
            "Object.fromEntries([...document.querySelectorAll('#person-facts dt')].map((name) => "
            "[name.innerText, name.nextSibling.innerText.replaceAll('\\u202f', '')]))"
        )
        told, rounded = run.people[person], float(f"{force:.2g}")
        expected = {
            "Speed": f"{run.speed(one):.2f} m/s",
            "Waited so far": f"{waited:.1f} s",
            "Contact force": f"{rounded:g} N" if rounded >= 10 else "below 10 N",
            "Level": run.levels[one["level"]]["stair"] or run.levels[one["level"]]["name"],
            "Exit time": f"{float(told['exit_time']):.2f} s" if told["exit_time"] else "did not get out",
            "Desired speed": f"{float(told['speed']):.2f} m/s",
            "Response time": "never" if told["response_time"] == "inf" else f"{float(told['response_time']):.2f} s",
        }
        computed |= {(k, name): value for name, value in expected.items()}
        shown |= {(k, name): facts[name] for name in expected}
        for name, value in (("speed", run.speed(one)), ("contact_force", force), ("waiting", waited)):
            scale, top = PEOPLE[name], colours[name].top
            ramp = np.round(255 * scale.ramp()).astype(np.uint8)
            shade = ramp[int(255 * scale.share(np.array(value), top) + 1e-6)].tolist()
            if value < {"speed": 0.0, "contact_force": 10.0, "waiting": 1.0}[name]:
                shade = list(rgb([NOTHING])[0])
            assert colours[name].of(trajectory[k])[row].tolist() == [shade] * 3
    assert_agree(shown, computed)


def test_events_on_the_time_line_are_those_of_the_run(browser, run):
    browser.show(run.folder / "replay.html")
    shown = browser.run(
        "[...document.querySelectorAll('#events button')].map(({ innerText }) => innerText.split('\\n'))"
    )
    out = run.exit_times()
    last = "last person out" if len(out) == len(run.people) else "last of those who got out"
    expected = {(out[0], "first person out"), (out[-1], last), *run.jams()}
    floors = [level["name"] for level in run.levels if level["kind"] == "floor"]
    for name in floors if len(floors) > 1 else ():
        left = run.use_of({name})[2]
        expected |= {(left, f"{name}: clear")} if left else set()
    told = [(float(text.removesuffix(" s")), what) for sign, text, what in shown if sign not in "▼◆★"]
    assert sorted(told) == sorted((round(time + TIE, 2), what) for time, what in expected)
    changes = [float(text.removesuffix(" s")) for sign, text, _ in shown if sign == "▼"]
    assert changes == [change["time"] for change in run.summary["changes"]]
    times = [float(text.removesuffix(" s")) for _, text, _ in shown]
    assert times == sorted(times)
    browser.run("document.querySelectorAll('#events button')[1].click()")
    browser.settle()
    assert browser.run("replay.state.time") == pytest.approx(times[1], abs=0.0051)
    assert browser.run("document.querySelectorAll('#marks button').length") == len(shown)


def test_the_longest_queue_is_shown_where_and_when_it_was(browser, run):
    browser.show(run.folder / "replay.html")
    _, told = run.queue()
    if told is None:
        assert not browser.run("[...document.querySelectorAll('#answer button')].length")
        return
    cause, time, place, level, most = told
    browser.run("document.querySelector('#answer button').click()")
    browser.settle()
    assert browser.run("replay.state.time") == pytest.approx(time, abs=0.051)
    assert browser.text("#labels .event") == f"longest queue, {cause}: {most} wait"
    assert browser.text("#events [aria-current=true]").endswith(f"longest queue, {cause}: {most} wait")
    at, found = browser.run(
        """(() => {
          const { longest: { at }, origin, building } = replay.record;
          return [[at.x + origin[0], at.y + origin[1]], building.levels[at.level].name];
        })()"""
    )
    assert found == level
    np.testing.assert_allclose(at, place, atol=0.051)
    browser.press("n", "KeyN")
    assert browser.text("#labels .event") != f"longest queue, {cause}: {most} wait"


def answer_of(run):
    """Lines of the answer by kind, as they have to be."""
    times, leaving = run.exit_times(), run.leaving
    most = time_of(times, len(leaving), 95)
    complete = len(times) == len(leaving) and not run.missing and not run.stopped
    share = "fewer than 95 % got out" if most is None else f"95 % are out after {most:.2f} s"
    last = "Evacuation time" if complete else "Last out after"
    exits = []
    changed = {one["what"]: one["kind"] for one in run.summary["changes"] if one["kind"] in ("close", "open")}
    for way in sorted(run.building["exits"], key=lambda one: -len(run.exit_times(one["name"]))):
        out = run.exit_times(way["name"])
        flow, who = steady(out), "person" if len(out) == 1 else "people"
        exits.append(
            f"Exit {way['name']!r}{' (closed)' * (changed.get(way['name']) == 'close')}: {len(out)} {who}"
            + (f" by {out[-1]:.2f} s" if out else "")
            + (f", middle fifths {flow:.2f}/s ({flow / way['width']:.2f}/s/m)" if flow else "")
        )
    number = f"{len(times)} of {len(run.people)} people out"
    if run.at_places:
        number += f", {len(run.at_places)} at a safe place"
    if run.stopped:
        number += f", {run.stopped} stopped by gases or heat"
    if run.staying:
        number += f", {run.staying} who do not leave"
    ended, after = run.summary["ended"].capitalize(), f" after {run.frames[-1][0]:.2f} s"
    return {
        "Answer": f"{ended}: {number}" if complete else f"NOT everybody is out{after} ({ended.lower()}): {number}",
        "Evacuation": f"{last} {times[-1]:.2f} s; {share}",
        "Exits": exits,
        "Queues": run.queue()[0],
    }


def test_every_number_of_the_terminal_is_that_of_the_trajectory(run, capsys):
    answer, results = answer_of(run), evac.read_results(run.folder)
    show_answer(results)
    _verdict, title, *lines = capsys.readouterr().out.splitlines()
    assert title == run.header["title"]
    told = [answer["Answer"], answer["Evacuation"], *answer["Exits"], answer["Queues"]]
    assert [line for line in lines if line in told] == told
    others = [line for line in lines if line not in told]
    staying = [run.staying] * (run.staying > 0)
    kinds = [len(run.summary[key]) for key in ("quality_warnings", "warnings") if run.summary[key]]
    changes = [one["time"] for one in run.summary["changes"]]
    changes += [one["values"]["value"] for one in run.summary["changes"] if one["kind"] == "slow"]
    stopped = sorted(float(one["stopped_at"]) for one in run.people if one.get("stopped_at"))
    stopped = [len(stopped), round(stopped[0], 1)] if stopped else []
    missing = [run.missing, len(run.people)] if run.missing else []
    others_used = [run.summary["left_by_other_exits"]] if run.summary["left_by_other_exits"] else []
    notes = [float(number) for note in run.summary["notes"] for number in re.findall(r"\d+(?:\.\d+)?", note)]
    numbers = [float(number) for line in others for number in re.findall(r"\d+(?:\.\d+)?", line)]
    places = [number for place in run.summary["places"] for number in (len(place["people"]), place["capacity"])]
    expected = [*changes, *staying, *kinds, *places, *stopped, *missing, *others_used, *notes]
    assert sorted(numbers) == sorted(expected)
    show_results(results)
    rows = [re.split(r"\s{2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]
    for way in run.building["exits"]:
        out, (row,) = (
            run.exit_times(way["name"]),
            [row for row in rows if row[0] == way["name"]],
        )
        flow = steady(out)
        times = [out[0], out[-1]] if out else [None, None]
        share = 100.0 * len(out) / max(run.summary["evacuated"], 1)
        values = [len(out), share, *times, way["width"], flow, flow and flow / way["width"]]
        assert row[1:] == ["-" if value is None else f"{value:.4g}" for value in values]
    for name, levels in run.stairs.items():
        row = [row for row in rows if row[0] == name and len(row) == 4][-1]
        assert row[1:] == ["-" if value is None else f"{value:.4g}" for value in run.use_of(levels)]
    facts = {row[0]: row[1] for row in reversed(rows) if len(row) == 2}
    responses = sorted(time for one in run.people if (time := float(one["response_time"])) < np.inf)
    spread = f"{responses[0]:.4g} to {responses[-1]:.4g} s"
    assert facts["response times"] == (spread if responses[-1] else "none: everybody starts at 0 s")
    assert facts["people"] == str(len(run.people))
    assert facts["simulated"].startswith(f"{run.frames[-1][0]:.2f} s in ")


#: Quantities of people in the report: column of people.csv, and digits.
DRAWN = {
    "desired speed on the flat": ("speed", 2),
    "desired speed up stairs, along the slope": ("speed_up", 2),
    "desired speed down stairs, along the slope": ("speed_down", 2),
    "radius of the body": ("radius", 3),
    "height of the body": ("height", 2),
    "mass": ("mass", 1),
    "relaxation time": ("tau", 2),
}


def extremes(values, digits):
    """Least, mean and greatest of some values."""
    return [fixed(value if value < np.inf else None, digits) for value in (min(values), np.mean(values), max(values))]


def report_of(run):
    """Rows of the tables of the report as they have to be, by words of their captions and the first cell."""
    leaving = run.leaving
    times, rows = run.exit_times(), {}
    for share in (5, 10, 25, 50, 75, 90, 95, 98, 100):
        rank = int(np.ceil(share / 100 * len(leaving)))
        rows["share of the people", f"{share} %"] = [rank, fixed(time_of(times, len(leaving), share), 1, "not reached")]
    groups = {name: [one for one in people if one in leaving] for name, people in run.groups.items()}
    for name, people in (groups | ({"everybody": leaving} if len(groups) > 1 else {})).items():
        out = sorted(float(one["exit_time"]) for one in people if one["exit_time"])
        first, mean = (fixed(out[0], 1), fixed(np.mean(out), 1)) if out else ("-", "-")
        shares = [
            fixed(time_of(out, len(people), share), 1, "not reached" if people else "-") for share in (50, 95, 100)
        ]
        rows["each group left", name] = [len(people), len(out), first, mean, *shares]
    for way in run.building["exits"]:
        out = run.exit_times(way["name"])
        flow, ends = steady(out), [fixed(out[k], 1) for k in (0, -1)] if out else ["-", "-"]
        flows = [fixed(flow, 2), fixed(flow and flow / way["width"], 2)]
        share = fixed(100.0 * len(out) / sum(len(run.exit_times(one["name"])) for one in run.building["exits"]), 1)
        rows["Exits; the flow", way["name"]] = [len(out), share, *ends, fixed(way["width"], 2), *flows]
    inner = {level for levels in run.stairs.values() for level in levels}
    places = {level["name"]: {level["name"]} for level in run.levels if level["name"] not in inner} | run.stairs
    for name, levels in places.items():
        people, most, last = run.use_of(levels)
        what = "Use of stairs" if name in run.stairs else "Use, and time"
        rows[what, name] = [people, most, fixed(last, 1, "not cleared" if people else "-")]
    for (kind, name, direction), (passed, width) in run.passages.items():
        if kind != "exit":
            flow = steady(passed)
            numbers = [len(passed), fixed(width, 2), fixed(flow, 2), fixed(flow and flow / width, 2)]
            rows["Lines of the case", kind, name, direction] = numbers
    for name, people in run.groups.items():
        responses = [float(one["response_time"]) for one in people]
        rows["Response times drawn", name] = extremes(responses, 1)
    for names in run.alike(column for column, _ in DRAWN.values()):
        people = [one for one in run.people if one["group"] in names]
        for what, (column, digits) in DRAWN.items():
            values = extremes([float(one[column]) for one in people], digits)
            rows[f"{'person' if len(people) == 1 else 'people'}: {', '.join(names)}", what] = values
    return rows


def test_the_report_has_the_numbers_of_the_trajectory(run):
    page = Page(run_report(run.folder, places=PlaceSettings(maps=())))
    shown, computed = {}, {}
    for (words, *first), numbers in report_of(run).items():
        tables = [table["rows"] for table in page.tables if words in table["caption"]]
        found = [row for table in tables for row in table[1:] if row[: len(first)] == first]
        if words == "Lines of the case" and not found:
            continue  # the table has ten doors and ten portals
        (row,) = found
        for k, number in enumerate(numbers):
            key = words, *first, k
            computed[key], shown[key] = str(number), row[k - len(numbers)]
    assert_agree(shown, computed)
    answer = answer_of(run)
    assert [page.fact(name) for name in ("Answer", "Evacuation", "Exits", "Queues")] == [
        answer["Answer"],
        answer["Evacuation"],
        "; ".join(answer["Exits"]),
        answer["Queues"],
    ]


def test_maps_have_the_values_of_the_trajectory(run):
    random, shown, computed = np.random.default_rng(2), {}, {}
    names = [level["name"] for level in run.levels]
    maps = [one for one in evac.read_trajectory(run.folder).maps().values() if np.nanmax(one.density) > 0.0]
    recounts = [Map(run, names.index(one.level), np.isfinite(one.density), one.origin) for one in maps]
    for number, cells in enumerate(random.permutation(len(maps) * 60)[: max(12, 2 * len(maps))]):
        one, recount = maps[cells % len(maps)], recounts[cells % len(maps)]
        used = np.argwhere(one.usage > 0) if number % 3 else recount.floor
        cell = tuple(used[int(random.integers(len(used)))].tolist())
        values = recount.smooth(cell) | (recount.covered(cell) if number % 3 == 1 else {})
        for name, value in values.items():
            computed[one.level, cell, name] = f"{value:.4g}"
            shown[one.level, cell, name] = f"{getattr(one, name)[cell]:.4g}"
    assert_agree(shown, computed)


def test_waiting_of_maps_is_the_time_that_people_waited(run):
    waited = sum(sum(waits.values()) for waits in run.waits)
    maps = evac.read_trajectory(run.folder).maps().values()
    assert sum(float(np.nansum(one.waiting)) * one.spacing**2 for one in maps) == pytest.approx(waited, rel=0.03)


def test_tables_have_the_numbers_of_the_trajectory(run):
    shown = {(row["time"], "out"): row["number_out"] for row in rows_of(run.folder / "egress.csv")[1:]}
    computed = {(repr(time), "out"): str(rank) for rank, time in enumerate(run.exit_times(), 1)}
    rows = rows_of(run.folder / "flows.csv")
    ends = [*np.arange(5.0, run.end, 5.0).tolist(), run.end]
    keys = [(kind, name, direction) for kind, name, direction in run.passages]
    assert {(row["kind"], row["name"], row["direction"]) for row in rows} == set(keys)
    for row in rows:
        key = *(row[column] for column in ("kind", "name", "direction")), row["time"]
        shown[key] = row["count"], float(row["flow"]), float(row["specific_flow"])
    for key in keys:
        times, width = run.passages[key]
        for before, time in zip([0.0, *ends], ends, strict=False):
            count, earlier = (sum(one <= end for one in times) for end in (time, before))
            flow = (count - earlier) / (time - before)
            computed[*key, repr(time)] = str(count), pytest.approx(flow), pytest.approx(flow / width)
    assert_agree(shown, computed)


def test_people_and_crossings_are_those_of_the_recorded_motion(run):
    first, last = {}, {}
    for k, (_, here) in enumerate(run.frames):
        for one in here:
            first.setdefault(one["person"], (k, one))
            last[one["person"]] = k, one
    for person, row in enumerate(run.people):
        assert (person in first) == bool(row["arrival_time"])
        if person not in first:
            continue
        k, one = first[person]
        if k == 0:
            place = np.array(one["motion"][:2]) + run.origin
            assert place == pytest.approx([float(row["start_x"]), float(row["start_y"])], abs=1e-5)
            assert run.levels[one["level"]]["name"] == run.named(row["start_level"], row["start_piece"])
        k, one = last[person]
        if row["exit_time"]:
            assert run.frames[k][0] <= float(row["exit_time"]) <= run.frames[k + 1][0]
        else:
            assert run.levels[one["level"]]["name"] == run.named(row["end_level"], row["end_piece"])
    levels = {one["name"]: {run.levels[index]["name"] for index in one["levels"]} for one in run.building["portals"]}
    on = [{one["person"]: run.levels[one["level"]]["name"] for one in here} for _, here in run.frames]
    for row in run.crossings:
        person, time = int(row["person"]), float(row["time"])
        assert (
            next(level for since, _, own, level in run.stays if own == person and since == time)
            in (run.stairs if row["piece"] else levels)[row["portal"]]
        )
    for (time, _), here in zip(run.frames, on, strict=True):
        came = {person for person, row in enumerate(run.people) if 0.0 < float(row["arrival_time"] or 0.0) == time}
        assert here == {person: level for person, level in run.there(time) if person not in came}


def test_tables_of_the_summary_are_those_of_the_crossings(run):
    for name, use in (run.summary["levels"] | run.summary["stairs"]).items():
        values = [use[key] for key in ("people", "greatest_number", "last_left")]
        assert tuple(values) == run.use_of(run.stairs.get(name, {name}))
    for use in run.summary["flows"]:
        times, width = run.passages[use["kind"], use["name"], use["direction"]]
        assert (use["people"], use["width"]) == (len(times), pytest.approx(width))
        assert (
            (use["first"], use["last"]) == (pytest.approx(times[0]), pytest.approx(times[-1])) if times else (None,) * 2
        )
        assert use["flow"] == (pytest.approx(steady(times)) if steady(times) else None)


def test_people_who_come_are_drawn_and_counted_from_then_on(browser, tmp_path):
    arrive = {"rate": 1.0, "from": 0.0, "to": 6.0}
    people = [{"name": "early", "level": "room", "number": 4}, {"name": "late", "level": "room", "arrive": arrive}]
    people.append({"name": "staff", "level": "room", "number": 1, "leave": False})
    quiet = {"output.animation": False, "output.picture": False}
    results = evac.run(evac.load("square_room", {"people": people, **quiet}), tmp_path / "result")
    browser.open(tmp_path / "result" / "replay.html")
    crowd = results.crowd
    for time in np.linspace(0.0, results.time, 40)[:-1] + 0.0037:
        inside = int(((crowd.arrival_time <= time) & ~(crowd.exit_time <= time)).sum())
        shown = browser.run(f"[replay.series.inside.at({time}), replay.record.at({time}).count]")
        assert shown == [inside, inside]
    (staff,) = np.flatnonzero(np.isinf(crowd.start_time)).tolist()
    browser.run(f"replay.act.select({staff})")
    browser.settle()
    assert "never" in browser.text("#person-facts").split("Response time")[1].split("\n")[:2]


@pytest.mark.parametrize("run", ["arrivals", "fire"], indirect=True, scope="module")
def test_a_run_that_is_stopped_goes_on_to_the_same_files(run, tmp_path):
    def stop(progress):
        if progress.time >= 0.4 * run.end:
            raise Stopped

    part = evac.run(run.case, tmp_path / "result", progress=stop)
    assert (part.ended, part.time) == ("interrupted", pytest.approx(0.4 * run.end, abs=0.11))
    assert part.egress()[0][1:].tolist() == [time for time in run.exit_times() if time <= part.time]
    results = evac.resume(tmp_path / "result")
    one, other = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")}
        for folder in (run.folder, tmp_path / "result")
    )
    assert one.keys() == other.keys()
    assert {name.name for name in one if one[name] != other[name]} <= {"summary.json", "manifest.jsonl"}
    summary, expected = results.summary(), json.loads((run.folder / "summary.json").read_text())
    assert [row["time"] for row in summary["resumed"]] == [part.time]
    for key, value in expected.items():
        if key == "conditions" and value:
            value["routes"] = summary[key]["routes"]
        assert key in ("resumed", "wall_time") or summary[key] == value, key


def test_a_notebook_has_what_is_in_the_files(run):
    read, results = evac.read_results(run.folder), run.results
    assert read.summary() == run.summary
    assert {**results.summary(), "wall_time": None} == {**run.summary, "wall_time": None}
    assert read.people.equals(results.people)
    for row, told in zip(results.people.reset_index().to_dict("records"), run.people, strict=True):
        assert [*row] == [*told]
        for name, value in told.items():
            same = row[name] == (value if isinstance(row[name], str) else float(value or "nan"))
            assert same or (not value and row[name] != row[name]) or (value == "" and row[name] in (None, "")), name
    time, number = results.egress()
    assert time[1:].tolist() == run.exit_times()
    assert number.tolist() == list(range(len(run.exit_times()) + 1))
    for line, other in zip(results.plot().axes[0].lines, read.plot().axes[0].lines, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), other.get_xydata())
    for rows, other, group in zip(results.groups, read.groups, sorted(run.groups), strict=True):
        assert rows.name == other.name == group
        assert rows.rows.tolist() == other.rows.tolist()
        assert [run.people[row]["group"] for row in rows.rows] == [group] * len(rows.rows)
    for name in ("position", "level", "distance", "exit_used", "start_time", "mass"):
        np.testing.assert_array_equal(getattr(read.crowd, name), getattr(results.crowd, name), err_msg=name)
    for of in ("levels", "portals", "exits", "areas", "doors"):
        assert [one.name for one in getattr(read.building, of)] == [one["name"] for one in run.building[of]]
    shown = results._repr_html_()
    assert f"{len(run.exit_times())} of {len(run.people)} people out" in shown
    assert read.queues == results.queues
    assert json.dumps(read.case.to_dict()) == json.dumps(run.case.to_dict())


def test_a_trajectory_has_the_motion_of_the_people(run):
    trajectory = evac.read_trajectory(run.folder)
    np.testing.assert_array_equal(trajectory.time, [time for time, _ in run.frames])
    assert [run.header["groups"][group] for group in trajectory.group] == [one["group"] for one in run.people]
    np.testing.assert_array_equal(trajectory.radius, [float(one["radius"]) for one in run.people])
    np.testing.assert_array_equal(trajectory.height, [float(one["height"]) for one in run.people])
    assert [(one.time, one.kind, one.what) for one in trajectory.changes] == [
        (one["time"], one["kind"], one["what"]) for one in run.summary["changes"]
    ]
    for k in range(0, len(run.frames), 7):
        frame, (time, here) = trajectory[k], run.frames[k]
        motion = np.array([one["motion"] for one in here]).reshape(len(here), -1)
        person = frame["person"].tolist()
        assert (frame["time"], person) == (time, [one["person"] for one in here])
        np.testing.assert_allclose(frame["position"], motion[:, :2] + run.origin, atol=1e-12)
        np.testing.assert_array_equal(frame["contact_force"], motion[:, 4])
        np.testing.assert_allclose(frame["speed"], [run.speed(one) for one in here], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(frame["z"], run.heights(here), atol=1e-6)
        circumference = 2.0 * np.pi * trajectory.radius[person]
        np.testing.assert_allclose(frame["crowd_pressure"], motion[:, 4] / circumference)
        np.testing.assert_array_equal(trajectory.position[k, person], frame["position"])
        np.testing.assert_array_equal(trajectory.level[k, person], frame["level"])
        assert np.isnan(trajectory.speed[k]).sum() == len(run.people) - len(here)
        assert trajectory.out_at(k) == sum(one <= time for one in run.exit_times())
        assert trajectory.nearest(time + 0.01) == k


def test_exports_have_the_motion_of_the_trajectory(run, tmp_path):
    written = {}
    for name in ("csv", "parquet", "geojson", "jupedsim"):
        assert main(["export", str(run.folder), "--to", name, "--out", str(tmp_path / f"motion.{name}")]) == 0
    rows = rows_of(tmp_path / "motion.csv")
    assert len(rows) == sum(len(here) for _, here in run.frames)
    table = pq.read_table(tmp_path / "motion.parquet").to_pylist()
    flat = [(time, one) for time, here in run.frames for one in here]
    for k in range(0, len(rows), 11):
        (time, one), row = flat[k], rows[k]
        level = run.levels[one["level"]]
        written = {name: value if isinstance(table[k][name], str) else float(value) for name, value in row.items()}
        assert written == table[k]
        on = level["stair"] or level["name"]
        assert (float(row["time"]), int(row["person"]), row["level"]) == (time, one["person"], on)
        assert row["group"] == run.people[one["person"]]["group"]
        place = [*(np.array(one["motion"][:2]) + run.origin), run.heights([one])[0]]
        assert [float(row[name]) for name in "xyz"] == pytest.approx(place, abs=1e-6)
        velocity = [float(row[f"velocity_{name}"]) for name in "xyz"]
        climb = np.tan(level["slope"]) * (np.array(velocity[:2]) @ level["uphill"])
        assert velocity == pytest.approx([*one["motion"][2:4], climb], abs=1e-6)
        assert float(row["speed"]) == pytest.approx(np.linalg.norm(velocity), abs=1e-6)
    features = json.loads((tmp_path / "motion.geojson").read_text())["features"]
    found = {(one["properties"]["kind"], one["properties"]["name"]): one["properties"] for one in features}
    for way in run.building["exits"]:
        assert found["exit", way["name"]]["width"] == way["width"]
        changes = found["exit", way["name"]].get("changes", [])
        assert [(one["time"], one["open"]) for one in changes] == [
            (one["time"], one["kind"] == "open")
            for one in run.summary["changes"]
            if one["what"] == way["name"] and one["kind"] in ("open", "close")
        ]


def test_the_animation_has_the_people_and_the_doors_of_each_time(run):
    reader = pyvista.get_reader(run.folder / "animation.pvd")
    assert reader.time_values == [time for time, _ in run.frames]
    for k in np.linspace(0, len(run.frames) - 1, 6).astype(int).tolist():
        time, here = run.frames[k]
        reader.set_active_time_value(time)
        people, building = reader.read()
        assert people.n_points == len(here)
        if here:
            assert people["person"].tolist() == [one["person"] for one in here]
            place = np.array([one["motion"][:2] for one in here]) + run.origin
            np.testing.assert_allclose(people.points, np.column_stack([place, run.heights(here)]), atol=1e-6)
            np.testing.assert_allclose(people["speed"], [run.speed(one) for one in here], rtol=1e-5, atol=1e-6)
            names = people.field_data["group_names"].tolist()
            assert [names[group] for group in people["group"]] == [run.people[one["person"]]["group"] for one in here]
            for name in ("radius", "height"):
                own = [float(run.people[one["person"]][name]) for one in here]
                np.testing.assert_allclose(people[name], own, rtol=1e-6)
        kinds = [CELL_KINDS[building["exits"][way["name"]].cell_data["kind"][0]] for way in run.building["exits"]]
        assert kinds == ["exit" if run.is_open(way["name"], time) else "closed exit" for way in run.building["exits"]]


def test_nobody_passes_what_is_closed_barred_or_of_another_direction(run):
    for change in run.summary["changes"]:
        time, what = change["time"], change["what"]
        ends = min(
            (one["time"] for one in run.summary["changes"] if one["what"] == what and one["time"] > time),
            default=np.inf,
        )
        if change["kind"] == "close":
            passed = {
                k for k, one in enumerate(run.people) if one["exit"] == what and time < float(one["exit_time"]) <= ends
            }
            assert passed <= set(change["values"].get("let_through", ()))
            assert not run.is_open(what, time + 1e-6)
        if change["kind"] == "one_way":
            for (kind, name, direction), (times, _) in run.passages.items():
                against = {("portal", "down"): "to gallery", ("door", "yard"): "to the right"}
                is_against = direction == against.get((kind, change["values"]["value"]))
                if is_against and (name.startswith(what) or f"- {what} " in name):
                    assert [one for one in times if one > time + 0.5] == []
        if change["kind"] == "bar":
            inside = [{one["person"] for one in here if run.is_in(what, one)} for _, here in run.frames]
            for (then, _), before, after in zip(run.frames[1:], inside, inside[1:], strict=False):
                assert then <= time or after <= before
        if change["kind"] == "slow":
            shares = [
                run.speed(one) / float(run.people[one["person"]]["speed"])
                for then, here in run.frames
                for one in here
                if then > time + 1.0 and run.is_in(what, one)
            ]
            assert np.median(shares) == pytest.approx(change["values"]["value"], abs=0.02)


def test_people_walk_stairs_at_their_speed_in_each_direction(run):
    shares = {"speed_up": [], "speed_down": []}
    for (_, here), (_, later) in pairwise(run.frames):
        after = {one["person"]: one for one in later}
        for one in here:
            level = run.levels[one["level"]]
            if level["slope"] > 0.1 and one["started"] and after.get(one["person"], {}).get("level") == one["level"]:
                climbs = np.array(one["motion"][2:4]) @ level["uphill"] > 0.0
                column = "speed_up" if climbs else "speed_down"
                shares[column].append(run.speed(one) / float(run.people[one["person"]][column]))
    for column, found in shares.items():
        # A few step back on a stair where nobody climbs; helpers go at the speed of a device.
        if len(found) > 10 and run.name not in ("school", "places"):
            assert np.median(found) == pytest.approx(1.0, abs=0.1), column


def test_people_at_places_are_in_their_areas(run):
    tables = [table for table in run.summary["case"]["place"] if table["kind"] != "fire"]
    for place, table in zip(run.summary["places"], tables, strict=True):
        assert (place["name"], place["kind"], place["capacity"]) == (table["name"], table["kind"], table["capacity"])
        assert len(place["people"]) <= (place["capacity"] or np.inf)
        there = {one["person"]: one for one in run.frames[-1][1]}
        assert all(run.is_in(table["area"], there[person]) for person in place["people"])
        came = [
            min(
                time
                for time, here in run.frames
                for one in here
                if one["person"] == person and run.is_in(table["area"], one)
            )
            for person in place["people"]
        ]
        assert max(came) - 0.5 <= place["last"] <= run.end


def test_doses_are_those_of_the_time_in_gases(run):
    """The sleeper breathes 4 % of CO, 1 % of CO2 and 15 % of oxygen: equations of the guide of FDS."""
    if run.name != "fire":
        assert ("gas_dose" in run.people[0]) == (run.case.dose is not None)
        return
    smoke = {"adults": True, "children": False}
    for group, people in run.groups.items():
        for one in people:
            greatest = float(one["greatest_extinction"])
            if group in smoke:
                assert greatest == pytest.approx(smoke[group] * 0.1 * float(one["exit_time"]), abs=0.06)
    (asleep,) = run.groups["asleep"]
    rate = 2.764e-5 * 40000.0**1.036 * np.exp(0.1903 * 1.0 + 2.0004) / 7.1 + 1.0 / np.exp(8.13 - 0.54 * (20.9 - 15.0))
    assert float(asleep["stopped_at"]) == pytest.approx(60.0 * 0.5 / rate, rel=0.01)
    assert float(asleep["greatest_extinction"]) == 1.0
    person = int(asleep["person"])
    assert [row["gas_dose"] > "0.5" for row in run.people] == [k == person for k in range(len(run.people))]
    doses = [one["motion"][5] for _, here in run.frames for one in here if one["person"] == person]
    assert doses == sorted(doses)
    times = [time for time, _ in run.frames]
    assert doses[4] == pytest.approx(rate / 60.0 * times[4], rel=0.02)
    assert doses[-1] == pytest.approx(float(asleep["gas_dose"]), rel=1e-6)
    told = run.summary["conditions"]
    assert (told["dose"]["stopped"], told["dose"]["threshold"]) == (1, 0.5)
    assert told["greatest_extinction"] == max(float(one["greatest_extinction"]) for one in run.people)


def test_people_come_when_and_where_they_are_to(run):
    tables = {table["name"]: table["arrive"] for table in run.summary["case"]["people"] if table.get("arrive")}
    first = {}
    for time, here in run.frames:
        for one in here:
            first.setdefault(one["person"], (time, one))
    for name, people in run.groups.items():
        if name not in tables:
            assert {one["arrival_time"] for one in people} <= {"0.0"}
            continue
        came = sorted(float(one["arrival_time"]) for one in people if one["arrival_time"])
        times = tables[name].get("times") or []
        for time, wanted in zip(came, times, strict=False):
            assert wanted <= time <= wanted + 2.0
        if tables[name].get("rate"):
            assert tables[name]["from"] <= came[0] <= came[-1] <= tables[name]["to"] + 2.0
        for one in people:
            if one["arrival_time"]:
                seen, found = first[int(one["person"])]
                start = np.array([float(one["start_x"]), float(one["start_y"])])
                assert 0.0 <= seen - float(one["arrival_time"]) <= 0.5
                assert run.levels[found["level"]]["name"] == run.named(one["start_level"], one["start_piece"])
                way = tables[name].get("exit") or tables[name].get("portal")
                ends = {"back": ([14, 3.5], [14, 4.5]), "north": ([1, 0.8], [1, 2.2])}.get(way)
                assert ends is None or distance_to(np.ravel(ends), start) < 0.5
