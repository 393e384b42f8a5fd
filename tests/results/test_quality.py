"""What a run's numbers say against it: each with a bound of its own, and nothing of a run that is all right."""

import re

import numpy as np
import pytest
import shapely

import evac
from evac.analysis.lines import LineFlow
from evac.base.change import Change
from evac.results.ending import Observation
from evac.results.quality import chatter_warning, closings, contact_warnings, crushing_warning, flow_warnings

ALL_RIGHT = {
    "model": "dem",
    "parameters": {"stiffness": 1.2e5},
    "steps": 100,
    "greatest_overlap": 0.1,
    "greatest_overlap_at": {"time": 3.21, "person": 7, "level": "hall", "x": 9.5, "y": 3.0},
    "promised_overlap": 0.1,
    "unconverged_steps": 0,
    "greatest_residual": 5e-4,
    "failed_position_corrections": 0,
    "failed_solves": 0,
    "energy": {"driving_work": 1000.0, "contact_dissipation": 400.0, "contact_creation": 410.0},
}
RIGID = ("stiff",)
PLACE = r"person 7 at \(9\.50, 3\.00\) on level 'hall'"


def test_nothing_is_said_of_a_run_that_is_all_right():
    assert contact_warnings(ALL_RIGHT, RIGID) == ()
    assert contact_warnings(ALL_RIGHT | {"greatest_overlap": 0.0, "greatest_overlap_at": None}, RIGID) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"greatest_overlap": 0.101}, f"Bodies .*100 mm.*'dem'.*t = 3\\.21 s, {PLACE}: 101 mm"),
        ({"unconverged_steps": 3, "greatest_residual": 0.25}, "3 of 100 steps .*0.25 m/s"),
        ({"failed_position_corrections": 7}, "7 times"),
        ({"energy": {**ALL_RIGHT["energy"], "contact_creation": 411.0}}, "411 J.*400 J"),
    ],
)
def test_each_number_has_a_warning_of_its_own_and_how_to_fix_it(change, words):
    (line,) = contact_warnings(ALL_RIGHT | change, RIGID)
    assert re.search(words, line)
    assert re.search("smaller simulation.step|check for", line)
    assert ("set contact.model=stiff" in line) == ("greatest_overlap" in change)


@pytest.mark.parametrize("keepers", [None, ["walking", "headway"]])
def test_large_overlaps_are_told_with_people_period_place_and_remedies(keepers):
    seen = Observation(12, 2.0, 8.0, 4.0, 6.0, 7, 1, 9.5, 3.0, (0.155, 0.7))
    (line,) = contact_warnings(ALL_RIGHT | {"greatest_overlap": 0.155}, RIGID, keepers, seen)
    assert line.startswith("large overlaps: ")
    assert re.search(f"t = 2\\.0 and 8\\.0 s 12 people .*100 mm.*'dem'.*t = 3\\.21 s, {PLACE}: 155 mm", line)
    assert re.search(r"contact\.dem\.stiffness .* simulation\.step.*set contact\.model=stiff", line)
    assert ("set behaviours.walking={} or behaviours.headway={}" in line) == (keepers is not None)
    (line,) = contact_warnings(ALL_RIGHT | {"greatest_overlap": 0.155, "parameters": {}}, RIGID, keepers, seen)
    assert "stiffness" not in line


@pytest.mark.parametrize(("people", "who"), [(1, "1 person "), (12, "12 people ")])
def test_what_was_noticed_of_people_is_one_line_with_time_and_place(people, who):
    seen = Observation(people, 2.0, 8.0, 4.0, 6.0, 7, 1, 9.5, 3.0, (0.92, 0.19))
    line = chatter_warning(seen, ["cellar", "hall"], ["stiff"])
    assert re.search(f"t = 2\\.0 and 8\\.0 s {who}.*from 4\\.0 to 6\\.0 s, {PLACE}: .*0\\.19 m/s.*0\\.92 m/s", line)
    assert line.startswith("chattering contacts: ")
    assert "set contact.model=stiff" in line
    pressed = Observation(people, 2.0, 8.0, 4.0, 6.0, 7, 1, 9.5, 3.0, (3140.0, 7850.0))
    line = crushing_warning(pressed, ["cellar", "hall"], ["gaps", "file"])
    assert re.search(f"t = 2\\.0 and 8\\.0 s {who}.*from 4\\.0 to 6\\.0 s, {PLACE}: 7\\.8 kN/m, 3\\.1 kN", line)
    assert "set behaviours.gaps={} or behaviours.file={}" in line
    assert "behaviour" not in crushing_warning(pressed, ["cellar", "hall"], None)


