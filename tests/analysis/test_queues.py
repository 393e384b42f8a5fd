"""Queues of crowds that were written as they are."""

from dataclasses import replace

import numpy as np
import pytest

from evac.analysis.congestion import Exceedance, find_congestion
from evac.analysis.lines import link_flows, recorded_moves
from evac.analysis.maps import QUANTITIES, level_maps
from evac.analysis.queues import QueueSearch, find_queues


def flows_of(trajectory):
    """Return the flows of a trajectory in which nobody passes several links between recorded times."""
    building, moves = trajectory.building, recorded_moves(trajectory)
    links = {tuple(sorted([*link.levels, -1][:2])): building.link_of(link) for link in building.links}
    ends = zip(moves.source.tolist(), moves.target.tolist(), strict=True)
    moves = replace(moves, link=np.array([links[min(pair), max(pair)] for pair in ends], np.int32))
    return link_flows(building, moves)


def queues_of(trajectory):
    return find_queues(trajectory, flows_of(trajectory))


def test_people_who_pass_nothing_wait_for_the_exit_that_is_nearest(written):
    # The first two stand 1 m from the door, the third one comes; they start at 0, 1.5 and 3 s. The last one walks.
    comes = [1.0 if k >= 2 else 9.0 - 4.0 * k for k in range(9)]
    standing = np.array([[[1.0, 1.5], [1.0, 2.0], [x, 1.0], [8.0 - k, 5.0]] for k, x in enumerate(comes)])
    (queue,) = queues_of(written(standing))
    assert (queue.cause, queue.level, queue.tail, queue.share) == ("exit 'door'", "floor 0", "floor 0", 1.0)
    assert (queue.people, queue.blocker) == (3, "")
    np.testing.assert_array_equal(queue.near, queue.at_once)
    (farther,) = queues_of(written(standing + np.array([1.5, 0.0])))  # more than 2 m away
    assert (farther.most, farther.near.max()) == (3, 0)
    assert (queue.most, queue.time, queue.start, queue.end) == (3, 4.0, 1.0, 8.0)


def test_stairs_are_causes_the_longest_queue_first(written):
    stands = np.array([[[12.0, 1.0], [12.0, 1.5], [2.0, 5.0]]] * 9)
    queues = queues_of(written(stands, [[3, 1, 0]] * 9))
    assert [(queue.cause, queue.people) for queue in queues] == [
        ("stair 'upper'", 1),
        ("stair 'lower'", 1),
        ("exit 'door'", 1),
    ]
    assert [queue.waited for queue in queues] == sorted((queue.waited for queue in queues), reverse=True)
    assert sum(queue.share for queue in queues) == pytest.approx(1.0)


@pytest.mark.parametrize("rows", [100_000, 1])
def test_a_queue_goes_on_to_what_is_passed_later_while_those_beyond_wait(written, monkeypatch, rows):
    """One walks down a stair, stands on it, and then before the door; the other stands above the stair meanwhile.

    They are found in parts of any size.
    """
    monkeypatch.setattr("evac.analysis.measures.MOST_ROWS", rows)
    stops = [(14.5, 2, 3), (13.5, 1, 7), (9.5, 0, 5), (1.0, 0, 1), (1.0, -1, 8)]  # x, level, frames
    first = [[x, 1.0] for x, _, frames in stops for _ in range(frames)]
    levels = [level for _, level, frames in stops for _ in range(frames)]
    after = [(15.0, 2)] * 21 + [(12.0, 1), (9.0, 0), (0.5, -1)]
    trajectory = written(
        np.stack([first, [[x, 1.0] for x, _ in after]], axis=1), np.stack([levels, [at for _, at in after]], axis=1)
    )
    queues = {queue.cause: queue for queue in queues_of(trajectory)}
    at = {cause: queue.at_once[[1, 6, 10, 12, 17]].tolist() for cause, queue in queues.items()}
    assert at == {"stair 'lower'": [1, 2, 0, 0, 0], "exit 'door'": [0, 0, 1, 2, 1]}
    door = queues["exit 'door'"]
    assert (door.most, door.time, door.level, door.tail, door.most_on) == (2, 11.0, "floor 0", "floor 1", "floor 1")


@pytest.mark.parametrize("rows", [100_000, 30, 1])
def test_one_pass_finds_the_maps_congestion_and_queues_that_each_finds_alone(written, monkeypatch, rows):
    """Its parts have more than so many rows by the people of one time at most; in the last one nobody is inside."""
    monkeypatch.setattr("evac.analysis.measures.MOST_ROWS", rows)
    crowd = np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2) * 0.4 + [1.0, 1.2]
    trajectory = written([crowd] * 9 + [crowd * 1.3] * 3, [[0] * 25] * 11 + [[-1] * 25])
    flows, sizes = flows_of(trajectory), []
    watched, search = Exceedance(trajectory), QueueSearch(trajectory, flows)
    maps = level_maps(
        trajectory, densities=watched.densities, also=lambda part: search.add(part) or sizes.append(len(part.frame))
    )
    (place,), (queue,) = find_congestion(trajectory).places, find_queues(trajectory, flows)
    assert (watched.congestion().places, search.found()) == ((place,), (queue,))
    for name, own in level_maps(trajectory).items():
        for quantity in QUANTITIES:
            np.testing.assert_array_equal(maps[name].array(quantity), own.array(quantity))
    assert sum(sizes) == 11 * 25
    assert max(sizes) <= rows + 25


def test_nobody_waits_before_the_response_time(written):
    assert queues_of(written(np.full((2, 3, 2), 2.0)))[0].people == 1  # the others start at 1.5 and 3 s
    assert queues_of(written([[[1.0, 1.0]]])) == ()


def test_who_has_not_started_in_front_of_the_first_is_named(written):
    """The third person starts at 3 s, and stands between the door and another one, who waits from 1 s on."""
    places = [[[1.5, 1.5], [6.0, 5.0], [0.6, 1.5]]] * 4
    (queue, *_) = queues_of(written(places))
    assert queue.blocker == "person 2, who has not started"
    assert queues_of(written(places * 4))[0].blocker == ""  # most of the waiting is later
