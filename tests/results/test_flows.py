"""Flows of a run, in all its files, against its other tables."""

import csv
import json
import shutil

import numpy as np
import pytest
from shapely import box

import evac
from evac.results.reading import recorded_flows

LINE = {"name": "across", "level": "room", "segment": [[4.0, 0.0], [4.0, 5.0]]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("flows") / "result"
    quiet = {"output.picture": False, "output.animation": False, "output.replay": False}
    evac.run(evac.load("square_room", {"line": [LINE], **quiet}), place)
    return place


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_flows_are_those_of_the_people(folder):
    people, rows = rows_of(folder / "people.csv"), rows_of(folder / "flows.csv")
    assert list(rows[0]) == ["time", "kind", "name", "direction", "count", "flow", "specific_flow"]
    door = [row for row in rows if row["kind"] == "exit"]
    exit_times = np.array([float(person["exit_time"]) for person in people])
    before = 0.0
    for row in door:
        time = float(row["time"])
        assert int(row["count"]) == (exit_times <= time).sum()
        flow = ((exit_times > before) & (exit_times <= time)).sum() / (time - before)
        assert float(row["flow"]) == pytest.approx(flow)
        assert float(row["specific_flow"]) == pytest.approx(flow / 0.82)
        before = time
    behind = sum(float(person["start_x"]) < 4.0 for person in people)
    passed = [int(row["count"]) for row in rows if row["name"] == "across"]
    assert passed[-1] == behind  # everybody who starts on the other side of the line


def test_summary_pictures_and_what_is_read_have_the_same_flows(folder, tmp_path):
    results = evac.read_results(folder)
    summary = json.loads((folder / "summary.json").read_text())
    assert [(use["kind"], use["name"]) for use in summary["flows"]] == [("exit", "door"), ("line", "across")]
    assert results.flow_totals == summary["flows"]
    assert summary["flows"][0]["flow"] == summary["exits"]["door"]["flow"]
    shown = {flow.name: flow.flow for flow in recorded_flows(results.trajectory)}
    assert shown["door"] == summary["flows"][0]["flow"]
    assert shown == {flow.name: flow.flow for flow in results.flows}
    shutil.copy(folder / "trajectory.evac", tmp_path)  # as of a killed run
    assert [flow.name for flow in recorded_flows(evac.read_trajectory(tmp_path))] == ["across"]


def test_people_from_stairs_and_from_the_floor_merge_in_a_row_of_the_tables():
    plan = evac.Plan()
    for k, name in enumerate(("ground", "first", "second")):
        plan.storey(name, box(0, 0, 16, 6), z=3.0 * k)
    plan.stair("low", "ground", [(5, 1), (5, 2.2)], "first", length=5.0, direction=(1, 0))
    plan.stair("high", "first", [(5, 4), (5, 5.2)], "second", length=5.0, direction=(1, 0))
    plan.exit("out", "ground", [(0, 2), (0, 4)])
    plan.exit("roof", "second", [(16, 2), (16, 4)])
    people = [{"name": f"on {one}", "level": one, "number": 6, "radius": 0.2} for one in ("first", "second")]
    people = [one | {"exits": ["out"]} for one in people]
    at_once = {"behaviours": {"response_time": {"time": 0.0}}}
    back = {
        "name": "turns back",
        "positions": [[4.0, 4.6]],
        "level": "first",
        "exits": ["roof"],
        "radius": 0.2,
    } | at_once
    turns = {"time": 3.0, "kind": "strategy", "target": "turns back", "value": ["out"]}
    late = {"response_time": {"time": {"uniform": [0.0, 20.0]}}}
    table = {"building": plan, "people": [*people, back], "event": [turns], "behaviours": late}
    results = evac.run(evac.load(table | {"contact": {"model": "nsm1"}}), progress=False)
    assert results.evacuated == 13
    assert results.stairs["high"]["people"] == 7  # with the one who turns back on it
    ((*place, from_stairs, from_floor, share),) = results.tables["merging"]
    assert (place, from_stairs, from_floor) == (["low", "first"], 6, 7)
    (top,) = (one for one in results.building.portals if one.name == "low - first")
    person, portal, time = results.crossings
    entered = {p: float(time[(person == p) & (portal == top.index)][0]) for p in range(13)}
    rows = {group.name: group.rows.tolist() for group in results.groups}
    floor = sorted(entered[p] for name in ("on first", "turns back") for p in rows[name])
    stairs = sorted(entered[p] for p in rows["on second"])
    since, until = max(floor[0], stairs[0]), min(floor[-1], stairs[-1])
    both = [sum(since <= t <= until for t in times) for times in (floor, stairs)]
    assert share == (pytest.approx(100.0 * both[0] / sum(both)) if both[0] else None)
