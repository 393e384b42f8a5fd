"""Numbers of a run, wherever they are shown, against code that reads its files with nothing of evac."""

import re

import numpy as np
import pytest

import evac
from evac.cli.outcome import show_answer, show_results
from evac.pictures.colouring import colouring
from evac.pictures.palette import NOTHING, rgb
from evac.pictures.scales import PEOPLE
from evac.report.of_run import run_report
from evac.report.sections import Places
from tests.replay.recount import Map, Recount, fixed, rows_of, steady, time_of
from tests.report.conftest import Page

#: Fewest numbers of each kind that are compared in each run.
PICKS = 40

#: A browser rounds ties away from zero.
TIE = 1e-9

HALL = {
    "storeys": [
        {"name": "hall", "polygons": [[[0, 0], [8, 0], [8, 8], [0, 8]], [[8.2, 0], [14, 0], [14, 8], [8.2, 8]]]},
        {"name": "gallery", "z": 3.0, "polygons": [[[0, 0], [14, 0], [14, 8], [0, 8]]]},
    ],
    "doors": [{"name": "inner", "storey": "hall", "segment": [[8.1, 3], [8.1, 4.2]]}],
    "stairs": [
        {
            **{"name": "north", "lower": "hall", "lower_edge": [[1, 0.8], [1, 2.2]], "upper": "gallery"},
            **{"length": 5.5, "direction": [1, 0]},
        }
    ],
    "exits": [
        {"name": "main", "storey": "hall", "segment": [[0, 3.5], [0, 4.7]]},
        {"name": "back", "storey": "hall", "segment": [[14, 3.5], [14, 4.5]]},
    ],
    "areas": [
        {"name": "loft", "storey": "gallery", "polygon": [[8, 1], [13, 1], [13, 7], [8, 7]]},
        {"name": "room", "storey": "hall", "polygon": [[9, 1], [13, 1], [13, 7], [9, 7]]},
        {"name": "yard", "storey": "hall", "polygon": [[2, 3], [7, 3], [7, 7.5], [2, 7.5]]},
    ],
}
LINE = {"name": "middle", "level": "hall", "segment": [[3, 0.1], [3, 7.8]]}
CONTACT = {"contact": {"model": "nsm2"}, "simulation": {"duration": 120.0}, "line": [LINE]}
CROWD = {"radius": {"uniform": [0.2, 0.25]}, "speed": {"uniform": [1.0, 1.6]}}

#: Stairs, groups that respond at different times, quickest ways, exits that close, arrivals, gatherings, smoke.
CASES = {
    "school": "primary_school",
    "groups": {
        **{"title": "Two groups", "building": {"plan": HALL}, **CONTACT},
        "people": [
            {"name": "early", "number": 25, "area": "room", **CROWD},
            {"name": "late", "number": 20, "area": "loft", "behaviours": {"response_time": {"time": 4.0}}, **CROWD},
        ],
        "behaviours": {"response_time": {"time": {"uniform": [0.0, 3.0]}}},
    },
    "events": {
        **{"title": "An exit closes", "building": {"plan": HALL}, **CONTACT, "behaviours": {"walking": {}}},
        "people": [
            {"name": "quick", "number": 30, "area": "room", "strategy": "quickest", **CROWD},
            {"name": "above", "number": 12, "area": "loft", **CROWD},
        ],
        "event": [
            {"time": 6.0, "kind": "close", "target": "back"},
            {"time": 9.0, "kind": "slow", "target": "room", "value": 0.7},
        ],
    },
    "arrivals": {
        **{"title": "A platform", "building": {"plan": HALL}, **CONTACT},
        "people": [
            {"name": "guests", "number": 25, "area": "loft", **CROWD},
            {"name": "train", "level": "hall", "arrive": {"rate": 1.0, "from": 1.0, "to": 15.0}, **CROWD},
            {"name": "staff", "number": 3, "area": "room", "leave": False, **CROWD},
        ],
    },
    "places": {
        **{"title": "A class gathers", "building": {"plan": HALL}, **CONTACT},
        "place": [{"name": "safe", "kind": "assembly", "area": "loft"}],
        "people": [
            {"name": "class", "number": 25, "area": "room", "behaviours": {"together": {"gather": "yard"}}, **CROWD},
            {"name": "guests", "number": 10, "area": "room", "assembly": ["safe"], **CROWD},
        ],
        "behaviours": {"walking": {}, "together": {"places": ["yard"]}},
        "event": [{"time": 4.0, "kind": "one_way", "target": "inner", "value": "yard"}],
    },
    "fire": "office_fire",
}
FAST = ("groups",)


