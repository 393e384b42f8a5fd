"""Parting overlaps: a displacement takes no time and is not walked, and a crowd that starts in a heap is parted."""

import numpy as np
import pytest

import evac
from evac.simulation import Simulation

POSITION_CORRECTION = {"contact.nsm2.position_correction": True}


def case_of(model, positions, **changes):
    group = {"name": "people", "positions": positions, "level": "room", "radius": 0.2, "mass": 80.0, "speed": 1.5}
    return evac.load("square_room").change(
        {"people": [group], "contact.model": model, **POSITION_CORRECTION, "simulation.duration": 2.0, **changes}
    )


@pytest.mark.parametrize("model", ["nsm1", "nsm2"])
def test_who_is_pushed_over_the_exit_is_out_at_once_and_has_not_walked(model):
    simulation = Simulation(case_of(model, [[4.88, 2.5], [4.735, 2.5]]))
    results = simulation.run()
    crowd = results.crowd
    assert results.report["position_corrections"] > 0
    assert (crowd.exit_time <= results.time).all()
    assert crowd.exit_time[0] <= 0.02
    assert crowd.distance[0] < 0.02  # of the 0.12 m to the exit


@pytest.mark.parametrize("model", ["nsm1", "nsm2"])
@pytest.mark.parametrize("place", [(0.21, 0.21), (4.79, 1.9)], ids=["corner", "post"])
def test_a_heap_is_parted(model, place):
    simulation = Simulation(case_of(model, [place] * 10, **{"simulation.duration": 1.0}))
    results = simulation.run()
    inside = results.crowd.position[results.crowd.level >= 0]
    assert ((inside > -1e-6) & (inside < 5.0 + 1e-6)).all()
    distance = np.hypot(*(inside[:, None] - inside[None, :]).T)[np.triu_indices(len(inside), 1)]
    assert distance.min() > 0.35
