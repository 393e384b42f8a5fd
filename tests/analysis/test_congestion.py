"""Congestion: where a crowd that stands for a known time is found, and for how long."""

import numpy as np
import pytest

from evac.analysis.congestion import SHARE, find_congestion

#: A crowd of 6.25 people per square metre on a square of 2 m, 1 m from the walls; where it stands otherwise.
CROWD = np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2) * 0.4 + [2.0, 1.2]
APART = np.stack(np.meshgrid(np.linspace(0.5, 9.5, 5), np.linspace(0.5, 5.5, 5)), axis=-1).reshape(-1, 2)


def test_a_crowd_that_stands_for_six_seconds_and_again_for_two(written):
    stays = [1, 1, 1, 0, 0, 1, 0, 0, 0, 0]
    trajectory = written([CROWD if here else APART for here in stays], interval=2.0)
    found = find_congestion(trajectory, 4.0, 3.0)
    (place,) = found.places
    assert (place.level, place.near) == ("floor 0", "door")
    assert (place.start, place.end, place.duration, place.longest_spell) == (0.0, 12.0, 8.0, 6.0)
    assert (place.x, place.y) == pytest.approx((2.8, 2.0), abs=0.15)
    assert 4.0 < place.density == found.greatest_density < 7.0
    assert 1.0 < place.area < 4.0
    assert found.longest == 8.0


def test_the_time_has_to_be_exceeded_and_is_a_share_by_default(written):
    trajectory = written([CROWD, CROWD] + 8 * [APART], interval=2.0)
    assert find_congestion(trajectory, 4.0, 3.9).places
    assert not find_congestion(trajectory, 4.0, 4.0).places
    assert find_congestion(trajectory).least_time == pytest.approx(SHARE * 18.0)
    assert not find_congestion(trajectory, 7.0, 0.0).places


def test_two_crowds_are_two_places_the_longer_one_first(written):
    second = CROWD + np.array([5.0, 2.0])
    both = [np.concatenate([CROWD, second])] * 3 + [np.concatenate([APART, second])] * 2
    found = find_congestion(written([*both, np.concatenate([APART, APART])], interval=1.0), 4.0, 1.0)
    assert [place.duration for place in found.places] == [5.0, 3.0]
    assert found.places[0].x > found.places[1].x
