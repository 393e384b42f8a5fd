"""Nobody hangs on a corner: each pupil's way out of the classroom and the school, alone."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.simulation.simulation import Simulation
from tests.runs import MODELS
from tests.validation.buildings import alone

#: Who does not get nearer to the exit for so long hangs somewhere [ticks of 0.1 s].
LONG = 15


def check_all(case, every=1, **changes):
    """Each of some people gets out alone, nearer all the time, and takes at most twice its way at its speeds."""
    simulation = Simulation(load_case(case, changes))
    crowd = simulation.population.crowd
    state = simulation.state()
    lengths = simulation.fields.lengths_at(crowd.level, crowd.position, crowd.route)
    expected = (lengths / crowd.speed).sum(axis=1)
    for person in range(0, len(expected), every):
        remaining = np.array(alone(simulation, person, state))
        assert np.isfinite(simulation.population.crowd.exit_time[person]), person
        assert (remaining[LONG:] < remaining[:-LONG]).all(), person
        assert expected[person] - 0.5 <= 0.1 * len(remaining) <= 2.0 * expected[person] + 2.0, person


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_in_the_classroom(model):
    check_all("classroom", **{"contact.model": model, "simulation.duration": 60.0})


@pytest.mark.parametrize(
    ("model", "every"), [("nsm2", 12), *(pytest.param(m, 1, marks=pytest.mark.slow) for m in MODELS)]
)
def test_in_the_school(model, every):
    check_all("primary_school", every, **{"contact.model": model, "behaviours.response_time": False})


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_in_the_square_room(model):
    check_all("square_room", **{"contact.model": model})


def test_a_person_who_hangs_would_be_seen():
    """The same check fails for somebody who cannot walk."""
    with pytest.raises(AssertionError):
        check_all("square_room", **{"people.people.speed": 1e-6, "simulation.duration": 5.0})
