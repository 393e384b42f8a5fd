"""The report of a study, from files as evac repeat writes them."""

import csv
import json

import numpy as np

import evac
from evac.case.loading import load_case
from evac.report.sections import Places
from evac.report.study import is_study, study_report

from .conftest import CASE, Page


def rows_of(folder):
    with (folder / "runs.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_numbers_are_those_of_the_files(study):
    assert is_study(study)
    page = Page(study_report(study))
    one = json.loads((study / "summary.json").read_text(encoding="utf-8"))["points"][0]["statistics"]
    times = [float(row["last_out"]) for row in rows_of(study)]
    shown = {row[0]: row[1:] for row in page.table("Evacuation time")[1:]}
    assert shown["runs"][0] == "20"
    assert shown["mean [s]"][:2] == [f"{np.mean(times):.1f}", f"{one['mean']['low']:.1f} to {one['mean']['high']:.1f}"]
    assert shown["percentile 95 [s]"][0] == f"{np.percentile(times, 95):.1f}"
    assert shown["percentile 95 [s]"][1].endswith("open")
    (door,) = page.table("by each exit")[1:]
    assert door[0] == "door"
    assert float(door[1]) == 5.0
    assert door[2:4] == ["20", f"{np.mean(times):.1f}"]
    listed = page.table("Every run")[1:]
    assert [row[-1] for row in listed] == [f"{time:.2f}" for time in times]
    assert "--runs 20" in page.text
    warned = sum(bool(row["quality_warnings"]) for row in rows_of(study))
    assert page.fact("Runs with quality warnings") == f"{warned} of 20"


def test_without_a_run_the_plans_are_missing_and_said_to_be(study):
    page = Page(study_report(study))
    assert page.lacks("building")
    assert page.lacks("times", "places")
    assert not page.lacks("model", "statistics")
    assert "script" not in page.tags


def test_a_run_of_the_study_adds_plans_places_and_maps(study, tmp_path):
    evac.run(load_case("square_room", CASE | {"simulation.seed": 3}), tmp_path / "three")
    page = Page(study_report(study, [tmp_path / "three"], places=Places(maps=("usage",))))
    assert page.table("Levels")[1][0] == "room"
    assert {"places", "congestion", "maps"} <= set(page.of("id"))
    assert not page.lacks("times", "places")
    words = [one.partition(" ") for one in page.of("alt")]
    assert page.of("alt")[0].startswith("The building at 0")
    assert [share for share, _, rest in words if rest.startswith("% of the people are out")] == ["25", "50", "75", "95"]


def test_blocked_runs_have_a_banner_and_are_not_averaged_away(repeated, tmp_path):
    times = np.sort(repeated.times(0)[:5])
    case = load_case("square_room", CASE | {"simulation.duration": float(np.mean(times[2:4]))})
    found = evac.repeat(case, 5, folder=tmp_path / "blocked", workers=1)
    blocked = int(np.isinf(found.times(0)).sum())
    assert 0 < blocked < 5
    page = Page(study_report(found.folder))
    assert f"{blocked} of 5" in page.text.partition("Project")[0]
    shown = {row[0]: row[1:] for row in page.table("Evacuation time")[1:]}
    assert shown["percentile 95 [s]"][0] == "not reached"
    assert shown["maximum [s]"][0] == "not reached"
    assert shown["mean [s]"][0] == f"{np.mean(found.times(0)[np.isfinite(found.times(0))]):.1f}"
    assert [row[-1] for row in page.table("Every run")[1:]].count("people left") == blocked


def test_a_sweep_has_its_points(tmp_path):
    case = load_case("square_room", CASE)
    found = evac.sweep(case, {"people.0.name": ["a", "<b>"]}, 2, folder=tmp_path / "sweep", workers=1)
    page = Page(study_report(found.folder))
    assert [row[:3] for row in page.table("at each point")[1:]] == [["0", "a", "2"], ["1", "<b>", "2"]]
    assert "points" in page.of("id")
    assert "people.0.name\na\n<b>\n" in page.text
    assert len(page.of("src")) == 2
