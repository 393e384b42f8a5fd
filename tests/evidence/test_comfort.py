"""Comfort: moments at and away from contacts, turns and steps back, on exact motions."""

import numpy as np
import pytest

from evac.evidence.comfort.page import measured_moments, steps_back
from evac.evidence.people.measures import Track
from evac.physics.state import make_crowd
from evac.physics.world import make_world
from tests.physics.scenes import make_building, uniform_fields

TICK = 0.1


def along(*velocity, start=(0.0, 0.0), level=0):
    """Return places of somebody who stands for 2 s, then has these velocities for a tick each, on given levels."""
    moved = TICK * np.array([*[(0.0, 0.0)] * 20, *velocity], float)
    place = np.array(start) + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return place, np.broadcast_to(np.asarray(level, np.int32), len(place))


def track_of(*people):
    place, level = (np.stack(each, axis=1) for each in zip(*people, strict=True))
    return Track(TICK * np.arange(len(place)), place, level, np.full(len(people), np.nan))


def moments_of(*people, tau=0.5):
    """Return the moments of people on three levels, of which the first two are joined by a portal."""
    building = make_building(3 * [(-10.0, -10.0, 10.0, 10.0)], portals=[(0, 1, (0.0, -10.0, 0.0, 10.0))])
    crowd = make_crowd([place[0] for place, _ in people], speed=1.0, radius=0.2, tau=tau)
    world = make_world(building, uniform_fields(3))
    return measured_moments(track_of(*people), crowd, world)


EVEN, SUDDEN = [(0.4, 0.0)] * 4, [(0.4, 0.0), (1.0, 0.0), (1.0, 0.0), (-0.5, 0.2)]


def test_accelerations_and_turns_away_from_contacts_count():
    """Changes of 0.4, 0.6, 0 and 1.51 m/s in a tick, of which the last is a turn."""
    found = moments_of(along(*SUDDEN), along(*EVEN, start=(0.0, 3.0)))
    assert found["moments"] == found["away from contacts"] == 2 * 3
    assert found["accelerations"] == found["accelerations away"] == 2
    assert found["greatest acceleration away [m/s2]"] == pytest.approx(10.0 * np.hypot(1.5, 0.2))
    assert found["turns away"] == 1
    assert found["greatest speed of the desired one away [-]"] == pytest.approx(1.0)


@pytest.mark.parametrize(("gap", "level", "away"), [(0.09, 0, 0), (0.09, 1, 0), (0.09, 2, 2), (0.2, 0, 2)])
def test_who_could_touch_within_a_tick_is_not_away_from_contacts(gap, level, away):
    """At a relative speed of 1 m/s, somebody who is nearer than 0.1 m, on the same level or through a portal."""
    found = moments_of(along(*SUDDEN), along(*[(0.0, 0.0)] * 4, start=(0.1, 0.4 + gap), level=level))
    assert found["accelerations"] == 2
    assert found["accelerations away"] == away


def test_who_steps_over_a_portal_and_back_is_counted_with_the_way_beyond_it():
    """One only passes it, two step beyond it, and one of them by the distance from the line on which it comes back."""
    ways = [(1.0, 0.0)] * 4, [(1.0, 0.0), (1.0, 0.0), (-1.5, 0.0), (0.0, 0.0)], [(1.0, 0.0), (4.0, 0.0), (-4.0, 0.0)]
    levels = [0] * 22 + [1] * 3, [0] * 21 + [1, 1, 0, 0], [0] * 21 + [1, 1, 0, 0]
    people = [along(*way, *[(0.0, 0.0)] * (4 - len(way)), level=level) for way, level in zip(ways, levels, strict=True)]
    assert steps_back(track_of(*people)) == {
        **{"people": 3, "step back": 2, "step back far": 1},
        "greatest way back [m]": pytest.approx(0.4),
    }
