"""The standard tests of the field: buildings, criteria, verdicts, and the page."""

import csv

import numpy as np
import pytest

from evac.evidence.report import Evidence
from evac.evidence.validation import capacity
from evac.evidence.validation.buildings import (
    across,
    corner,
    hall_and_stair,
    rectangle,
    rooms_along_a_corridor,
    two_rooms,
    two_ways,
    write_case,
    write_obj,
)
from evac.evidence.validation.flows import weidmann
from evac.evidence.validation.page import QUICK_SUBJECTS, check_row, failed_tests, run, verdict_rows
from evac.evidence.validation.trial import Check, Criterion, Trial, mean_interval
from evac.simulation.assembly import read_building
from evac.study.statistics import mean_interval as of_a_study

ASKED = Criterion("RiMEA 1", "time [s]", "RiMEA", low=26.0, high=34.0)
PERSON = {"positions": [[1.0, 1.0]], "z": 0.0, "speed": 1.0, "tau": 0.5}


def test_a_band_is_told_in_words_and_has_a_middle():
    assert (ASKED.band, ASKED.reference) == ("26 to 34", 30.0)
    assert Criterion("a", "b", "c", low=1.0).band == "at least 1"
    assert Criterion("a", "b", "c", high=1.33).band == "at most 1.33"
    assert Criterion("a", "b", "c", high=1.33).reference == 1.33
    assert Criterion("a", "b", "c", low=20, high=20).band == "20"


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ((26.0,), "yes"),
        ((30.0, 30.2), "yes"),
        ((30.0, 36.0), "yes, not certain: 33"),
        ((33.0, 37.0), "NO, not certain: 35, 1.03 times the bound"),
        ((68.0, 68.0), "NO: 68, 2 times the bound"),
        ((68.0,), "NO: 68, 2 times the bound"),
        ((13.0,), "NO: 13, 0.5 times the bound"),
        ((30.0, np.nan, 30.0), "NO: 1 of 3 runs block"),
        ((np.nan,), "NO: 1 of 1 runs block"),
    ],
)
def test_a_check_is_passed_by_its_mean_and_by_no_blocked_run(values, verdict):
    check = Check(ASKED, "DEM", values)
    assert check.verdict == verdict
    assert check.is_passed == verdict.startswith("yes")


def test_blocked_runs_are_left_out_of_the_mean_and_counted():
    check = Check(ASKED, "DEM", (28.0, np.nan, 32.0, 30.0))
    assert (check.mean, check.blocked) == (30.0, 1)
    assert check.interval == mean_interval(np.array([28.0, 32.0, 30.0]))
    assert Check(ASKED, "DEM", (np.nan,)).mean is None


def test_the_interval_of_a_flow_is_that_of_studies_and_never_below_zero():
    flows = np.array([0.9, 1.1, 1.4, 0.9, 1.7])
    low, high = mean_interval(flows)
    assert (low, high) == of_a_study(flows)
    assert 0.0 < low < high
    assert mean_interval(np.array([0.83, 1.65])) is None  # Student's t gives -3.93 to 6.41
    assert mean_interval(np.array([1.0])) is None


def test_a_check_of_several_runs_without_an_interval_is_not_certain():
    assert Check(ASKED, "DEM", (14.0, 46.0)).verdict == "yes, not certain: 30"


def test_weidmanns_curve_has_its_published_values():
    assert [weidmann(density) for density in (0.5, 1.0, 2.0, 3.0)] == pytest.approx(
        [1.298, 1.058, 0.606, 0.331], abs=1e-3
    )
    assert weidmann(5.4) == pytest.approx(0.0)


def test_a_written_case_is_read_back_with_exits_areas_and_groups(tmp_path):
    case = write_case(
        tmp_path,
        [rectangle(0, 0, 4, 2), rectangle(4, 0, 8, 2, 0.0, 3.0), rectangle(8, 0, 12, 2, 3.0)],
        [("end", across(12, 0, 2), 3.0)],
        [PERSON, {"area": "below", "number": 2}],
        [("below", (2, 0, 3.5, 2), 0.0)],
        {"contact.model": "dem", "simulation": {"duration": 5.0}},
    )
    assert [group.name for group in case.people] == ["group 0", "group 1"]
    assert case.simulation.duration == 5.0
    outcome = Trial("NSM2", (1,)).run_case(case)[0]
    assert [level.kind for level in outcome.results.building.levels] == ["floor", "flight", "floor"]
    assert outcome.results.number_of_people == 3


@pytest.mark.parametrize(
    ("faces", "way_out", "kinds", "portals"),
    [
        (hall_and_stair(1.2), across(23, 0, 10), ["flight", "floor", "floor"], 2),
        (two_ways(), [[27, 0], [29, 0]], ["flight", "flight", "floor", "floor"], 4),
        (rooms_along_a_corridor()[0], across(18, 5, 6), ["floor"], 0),
        (corner(), [[10, 12], [12, 12]], ["floor"], 0),
        (two_rooms(0.8, 0.2, 1.0)[0], two_rooms(0.8, 0.2, 1.0)[1], ["floor"], 0),
    ],
)
def test_buildings_hang_together(tmp_path, faces, way_out, kinds, portals):
    exits = [{"name": "end", "segment": way_out, "z": 0.0}]
    building = read_building(write_obj(tmp_path / "building.obj", faces), exits=exits)
    assert sorted(level.kind for level in building.levels) == kinds
    assert len(building.portals) == portals


