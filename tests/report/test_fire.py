"""The section of a report on smoke, gases and heat, and the limits that a report states."""

import html

import pytest

import evac
from evac.replay.writer import account_of_run, texts
from evac.report.of_run import run_report
from evac.report.sections import PlaceSettings
from evac.results.verdict import bars
from tests.conditions.corridor import corridor, prescribed

from .conftest import Page

AIR = {"extinction": [0.0, 2.0], "co": [0, 4000], "co2": [0, 2], "o2": [20.9, 17.0]}


def reported(folder, **tables):
    smoke = prescribed(times=[0, 20], values=AIR, hold=True)
    results = evac.run(corridor(smoke, positions=((0.5, 1.0), (20.0, 1.0)), **tables), folder)
    return results, run_report(folder, places=PlaceSettings(maps=()))


def test_a_run_with_a_dose_has_its_numbers_and_times(tmp_path):
    results, text = reported(tmp_path / "result", dose={"heat": "none", "threshold": 0.05})
    assert Page(text).text
    for words in (
        "prescribed",
        "fds_evac",
        "Threshold",
        "0.05, deterministic",
        "hcn, no",
        "No limit set",
    ):
        assert words in text
    series = results.conditions["doses"]
    assert series["time"][:3] == [0.0, 2.0, 4.0]
    assert series["greatest_gas"] == sorted(series["greatest_gas"])
    assert series["mean_gas"][-1] <= series["greatest_gas"][-1] <= results.exposure["gas_dose"].max()
    assert "doses over time" in text
    assert len(results.stopped) == 2


def test_the_verdict_and_the_times_of_compartments_are_those_of_the_results(tmp_path):
    report = {"project": "A house", "author": "B"}
    results = evac.run(corridor(report=report, safety={"available": 3.0, "factor": 2.0}), tmp_path / "r")
    page = Page(run_report(tmp_path / "r", places=PlaceSettings(maps=())))
    (row,) = page.table("Available and required times")[1:]
    left = results.levels["f"]["last_left"]
    times = [f"{time:.1f}" for time in (left, 3.0, 3.0 - left, 3.0 - 2.0 * left, 3.0 - left)]
    assert [*row[:4], *row[5:7]] == ["f", "1", *times[:4]]
    assert float(row[7]) == pytest.approx(3.0 - left, abs=0.2)
    (worst,) = page.table("The people with the least margins")[1:]
    assert worst[:3] == ["0", "p", f"{results.margins['least_margin'][0]:.1f}"]
    assert worst[4] == "f"
    assert "red triangles below 0 s: 1 person" in page.text
    account = account_of_run(results)
    assert [one.person for one in account.margins] == [0]
    assert results.verdict["text"] in html.unescape(texts(account)["answer"])
    assert [(one["name"], one["status"], one["limit"]) for one in bars(account.safety)] == [("f", "red", 3.0)]
    assert results.verdict["text"] in page.text
    assert (page.fact("Project"), page.fact("Author")) == ("A house", "B")


def test_a_run_without_a_dose_says_so_and_one_without_conditions_has_no_section(tmp_path):
    _, text = reported(tmp_path / "smoke")
    assert "No dose was computed" in text
    assert "smoke, gases and heat on people are modelled" in text
    evac.run(corridor(), tmp_path / "clear")
    text = run_report(tmp_path / "clear", places=PlaceSettings(maps=()))
    assert "Smoke, gases and heat" not in text
    assert "Fire, smoke, heat, toxic gas" in text
