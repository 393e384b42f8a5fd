"""The section of a report on smoke, gases and heat, and the limits that a report states."""

import pytest

import evac
from evac.base.errors import ScenarioError
from evac.report.of_run import run_report
from tests.conditions.corridor import corridor, prescribed

from .conftest import Page

AIR = {"extinction": [0.0, 2.0], "co": [0, 4000], "co2": [0, 2], "o2": [20.9, 17.0]}


def reported(folder, **tables):
    smoke = prescribed(times=[0, 20], values=AIR, hold=True)
    results = evac.run(corridor(smoke, positions=((0.5, 1.0), (20.0, 1.0)), **tables), folder)
    return results, run_report(folder)


def test_a_run_with_a_dose_has_its_numbers_and_times(tmp_path):
    results, text = reported(tmp_path / "result", dose={"heat": "none", "threshold": 0.05})
    assert Page(text).text
    for words in (
        "prescribed",
        "fds_evac",
        "Threshold",
        "0.05, deterministic",
        "hcn, no",
        "Available and required times",
    ):
        assert words in text
    assert results.conditions["levels"]["f"]["untenable"] == 4.0  # K > 0.3 1/m at 3 s, looked at every 2 s
    assert results.conditions["levels"]["f"]["turns_back"] == 12.0
    series = results.conditions["doses"]
    assert series["time"][:3] == [0.0, 2.0, 4.0]
    assert series["greatest_gas"] == sorted(series["greatest_gas"])
    assert series["mean_gas"][-1] <= series["greatest_gas"][-1] <= results.exposure["gas_dose"].max()
    assert "doses over time" in text
    assert len(results.stopped) == 2


def test_available_times_of_the_case_are_beside_required_ones(tmp_path):
    results = evac.run(corridor(report={"aset": {"f": 3.0}, "project": "A house", "author": "B"}), tmp_path / "r")
    page = Page(run_report(tmp_path / "r"))
    (row,) = [one for one in page.table("Available and required times")[1:] if one[0] == "f"]
    left = results.levels["f"]["last_left"]
    assert row == ["f", "3.0", "-", "-", f"{left:.1f}", f"{3.0 - left:.1f}"]
    assert (page.fact("Project"), page.fact("Author")) == ("A house", "B")
    with pytest.raises(ScenarioError, match=r"report\.aset: no level is named 'g'"):
        evac.run(corridor(report={"aset": {"g": 3.0}}), tmp_path / "s")


def test_a_run_without_a_dose_says_so_and_one_without_conditions_has_no_section(tmp_path):
    _, text = reported(tmp_path / "smoke")
    assert "No dose was computed" in text
    assert "smoke, gases and heat on people are modelled" in text
    evac.run(corridor(), tmp_path / "clear")
    text = run_report(tmp_path / "clear")
    assert "Smoke, gases and heat" not in text
    assert "Fire, smoke, heat, toxic gas" in text


def test_without_a_trajectory_the_times_are_those_of_levels(tmp_path):
    _, text = reported(tmp_path / "result", output={"trajectory": False, "picture": False, "replay": False})
    rows = next(table["rows"] for table in Page(text).tables if "by storey" in table["caption"])
    assert [row[0] for row in rows[1:]] == ["f"]


def test_available_and_required_times_are_those_of_storeys_with_their_stairs(tmp_path):
    quiet = {"output.picture": False, "output.replay": False}
    results = evac.run(evac.load("office_fire", {"simulation.duration": 40.0, **quiet}), tmp_path / "result")
    tables = Page(run_report(tmp_path / "result")).tables
    rows = next(table["rows"] for table in tables if "by storey" in table["caption"])
    levels = results.conditions["levels"]
    assert {"hall", "offices"} < set(levels)  # which has the stairs, too
    first = min(
        time for time in (levels[name]["untenable"] for name in levels if name != "offices") if time is not None
    )
    assert [row[0] for row in rows[1:]] == ["hall", "offices"]
    assert float(rows[1][2]) == first
    assert rows[1][4:] == ["not cleared", "none"]
    assert rows[2][1:3] == ["-", "-"]
