"""Parting overlaps: a displacement takes no time and is not walked, and a crowd that starts in a heap is parted."""

import numpy as np
import pytest

import evac
from evac.simulation.simulation import Simulation

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


def after_one_step(positions, radius):
    """Let people stand for one step of NSM1; return the results and how deep each overlaps the one before it [m]."""
    group = {"name": "people", "positions": positions, "level": "room", "radius": radius, "mass": 80.0, "speed": 0.0}
    results = Simulation(case_of("nsm1", positions, **{"people": [group], "simulation.duration": 0.01})).run()
    return results, 2.0 * radius - np.hypot(*np.diff(results.crowd.position, axis=0).T)


@pytest.mark.parametrize(("radius", "most"), [(0.3, 0.1), (0.15, 0.075)], ids=["reach", "half a radius"])
def test_a_row_is_parted_by_the_same_share_everywhere(radius, most):
    """The last of six who overlap by 50 mm has 250 mm to go, farther than one step may take anybody."""
    row = [[radius + (2.0 * radius - 0.05) * k, 2.5] for k in range(6)]
    _, overlap = after_one_step(row, radius)
    np.testing.assert_allclose(overlap, 0.05 * (1.0 - most / 0.25), rtol=0, atol=1e-4)


@pytest.mark.parametrize(("overlap", "corrections"), [(3.5e-5, 0), (4.5e-5, 1)])
def test_overlaps_are_parted_early_enough_for_what_a_step_adds(overlap, corrections):
    """Two fifths of NSM1's tolerance, 0.1 mm, and the half of it that a solve may leave, stay below it."""
    results, _ = after_one_step([[2.0, 2.5], [2.4 - overlap, 2.5]], 0.2)
    assert results.report["position_corrections"] == corrections


def test_a_row_across_a_crowd_is_parted_at_once():
    """Its last one has 23 overlaps to go; among few people, contacts are looked for as far as 20."""
    row = [[0.1 + 0.199 * k, 4.5] for k in range(24)]
    others = [[0.2 + 0.3 * i, 0.2 + 0.3 * j] for i in range(15) for j in range(10)]
    _, alone = after_one_step(row, 0.1)
    _, among = after_one_step(row + others, 0.1)
    assert alone.max() == pytest.approx(1e-3 * (1.0 - 20.0 / 23.0), abs=2e-5)
    assert among[:23].max() < 2e-5
