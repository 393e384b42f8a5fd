"""RiMEA tests 1, 2, 3, 5 and 6 (guideline 4.1.1, annex 1)."""

import numpy as np
import pytest

from tests.validation.buildings import corner, crossing_times, rectangle, simulate, straight_stair, track

MODELS = ["dem", "nsm1", "nsm2"]


@pytest.mark.parametrize("model", MODELS)
def test_1_a_corridor_of_40_m(tmp_path, model):
    """2 x 40 m at 1.33 m/s from rest: 40 / 1.33 + tau = 30.58 s, within 26 to 34 s."""
    person = {"positions": [[0.0, 1.0]], "z": 0.0, "speed": 1.33}
    exits = [("end", [[40, 0], [40, 2]], 0.0)]
    simulation = simulate(tmp_path, [rectangle(-2, 0, 40, 2)], exits, [person], model)
    results = simulation.run()
    assert 26.0 <= results.crowd.exit_time[0] <= 34.0
    assert results.crowd.exit_time[0] == pytest.approx(40.0 / 1.33 + 0.5, abs=0.006)
    assert results.crowd.distance[0] == pytest.approx(40.0, abs=0.02)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("way", "speed"), [("up", 0.5), ("down", 0.65)])
def test_2_and_3_a_stair_of_10_m_along_the_slope(tmp_path, model, way, speed):
    """Up at 0.5 m/s: 20 s; down at 0.65 m/s: 15.38 s; within 5 %."""
    up = way == "up"
    person = {
        "positions": [[-1.5, 1.0]] if up else [[9.5, 1.0]],
        "z": 0.0 if up else 6.0,
        "speed": 1.33,
        f"speed_{way}": speed,
        "tau": 0.2,
    }
    exits = [("end", [[10, 0], [10, 2]], 6.0) if up else ("end", [[-2, 0], [-2, 2]], 0.0)]
    simulation = simulate(tmp_path, straight_stair(), exits, [person], model)
    simulation.run()
    (first, start), (last, end) = crossing_times(simulation)
    assert first != last
    assert end - start == pytest.approx(10.0 / speed, rel=0.05)
    # Entered at a speed v_0, the stair takes 10 m / v less what the relaxation gains, tau (v_0 - v) / v.
    tau, plan = 0.2, 0.8 * speed
    assert end - start == pytest.approx(10.0 / speed - tau * (1.33 - plan) / plan, rel=0.01)


def test_5_nobody_moves_before_its_response_time(tmp_path):
    """Ten people, response times of 10 to 100 s drawn uniformly; noticed within two frames of 1/8 s."""
    places = [[0.25 + 0.5 * k, 0.5] for k in range(10)]
    people = [{"positions": places, "z": 0.0, "speed": 1.33, "radius": 0.2}]
    simulation = simulate(
        tmp_path,
        [rectangle(0, 0, 5, 8)],
        [("door", [[2, 8], [3, 8]], 0.0)],
        people,
        behaviours={"response_time": {"time": {"uniform": [10.0, 100.0]}}},
    )
    crowd = simulation.population.crowd
    response = crowd.start_time.copy()
    assert ((response >= 10.0) & (response <= 100.0)).all()
    assert len(np.unique(response)) == 10
    start = crowd.position.copy()
    set_off = np.full(10, np.nan)
    for time, crowd in track(simulation):
        moved = np.hypot(*(crowd.position - start).T) > 1e-3
        set_off[moved & np.isnan(set_off)] = time
    assert (set_off >= response).all()
    assert (set_off - response <= 0.25).all()
    assert (crowd.exit_time > response).all()


@pytest.mark.parametrize("model", MODELS)
def test_6_round_a_corner(tmp_path, model):
    """Twenty people walk along x = 0 to 12 and turn left into y = 2 to 12: nobody beyond the corner's walls."""
    places = [[0.5 + x, 0.4 + 0.6 * y] for x in np.arange(0.0, 5.6, 0.8) for y in range(3)][:20]
    people = [{"positions": places, "z": 0.0, "speed": {"uniform": [1.2, 2.0]}}]
    simulation = simulate(tmp_path, corner(), [("end", [[10, 12], [12, 12]], 0.0)], people, model)
    for _, crowd in track(simulation):
        x, y = crowd.position[crowd.level >= 0].T
        assert not ((x < 10.0) & (y > 2.0)).any()
        assert ((x > 0.0) & (x < 12.0) & (y > 0.0) & (y < 12.0)).all()
    assert simulation.ended == "everybody out"
