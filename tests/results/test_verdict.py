"""The verdict on compartments, the person with the least margin, and the answer of a run."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evac.results.verdict import answer_of, bars, judged, least_margins, movement_of, rank, time_of_share, verdict_of


def row(name, required, available=100.0, people=3, **more):
    return {
        "name": name,
        "people": people,
        "required": required,
        "available": available,
        "until": 120.0,
        "criterion": "fed",
    } | more


def safety(*rows, factor=2.0):
    return {"factor": factor, "compartments": list(rows)}


@pytest.mark.parametrize(
    ("required", "factor", "status", "margins", "words"),
    [
        (50.0, 2.0, "green", (50.0, 0.0), "In time: 'hall' is left after 50.0 s, available for 100.0 s (dose): margin"),
        (50.1, 2.0, "amber", (49.9, -0.2), "In time, but not with the safety factor: 'hall' is left after 50.1 s"),
        (100.0, 2.0, "amber", (0.0, -100.0), ": margin 0.0 s, -100.0 s with the factor 2"),
        (100.1, 2.0, "red", (-0.1, -100.2), "NOT in time: 'hall' is left after 100.1 s"),
        (90.0, 1.0, "green", (10.0, 10.0), "(dose): margin 10.0 s"),
        (None, 2.0, "red", (None, None), "'hall' is not left by everybody, available for 100.0 s (dose): no margin"),
    ],
)  # fmt: skip
def test_the_status_of_a_compartment_follows_from_its_margins(required, factor, status, margins, words):
    verdict = verdict_of(safety(row("hall", required), factor=factor))
    assert (verdict["status"], verdict["compartment"]) == (status, "hall")
    assert (verdict["required"], verdict["available"]) == (required, 100.0)
    found = verdict["margin"], verdict["margin_with_factor"]
    assert found == margins if required is None else found == pytest.approx(margins)
    assert words in verdict["text"]
    assert ("with the factor" in verdict["text"]) == (factor != 1.0 and required is not None)


def test_the_worst_compartment_decides_and_empty_ones_do_not():
    rows = row("a", 30.0), row("b", 45.0, criterion="layer"), row("c", None, people=0), row("d", 20.0, available=None)
    verdict = verdict_of(safety(*rows))
    assert (verdict["compartment"], verdict["margin_with_factor"]) == ("b", 10.0)
    assert "(layer of smoke)" in verdict["text"]
    assert [one["name"] for one in bars(safety(*rows))] == ["b", "a", "d"]
    by_name = {one["name"]: one for one in judged(safety(*rows))}
    assert [*by_name] == ["a", "b", "d"]
    assert (by_name["d"]["limit"], by_name["d"]["margin"]) == (120.0, 100.0)  # at least as long as the data
    assert by_name["d"]["text"] == "'d' is left after 20.0 s, available for at least 120.0 s"
    assert verdict_of(safety(row("c", None, people=0)))["status"] == verdict_of(None)["status"] == "none"
    assert bars(None) == []
    spread = next(judged(safety(row("a", 30.0, spread=" (95 %)"))))
    assert "left after 30.0 s (95 %), available" in spread["text"]


def test_verdicts_have_an_order_from_the_worst():
    times = (None, 101.0, 60.0, 55.0, 45.0, 10.0)
    verdicts = [verdict_of(None), *(verdict_of(safety(row("a", time))) for time in times)]
    assert sorted(reversed(verdicts), key=rank) == verdicts
    assert rank(verdicts[0]) == (0, -math.inf)


def test_least_margins_have_the_last_place_recorded_by_then():
    levels = [SimpleNamespace(name="down"), SimpleNamespace(name="up")]
    rows = [
        SimpleNamespace(
            person=np.array(people),
            level=np.array(level),
            motion=np.array([[x, 1.0, 0.0, 0.0] for x in xs], np.float32),
        )
        for people, level, xs in (([0, 1], [1, 1], [1.0, 2.0]), ([0, 1], [0, 1], [3.0, 4.0]), ([1], [0], [5.0]))
    ]
    building, time = SimpleNamespace(levels=levels), np.array([0.0, 0.5, 1.0])
    motion = SimpleNamespace(rows=rows, time=time, origin=np.array([100.0, 200.0]), building=building)
    margins = {"least_margin": np.array([7.0, -2.0, np.inf, 3.0]), "least_margin_at": np.array([0.7, 1.0, 0.0, 0.5])}
    found = [(one.person, one.margin, one.time, one.level.name, one.x, one.y) for one in least_margins(margins, motion)]
    assert found == [(1, -2.0, 1.0, "down", 105.0, 201.0), (0, 7.0, 0.7, "down", 103.0, 201.0)]
    assert [one.person for one in least_margins(margins, motion, 1)] == [1]
    assert least_margins({}, motion) == []


def test_the_time_of_a_share_is_that_of_the_person_who_completes_it():
    times = np.array([4.0, np.nan, 1.0, 3.0, 2.0])
    assert [time_of_share(times, share) for share in (0.0, 20.0, 21.0, 80.0)] == [1.0, 1.0, 2.0, 4.0]
    assert time_of_share(times, 81.0) is None
    assert time_of_share(np.zeros(0), 95.0) is None


def test_the_answer_of_a_run(results, make_results):
    answer = answer_of(results)
    assert answer.outcome == "NOT everybody is out after 20.00 s (no progress): 2 of 5 people out"
    assert answer.times == "Last out after 9.00 s; fewer than 95 % got out"
    assert answer.exits == ("Exit 'door': 2 people by 9.00 s",)
    assert answer.queue == ""
    assert answer.remarks == results.remarks
    assert answer.warnings == "1 warning about building and people"
    assert [line for line in answer.lines() if not line] == []
    everybody = replace(
        results, crowd=results.crowd.replace(exit_time=np.arange(1.0, 6.0), level=np.full(5, -1, np.int32))
    )
    assert answer_of(replace(everybody, ended="everybody out")).outcome == "Everybody out: 5 of 5 people out"
    assert answer_of(replace(everybody, ended="duration over")).outcome == "Complete: 5 of 5 people out"
    assert answer_of(everybody).times == "Evacuation time 5.00 s; 95 % are out after 5.00 s"
    nobody = answer_of(replace(results, crowd=results.crowd.replace(exit_time=np.full(5, np.nan))))
    assert nobody.times == ""
    assert nobody.outcome.endswith(": 0 of 5 people out")


def test_more_than_four_exits_are_counted_together(results, make_results):
    door = results.building.exits[0]
    exits = tuple(replace(door, index=k, name=f"door {k}") for k in range(5))
    used = np.array([0, 1, 1, 2, 3], np.int32)
    crowd = results.crowd.replace(exit_used=used, exit_time=np.arange(1.0, 6.0))
    lines = answer_of(make_results(building=replace(results.building, exits=exits), crowd=crowd)).exits
    assert [line.partition(":")[0] for line in lines] == [
        "Exit 'door 1'",
        "Exit 'door 0'",
        "Exit 'door 2'",
        "2 other exits",
    ]
    assert lines[0].startswith("Exit 'door 1': 2 people by 3.00 s")
    assert lines[3] == "2 other exits: 1 person"


def test_it_is_told_whether_people_keep_distances():
    assert movement_of(["walking", "headway"]) == "People keep distances (walking, headway)"
    assert movement_of([]) == "People do not keep distances; to change this, set behaviours.walking={}"