@pytest.fixture(
    scope="module", params=[name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def run(request, tmp_path_factory):
    """A run of a case: what was recorded of it."""
    folder = tmp_path_factory.mktemp("truth") / "result"
    changes = {"output.picture": False, "output.animation": False, "simulation.seed": 3}
    evac.run(evac.load(CASES[request.param], changes), folder)
    return Recount(folder)


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
            "Level": run.levels[one["level"]]["name"],
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
            if name == "contact_force" and value < 10:
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
    words = r"Longest queue, (.*): \d+ \w+ waited .*, at most (\d+) at once, at (.*) s around \((.*), (.*)\) on '(.*)'"
    place, most, time, x, y, level = re.fullmatch(words, run.longest_queue()).groups()
    browser.show(run.folder / "replay.html")
    browser.run("document.querySelector('#answer button').click()")
    browser.settle()
    assert browser.run("replay.state.time") == pytest.approx(float(time), abs=0.051)
    assert browser.text("#labels .event") == f"longest queue, {place}: {most} wait"
    assert browser.text("#events [aria-current=true]").endswith(f"longest queue, {place}: {most} wait")
    at, found = browser.run(
        """(() => {
          const { longest: { at }, origin, building } = replay.record;
          return [[at.x + origin[0], at.y + origin[1]], building.levels[at.level].name];
        })()"""
    )
    assert found == level
    np.testing.assert_allclose(at, [float(x), float(y)], atol=0.051)
    browser.press("n", "KeyN")
    assert browser.text("#labels .event") != f"longest queue, {place}: {most} wait"


def answer_of(run):
    """Lines of the answer by kind, as they have to be."""
    times, leaving = run.exit_times(), run.leaving
    most, complete = time_of(times, len(leaving), 95), run.summary["ended"].startswith("everybody")
    share = "fewer than 95 % got out" if most is None else f"95 % are out after {most:.2f} s"
    last = "Evacuation time" if complete else "Last out after"
    exits = []
    closed = {one["what"] for one in run.summary["changes"] if one["kind"] == "close"}
    for way in sorted(run.building["exits"], key=lambda one: -len(run.exit_times(one["name"]))):
        out = run.exit_times(way["name"])
        flow = steady(out)
        exits.append(
            f"Exit {way['name']!r}{' (closed)' * (way['name'] in closed)}: {len(out)} people"
            + (f" by {out[-1]:.2f} s" if out else "")
            + (f", {flow:.2f}/s ({flow / way['width']:.2f}/s/m)" if flow else "")
        )
    number = f"{len(times)} of {len(run.people)} people out"
    if run.at_places:
        number += f", {len(run.at_places)} at a safe place"
    if stays := len(run.people) - len(run.leaving) - len(run.at_places):
        number += f", {stays} who do not leave"
    ended, after = run.summary["ended"].capitalize(), f" after {run.frames[-1][0]:.2f} s"
    return {
        "Answer": f"{ended}: {number}" if complete else f"NOT everybody is out{after} ({ended.lower()}): {number}",
        "Evacuation": f"{last} {times[-1]:.2f} s; {share}",
        "Exits": exits,
        "Queues": run.longest_queue(),
    }


def test_every_number_of_the_terminal_is_that_of_the_trajectory(run, capsys):
    answer, results = answer_of(run), evac.read_results(run.folder)
    show_answer(results)
    title, *lines = capsys.readouterr().out.splitlines()
    assert title == run.header["title"]
    told = [answer["Answer"], answer["Evacuation"], *answer["Exits"], answer["Queues"]]
    assert [line for line in lines if line in told] == told
    others = [line for line in lines if line not in told]
    stays = len(run.people) - len(run.leaving) - len(run.at_places)
    staying = [stays] * (stays > 0)
    kinds = [len(run.summary[key]) for key in ("quality_warnings", "warnings") if run.summary[key]]
    changes = [number for one in run.summary["changes"] for number in (one["time"], *one["values"].values())]
    changes = [number for number in changes if isinstance(number, float | int)]
    numbers = [float(number) for line in others for number in re.findall(r"\d+(?:\.\d+)?", line)]
    stay_there = [len(place["people"]) for place in run.summary["places"]]
    assert sorted(numbers) == sorted([*changes, *staying, *kinds, *stay_there])
    show_results(results)
    rows = [re.split(r"\s{2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]
    for way in run.building["exits"]:
        out, (row,) = (
            run.exit_times(way["name"]),
            [row for row in rows if row[0].partition(" (closed)")[0] == way["name"]],
        )
        flow = steady(out)
        values = [len(out), out[-1] if out else None, way["width"], flow, flow and flow / way["width"]]
        assert row[1:] == ["-" if value is None else f"{value:.4g}" for value in values]
    for name, levels in run.stairs.items():
        (row,) = [row for row in rows if row[0] == name and len(row) == 4]
        assert row[1:] == ["-" if value is None else f"{value:.4g}" for value in run.use_of(levels)]
    facts = {row[0]: row[1] for row in reversed(rows) if len(row) == 2}
    responses = sorted(time for one in run.people if (time := float(one["response_time"])) < np.inf)
    spread = f"{responses[0]:.4g} to {responses[-1]:.4g} s"
    assert facts["response times"] == (spread if responses[-1] else "none: everybody starts at 0 s")
    assert facts["people"] == str(len(run.people))
    assert facts["out"] == str(len(run.exit_times()))
    assert facts["last out"].startswith(f"{run.exit_times()[-1]:.2f} s")
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
        rows["Exits; the flow", way["name"]] = [len(out), *ends, fixed(way["width"], 2), *flows]
    inner = {level for levels in run.stairs.values() for level in levels}
    places = {level["name"]: {level["name"]} for level in run.levels if level["name"] not in inner} | run.stairs
    for name, levels in places.items():
        people, most, last = run.use_of(levels)
        rows["Use, and time", name] = [people, most, fixed(last, 1, "not cleared" if people else "-")]
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
            rows[f"people: {', '.join(names)}", what] = values
    return rows


def test_the_report_has_the_numbers_of_the_trajectory(run):
    page = Page(run_report(run.folder, places=Places(maps=())))
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
    assert waited > 1.0


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
        k, one = first[person]
        if k == 0:
            place = np.array(one["motion"][:2]) + run.origin
            assert place == pytest.approx([float(row["start_x"]), float(row["start_y"])], abs=1e-5)
            assert run.levels[one["level"]]["name"] == row["start_level"]
        k, one = last[person]
        if row["exit_time"]:
            assert run.frames[k][0] <= float(row["exit_time"]) <= run.frames[k + 1][0]
        else:
            assert run.levels[one["level"]]["name"] == row["end_level"]
    levels = {one["name"]: {run.levels[index]["name"] for index in one["levels"]} for one in run.building["portals"]}
    on = [{one["person"]: run.levels[one["level"]]["name"] for one in here} for _, here in run.frames]
    for row in run.crossings:
        person, time = int(row["person"]), float(row["time"])
        assert (
            next(level for since, _, own, level in run.stays if own == person and since == time)
            in levels[row["portal"]]
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
