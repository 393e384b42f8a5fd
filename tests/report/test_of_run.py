"""The report of a run: its numbers are those of the files, nothing in it comes from a network, all text is escaped."""

import base64
import csv
import io
import json
import re
import tomllib

import numpy as np
import pytest
from PIL import Image

import evac
from evac.base.errors import ResultError
from evac.base.toml import case_text
from evac.case.loading import load_case
from evac.evidence.validation.page import SUBJECTS
from evac.report.of_run import run_report
from evac.report.pages import Labels
from evac.report.sections import PlaceSettings
from evac.report.verification import evidence, subject_like
from evac.results.reading import read_results
from evac.results.recordedcase import CaseTable
from evac.results.verdict import time_of_share

from .conftest import HOSTILE, Page

QUIET = {"simulation.duration": 60.0, "output.picture": False, "output.animation": False}


@pytest.fixture(scope="module")
def text(finished):
    return run_report(finished, Labels(project="A hall", author=HOSTILE))


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


@pytest.fixture(scope="module")
def summary(finished):
    return json.loads((finished / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def people(finished):
    with (finished / "people.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_nothing_is_executed_and_nothing_is_fetched(page, text):
    assert not {"script", "link", "iframe", "object", "base"} & set(page.tags)
    assert not [name for _, name, _ in page.attributes if name.startswith("on")]
    assert all(source.startswith("data:image/") for source in page.of("src"))
    assert len(page.of("src")) >= 8
    assert not re.search(r"url\((?!data:font/woff;base64,)", text)
    assert "@import" not in text
    assert "http://" not in text
    assert "https://" not in text


def test_text_of_files_and_options_is_escaped(page, text):
    assert "<script" not in text
    assert HOSTILE in page.text
    assert page.fact("Author") == HOSTILE


def test_the_last_person_out_is_told_with_its_response_and_its_way(page, people):
    last = max(people, key=lambda one: float(one["exit_time"]))
    start, exit_time = float(last["response_time"]), float(last["exit_time"])
    way = f"{float(last['distance']):.1f} m in {exit_time - start:.1f} s"
    assert page.fact("Last person out") == f"Person {last['person']}, who started to walk at {start:.1f} s, then {way}"


def test_page_one_tells_where_people_pass_faster_than_by_hand(page, finished):
    run, answer = read_results(finished), page.fact("Second opinion")
    flows = {one.name: one.flow / one.hydraulic_flow for one in run.design_flows if one.flow is not None}
    above = [name for name in flows if flows[name] >= 1.01]
    assert f"{len(above)} place" in answer
    assert f"of {len(run.design_flows)} had more" in answer
    if above:
        most = max(above, key=flows.get)
        assert f"{most!r}, by {100.0 * (flows[most] - 1.0):.0f} %" in answer
    assert ("places with more than the hydraulic flow", len(above)) in run.tables["outcomes"]


def test_links_lead_to_sections_and_ids_are_unique(page):
    targets = {target.removeprefix("#") for target in page.of("href") if target.startswith("#")}
    ids = page.of("id")
    assert targets <= set(ids)
    assert len(ids) == len(set(ids))
    assert {"building", "occupants", "model", "verification", "times", "congestion", "maps", "limits"} <= targets


def test_the_case_of_the_appendix_is_the_case(page, summary, tmp_path, finished):
    table = tomllib.loads(case_text(summary["case"]))
    assert table == summary["case"]
    assert case_text(summary["case"]) in page.text
    (attached,) = [target for target in page.of("href") if not target.startswith("#")]
    head, _, data = attached.partition(",")
    assert head == "data:text/plain;charset=utf-8;base64"
    assert base64.b64decode(data).decode() == case_text(summary["case"])
    shipped = load_case("square_room")
    (tmp_path / "case.toml").write_text(case_text(summary["case"]), encoding="utf-8")
    (tmp_path / shipped.mesh.name).write_bytes(shipped.mesh.read_bytes())
    assert load_case(tmp_path / "case.toml").to_dict() == load_case(tmp_path / "case.toml", summary["case"]).to_dict()
    assert load_case(tmp_path / "case.toml").people[1].behaviours == {"response_time": {"time": 2.0}}


def test_every_failed_test_of_the_model_is_shown(page):
    failed = [row for row in evidence()["tests"] if row["NSM2"].startswith("NO")]
    shown = page.table("Criteria that are not met")[1:]
    assert [row[0] for row in shown] == list(dict.fromkeys(row["test"] for row in failed))
    for row in failed:
        assert any(row["test"] == test and row["measured"] in criteria for test, criteria, _ in shown)
    assert evidence()["commit"] in page.text


@pytest.mark.parametrize(
    ("contact", "keepers", "subject"),
    [
        ({"model": "nsm2", "nsm2": {}}, [], "NSM2"),
        ({"model": "nsm1", "nsm1": {"variant": "inertial"}}, ["walking"], "NSM1 inertial, walking"),
        ({"model": "nsm1", "nsm1": {"variant": "inertial"}}, ["headway"], None),
        ({"model": "nsm2", "nsm2": {}}, ["headway"], "NSM2, headway"),
        ({"model": "nsm1", "nsm1": {"variant": "overdamped"}}, [], None),
        ({"model": "dem", "dem": {"stiffness": 1.0}}, [], "DEM"),
        ({"model": "dem", "dem": {}}, ["gaps"], None),
        ({"model": "dem", "dem": {}}, ["headway", "gaps"], None),
        ({"model": "own"}, [], None),
    ],
)
def test_a_model_is_shown_as_it_was_tested(contact, keepers, subject):
    case = CaseTable(building={}, people=[], contact=contact, simulation={})
    assert subject_like(case, keepers, list(SUBJECTS)) == subject


@pytest.mark.parametrize(
    ("preset", "subject"), [("measured", "NSM2, walking"), ("regulation", "NSM2, walking regulation")]
)
def test_a_preset_is_shown_as_it_was_tested(preset, subject):
    behaviours = {"walking": {"preset": preset}}
    contact = {"model": "nsm2"}
    case = CaseTable(building={}, people=[], contact=contact, behaviours=behaviours, simulation={})
    assert subject_like(case, ["walking"], list(SUBJECTS)) == subject


def test_each_bottleneck_has_a_map_and_a_curve(page, text, finished):
    queues = evac.read_results(finished).queues
    assert queues
    words = [one for one in page.of("alt") if re.match(r"\d\. (Door|Exit|Shaft|Stair|Portal|Person)", one)]
    assert [one[3:].lower() for one in words] == [f"{queue}.".lower() for queue in queues[:4]]
    pictures = re.findall(r'<figure class="place"><img src="data:image/png;base64,([^"]*)"', text)
    assert len(pictures) == len(words)
    width, height = Image.open(io.BytesIO(base64.b64decode(pictures[0]))).size
    assert width / 4 < height < width / 3  # the part of the plan is a square, a third of the width


def test_people_left_inside_are_marked_on_the_plan(tmp_path):
    people = [{"name": "all", "number": 9, "area": "room"}]
    case = load_case("square_room", {"people": people, **QUIET, "simulation.duration": 1.0})
    run = evac.run(case, tmp_path / "r", progress=False)
    inside = len(run.leaving) - run.evacuated
    assert inside
    assert f"{inside} in all, as red marks" in run_report(tmp_path / "r", places=PlaceSettings(maps=()))


def test_shares_of_people_who_are_not_all_out():
    times = np.array([4.0, np.nan, 1.0, 2.0])
    assert [time_of_share(times, share) for share in (25, 50, 51, 75, 76, 100)] == [1.0, 2.0, 4.0, 4.0, None, None]


def test_an_interrupted_run_has_a_banner(result):
    with (result / "people.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    data = json.loads((result / "summary.json").read_text(encoding="utf-8"))
    last = max(float(row["exit_time"]) for row in rows[4:])
    data |= {"ended": "interrupted", "evacuated": 10, "last_out": last, "exit_status": 3}
    (result / "summary.json").write_text(json.dumps(data), encoding="utf-8")
    with (result / "people.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(row | {"exit": "", "exit_time": "", "end_level": "room"} for row in rows[:4])
        writer.writerows(rows[4:])
    page = Page(run_report(result, places=PlaceSettings(maps=())))
    assert "interrupted" in page.text.partition("Project")[0]
    assert "4 of 14 people" in page.text.partition("Project")[0]


def test_without_a_trajectory_the_checklist_says_what_is_missing(result):
    (result / "trajectory.evac").unlink()
    page = Page(run_report(result, places=PlaceSettings(maps=())))
    assert page.lacks("building")
    assert page.lacks("congestion", "maps", "run_maps")
    assert not page.lacks("times", "statistics")


def test_damaged_files_are_named(result):
    (result / "people.csv").unlink()
    with pytest.raises(ResultError, match=r"people\.csv"):
        run_report(result)


def test_the_same_files_give_the_same_page(finished, text, monkeypatch):
    """The queues are found in the pass over the motion that makes the maps, and in none of their own."""
    monkeypatch.setattr("evac.results.results.find_queues", None)
    again = run_report(finished, Labels(project="A hall", author=HOSTILE), places=PlaceSettings(maps=("max_density",)))
    head, _, rest = again.partition('<section id="congestion"')
    assert head.partition("<nav>")[0] in text
    assert rest.partition("</section>")[0] in text