def test_an_outcome_is_what_the_folder_holds():
    runs = Trial("DEM", (1, 2)).runs([rectangle(0, 0, 6, 2)], [("end", across(6, 0, 2), 0.0)], [PERSON])
    assert len(runs) == 2
    for outcome in runs:
        assert outcome.last_out == pytest.approx(5.0 + 0.5, abs=0.01)
        assert outcome.numbers("response_time").tolist() == [0.0]
        assert outcome.trajectory.position.shape[1] == 1


def test_with_headway_the_slow_are_followed_and_not_pushed():
    """Two in line, 1.2 m/s behind 0.6 m/s: contact pushes the slow one on, headway does not."""
    people = [{**PERSON, "positions": [[0.5, 1.0]], "speed": 1.2}, {**PERSON, "speed": 0.6}]
    building = [rectangle(0, 0, 10, 2)], [("end", across(10, 0, 2), 0.0)]
    times = {}
    for headway in (False, True):
        trial = Trial("NSM1 inertial", (1,), headway)
        assert trial.name == ("NSM1 inertial, headway" if headway else "NSM1 inertial")
        times[headway] = trial.runs(*building, people)[0].numbers("exit_time")
    assert times[True][1] == pytest.approx(9.0 / 0.6 + 0.5, abs=0.02)
    assert times[False][1] < times[True][1] - 2.0


def test_people_left_make_a_run_blocked():
    (outcome,) = Trial("DEM", (1,)).runs(
        [rectangle(0, 0, 6, 2)], [("end", across(6, 0, 2), 0.0)], [PERSON], **{"simulation.duration": 2.0}
    )
    assert outcome.is_blocked
    assert np.isnan(outcome.last_out)


@pytest.mark.parametrize("way", capacity.WAYS)
def test_a_few_on_a_wide_stair_walk_at_their_own_speed(monkeypatch, way):
    monkeypatch.setattr(capacity, "PEOPLE", 4)
    stair = capacity.run_stair(Trial("NSM2", (1, 2)), 1.8, way)
    assert np.median(stair.ratios) == pytest.approx(1.0, abs=0.05)
    assert stair.flows.shape == (2,)


def test_doors_tell_the_share_of_blocked_runs_and_the_flow_of_the_others():
    trial = Trial("NSM2", (1, 2, 3, 4))
    door = capacity.Door(trial, 1.0, np.array([2.0, np.nan, 3.0, np.nan]), np.array([3.0, 4.5, 3.0, np.nan]))
    row = capacity.door_row(door)
    assert (row["blocked"], row["share blocked"], row["flow [1/s]"]) == (2, 0.5, 2.5)
    assert (row["exit at the door [1/s]"], row[capacity.AT_EXIT]) == (3.5, 1.4)
    (check,) = capacity.door_checks([door, capacity.Door(trial, 0.8, np.array([2.0]), np.array([2.0]))])
    assert check.blocked == 2
    blocked = capacity.door_row(capacity.Door(trial, 0.6, np.array([np.nan]), np.array([1.0])))
    assert blocked["flow [1/s]"] is blocked[capacity.AT_EXIT] is None


def test_a_test_is_passed_if_all_its_checks_are():
    other = Criterion("RiMEA 2", "time [s]", "RiMEA", low=1.0)
    checks = [
        Check(ASKED, "DEM", (30.0,)),
        Check(ASKED, "NSM2", (30.0,)),
        Check(other, "DEM", (2.0,)),
        Check(other, "NSM2", (0.5,)),
        Check(Criterion("RiMEA 2", "speed [m/s]", "RiMEA", low=1.0), "DEM", (0.5,)),
        Check(Criterion("RiMEA 2", "speed [m/s]", "RiMEA", low=1.0), "NSM2", (1.5,)),
        Check(Criterion("IMO 4", "flow [1/s]", "IMO", high=1.33), "DEM", (1.0,)),
        Check(Criterion("IMO 4", "flow [1/s]", "IMO", high=1.33), "NSM2", (2.66,)),
    ]
    assert failed_tests([check_row(check) for check in checks]) == {"DEM": ["RiMEA 2"], "NSM2": ["RiMEA 2", "IMO 4"]}
    row = verdict_rows(checks)[-1]
    assert (row["test"], row["DEM"], row["NSM2"]) == ("IMO 4", "yes", "NO: 2.66, 2 times the bound")


@pytest.mark.slow
def test_quick_run_writes_verdicts_stairs_and_doors(tmp_path):
    run(Evidence("validation", tmp_path, quick=True))
    assert (tmp_path / "validation.png").is_file()
    with (tmp_path / "verdicts.csv").open() as file:
        verdicts = list(csv.DictReader(file))
    for test in ("RiMEA 1", "RiMEA 2", "RiMEA 3", "RiMEA 6", "RiMEA 14"):
        for name in ("NSM2", "NSM2, headway"):
            assert {row[name] for row in verdicts if row["test"] == test} == {"yes"}, (name, test)
    for name in ("tests", "stairs", "doors"):
        with (tmp_path / f"{name}.csv").open() as file:
            assert {row["model"] for row in csv.DictReader(file)} == {subject.name for subject in QUICK_SUBJECTS}, name
    page = (tmp_path / "README.md").read_text()
    run(Evidence("validation", tmp_path, page_only=True))
    assert (tmp_path / "README.md").read_text() == page
