"""Queues before gates."""

import numpy as np
import pytest

from evac.directions.build import build_fields
from evac.directions.density import BINS, STEP, THROUGH_DOORS, Gates
from evac.directions.routes import Route


@pytest.fixture
def gates(hall):
    return Gates(build_fields(hall, [Route((), "quickest")]).grids[0].grids)  # two exits of 1 m


def test_a_gate_is_passed_at_its_flow(gates):
    gates.count(np.zeros(74, np.int32), np.full(74, 0.5), 1.0)
    assert gates.queues[0, 0] == pytest.approx(STEP * THROUGH_DOORS / 74)
    assert (gates.queues[0, 1:] == 1.0).all()
    assert (gates.queues[1] == 1.0).all()


def test_whoever_arrives_after_the_queue_does_not_wait(gates):
    gates.count(np.zeros(3, np.int32), np.array([0.5, 0.5, 20.5]), 1.0)
    assert gates.queues[0, 0] == pytest.approx(STEP * THROUGH_DOORS / 2)
    assert (gates.queues[0, 1:] == 1.0).all()


def test_counts_are_averaged_and_leave_out_who_is_on_no_way_or_far_away(gates):
    for gain in (1.0, 0.25):
        gates.count(np.array([1, -1, 1], np.int32), np.array([4.5, 4.5, BINS * STEP]), gain)
    assert gates.people[1, 4] == pytest.approx(1.0)
    assert gates.people.sum() == pytest.approx(1.0)
    gates.count(np.zeros(0, np.int32), np.zeros(0), 0.25)
    assert gates.people[1, 4] == pytest.approx(0.75)