def test_flows_beyond_measured_ones_have_a_warning_each_and_stairs_one_for_all_their_ends():
    plan = evac.Plan()
    plan.storey("low", [shapely.box(0, 0, 8, 2)])
    plan.storey("high", [shapely.box(12, 0, 20, 2)], z=2.4)
    plan.stair("west", "low", [(8, 0), (8, 1)], "high", [(12, 0), (12, 1)])
    plan.exit("out", "low", [(0, 0.5), (0, 1.5)])
    building = plan.building()
    (flight,) = (level for level in building.levels if level.stair)

    def line(kind, flow, name="way", level=flight.index, is_back=()):
        person, time = np.arange(40) // 2, np.arange(40) // 2 / flow  # there, and once more
        return LineFlow(kind, name, (level,), np.zeros((1, 4)), 1.0, ("", ""), person, time, np.arange(40) % 2 == 0)

    flows = [
        *(line(kind, flow, f"{kind} {flow}", 0) for kind in ("exit", "door") for flow in (2.79, 2.82)),
        *(line("portal", flow) for flow in (1.15, 1.18, 1.21)),
        line("line", 9.0),
    ]
    warned = flow_warnings(building, (), flows, ["gaps"])
    assert [re.findall(r"([\d.]+) people .* passed (.*), at most ([\d.]+)", line) for line in warned] == [
        [("2.82", "exit 'exit 2.82'", "2.8")],
        [("2.82", "door 'door 2.82'", "2.8")],
        [("1.21", "stair 'west'", "1.16")],
    ]
    assert all(line.startswith("flow higher than measured: ") and "set behaviours.gaps={}" in line for line in warned)
    assert "flows.csv" in flow_warnings(building, (), flows, None)[0]
    stopped = Change(5.0, "move", "west", {"value": False})
    assert not [line for line in flow_warnings(building, (stopped,), flows, None) if "west" in line]


def test_an_exit_that_few_leave_by_while_others_queue_has_a_warning(tmp_path):
    plan = evac.Plan()
    plan.storey("room", [shapely.box(0, 0, 8, 2)])
    plan.exit("out", "room", [(0, 0.65), (0, 1.35)])
    crowd = [(x, y) for x in (1.5, 2.0, 2.5, 3.0) for y in (0.4, 0.9, 1.4)]
    post = {"name": "post", "positions": [(0.3, 1.0)], "level": "room", "behaviours": {"response_time": {"time": 40.0}}}
    case = {
        "building": plan,
        "contact": {"model": "nsm2"},
        "people": [{"name": "crowd", "positions": crowd, "level": "room"}, post],
        "behaviours": {"walking": {}, "response_time": {}},
    }
    results = evac.run(evac.load(case), tmp_path / "post")
    (line,) = (line for line in results.quality_warnings if line.startswith("flow lower than measured: "))
    words = re.search(r"([\d.]+) people .* in ([\d.]+) s .* ([\d.]+) and ([\d.]+) s", line)
    flow, seconds, since, until = map(float, words.groups())
    passed = ((since < results.crowd.exit_time) & (results.crowd.exit_time <= until)).sum()
    assert passed - 3 < flow * seconds * 0.7 < passed + 0.2  # of whom the last leave when the queue is short
    assert "exit 'out'" in line
    assert evac.read_results(tmp_path / "post").quality_warnings == results.quality_warnings
    case["people"][1]["behaviours"]["response_time"]["time"] = 5.0
    results = evac.run(evac.load(case), tmp_path / "none")
    assert not [line for line in results.quality_warnings if line.startswith("flow lower")]
    case["people"].pop()
    controlled = evac.load(case, {"building.controls": {"out": {"every": 3.0}}})
    results = evac.run(controlled, tmp_path / "controlled")
    assert np.diff(np.sort(results.crowd.exit_time)).min() >= 3.0  # which is meant to be slow
    assert not [line for line in results.quality_warnings if line.startswith("flow lower")]


