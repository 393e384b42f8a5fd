"""Flows of a run, in all its files, against its other tables."""

import csv
import json

import numpy as np
import pytest

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


def test_summary_pictures_and_what_is_read_have_the_same_flows(folder):
    results = evac.read_results(folder)
    summary = json.loads((folder / "summary.json").read_text())
    assert [(use["kind"], use["name"]) for use in summary["flows"]] == [("exit", "door"), ("line", "across")]
    assert results.flow_totals == summary["flows"]
    assert summary["flows"][0]["flow"] == summary["exits"]["door"]["flow"]
    shown = {flow.name: flow.flow for flow in recorded_flows(results.trajectory)}
    assert shown["door"] == summary["flows"][0]["flow"]
    assert shown == {flow.name: flow.flow for flow in results.flows}
