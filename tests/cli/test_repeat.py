import csv
import json
import os
import re
import signal
import subprocess
import sys

import pytest


def test_repeat_runs_seeds_and_says_how_certain_the_result_is(evac, tmp_path, capsys):
    few = ("people.people.number=5", "output.every=0.5")
    assert evac("repeat", "square_room", "--runs", "3", "--jobs", "1", "--seed", "4", "--set", *few) == 0
    with (tmp_path / "square_room-runs" / "runs.csv").open() as file:
        assert [row["seed"] for row in csv.DictReader(file)] == ["4", "5", "6"]
    out = capsys.readouterr().out
    assert "in 3 of 3 runs" in out
    found = json.loads((tmp_path / "square_room-runs" / "summary.json").read_text())["last_out"]
    lines = [re.split(r"\s{2,}", line.strip()) for line in out.splitlines()]
    assert ["mean", f"{found['over_complete_runs']['mean']:.2f} s", "3 of 3 runs, in which everybody got out"] in lines
    assert ["percentile 95", f"{found['over_runs']['percentile_95']:.2f} s", "3 of 3 runs"] in lines


@pytest.mark.parametrize("command", [("run",), ("repeat", "--runs", "1", "--jobs", "1")])
def test_people_who_are_unusual_are_told_of(evac, capsys, command):
    """70 kg in grams."""
    changes = ("people.people.mass=70000", "people.people.number=2", "simulation.duration=0.1", "output.picture=false")
    evac(command[0], "square_room", *command[1:], "--set", *changes)
    assert "warning: people.people.mass is 7e+04 to 7e+04 kg, which is unusual" in capsys.readouterr().err


@pytest.mark.parametrize("command", [("run",), ("repeat", "--runs", "1", "--jobs", "1")])
def test_a_run_that_is_not_to_be_trusted_says_so(evac, capsys, command):
    """Steps of 0.1 s throw people about at a door."""
    changes = ("contact.model=nsm2", "simulation.step=0.1", "simulation.seed=4", "output.picture=false")
    assert evac(command[0], "square_room", *command[1:], "--set", *changes) == 0
    assert re.search("warning: .*contacts made [0-9.]+ J, more than", capsys.readouterr().err)


def test_runs_with_people_left_are_named(evac, capsys):
    assert evac("repeat", "square_room", "--runs", "2", "--jobs", "1", "--set", "simulation.duration=1.0") == 3
    out, err = capsys.readouterr()
    assert "seeds 1, 2" in err
    assert re.search(r"percentile 50 +not reached: people are left in 2 of 2 runs +2 of 2 runs", out)
    assert not re.search(r"^mean ", out, re.MULTILINE)


def heed_interrupts():
    """Undo that whoever runs the tests may have SIGINT ignored, which processes inherit."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to a group")
def test_ctrl_c_stops_all_processes_at_once(tmp_path):
    words = [sys.executable, "-m", "evac", "repeat", "primary_school", "--runs", "500", "--jobs", "2"]
    process = subprocess.Popen(
        words, cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=heed_interrupts
    )
    lines = [process.stderr.readline(), process.stderr.readline()]
    assert lines == ["runs: 500, seeds from 1 on\n", "1/500 runs\n"]
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=120)  # 500 runs take longer
    assert process.returncode == 130
    assert "Traceback" not in err
    assert err.endswith("evac: interrupted\n")