def test_closings_in_force_are_those_that_nothing_has_undone():
    changes = [("close", "a", {}), ("close", "b", {"value": "bodies"}), ("no_entry", "c", {}), ("open", "a", {})]
    changes += [("no_entry", "d", {}), ("no_entry", "d", {"value": False}), ("slow", "b", {"value": 0.5})]
    made = [evac.Change(float(k), kind, what, values) for k, (kind, what, values) in enumerate(changes)]
    assert closings(made) == ["'b' closed for bodies alone at 1 s", "'c' closed to those who would enter at 2 s"]


CLOSED = [{"time": 0.0, "kind": "close", "target": "far"}]


@pytest.mark.parametrize(
    ("group", "events", "length", "is_told"),
    [
        ({}, [], 12.0, True),
        ({"strategy": "quickest"}, [], 12.0, False),
        ({"exits": ["near"]}, [], 12.0, False),
        ({}, CLOSED, 12.0, False),
        ({}, [], 60.0, False),  # too far to be reached before the queue is over
    ],
)
def test_an_exit_that_nobody_leaves_by_while_people_queue_at_another_is_told(group, events, length, is_told):
    plan = evac.Plan()
    plan.storey("room", [shapely.box(0, 0, length, 5)])
    plan.exit("near", "room", [(0, 2.1), (0, 2.9)])
    plan.exit("far", "room", [(length, 1.5), (length, 3.5)])
    plan.area("start", "room", shapely.box(0.5, 0.2, 5, 4.8))
    case = {
        "building": plan,
        "contact": {"model": "nsm2"},
        "people": [{"name": "crowd", "area": "start", "number": 50, "speed": 1.3, **group}],
        "event": events,
        "behaviours": {"walking": {}},
    }
    lines = [line for line in evac.run(evac.load(case)).remarks if "exit 'far'" in line and "exit 'near'" in line]
    assert len(lines) == is_told


def test_who_is_held_up_by_people_at_a_refuge_is_told_so():
    plan = evac.Plan()
    plan.storey("hall", shapely.box(0, 0, 12, 1.0))
    plan.exit("out", "hall", [(0, 0.15), (0, 0.85)])
    plan.area("niche", "hall", shapely.box(4, 0, 6, 1))
    people = [
        {"name": "wide", "positions": [[5.0, 0.5]], "level": "hall", "radius": 0.42, "turns": False},
        {"name": "late", "positions": [[10.0, 0.5]], "level": "hall", "radius": 0.22},
    ]
    content = {"building": plan, "people": people, "place": [{"name": "niche", "kind": "refuge", "area": "niche"}]}
    models = {"contact": {"model": "nsm2"}, "behaviours": {"walking": {}}, "simulation": {"no_progress": 12.0}}
    with pytest.warns(evac.RunWarning):
        results = evac.run(evac.load(content | models))
    (line,) = [line for line in results.remarks if "without progress" in line]
    assert line.endswith(
        "people at refuge 'niche' stand in the way: draw its area beside the ways of others, or larger"
    )


def test_irritants_are_told_from_the_concentration_of_incapacitation_on(make_results):
    def lines(*greatest):
        results = make_results(exposure={"greatest_irritants": np.array([*greatest, 0.0, 0.0, 0.0])})
        return [line for line in results.remarks if "irritants" in line]

    assert lines(0.99, 0.5) == []
    (line,) = lines(1.0, 0.5)
    assert line.startswith("1 person in irritants")
    assert "up to 1 times" in line
    (line,) = lines(1.0, 2.5)
    assert line.startswith("2 people in irritants")
    assert "up to 2.5 times" in line
