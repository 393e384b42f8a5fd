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
    summary = json.loads((tmp_path / "square_room-runs" / "summary.json").read_text())
    found = summary["points"][0]["statistics"]
    lines = [re.split(r"\s{2,}", line.strip()) for line in out.splitlines()]
    mean, (_, median, _) = found["mean"], found["percentiles"]
    assert ["mean", f"{mean['value']:.2f}", f"{mean['low']:.2f} to {mean['high']:.2f}", "3 runs"] in lines
    note = "no 95 % interval below 6 runs"
    assert ["percentile 50", f"{median['value']:.2f}", "-", f"3 runs; {note}"] in lines


def test_repetitions_of_populations(evac, tmp_path, capsys):
    few = ("people.people.number=4", "output.picture=false")
    assert evac("repeat", "square_room", "--runs", "4", "--repetitions", "2", "--jobs", "1", "--set", *few) == 0
    assert "populations" in capsys.readouterr().out
    with (tmp_path / "square_room-runs" / "runs.csv").open() as file:
        assert [row["population_seed"] for row in csv.DictReader(file)] == ["1", "1", "2", "2"]
    assert evac("repeat", "square_room", "--imo", "--runs", "4") == 2


def test_half_the_step_is_shown_beside_the_interval(evac, tmp_path, capsys):
    few = ("people.people.number=1", "output.picture=false", "simulation.step=0.1")
    assert evac("repeat", "square_room", "--runs", "8", "--check-step", "--jobs", "1", "--set", *few, "--out", "r") == 0
    out, err = capsys.readouterr()
    change = json.loads((tmp_path / "r" / "summary.json").read_text())["step_change"]
    assert change["high"] < 0.0
    bounds = rf"\{change['low']:+.2f} to \{change['high']:+.2f}"
    assert re.search(rf"change .*mean +\{change['value']:+.2f} +{bounds} +8 pairs", out)
    assert re.search(r"evac: .*simulation\.step=0\.05", err)
    assert evac("report", "r") == 0
    assert f"{change['value']:+.2f} (" in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")


def test_failed_runs_are_named_and_the_status_is_an_error(evac, tmp_path, capsys):
    explicit = ("simulation.driving=explicit", "people.people.tau={uniform=[0.002, 0.06]}")
    quick = (*explicit, "people.people.number=5", "output.picture=false")
    command = ("repeat", "square_room", "--runs", "10", "--seed", "5", "--jobs", "1", "--out", "r", "--set", *quick)
    assert evac(*command) == 2
    out, err = capsys.readouterr()
    with (tmp_path / "r" / "runs.csv").open() as file:
        failed = [row["seed"] for row in csv.DictReader(file) if row["ended"] == "failed"]
    assert re.search(rf"failed +{len(failed)} more runs", out)
    assert re.search(rf"failed: seed {failed[0]}: .*smallest tau", err)
    assert evac(*command, "--resume") == 2
    assert evac("report", "r") == 0


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
    assert re.search(r"evac: interrupted\n.*running has \d+ runs", err)
