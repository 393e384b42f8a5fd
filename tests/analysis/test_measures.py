"""Waiting and contact forces, as every picture, map and page has them."""

import numpy as np

from evac.analysis.measures import Measuring

EVERYBODY = np.arange(3, dtype=np.int32)


def frames():
    """A person who stands, one who stands and starts at 1 s, one who walks and is gone after 1 s; every 0.5 s."""
    for k in range(6):
        rows = EVERYBODY if k < 3 else EVERYBODY[:2]
        speed, force = np.array([0.1, 0.0, 1.2])[: len(rows)], np.array([100.0 * k, 0.0, 50.0])[: len(rows)]
        yield 0.5 * k, rows, speed, np.array([True, k >= 2, True])[: len(rows)], force


def test_people_wait_after_their_response_time_and_below_the_waiting_speed():
    measuring = Measuring(3)
    found = [measuring.add(*frame) for frame in frames()]
    assert found[-1].waited.tolist() == [2.5, 1.5]
    assert measuring.waited.tolist() == [2.5, 1.5, 0.0]
    assert [measures.waits.tolist()[:2] for measures in found] == [[0, 0], [0.5, 0], [0.5, 0], *[[0.5, 0.5]] * 3]


def test_contact_forces_are_means_of_a_second_of_those_who_are_there():
    measuring = Measuring(3)
    found = [measuring.add(*frame).contact_force.tolist() for frame in frames()]
    assert found == [[0, 0, 50], [50, 0, 50], [150, 0, 50], [250, 0], [350, 0], [450, 0]]
