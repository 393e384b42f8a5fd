"""What a run's numbers say against it: each with a bound of its own, and nothing of a run that is all right."""

import re

import pytest

from evac.output.doubts import MEASURED, doubts_about, doubts_about_flows

ALL_RIGHT = {
    "steps": 100,
    "greatest_overlap": 0.1,
    "unconverged_steps": 0,
    "greatest_residual": 5e-4,
    "failed_position_corrections": 0,
    "energy": {"driving_work": 1000.0, "contact_dissipation": 400.0, "contact_creation": 410.0},
}


def test_nothing_is_said_of_a_run_that_is_all_right():
    assert doubts_about(ALL_RIGHT, 0.2) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"greatest_overlap": 0.101}, "overlapped by up to 0.10 m, the smallest radius being 0.20 m"),
        ({"unconverged_steps": 3, "greatest_residual": 0.25}, "in 3 of 100 steps .* the worst to 0.25 m/s"),
        ({"failed_position_corrections": 7}, "could not be parted 7 times"),
        ({"energy": {**ALL_RIGHT["energy"], "contact_creation": 411.0}}, "made 411 J, more than the 400 J"),
    ],
)
def test_each_number_is_doubted_alone_and_with_a_way_out(change, words):
    (doubt,) = doubts_about(ALL_RIGHT | change, 0.2)
    assert re.search(words, doubt)
    assert re.search("smaller simulation.step|look for", doubt)


def test_contacts_that_give_back_what_springs_took_are_not_doubted():
    springs = {"driving_work": 1000.0, "contact_dissipation": 8900.0, "contact_creation": 8700.0}
    assert doubts_about(ALL_RIGHT | {"energy": springs}, 0.2) == ()


def test_driving_that_brakes_more_than_it_works_is_no_work_of_contacts():
    braked = {"driving_work": -1000.0, "contact_dissipation": 5.0, "contact_creation": 0.0}
    assert doubts_about(ALL_RIGHT | {"energy": braked}, 0.2) == ()


def test_only_flows_beyond_measured_ones_are_doubted_and_the_exit_is_named():
    flows = {"few": None, "slow": MEASURED, "fast": 2.81}
    exits = {name: {"flow_per_metre": flow} for name, flow in flows.items()}
    (doubt,) = doubts_about_flows(exits, keeps_distance=False)
    assert doubt.startswith("2.81 people per second and metre left by 'fast', more than the 2.8 that")
    assert "[behaviours.headway]" in doubt
    (doubt,) = doubts_about_flows(exits, keeps_distance=True)
    assert doubt.endswith("look at egress.csv whether they left in one short rush")
