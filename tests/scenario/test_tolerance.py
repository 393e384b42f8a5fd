"""The rule of `evac run --tolerance`, also on a scene that it was not found on."""

import json
import math

import numpy as np
import pytest

import evac
from evac.errors import ScenarioError
from evac.scenario.tolerance import ERROR_PER_PATH, LONGEST, SOLVER_SHARE, greatest_speed, settings_for
from evac.simulation import Simulation


@pytest.fixture(scope="module")
def room():
    return evac.load("square_room").change({"output.animation": False, "output.picture": False})


def test_the_step_walks_the_stated_share_of_the_tolerance(room):
    chosen = settings_for(room, 0.001)
    assert greatest_speed(room) == 2.0
    assert chosen["simulation.step"] <= 0.001 / (ERROR_PER_PATH * 2.0)
    assert chosen["simulation.step"] > 0.99 * 0.001 / (ERROR_PER_PATH * 2.0)
    assert room.change(chosen).simulation.step == chosen["simulation.step"]


def test_a_large_tolerance_keeps_the_longest_step(room):
    assert settings_for(room, 1.0)["simulation.step"] == pytest.approx(LONGEST)


def test_the_step_is_shortened_to_a_divisor_of_the_tick(room):
    """0.1 s over 0.0013 m / (2.5 * 2 m/s) is 384.6."""
    assert settings_for(room, 0.0013)["simulation.step"] == pytest.approx(0.1 / 385, rel=1e-12)


def test_the_velocity_tolerance_follows_the_tolerance_up_to_its_default(room):
    case = room.change({"contact.model": "nsm1"})
    found = [settings_for(case, tolerance)["contact.nsm1.velocity_tolerance"] for tolerance in (0.001, 1.0)]
    assert found == pytest.approx([1e-4, 5e-4], rel=1e-12)


def test_only_parameters_that_the_model_has_are_set(room):
    names = {
        model: set(settings_for(room.change({"contact.model": model}), 0.001)) - {"simulation.step"}
        for model in ("dem", "nsm1", "nsm2")
    }
    assert names == {
        "dem": set(),
        "nsm1": {"contact.nsm1.gap_tolerance", "contact.nsm1.velocity_tolerance"},
        "nsm2": {"contact.nsm2.velocity_tolerance"},
    }
    chosen = settings_for(room.change({"contact.model": "nsm1"}), 0.001)
    assert chosen["contact.nsm1.gap_tolerance"] == pytest.approx(SOLVER_SHARE * 0.001)


def test_unbounded_speeds_count_as_a_multiple_of_their_mean(room):
    fast = room.change({"people.people.speed": {"normal": [1.0, 0.2], "minimum": 0.1}})
    assert greatest_speed(fast) == pytest.approx(3.0, rel=1e-4)


def test_initial_velocities_count(room):
    group = {"name": "people", "positions": [[1.0, 1.0]], "velocity": [[3.0, 4.0]], "level": "room", "speed": 1.3}
    assert greatest_speed(room.change({"people": [group]})) == 5.0


@pytest.mark.parametrize(
    ("changes", "greatest"),
    [
        ({"speed_down": 4.0, "limit_stair_speeds": False}, 4.0),
        ({"speed_up": {"factor": {"uniform": [1.0, 2.5]}}, "limit_stair_speeds": False}, 2.5),
        ({"speed": 0.4}, 0.4),  # the default on stairs is at most that on the flat
    ],
)
def test_speeds_on_stairs_count(room, changes, greatest):
    group = {"name": "people", "number": 2, "area": "room", "speed": 1.0}
    assert greatest_speed(room.change({"people": [group | changes]})) == greatest


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.inf, math.nan, 1e-9])
def test_tolerances_that_make_no_sense_are_refused(room, tolerance):
    with pytest.raises(ScenarioError, match="tolerance"):
        settings_for(room, tolerance)


@pytest.mark.parametrize("model", ["dem", "nsm1"])
def test_positions_stay_within_the_tolerance_on_a_scene_not_used_for_the_rule(room, model):
    case = room.change({"contact.model": model})
    tolerance = 0.005
    chosen = settings_for(case, tolerance)
    finer = {key: value / 16 for key, value in chosen.items()}
    places = []
    for overrides in (chosen, finer):
        simulation = Simulation(case.change(overrides))
        simulation.recording.recorders = []
        while simulation.time < 1.0 - 1e-9:
            simulation.advance_tick()
        places.append(simulation.population.crowd.position.copy())
    assert np.hypot(*(places[0] - places[1]).T).max() <= tolerance


def test_the_command_says_what_it_chose_and_runs_with_it(tmp_path, capsys):
    from evac.cli import main

    words = ["run", "square_room", "--tolerance", "0.05", "--out", str(tmp_path / "r")]
    words += ["--set", "simulation.duration=0.5", "output.animation=false", "output.picture=false"]
    main(words)
    assert "simulation.step (from --tolerance)" in capsys.readouterr().out
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    step = settings_for(evac.load("square_room"), 0.05)["simulation.step"]
    assert summary["steps"] == round(0.5 / step)
