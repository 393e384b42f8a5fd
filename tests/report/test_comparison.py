"""Designs compared: pairs of runs with the same seeds, their page, and what cannot be compared."""

import math
import re

import numpy as np
import pytest

import evac
from evac.base.errors import ResultError
from evac.study.statistics import difference
from tests.report.letters import noted_letters

QUIET = {"output.picture": False, "output.animation": False, "output.replay": False, "people.people.number": 6}


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """Two studies of a room with a door and a wider one, of six and of four runs with the same first seed."""
    place = tmp_path_factory.mktemp("designs")
    case = evac.load("square_room", QUIET)
    few = evac.repeat(case, runs=6, folder=place / "few")
    more = evac.repeat(case.change({"people.people.number": 12}), runs=4, folder=place / "more")
    return few, more


def test_differences_are_those_of_pairs_with_the_same_seeds(studies):
    few, more = studies
    compared = evac.compare(few.folder, more)
    table = compared.to_pandas().set_index("measure")
    before, after = few.times(0)[:4], more.times(0)
    expected = difference(before, after)
    total = table.loc["evacuation time"]
    assert total[["difference", "low", "high"]].tolist() == [expected.value, expected.low, expected.high]
    assert (total["before"], total["after"], total["pairs"]) == (before.mean(), after.mean(), 4)
    assert total["verdict"] == "longer"
    times = [np.sort(row["exit_time"]) for row in few.rows(0, ["exit_time"])]
    assert table.loc["time of 95 %", "before"] == np.mean([one[math.ceil(0.95 * 6) - 1] for one in times[:4]])
    assert table.loc["mean time of people", "before"] == pytest.approx(np.mean([one.mean() for one in times[:4]]))


def test_points_of_a_sweep_are_designs(tmp_path):
    sweep = evac.sweep(
        evac.load("square_room", QUIET), {"people.people.number": [3, 5, 8]}, runs=2, folder=tmp_path / "s"
    )
    compared = evac.compare(sweep)
    assert [one.label for one in compared.designs] == [f"s: people.people.number = {n}" for n in (3, 5, 8)]
    assert len(compared.differences) == 6
    assert evac.compare((sweep, 2), (sweep, 0)).designs[0].label.endswith("= 8")
    shown, mean = sweep._repr_html_(), sweep.statistics[2].mean
    assert f"<td>{mean.value:.2f}</td>" in shown or f"<td>{mean.value:.2f} ({mean.bounds()})</td>" in shown
    assert shown.count("<th>") == 5  # the parameter, the verdict, two statistics and blocked runs
    assert f"<td>{compared.differences[0].change.value:.2f}</td>" in compared._repr_html_()
    assert len(sweep.plot().axes) == 1


def test_a_page_has_differences_curves_and_maps_of_runs(tmp_path):
    case = evac.load("square_room", QUIET)
    evac.run(case, tmp_path / "a")
    evac.run(case.change({"people.people.number": 9}), tmp_path / "b")
    compared = evac.compare(tmp_path / "a", tmp_path / "b")
    with noted_letters() as letters:
        page = compared.page()
    assert len(letters) == 3
    assert min(letters) >= 7.0
    assert page.count("<img") == 3  # curves, maximum density, waiting
    assert re.search(r"<td>b</td>.*evacuation time", page, re.DOTALL)
    assert "http:" not in re.sub(r'src="[^"]*"', "", page)
    assert all(one.verdict == "not certain" for one in compared.differences)
    evac.run(evac.load("classroom", {"simulation.duration": 0.5, "output.picture": False}), tmp_path / "c")
    assert evac.compare(tmp_path / "a", tmp_path / "c").page().count("<img") == 1  # no level in common
    same = evac.compare(tmp_path / "a", tmp_path / "a").differences
    assert [one.change.value for one in same] == [0.0] * 3


def test_designs_without_a_common_seed_are_refused(tmp_path, studies):
    other = evac.run(
        evac.load("square_room", QUIET | {"simulation.seed": 99, "simulation.duration": 0.5}), tmp_path / "r"
    )
    with pytest.raises(ResultError, match="no seed in common"):
        evac.compare(studies[0], other)
    with pytest.raises(ResultError, match="two or more"):
        evac.compare(studies[0])


def test_pairs_in_which_people_are_left_are_in_no_difference(tmp_path):
    case = evac.load("square_room", QUIET | {"simulation.duration": 1.0})
    result = evac.run(case, tmp_path / "short")
    (total, *_) = evac.compare(result, result).differences
    assert (total.change.runs, total.verdict) == (0, "no pair")
