"""A run ends with everybody out, when its duration is over, or when nobody gets on for too long."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from evac.case.schema import SimulationSettings
from evac.physics.state import make_crowd
from evac.results.ending import DURATION_OVER, EVERYBODY_OUT, NO_PROGRESS, PROGRESS, Ending

SETTINGS = SimulationSettings(step=0.01, tick=0.1, duration=100.0, no_progress=5.0)


@dataclass
class Ways:
    """Everybody is so many seconds from an exit: the time left on each route (routes, people), or on the only one."""

    remaining: np.ndarray = field(default_factory=lambda: np.array([9.0, 4.0]))

    def travel_time_at(self, level, position, route, radius=0.0):
        return np.atleast_2d(self.remaining)[route, np.arange(len(level))]


def two():
    return make_crowd(np.zeros((2, 2)))


def first_end(ending, crowd, ways, first=0, last=10_000, change=lambda time: None):
    """Return step and reason of the end; people do not move unless `change` changes crowd or ways at a time [s]."""
    for step in range(first, last, SETTINGS.steps_per_tick):
        change(step * SETTINGS.step)
        if reason := ending.reason(step, crowd, ways):
            return step, reason
    return None


def test_everybody_out_comes_before_the_end_of_the_duration():
    crowd = two()
    crowd.level[:] = -1
    assert Ending(SETTINGS, 2, 1).reason(10_000, crowd, Ways()) == EVERYBODY_OUT
    assert Ending(SETTINGS, 2, 1).reason(10_000, two(), Ways()) == DURATION_OVER


def test_nobody_moves_for_too_long():
    assert first_end(Ending(SETTINGS, 2, 1), two(), Ways(), first=100) == (600, NO_PROGRESS)


@pytest.mark.parametrize(("change", "end"), [(0.2, 600), (0.3, 800)])
def test_a_quarter_of_a_second_of_the_way_is_progress(change, end):
    ending, ways = Ending(SETTINGS, 2, 1), Ways()
    assert first_end(ending, two(), ways, first=100, last=300) is None
    ways.remaining[1] -= change
    assert first_end(ending, two(), ways, first=300) == (end, NO_PROGRESS)


def test_who_has_yet_to_set_off_and_who_gets_out_are_progress():
    crowd = two()
    crowd.start_time[0] = 20.0
    assert first_end(Ending(SETTINGS, 2, 1), crowd, Ways())[0] >= 2400
    crowd = two()
    crowd.level[0], crowd.exit_time[0] = -1, 30.0
    assert first_end(Ending(SETTINGS, 2, 1), crowd, Ways())[0] == 3500


def test_who_stays_at_a_refuge_makes_no_progress_for_others():
    arrived = np.array([False, False])
    ending = Ending(SETTINGS, 2, 1, arrived)

    def arrive(time):
        arrived[1] = time >= 3.0

    assert first_end(ending, two(), Ways(), change=arrive) == (500, NO_PROGRESS)


def test_who_stands_is_stuck_unless_gone_or_not_yet_started():
    ending, crowd = Ending(SETTINGS, 4, 1), make_crowd(np.zeros((4, 2)))
    crowd.start_time[0], crowd.level[3] = 20.0, -1
    assert first_end(ending, crowd, Ways(np.full(4, 9.0)), last=900) is None
    assert ending.stuck(490, crowd).tolist() == []
    assert ending.stuck(900, crowd).tolist() == [1, 2]


@pytest.mark.parametrize(("depth", "end"), [(0.3, 500), (3.0, 600)])
def test_a_jam_that_jiggles_makes_no_progress(depth, end):
    """Both are pushed back and return, again and again, to where one of them is at the start, the other after 1 s."""
    ways = Ways()
    start = ways.remaining.copy()

    def jiggle(time):
        ways.remaining = start + depth * np.array([0.5 - 0.5 * np.cos(time), 0.5 - 0.5 * np.sin(1.3 * time)])

    assert first_end(Ending(SETTINGS, 2, 1), two(), ways, change=jiggle) == (end, NO_PROGRESS)


@pytest.mark.parametrize(("share", "ends"), [(0.5, True), (3.0, False)])
def test_creep_is_no_progress_but_a_slow_queue_is(share, ends):
    """`PROGRESS` in so many times `no_progress`, all the time."""
    settings = SETTINGS.model_copy(update={"no_progress": 20.0, "duration": 1000.0})
    ways = Ways(np.array([900.0, 800.0]))

    def creep(time):
        ways.remaining = np.array([900.0, 800.0]) - share * PROGRESS * time / settings.no_progress

    found = first_end(Ending(settings, 2, 1), two(), ways, last=90_000, change=creep)
    assert found == ((2000, NO_PROGRESS) if ends else None)


def test_who_alternates_between_routes_for_ever_makes_no_progress():
    """Towards one exit for 2 s, then back towards the other: each route counts once, the last at 3 s."""
    crowd, ways = two(), Ways(np.array([[9.0, 9.0], [9.0, 9.0]]))

    def turn(time):
        crowd.route[:] = int(time / 2.0) % 2
        way = time % 4.0 if time % 4.0 < 2.0 else 4.0 - time % 4.0
        ways.remaining = np.array([[9.0 - way] * 2, [7.0 + way] * 2])

    assert first_end(Ending(SETTINGS, 2, 2), crowd, ways, change=turn) == (800, NO_PROGRESS)


def test_a_better_way_is_progress_from_where_it_starts():
    """After 4 s in vain on a way of 9 s both follow one of 50 s, and walk on."""
    crowd, ways = two(), Ways(np.array([[9.0, 9.0], [50.0, 50.0]]))

    def walk_on(time):
        crowd.route[:] = time > 4.0
        ways.remaining = np.array([[9.0] * 2, [50.0 - 0.5 * time] * 2])

    assert first_end(Ending(SETTINGS, 2, 2), crowd, ways, last=9_000, change=walk_on) is None


def test_people_are_measured_from_where_they_set_off():
    """Pushed on by 2 s of the way and back before they set off, both are as far as at the start."""
    crowd, ways = two(), Ways()
    crowd.start_time[:] = 20.0

    def go(time):
        ways.remaining = np.array([9.0, 4.0]) - (2.0 if time < 10.0 else 0.0) - max(0.0, min(1.0, time - 22.0))

    assert first_end(Ending(SETTINGS, 2, 1), crowd, ways, change=go) == (2800, NO_PROGRESS)


@pytest.mark.parametrize("no_progress", [0.05, 5.0])
def test_who_walks_slowly_makes_progress_however_short_the_patience(no_progress):
    """At 0.3 of the reference speed."""
    ways = Ways(np.array([90.0, 80.0]))

    def go(time):
        ways.remaining = np.array([90.0, 80.0]) - 0.3 * time

    settings = SETTINGS.model_copy(update={"no_progress": no_progress})
    assert first_end(Ending(settings, 2, 1), two(), ways, last=9_000, change=go) is None


def test_people_whom_no_way_leads_out_end_a_run():
    ways = Ways(np.array([np.inf, np.inf]))
    assert first_end(Ending(SETTINGS, 2, 1), two(), ways)[1] == NO_PROGRESS
