"""The answer of a run says what its tables say."""

import numpy as np

from evac.results.answer import answer_of


def test_people_left_are_said_first(make_results):
    answer = answer_of(make_results())
    assert answer.verdict == "NOT everybody is out after 20.00 s (no progress): 2 of 5 people out"
    assert answer.times == "Last out after 9.00 s; fewer than 95 % got out"
    assert answer.exits == ("Exit 'door': 2 people by 9.00 s",)
    assert answer.queue == ""  # nothing was recorded
    assert answer.warnings == "1 warning about building and people"


def test_a_complete_run_has_its_times(make_results):
    results = make_results(ended="everybody out")
    results.crowd.level[:] = -1
    results.crowd.exit_used[:] = 0
    results.crowd.exit_time[:] = np.arange(5) * 2.0 + 1.0
    answer = answer_of(results)
    assert answer.verdict == "Everybody out: 5 of 5 people out"
    assert answer.times == "Evacuation time 9.00 s; 95 % are out after 9.00 s"


def test_quality_warnings_are_named_by_their_kind(make_results):
    from dataclasses import replace

    results = replace(make_results(), quality_warnings=("lethal: a", "lethal: b", "flow: c"), keeps_distance=("mine",))
    answer = answer_of(results)
    assert answer.warnings == "3 quality warnings (lethal; flow), 1 warning about building and people"
    assert "(mine)" in answer.movement
    assert "--set" in answer_of(make_results()).movement
