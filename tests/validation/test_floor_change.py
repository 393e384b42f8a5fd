"""Changing floors: speeds, counts, continuity, and floors that lie above one another."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.simulation.simulation import Simulation
from tests.validation.buildings import crossing_times, rectangle, simulate, straight_stair, track

MODELS = ["dem", "nsm1", "nsm2"]


def test_the_speed_switches_at_the_edge_of_the_stair_and_back(tmp_path):
    """At each edge the plan velocity relaxes with tau from the old to the new speed times the cosine."""
    tau, flat, up = 0.3, 1.4, 0.6
    person = {"positions": [[-5.5, 1.0]], "z": 0.0, "speed": flat, "speed_up": up, "tau": tau}
    faces = [rectangle(-6, 0, 0, 2), rectangle(0, 0, 8, 2, 0.0, 6.0), rectangle(8, 0, 14, 2, 6.0)]
    settings = {"simulation": {"step": 0.01, "tick": 0.01}}
    simulation = simulate(tmp_path, faces, [("end", [[14, 0], [14, 2]], 6.0)], [person], "nsm1", **settings)
    seen = [(time, crowd.velocity[0, 0], crowd.level[0]) for time, crowd in track(simulation)]
    (_, first), (_, last) = crossing_times(simulation)
    for time, speed, _ in seen:
        if first + 0.01 < time < last:
            assert speed == pytest.approx(0.8 * up + (flat - 0.8 * up) * np.exp(-(time - first) / tau), abs=0.04)
        elif last + 0.01 < time < simulation.time - 0.05:
            assert speed == pytest.approx(flat + (0.8 * up - flat) * np.exp(-(time - last) / tau), abs=0.04)
    levels = [level for _, _, level in seen]
    assert [levels[k] for k in range(1, len(levels)) if levels[k] != levels[k - 1]] == [1, 2, -1]


def test_levels_and_those_out_add_up_in_the_school():
    simulation = Simulation(load_case("primary_school"))
    people = len(simulation.population.crowd.level)
    before = None
    for _, crowd in track(simulation):
        counts = np.bincount(crowd.level + 1, minlength=len(simulation.building.levels) + 1)
        assert counts.sum() == people
        assert counts[0] == np.isfinite(crowd.exit_time).sum()
        np.testing.assert_array_equal(crowd.level == -1, np.isfinite(crowd.exit_time))
        if before is not None:  # nobody jumps: at most 0.1 s at the greatest speed
            assert np.hypot(*(crowd.position - before).T).max() <= 0.1 * simulation.engine.report()["greatest_speed"]
        before = crowd.position.copy()
        if simulation.time >= 30.0:
            break
    assert len(simulation.population.crossings[0]) > 50


@pytest.mark.parametrize("model", ["nsm1", "dem"])
def test_a_queue_extends_up_the_stair_without_overlaps(tmp_path, model):
    """People come down to a floor where three who cannot be pushed aside block the way."""
    faces = [*straight_stair(run=5.0, rise=2.5, width=1.4, landing=3.0), rectangle(-6, 0, -3, 1.4)]
    places = [[x, y] for x in (5.4, 6.0, 6.6, 7.2) for y in (0.35, 1.05)]
    people = [
        {"positions": places, "z": 2.5, "speed": 1.5, "speed_down": 0.8},
        {"positions": [[-0.3, 0.25], [-0.3, 0.7], [-0.3, 1.15]], "z": 0.0, "speed": 0.01, "mass": 1e5},
    ]
    settings = {"simulation": {"duration": 25.0}}
    simulation = simulate(tmp_path, faces, [("end", [[-6, 0], [-6, 1.4]], 0.0)], people, model, **settings)
    stair = next(level.index for level in simulation.building.levels if level.kind == "flight")
    for _, crowd in track(simulation):
        inside = np.flatnonzero(crowd.level >= 0)
        gap = np.linalg.norm(crowd.position[inside, None] - crowd.position[inside], axis=2)
        gap -= crowd.radius[inside] + crowd.radius[inside, None]
        np.fill_diagonal(gap, np.inf)
        assert gap.min() > (-1e-4 if model == "nsm1" else -0.06)
    assert (crowd.level == stair).sum() >= 4
    assert len(simulation.population.crossings[0]) >= 8


@pytest.mark.parametrize("model", MODELS)
def test_floors_with_the_same_plan_do_not_touch(tmp_path, model):
    """A crowd on the upper floor, at the places of the lower one: both move as each does alone."""
    faces = [rectangle(0, 0, 6, 4, 0.0), rectangle(0, 0, 6, 4, 3.0)]
    exits = [("lower", [[6, 1.5], [6, 2.5]], 0.0), ("upper", [[6, 1.5], [6, 2.5]], 3.0)]
    places = [[0.5 + 0.6 * i, 0.5 + 0.6 * j] for i in range(4) for j in range(6)]
    group = {"positions": places, "speed": 1.4}
    settings = {"forces": {"social": {}}}
    if model != "dem":  # solved so far that the order in which contacts are solved does not show
        settings |= {f"contact.{model}.velocity_tolerance": 1e-12, f"contact.{model}.iterations": 100_000}
    tracks = []
    for heights in ((0.0,), (0.0, 3.0)):
        people = [group | {"z": z} for z in heights]
        simulation = simulate(tmp_path, faces, exits, people, model, **settings)
        tracks.append(np.array([crowd.position.copy() for time, crowd in track(simulation) if time < 6.05]))
    # Not to the bit: a solver stops when the residual of all contacts is small.
    np.testing.assert_allclose(tracks[1][:, :24], tracks[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(tracks[1][:, 24:], tracks[0], rtol=0, atol=1e-9)
