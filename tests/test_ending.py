"""A run ends with everybody out, when its duration is over, or when nobody gets on for too long."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from evac.ending import DURATION_OVER, EVERYBODY_OUT, NO_PROGRESS, Ending
from evac.physics.bundles import make_crowd
from evac.scenario.schema import SimulationSettings

SETTINGS = SimulationSettings(step=0.01, tick=0.1, duration=100.0, no_progress=5.0)


@dataclass
class Ways:
    """Everybody is so many seconds from an exit."""

    remaining: np.ndarray = field(default_factory=lambda: np.array([9.0, 4.0]))

    def travel_time_at(self, level, position, route):
        return self.remaining[: len(level)]


def two():
    return make_crowd(np.zeros((2, 2)))


def first_end(ending, crowd, ways, first=0, last=10_000):
    """Return step and reason of the end of people who do not move."""
    reasons = ((step, ending.reason(step, crowd, ways)) for step in range(first, last, SETTINGS.steps_per_tick))
    return next((found for found in reasons if found[1]), None)


def test_everybody_out_comes_before_the_end_of_the_duration():
    crowd = two()
    crowd.level[:] = -1
    assert Ending(SETTINGS, 2, 1).reason(10_000, crowd, Ways()) == EVERYBODY_OUT
    assert Ending(SETTINGS, 2, 1).reason(10_000, two(), Ways()) == DURATION_OVER


def test_nobody_moves_for_too_long():
    assert first_end(Ending(SETTINGS, 2, 1), two(), Ways(), first=100) == (600, NO_PROGRESS)


def test_infinite_patience():
    settings = SETTINGS.model_copy(update={"no_progress": float("inf")})
    assert first_end(Ending(settings, 2, 1), two(), Ways()) is None


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


def test_people_whom_no_way_leads_out_end_a_run():
    ways = Ways(np.array([np.inf, np.inf]))
    assert first_end(Ending(SETTINGS, 2, 1), two(), ways)[1] == NO_PROGRESS


def test_it_goes_on_where_it_stopped():
    ending = Ending(SETTINGS, 2, 1)
    assert first_end(ending, two(), Ways(), first=100, last=400) is None
    other = Ending(SETTINGS, 2, 1)
    other.restore(ending.state())
    assert first_end(other, two(), Ways(), first=400) == (600, NO_PROGRESS)
