"""Steps that are made in parts: what has been done before the cut leaves no trace."""

import numpy as np
import pytest

from evac.base.errors import SimulationError
from evac.physics.state import Events, allocate, make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm2 import Nsm2
from tests.physics.scenes import kinetic_energy, make_building, make_engine, uniform_fields, walk

FREE = 1e30


def cut_twice(*others):
    """One step of 0.01 s with somebody of 4 kg who leaves a wall at 15 m/s, and others, (x, speed along x) each.

    At 15 m/s whole steps are too long for a radius of 0.2 m and halves are not, but h^2 k / m is 0.75 in halves.
    """
    crowd = make_crowd(
        [(0.0, 0.15), *((x, 5.0) for x, _ in others)],
        [(0.0, 15.0), *((speed, 0.0) for _, speed in others)],
        radius=0.2,
        mass=[4.0] + [80.0] * len(others),
        tau=FREE,
    )
    before = kinetic_energy(crowd)
    building = make_building(walls=[(-2, 0, 2, 0)], exits=[(0, (3, -10, 3, 10))])
    engine = make_engine(crowd, building, uniform_fields())
    events = engine.advance(Dem(), crowd, 0, 1, 0.01, True, False)
    report = engine.report()
    assert (report["steps"], report["too_fast_steps"], report["too_stiff_steps"]) == (1, 1, 1)
    return crowd, events, report, kinetic_energy(crowd) - before


def test_a_cut_step_counts_its_parts_and_its_work_once():
    _, _, report, change = cut_twice()
    assert report["sub_steps"] == 4
    assert change > 100.0
    assert report["contact_creation"] - report["contact_dissipation"] == pytest.approx(change, rel=1e-12)
    assert abs(report["driving_work"]) < 1e-9


def test_a_crossing_before_a_cut_is_no_event():
    crowd, events, _, _ = cut_twice((2.994, 1.5))
    assert events.number == 1
    assert (events.row[0], events.kind[0], events.link[0]) == (1, 1, 0)
    assert events.time[0] == pytest.approx(0.004, abs=1e-12)
    np.testing.assert_array_equal(crowd.level, [0, -1])
    assert crowd.distance[1] == pytest.approx(0.006, abs=1e-12)


def test_a_walk_through_a_cut_step_is_as_long_as_its_path():
    crowd, _, _, _ = cut_twice((1.0, 1.5))
    assert crowd.distance[1] == pytest.approx(0.015, abs=1e-15)
    np.testing.assert_allclose(crowd.position[1], (1.015, 5.0), rtol=0, atol=1e-15)
    assert crowd.distance[0] == pytest.approx(crowd.position[0, 1] - 0.15, abs=1e-15)


def test_a_fast_body_that_is_braked_within_the_step_still_cuts_it():
    """NSM2 moves by the mean of old and new velocity: with h = tau the free velocity is 0, and 30 m/s are too fast.

    In halves 30 m/s become 15 and 7.5 m/s.
    """
    crowd = make_crowd([(0, 0)], [(30.0, 0.0)], radius=0.2, tau=0.01)
    engine = walk(Nsm2(), crowd, 1)
    assert engine.report()["too_fast_steps"] == 1
    np.testing.assert_allclose(crowd.velocity, [(7.5, 0.0)], rtol=1e-14)
    np.testing.assert_allclose(crowd.position, [(0.005 * (22.5 + 11.25), 0.0)], rtol=1e-14)


def test_who_is_thrown_faster_than_anybody_can_be_ends_the_run():
    """With a step of 0.01 s, 99 m/s take eight parts, so that no path is longer than a radius; 101 m/s take none."""
    crowd = make_crowd([(0, 0)], [(99.0, 0.0)], radius=0.2, tau=FREE)
    engine = walk(Nsm2(), crowd, 1)
    assert engine.report()["too_fast_steps"] == 3
    crowd = make_crowd([(0, 0)], [(101.0, 0.0)], radius=0.2, tau=FREE)
    with pytest.raises(SimulationError, match=r"person 0 .* 100 m/s"):
        walk(Nsm2(), crowd, 1)


@pytest.mark.parametrize("is_scarce", [False, True])
def test_a_cut_step_that_runs_out_of_room_is_cut_once(is_scarce):
    """In two parts, the second of which crosses an exit: it waits for room, and is not begun in one part again."""
    velocity = [(15.0, 0.0), (1.5, 0.0), (1.5, 0.0)]
    crowd = make_crowd([(0, 0), (2.99, 5.0), (2.99, 7.0)], velocity, radius=0.2, tau=FREE)
    engine = make_engine(crowd, make_building(exits=[(0, (3, -10, 3, 10))]))
    if is_scarce:
        engine.data.events = allocate(Events, 1)
    events = engine.advance(Dem(), crowd, 0, 1, 0.01, True, False)
    report = engine.report()
    assert (report["too_fast_steps"], report["sub_steps"]) == (1, 2)
    assert events.row[: events.number].tolist() == [1, 2]
    np.testing.assert_allclose(events.time[: events.number], 0.01 / 1.5, rtol=1e-12)
