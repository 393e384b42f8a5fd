"""Many runs: seeds in order whatever the processes, statistics against exact answers, files that hold them."""

import csv
import json
import math

import numpy as np
import pytest

import evac
from evac.ensemble import Ensemble, Run, in_processes, run_many


@pytest.fixture(scope="module")
def case():
    return evac.load("square_room", {"people.people.number": 6, "simulation.seed": 5, "output.every": 0.5})


def made(case, *times, ended="everybody out"):
    runs = tuple(Run(seed, ended, 10.0, np.array(time)) for seed, time in enumerate(times))
    return Ensemble(case, runs)


def test_runs_are_those_of_their_seeds(case):
    ensemble = run_many(case, 3, workers=2)
    assert [run.seed for run in ensemble.runs] == [5, 6, 7]
    for run in ensemble.runs:
        alone = evac.run(case.change({"simulation.seed": run.seed}))
        assert alone.crowd.exit_time.tobytes() == run.exit_time.tobytes()
    assert len({run.exit_time.tobytes() for run in ensemble.runs}) == 3


def test_statistics_of_the_last_one_out(case):
    found = made(case, [1.0, 2.0], [4.0, 3.0], [6.0, 1.0]).last_out()
    assert (found["mean"], found["least"], found["percentile 50"], found["greatest"]) == (4.0, 2.0, 4.0, 6.0)
    assert found["standard deviation"] == 2.0
    # Student's t for two degrees of freedom and 95 %: 4.303.
    assert found["mean, 95 % interval to"] - found["mean"] == pytest.approx(4.303 * 2.0 / math.sqrt(3.0), rel=1e-3)
    assert made(case, [math.nan, 1.0], ended="no progress").last_out() == {}
    assert "standard deviation" not in made(case, [1.0, 2.0]).last_out()


def test_egress_counts_who_is_out_at_each_time(case):
    egress = made(case, [1.0, 2.0], [2.0, math.nan]).egress()
    assert egress["time"][:6].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
    assert egress["mean"][:6].tolist() == [0.0, 0.0, 0.5, 0.5, 1.5, 1.5]
    assert egress["percentile 50"][-1] == 1.5


def test_the_folder_holds_runs_curves_and_statistics(case, tmp_path):
    ensemble = made(case, [1.0, 2.0], [4.0, math.nan])
    ensemble.write(tmp_path / "r")
    with (tmp_path / "r" / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[1] == {"seed": "1", "ended": "everybody out", "out": "1", "last_out": "4.0"}
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert (summary["runs"], summary["people"]) == (2, 2)
    assert summary["last_out"]["greatest"] == 4.0
    assert (tmp_path / "r" / "egress.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "r" / "egress.csv").open() as file:
        assert next(csv.reader(file)) == ["time", "mean", "percentile 5", "percentile 50", "percentile 95"]
    ensemble.write(tmp_path / "r")  # its own results may be overwritten


@pytest.mark.parametrize("workers", [1, 2])
def test_processes_keep_the_order_of_the_items(workers):
    # A function that a new process can import: `tests` is importable only where pytest runs.
    assert in_processes(math.factorial, [3, 1, 2], workers) == [6, 1, 2]
