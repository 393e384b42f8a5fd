"""No traps: whoever has a way of own width gets out, and whoever has none is told of before the run."""

import re

import numpy as np
import pytest

from evac.case.loading import as_case
from evac.simulation.simulation import Simulation
from tests.validation.buildings import alone
from tests.validation.gaps import gap_case, has_way

#: Random plans, of which a share is tested every time.
PLANS, SHARE = 300, (3, 7, 29)


def check_plan(seed, model):
    """Compare who is told to have no way with polygons; all others get out, without the former.

    Returns how many block a door for each other.
    """
    content = gap_case(seed, model)
    told = Simulation(as_case(content), will_run=False)
    crowd = told.population.crowd
    has_own = has_way(told.building, crowd.position, crowd.contact_radius)
    lengths = told.fields.lengths_at(crowd.level, crowd.position, crowd.route, crowd.contact_radius)
    assert np.isfinite(lengths[has_own == 1]).all()
    assert np.isinf(lengths[has_own == 0]).all()
    stopped = sum(int(re.search(r": (\d+) of", place.text)[1]) for place in told.stopping)
    assert (has_own == 0).sum() <= stopped <= (has_own != 1).sum()
    content["people"] = [
        {
            "name": f"person {row}",
            "level": "f",
            "positions": [crowd.position[row].tolist()],
            "radius": crowd.radius[row],
        }
        for row in np.flatnonzero(has_own == 1)
    ]
    if content["people"]:
        run = Simulation(as_case(content))
        assert run.stopping == ()
        run.run()
        inside = np.flatnonzero(np.isnan(run.population.crowd.exit_time))
        state = run.state()
        state["ending.progress_at"][:] = run.time
        # Bodies in contact can block a door for each other. Then each gets out from there alone.
        for person in inside:
            alone(run, person, state)
            assert np.isfinite(run.population.crowd.exit_time[person]), (
                person,
                state["population.crowd.position"][person],
            )
        return len(inside)
    return 0


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
@pytest.mark.parametrize("seed", SHARE)
def test_everybody_with_a_way_of_own_width_gets_out(seed, model):
    check_plan(seed, model)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
@pytest.mark.parametrize("seed", range(PLANS))
def test_everybody_with_a_way_of_own_width_gets_out_of_many_plans(seed, model):
    check_plan(seed, model)
