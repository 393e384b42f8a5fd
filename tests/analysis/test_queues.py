"""Queues of crowds that were written as they are."""

from dataclasses import replace

import numpy as np
import pytest

from evac.analysis.congestion import find_queues


def test_people_wait_before_the_exit_that_is_nearest(written):
    # The first two stand 1 m from the door, the third one comes; they start at 0, 1.5 and 3 s. The last one walks.
    comes = [1.0 if k >= 2 else 9.0 - 4.0 * k for k in range(9)]
    standing = np.array([[[1.0, 1.5], [1.0, 2.0], [x, 1.0], [8.0 - k, 5.0]] for k, x in enumerate(comes)])
    (queue,) = find_queues(written(standing))
    assert (queue.place, queue.level) == ("before exit 'door'", "floor 0")
    assert queue.people == 3
    np.testing.assert_array_equal(queue.near, queue.at_once)
    (farther,) = find_queues(written(standing + np.array([1.5, 0.0])))  # more than 2 m away
    assert (farther.most, farther.near.max()) == (3, 0)
    assert "1 person waited" in str(replace(queue, people=1))
    assert (queue.most, queue.time) == (3, 4.0)
    assert (queue.x, queue.y) == (pytest.approx(1.0), pytest.approx(1.5))


def test_stairs_and_what_leads_to_them_are_named_the_longest_queue_first(written):
    stands = np.array([[[12.0, 1.0], [12.0, 1.5], [2.0, 5.0]]] * 9)
    queues = find_queues(written(stands, [[3, 1, 4]] * 9))
    assert [(queue.place, queue.level) for queue in queues] == [
        ("on stair 'upper'", "flight 2"),
        ("on stair 'lower'", "flight 1"),
        ("before stair 'upper'", "floor 2"),
    ]
    assert [queue.waited for queue in queues] == sorted((queue.waited for queue in queues), reverse=True)


def test_nobody_waits_before_the_response_time(written):
    assert find_queues(written(np.full((2, 3, 2), 2.0)))[0].people == 1  # the others start at 1.5 and 3 s
    assert find_queues(written([[[1.0, 1.0]]])) == ()
