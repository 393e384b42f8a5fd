"""The report of a study, from files as evac repeat writes them."""

import csv
import json

import numpy as np
import pytest

import evac
from evac.analysis.congestion import DENSITY
from evac.base.errors import ResultError
from evac.case.loading import load_case
from evac.report.study import study_report
from evac.report.study_files import is_study

from .conftest import Page


def rows_of(folder):
    with (folder / "runs.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def change_runs(folder, change):
    rows = rows_of(folder)
    change(rows)
    with (folder / "runs.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def test_numbers_are_those_of_the_files(study):
    assert is_study(study)
    page = Page(study_report(study, density=DENSITY))
    one = json.loads((study / "summary.json").read_text(encoding="utf-8"))["points"][0]["statistics"]
    times = [float(row["last_out"]) for row in rows_of(study)]
    shown = {row[0]: row[1:] for row in page.table("Evacuation time")[1:]}
    assert shown["runs"][0] == "20"
    assert shown["mean [s]"][:2] == [f"{np.mean(times):.1f}", f"{one['mean']['low']:.1f} to {one['mean']['high']:.1f}"]
    assert shown["percentile 95 [s]"][0] == f"{np.percentile(times, 95):.1f}"
    assert shown["percentile 95 [s]"][1].endswith("open")
    (door,) = page.table("by each exit")[1:]
    assert door[0] == "door"
    assert float(door[1]) == 20.0
    assert door[2:4] == ["20", f"{np.mean(times):.1f}"]
    listed = page.table("Every run")[1:]
    assert [row[-1] for row in listed] == [f"{time:.2f}" for time in times]
    assert "evac repeat case.toml --runs 20" in page.text
    warned = sum(bool(row["quality_warnings"]) for row in rows_of(study))
    assert page.fact("Runs with quality warnings") == f"{warned} of 20"


def test_without_a_run_the_plans_are_missing_and_said_to_be(study):
    page = Page(study_report(study, density=DENSITY))
    assert page.lacks("building")
    assert page.lacks("times", "places")
    assert not page.lacks("model", "statistics")
    assert "script" not in page.tags


def test_a_run_of_the_study_adds_plans_places_and_maps(study, tmp_path):
    results = evac.run(load_case("square_room", {"simulation.seed": 3, "output.animation": False}), tmp_path / "three")
    change_runs(study, lambda rows: rows[2].update(last_out=repr(results.last_out)))
    page = Page(study_report(study, [tmp_path / "three"], density=DENSITY, maps=("usage",)))
    assert page.table("Levels")[1][0] == "room"
    assert {"places", "congestion", "maps"} <= set(page.of("id"))
    assert not page.lacks("times", "places")


def test_a_run_of_another_study_is_refused(study, tmp_path):
    evac.run(load_case("square_room", {"simulation.seed": 30, "output.animation": False}), tmp_path / "other")
    with pytest.raises(ResultError, match="seed 30"):
        study_report(study, [tmp_path / "other"], density=DENSITY)
    change_runs(study, lambda rows: rows[0].update(seed="30", last_out="1.0"))
    with pytest.raises(ResultError, match=r"1\.0"):
        study_report(study, [tmp_path / "other"], density=DENSITY)
    change = {"simulation.seed": 30, "people.people.number": 5, "output.animation": False}
    evac.run(load_case("square_room", change), tmp_path / "fewer")
    with pytest.raises(ResultError, match=r"\[people\]"):
        study_report(study, [tmp_path / "fewer"], density=DENSITY)


def test_blocked_runs_have_a_banner_and_are_not_averaged_away(study):
    data = json.loads((study / "summary.json").read_text(encoding="utf-8"))
    data["blocked"] = 2
    one = data["points"][0]["statistics"]
    one |= {"blocked": 2, "greatest": None}
    one["percentiles"][-1] |= {"value": None, "low": 9.0, "high": None}
    (study / "summary.json").write_text(json.dumps(data), encoding="utf-8")
    change_runs(study, lambda rows: rows[4].update(last_out="", blocked="true", ended="no progress", out="17"))
    page = Page(study_report(study, density=DENSITY))
    assert "2 of 20" in page.text.partition("Project")[0]
    shown = {row[0]: row[1:] for row in page.table("Evacuation time")[1:]}
    assert shown["percentile 95 [s]"][0] == "not reached"
    assert shown["maximum [s]"][0] == "not reached"
    assert page.table("Every run")[5][-2:] == ["17 of 20", "people left"]


def test_a_sweep_has_its_points(study):
    data = json.loads((study / "summary.json").read_text(encoding="utf-8"))
    point = data["points"][0]
    data["points"] = [point | {"parameters": {"contact.model": model}} for model in ("dem", "<nsm2>")]
    data["runs"] = 40
    (study / "summary.json").write_text(json.dumps(data), encoding="utf-8")
    change_runs(study, lambda rows: rows.extend([row | {"point": "1"} for row in rows]))
    lines = (study / "egress.csv").read_text(encoding="utf-8").splitlines()
    both = [f"point,{lines[0]}", *(f"{number},{line}" for number in (0, 1) for line in lines[1:])]
    (study / "egress.csv").write_text("\n".join(both) + "\n", encoding="utf-8")
    page = Page(study_report(study, density=DENSITY))
    assert [row[:3] for row in page.table("at each point")[1:]] == [["0", "dem", "20"], ["1", "<nsm2>", "20"]]
    assert "points" in page.of("id")
    assert "contact.model\ndem\n<nsm2>\n" in page.text
    assert len(page.of("src")) == 2


@pytest.mark.parametrize("name", ["summary.json", "runs.csv", "egress.csv"])
def test_damaged_files_are_named(study, name):
    path = study / name
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.rindex("\n", 0, len(text) - 2)] + "\n1", encoding="utf-8")
    with pytest.raises(ResultError, match=name):
        study_report(study, density=DENSITY)
