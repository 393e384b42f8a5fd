"""A study: its tables, statistics, report and repeated runs against single runs of the same seeds."""

import csv
import json

import numpy as np
import pytest

import evac
from evac.cli.main import main
from tests.journeys.cases import COMMON, CROWD
from tests.report.conftest import Page

CASE = {
    **{"title": "Few people", **COMMON, "contact": {"model": "nsm2"}, "simulation": {"duration": 30.0, "seed": 4}},
    "directions": {"spacing": 0.2},
    "people": [
        {"name": "above", "number": 5, "area": "loft", "exits": ["main"], **CROWD},
        {"name": "staff", "number": 1, "area": "room", "leave": False},
    ],
}
KEY = "people.above.number"
RUNS = 3


@pytest.fixture(scope="module")
def case():
    return evac.load(CASE)


@pytest.fixture(scope="module")
def swept(case, tmp_path_factory):
    """A sweep of two points, of which the second has more people, and the single runs of its seeds."""
    study = evac.sweep(case, {KEY: [5, 8]}, runs=RUNS, folder=tmp_path_factory.mktemp("study") / "s", workers=1)
    alone = {
        (point, run): evac.run(case.change({KEY: number, "simulation.seed": 4 + run}))
        for point, number in enumerate((5, 8))
        for run in range(RUNS)
    }
    return study, alone


def test_rows_are_those_of_single_runs(swept):
    study, alone = swept
    rows = study.table().to_pylist()
    with (study.folder / "runs.csv").open() as file:
        told = list(csv.DictReader(file))
    assert [(row["point"], row["run"]) for row in rows] == sorted(alone)
    for row, words in zip(rows, told, strict=True):
        results = alone[row["point"], row["run"]]
        leaving = results.leaving
        assert row["seed"] == int(words["seed"]) == results.seed
        assert row["ended"] == words["ended"] == results.ended
        assert (row["people"], row["out"]) == (len(leaving), results.evacuated)
        assert (row["time"], row["last_out"], row["blocked"]) == (results.time, results.last_out, False)
        assert float(words["last_out"]) == results.last_out
        assert row["exit_time"] == results.crowd.exit_time[leaving].tolist()
        names = [exit_["name"] for exit_ in row["exits"]]
        assert [names[used] for used in row["exit_used"]] == ["main"] * len(leaving)
        assert {one["name"]: one["people"] for one in row["exits"]} == {
            name: use["people"] for name, use in results.exits.items()
        }
        assert row[KEY] == (5, 8)[row["point"]]


def test_statistics_are_those_of_the_runs_wherever_they_are_told(swept, capsys):
    study, alone = swept
    opened = evac.read_study(study.folder)
    summary = json.loads((study.folder / "summary.json").read_text())
    with (study.folder / "statistics.csv").open() as file:
        rows = list(csv.DictReader(file))
    for point in (0, 1):
        times = np.array([alone[point, run].last_out for run in range(RUNS)])
        mean, deviation = times.mean(), times.std(ddof=1)
        for one in (study, opened):
            np.testing.assert_array_equal(one.times(point), times)
            statistics = one.statistics[point]
            assert statistics["mean"].value == pytest.approx(mean)
            assert statistics["mean"].low < mean < statistics["mean"].high
            assert statistics["percentile 50"].value == pytest.approx(np.median(times), rel=0.1)
        assert float(rows[point]["mean"]) == pytest.approx(mean)
        assert float(rows[point]["standard_deviation"]) == pytest.approx(deviation)
        assert [float(rows[point][name]) for name in ("least", "greatest")] == [times.min(), times.max()]
        assert rows[point][KEY] == str((5, 8)[point])
        assert json.dumps(summary).count(repr(float(rows[point]["mean"]))) >= 1
    pairs = [alone[1, run].last_out - alone[0, run].last_out for run in range(RUNS)]
    assert study.difference(0, 1).value == pytest.approx(np.mean(pairs))
    frame = opened.to_pandas()
    assert frame.groupby(KEY).last_out.mean().tolist() == pytest.approx(
        [opened.statistics[k]["mean"].value for k in (0, 1)]
    )
    assert main(["report", str(study.folder), "--out", str(study.folder.parent / "report.html")]) == 0
    page = Page((study.folder.parent / "report.html").read_text())
    cells = {cell for table in page.tables for row in table["rows"] for cell in row}
    for point in (0, 1):
        assert any(f"{study.statistics[point]['mean'].value:.1f}" in cell for cell in cells)
    assert main(["check", str(study.folder)]) == 0
    capsys.readouterr()


def test_a_study_that_stopped_goes_on_to_the_same_tables(swept, case, tmp_path):
    class StopError(Exception):
        pass

    def stop(progress):
        if progress.row is not None and progress.done >= 3:
            raise StopError

    study, _ = swept
    options = {"runs": RUNS, "folder": tmp_path / "s", "workers": 1}
    with pytest.raises(StopError):
        evac.sweep(case, {KEY: [5, 8]}, progress=stop, **options)
    evac.sweep(case, {KEY: [5, 8]}, resume=True, **options)
    for name in ("runs.csv", "statistics.csv", "egress.csv", "summary.json"):
        assert (tmp_path / "s" / name).read_bytes() == (study.folder / name).read_bytes(), name


def test_a_run_that_is_made_again_is_that_of_the_study(swept, tmp_path):
    study, alone = swept
    again = study.run_again(1, 2, tmp_path / "again")
    assert again.crowd.exit_time.tobytes() == alone[1, 2].crowd.exit_time.tobytes()
    assert evac.read_results(tmp_path / "again").seed == 6
    compared = evac.compare(study.folder).to_pandas().set_index("measure")
    total = compared.loc["evacuation time"]
    assert total["difference"] == pytest.approx(study.difference(0, 1).value)
    shares = [
        np.mean([np.sort(alone[point, run].egress()[0])[int(np.ceil(0.95 * number))] for run in range(RUNS)])
        for point, number in enumerate((5, 8))
    ]
    assert compared.loc["time of 95 %", ["before", "after"]].tolist() == pytest.approx(shares)
