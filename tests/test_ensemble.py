"""Many runs: seeds in order whatever the processes, statistics against exact answers, files that hold them."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

import evac
from evac.ending import EVERYBODY_OUT
from evac.ensemble import Ensemble, Run, in_processes, mean_interval, percentile, run_many
from evac.errors import PluginError, ScenarioError


@pytest.fixture(scope="module")
def case():
    return evac.load("square_room", {"people.people.number": 6, "simulation.seed": 5, "output.every": 0.5})


def made(case, *times):
    """Return runs in which people leave at the times given, NaN: not at all."""
    ends = ["no progress" if np.isnan(time).any() else EVERYBODY_OUT for time in times]
    return Ensemble(case, tuple(Run(k, ends[k], 10.0, (), np.array(time)) for k, time in enumerate(times)))


def test_runs_are_those_of_their_seeds(case):
    ensemble = run_many(case, 3, workers=2)
    assert [run.seed for run in ensemble.runs] == [5, 6, 7]
    for run in ensemble.runs:
        alone = evac.run(case.change({"simulation.seed": run.seed}))
        assert alone.crowd.exit_time.tobytes() == run.exit_time.tobytes()
    assert len({run.exit_time.tobytes() for run in ensemble.runs}) == 3


def test_progress_is_told_run_by_run(case):
    told = []
    run_many(case, 2, workers=1, progress=lambda done, runs: told.append((done, runs)))
    assert told == [(1, 2), (2, 2)]


def test_no_runs_and_no_workers_are_refused(case):
    with pytest.raises(ScenarioError, match="0 and None"):
        run_many(case, 0)
    with pytest.raises(ScenarioError, match="2 and -1"):
        run_many(case, 2, workers=-1)


def test_a_run_that_fails_tells_its_seed(tmp_path):
    path = tmp_path / "odd.py"
    path.write_text(
        "from evac import Behaviour, hookimpl\nevac_interface = 2\n"
        "class Odd(Behaviour):\n"
        '    """Fails."""\n'
        "    name = 'odd'\n"
        "    def act(self, crowd, time):\n"
        "        raise ValueError('oops')\n"
        "@hookimpl\n"
        "def evac_behaviours():\n"
        "    return [Odd]\n"
    )
    case = evac.load("square_room", {"behaviours.odd": {}, "simulation.seed": 8}, plugin_files=[path])
    with pytest.raises(PluginError, match="oops") as caught:
        run_many(case, 1, workers=1)
    assert caught.value.__notes__ == ["in the run with simulation.seed = 8"]


def test_statistics_of_the_last_one_out(case):
    found = made(case, [1.0, 2.0], [4.0, 3.0], [6.0, 1.0]).last_out()
    assert found["over_runs"] == {
        "runs": 3,
        "least": 2.0,
        "greatest": 6.0,
        "percentile_5": pytest.approx(2.2),
        "percentile_50": 4.0,
        "percentile_95": pytest.approx(5.8),
    }
    mean = found["over_complete_runs"]
    assert (mean["runs"], mean["mean"], mean["standard_deviation"]) == (3, 4.0, 2.0)
    # Student's t for two degrees of freedom and 95 %: 4.303.
    assert math.log(mean["mean_to"] / 4.0) == pytest.approx(
        4.303 * math.sqrt(math.log(1.0 + 4.0 / (3 * 16.0))), rel=1e-3
    )
    assert mean["mean_from"] * mean["mean_to"] == pytest.approx(16.0, rel=1e-12)
    assert made(case, [1.0, 2.0]).last_out() == {  # one run has no spread
        "over_runs": {"runs": 1, "least": 2.0, "greatest": 2.0},
        "over_complete_runs": {"runs": 1, "mean": 2.0},
    }


def test_a_run_with_people_left_counts_as_endless(case):
    found = made(case, [1.0, 2.0], [4.0, math.nan], [6.0, 1.0]).last_out()
    assert found["over_runs"]["least"] == 2.0
    assert found["over_runs"]["percentile_50"] == 6.0
    assert found["over_runs"]["percentile_95"] == found["over_runs"]["greatest"] == math.inf
    assert (found["over_complete_runs"]["runs"], found["over_complete_runs"]["mean"]) == (2, 4.0)
    blocked = made(case, [math.nan, 1.0]).last_out()
    assert blocked["over_runs"] == {"runs": 1, "least": math.inf, "greatest": math.inf}
    assert blocked["over_complete_runs"] == {"runs": 0}


@pytest.mark.parametrize("of", [0, 5, 37.5, 50, 95, 100])
def test_a_percentile_is_that_of_numpy_as_long_as_times_are_finite(of):
    times = np.random.default_rng(1).lognormal(size=9)
    assert percentile(times, of) == pytest.approx(np.percentile(times, of), rel=1e-12)


def test_a_percentile_among_endless_runs_is_endless():
    times = np.array([3.0, math.inf, 1.0, 2.0, math.inf])
    assert [percentile(times, of) for of in (0, 25, 50, 51, 75, 100)] == [1.0, 2.0, 3.0, math.inf, math.inf, math.inf]


@pytest.mark.parametrize("n", [2, 3, 5, 20])
@pytest.mark.parametrize(("sigma", "least"), [(0.05, 0.94), (0.6, 0.915)])
def test_the_interval_of_a_mean_is_positive_and_covers_it(n, sigma, least):
    """Log-normal samples, more skewed than times of egress are for sigma = 0.6; 95 % is asked for."""
    samples = np.random.default_rng(3).lognormal(0.0, sigma, (4000, n))
    low, high = np.array([mean_interval(sample) for sample in samples]).T
    true = math.exp(0.5 * sigma**2)
    assert (low > 0.0).all()
    assert np.mean((low <= true) & (true <= high)) >= least


def test_egress_counts_who_is_out_at_each_time(case):
    egress = made(case, [1.0, 2.0], [2.0, math.nan]).egress()
    assert egress["time"][:6].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
    assert egress["mean_over_runs"][:6].tolist() == [0.0, 0.0, 0.5, 0.5, 1.5, 1.5]
    assert egress["percentile_50_over_runs"][-1] == 1.5


def test_percentiles_of_the_curves(case):
    """Of 21 runs, with 0, 1, ..., 20 people out after 1 s."""
    egress = made(case, *([1.0] * out + [math.nan] * (20 - out) for out in range(21))).egress()
    after = egress["time"].tolist().index(1.0)
    assert [egress[f"percentile_{k}_over_runs"][after] for k in (5, 50, 95)] == pytest.approx(
        [1.0, 10.0, 19.0], rel=1e-12
    )


@pytest.mark.parametrize(("end", "every", "points"), [(1.1, 0.1, 12), (0.7, 0.1, 8), (1.0, 0.5, 3), (1.1, 0.5, 4)])
def test_the_curves_end_with_the_longest_run(case, end, every, points):
    """1.1 + 0.1 is rounded to more than twelve times 0.1: np.arange to it would go on to 1.2."""
    runs = tuple(Run(0, "everybody out", time, (), np.array([0.2, time])) for time in (0.25, end))
    egress = Ensemble(case.change({"output.every": every}), runs).egress()
    np.testing.assert_allclose(egress["time"], every * np.arange(points), rtol=1e-12)
    assert egress["mean_over_runs"][-1] == 2.0


def test_the_folder_holds_runs_curves_and_statistics(case, tmp_path):
    ensemble = made(case, [1.0, 2.0], [4.0, math.nan])
    warned = replace(ensemble.runs[0], quality_warnings=("deep", "thrown about"))
    ensemble = replace(ensemble, runs=(warned, ensemble.runs[1]))
    ensemble.write(tmp_path / "r")
    with (tmp_path / "r" / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["quality_warnings"] == "deep; thrown about"
    assert (rows[0]["out"], rows[0]["last_out"]) == ("2", "2.0")
    assert rows[1] == {"seed": "1", "ended": "no progress", "out": "1", "last_out": "", "quality_warnings": ""}
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert (summary["runs"], summary["complete"], summary["people"]) == (2, 1, 2)
    assert summary["last_out"]["over_runs"]["least"] == 2.0
    assert summary["last_out"]["over_runs"]["greatest"] is None
    assert summary["last_out"]["over_complete_runs"] == {"runs": 1, "mean": 2.0}
    assert (tmp_path / "r" / "egress.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "r" / "egress.csv").open() as file:
        assert next(csv.reader(file)) == [
            "time",
            "mean_over_runs",
            "percentile_5_over_runs",
            "percentile_50_over_runs",
            "percentile_95_over_runs",
        ]
    ensemble.write(tmp_path / "r")  # its own results may be overwritten


@pytest.mark.parametrize("workers", [1, 2])
def test_processes_keep_the_order_of_the_items(workers):
    # A function that a new process can import: `tests` is importable only where pytest runs.
    assert list(in_processes(math.factorial, [3, 1, 2], workers)) == [6, 1, 2]
