"""A run that is started from the page, and what is told of it."""

import json
import os
import re
import socket
import time
from pathlib import Path

import pytest

import evac
from evac.base.errors import ResultError
from evac.cli.main import main
from evac.editor import Session
from evac.editor.runner import Runner


@pytest.fixture
def runners(house, tmp_path):
    """A function that looks at runs of the house."""
    made = []

    def making():
        made.append(Runner(house / "case.toml", house / "house.plan.toml", tmp_path / "result"))
        return made[-1]

    yield making
    for runner in made:
        runner.stop()
        runner.close()


def awaited(runner, is_so, seconds=120):
    """Return the first state for which something is so."""
    end = time.monotonic() + seconds
    while not is_so(state := runner.state()):
        assert time.monotonic() < end, state
        time.sleep(0.05)
    return state


def test_a_run_ends_with_its_answer_and_files(runners, tmp_path):
    runner = runners()
    assert runner.state() == {"phase": "none"}
    runner.begin("run")
    with pytest.raises(ResultError, match="being written"):
        runner.begin("run")
    ended = awaited(runner, lambda state: state["phase"] != "running")
    results = evac.read_results(tmp_path / "result")
    assert ended["phase"] == "ended"
    assert ended["answer"] == results.answer.lines()
    assert ended["status"] == results.verdict["status"]
    assert ended["files"] == ["replay.html"]
    assert runner.file("replay.html") == (tmp_path / "result/replay.html").read_bytes()
    assert runner.file("report.html") is runner.file("../house/case.toml") is runner.file("summary.json") is None


def test_a_run_is_found_again_and_stopped_by_another_one(house, runners, tmp_path):
    case = house / "case.toml"
    text = re.sub(r"uniform = \[0.0, 10.0\]", "uniform = [2e4, 2.1e4]", case.read_text())
    case.write_text(text.replace("duration = 3600.0", "duration = 3e4"))
    first, second = runners(), runners()
    first.begin("run")
    state = awaited(second, lambda state: state.get("people") and "ETA" in state["text"])
    assert {name: len(at) // 3 for name, at in state["people"].items()} == {"ground": 15, "first": 10}
    second.stop()
    for runner in (first, second):
        assert awaited(runner, lambda state: state["phase"] != "running")["phase"] == "ended"
    assert (tmp_path / "result/checkpoint.evac").exists()
    assert str(tmp_path / "result") in first.state()["stopped"]  # with the command that continues it


def test_a_lock_that_a_killed_run_has_left_is_nobodys(runners, tmp_path):
    lock = tmp_path / "result.lock"
    lock.write_text(json.dumps({"process": os.getpid(), "host": socket.gethostname(), "since": "now"}))
    runner = runners()
    assert runner.state() == {"phase": "none"}
    runner.stop()  # stops nobody, whatever process has the number now


def test_a_run_that_is_refused_says_why(house, runners):
    case = house / "case.toml"
    case.write_text(case.read_text().replace('area = "office"', 'area = "offise"'))
    runner = runners()
    runner.begin("run")
    failed = awaited(runner, lambda state: state["phase"] != "running")
    assert failed["phase"] == "failed"
    assert "'offise'" in failed["text"]


def test_a_plan_without_a_case_is_not_run(house):
    session = Session(house / "house.plan.toml")
    assert "case" not in session.document()["table"]
    assert not {"run", "repeat"} & session.orders({}).keys()
    session.close()


def test_results_are_where_evac_run_writes_them(house, monkeypatch):
    monkeypatch.chdir(house.parent)
    session = Session(Path("house"))
    assert main(["run", "house", "--set", "output.replay=false"]) == 0
    assert session.runner.state()["phase"] == "ended"
    session.close()
