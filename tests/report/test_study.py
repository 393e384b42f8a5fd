"""The report of a study, from files as evac repeat writes them."""

import csv
import html
import json
import shutil

import numpy as np
import pytest

import evac
from evac.base.errors import BuildingError
from evac.case.loading import load_case
from evac.report.sections import PlaceSettings
from evac.report.study import is_study, study_report
from tests.conditions.corridor import corridor, prescribed, two_storeys

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
    assert shown["minimum"][2] == "20 runs"
    assert shown["mean"][:2] == [f"{np.mean(times):.2f}", f"{one['mean']['low']:.2f} to {one['mean']['high']:.2f}"]
    assert shown["percentile 95"][0] == f"{np.percentile(times, 95):.2f}"
    assert shown["percentile 95"][1].endswith("open")
    door = {row[1]: row[2:] for row in page.table("Exits; the flow")[1:]}
    assert [door[what][:2] for what in ("people", "share of all out [%]")] == [["20", "5"], ["20", "100"]]
    last, middle = door["last [s]"], evac.read_study(study).statistics[0].percentiles[1]
    assert float(last[1]) == pytest.approx(np.mean(times), abs=0.006)
    assert last[3] == f"{middle.value:.2f} ({middle.bounds()})"
    assert page.of("id").count("outcomes") == 1
    assert "No limit set" in page.text
    listed = page.table("Every run")[1:]
    assert [row[-1] for row in listed] == [f"{time:.2f}" for time in times]
    assert "--runs 20" in page.text
    assert "1 to 20, a run with each" in page.text
    warned = sum(bool(row["quality_warnings"]) for row in rows_of(study))
    assert page.fact("Runs with quality warnings") == f"{warned} of 20"


def test_a_study_carries_what_its_runs_carry(tmp_path):
    plan = two_storeys() | {"areas": [{"name": "r", "storey": "up", "polygon": [[0, 4], [12, 4], [12, 8], [0, 8]]}]}
    room = [[6, 4], [12, 4], [12, 8], [6, 8]]
    plan["rooms"] = [{"name": "room", "storey": "up", "polygon": room, "use": "office"}]
    people = [
        {"name": "legs", "use": "office"},
        {"name": "chair", "area": "r", "number": 1, "steepest": 0.1},
    ]
    case = corridor(
        prescribed(values={"co": 20000.0}),
        building={"plan": plan},
        people=people,
        place=[{"name": "safe", "kind": "refuge", "area": "r"}],
        event=[{"kind": "slow", "target": "r", "time": 1.0, "value": 0.9}],
        dose={"heat": "none", "without": ["co2", "o2"]},
        smoke={"law": "none", "routes": False},
        safety={"fed": 0.3, "factor": 1.5},
        simulation={"duration": 60.0},  # before the gases stop the person in the refuge
    )
    study = evac.repeat(case, 2, folder=tmp_path / "s", workers=1)
    runs = [study.run_again(0, k) for k in range(2)]
    rows = list(study.rows())
    assert [row["people"] for row in rows] == [5, 5]
    hydraulic = []
    for row, run in zip(rows, runs, strict=True):
        assert row["compartments"] == run.safety["compartments"]
        numbers = {tuple(one.values())[:3]: one["value"] for one in row["tables"]}
        outcomes = {row: value for (table, row, _), value in numbers.items() if table == "outcomes"}
        assert outcomes["greatest dose"] == run.exposure["gas_dose"].max()
        assert outcomes["hydraulic evacuation time [s]"] == run.hydraulic.hydraulic_time
        hydraulic.append(run.hydraulic.hydraulic_time)
        assert outcomes["people at refuge 'safe'"] == 1.0
        assert outcomes["'r' at 0.9 of the speed, at [s]"] == 1.0
        assert numbers["levels", "down", "last left [s]"] == run.levels["down"]["last_left"]
        assert numbers["doses", "of gases", "people above 0.3"] == run.conditions["dose"]["gas_above_0.3"]
    for k, one in enumerate(study.safety(0)["compartments"]):
        of_runs = [run.safety["compartments"][k] for run in runs]
        assert one["people"] == max(row["people"] for row in of_runs)
        if one["people"]:
            assert one["required"] == pytest.approx(np.percentile([row["required"] for row in of_runs], 95))
        assert one["available"] == min(row["available"] for row in of_runs)
    summary = json.loads((tmp_path / "s/summary.json").read_text(encoding="utf-8"))
    assert summary["verdict"] == study.verdict
    assert study.verdict["text"] in html.unescape(study._repr_html_())
    page = Page(study_report(tmp_path / "s"))
    assert study.verdict["text"] in page.text
    assert [row[0] for row in page.table("ASET, RSET")[1:]] == ["up", "stair"]
    apart = round(100.0 * (np.median([run.last_out for run in runs]) / np.median(hydraulic) - 1.0))
    assert f"is {np.median(hydraulic):.1f};" in page.fact("Second opinion")
    assert f"that of the runs is {apart} % more" in page.fact("Second opinion")
    assert page.fact("Walking") == runs[0].answer.movement
    assert page.fact("People at refuge 'safe'") == "1"
    assert [row["people at refuge 'safe'"] for row in rows_of(tmp_path / "s")] == ["1", "1"]
    assert {row[0]: row[1] for row in page.table("Groups, their")[1:]} == {"chair": "1", "legs": "4"}
    assert page.table("Rooms by use")[1][:5] == ["office", "1", "24.0", "6.0", "4"]
    what = [row[0] for row in page.table("events, safe places")[1:]]
    assert {"people at refuge 'safe'", "'r' at 0.9 of the speed, at [s]", "greatest dose"} <= set(what)
    assert "Fire, smoke, heat, toxic gas" not in page.text
    assert "co: 20000" in page.text
    assert not page.lacks("fire")


def test_without_a_run_there_are_plans_but_no_course(study):
    page = Page(study_report(study))
    assert not page.lacks("building")
    assert page.lacks("times")
    assert not page.lacks("times", "places", "parts")
    assert not page.lacks("model", "statistics")
    assert "script" not in page.tags


def test_a_run_of_the_study_adds_plans_places_and_maps(study, tmp_path):
    evac.run(load_case("square_room", CASE | {"simulation.seed": 3}), tmp_path / "three")
    page = Page(study_report(study, [tmp_path / "three"], places=PlaceSettings(maps=("usage",))))
    assert page.table("Levels")[1][0] == "room"
    assert {"places", "congestion", "maps"} <= set(page.of("id"))
    assert not page.lacks("times")
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
    assert shown["percentile 95"][0] == "not reached"
    assert shown["maximum"][0] == "not reached"
    assert shown["mean"][0] == f"{np.mean(found.times(0)[np.isfinite(found.times(0))]):.2f}"
    assert [row[-1] for row in page.table("Every run")[1:]].count("people left") == blocked


def test_a_study_is_reported_and_compared_after_its_case_has_moved(tmp_path):
    shutil.copytree(evac.load("square_room").folder, tmp_path / "case")
    case = evac.load(tmp_path / "case", {"output.picture": False})
    numbers = {"people.people.number": [3, 5]}
    evac.sweep(case, numbers, 2, folder=tmp_path / "study", workers=1)
    before = study_report(tmp_path / "study")
    (tmp_path / "case").rename(tmp_path / "elsewhere")
    assert Page(study_report(tmp_path / "study")).tables == Page(before).tables
    study = evac.read_study(tmp_path / "study")
    assert {difference.change.runs for difference in evac.compare(study).differences} == {2}
    with pytest.raises(BuildingError, match=r"square_room\.msh: no such file"):
        evac.run(study.points[1].case)
