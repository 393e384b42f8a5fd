"""Recorded velocities are displacements over the tick; what a run notices of velocities, forces and overlaps."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.simulation.running import run
from evac.simulation.simulation import Simulation
from evac.trajectory.trajectory import read_trajectory
from tests.runs import MODELS, model_of, run_ticks

#: Differences of positions in float32, up to 32 m from the origin, over 0.1 s and over 0.05 s [m/s].
ROUNDING = 32.0 * 2.0**-23 / 0.05

CROWDED = {"people.people.number": 60}


def recorded(tmp_path, name, **changes):
    quiet = {f"output.{name}": False for name in ("picture", "animation", "replay")}
    run(load_case(name, changes | quiet), tmp_path / "result")
    return read_trajectory(tmp_path / "result")


@pytest.mark.parametrize(
    "changes",
    [
        model_of("dem"),
        model_of("nsm2") | {"contact.nsm2.position_correction": True},
    ],
    ids=["dem", "nsm2-corrected"],
)
def test_recorded_velocities_are_differences_of_recorded_positions_on_stairs_too(changes, tmp_path):
    found = recorded(tmp_path, "primary_school", **changes, **{"simulation.duration": 16.0, "output.every": 0.1})
    assert len(found) == 161
    moved = np.diff(found.position, axis=0) / np.diff(found.time)[:, None, None]
    inside = found.level[1:] >= 0
    velocity = found.velocity[1:]
    np.testing.assert_allclose(velocity[inside][:, :2], moved[inside], rtol=0.0, atol=ROUNDING)
    slope = np.array([np.tan(level.slope) * level.uphill for level in found.building.levels])[found.level[1:]]
    rise = (slope * velocity[..., :2]).sum(axis=-1)
    np.testing.assert_allclose(velocity[inside][:, 2], rise[inside], rtol=0.0, atol=1e-12)
    assert (np.abs(velocity[inside][:, 2]) > 0.3).sum() > 500  # people on flights
    np.testing.assert_allclose(found.speed[1:][inside], np.linalg.norm(velocity[inside], axis=-1), rtol=1e-12)


def test_somebody_alone_on_a_stair_is_recorded_at_the_stair_speed(tmp_path):
    """With the exact directions of a straight flight, and once the speed has been taken up, to the last digits."""
    teacher = {"people": [{"name": "one", "number": 1, "area": "teacher_2a", "speed": 1.4, "speed_down": 0.6}]}
    changes = {"behaviours": {}, "output.every": 0.1, "simulation.duration": 60.0}
    found = recorded(tmp_path, "primary_school", **teacher, **changes)
    kinds = np.array([level.kind for level in found.building.levels])
    on_flight = (found.level[:, 0] >= 0) & (kinds[found.level[:, 0]] == "flight")
    settled = on_flight & np.roll(on_flight, 20)
    assert settled.sum() > 20
    assert np.median(found.speed[settled, 0]) == pytest.approx(0.6, abs=1e-3)


def test_the_first_frame_has_the_initial_velocity_and_the_last_one_that_of_its_own_tick(tmp_path):
    velocity = [[0.25, 0.5], [0.0, -0.75]]
    people = [{"name": "two", "positions": [[1.0, 1.0], [1.0, 3.0]], "velocity": velocity, "level": "room"}]
    changes = {"people": people, "simulation.duration": 0.35, "output.every": 0.1}
    found = recorded(tmp_path, "square_room", **changes)
    assert found.time.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.35])
    np.testing.assert_array_equal(found.velocity[0][:, :2], velocity)
    moved = np.diff(found.position, axis=0) / np.array([0.1, 0.1, 0.1, 0.05])[:, None, None]
    np.testing.assert_allclose(found.velocity[1:, :, :2], moved, rtol=0.0, atol=ROUNDING)


def velocities_in_a_jam(changes):
    """Return means of |u| and of the recorded speed of people who get on at less than 0.3 m/s, and the simulation."""
    simulation = Simulation(load_case("classroom", changes))
    crowd = simulation.population.crowd
    found = []
    while not simulation.ended and simulation.step < 1500:
        simulation.advance_tick()
        speed = np.hypot(*simulation.displacement_velocity.T)
        slow = (crowd.level >= 0) & (speed < 0.3)
        found.append(np.column_stack([np.hypot(*crowd.velocity.T), speed])[slow])
    return *np.concatenate(found).mean(axis=0), simulation


def test_contacts_that_chatter_have_a_warning():
    """The paper's K_N reverses velocities in most steps of a jam."""
    velocity, speed, simulation = velocities_in_a_jam(model_of("nsm2"))
    assert velocity > 2.0 * speed
    found = simulation.watch.observations().get("chatter")
    assert found.people >= 3
    assert found.values[0] > 2.0 * found.values[1]
    assert any(line.startswith("chattering contacts: ") for line in simulation.results().quality_warnings)


@pytest.mark.parametrize("dissipation", [0.0, 200.0])
@pytest.mark.parametrize("correction", [False, True])
def test_nobody_walks_in_place(dissipation, correction):
    """Corrections undo no steps: with or without them velocities are those that people move with."""
    changes = {"contact.nsm2.normal_dissipation": dissipation, "contact.nsm2.position_correction": correction}
    velocity, speed, simulation = velocities_in_a_jam(model_of("nsm2") | changes)
    assert velocity < 1.25 * speed
    assert simulation.watch.observations().get("chatter") is None
    assert (simulation.results().report["position_corrections"] > 0) == correction


def test_constrained_positions_do_not_chatter():
    velocity, speed, simulation = velocities_in_a_jam(model_of("nsm1"))
    assert velocity < 1.25 * speed
    assert simulation.watch.observations().get("chatter") is None


@pytest.mark.parametrize("model", MODELS)
def test_forces_that_nobody_survives_have_a_warning_in_a_jam_only(model):
    crowded, few = (Simulation(load_case("square_room", changes | model_of(model))) for changes in (CROWDED, {}))
    found = run_ticks(crowded, 150).watch.observations().get("crushing")
    assert found.people >= 1
    assert found.values[1] > 4500.0
    assert run_ticks(few, 150).watch.observations().get("crushing") is None


@pytest.mark.parametrize("model", MODELS)
def test_overlaps_beyond_the_promise_have_a_warning_with_time_and_place(model):
    positions = [[1.0, 1.0], [1.25, 1.0], [3.0, 3.0]]
    people = [{"name": "people", "positions": positions, "level": "room", "radius": 0.25, "speed": 1.3}]
    results = run_ticks(Simulation(load_case("square_room", {"people": people} | model_of(model))), 5).results()
    at = results.report["greatest_overlap_at"]
    assert (at["time"], at["level"], at["y"]) == (0.0, "room", 1.0)
    assert at["x"] == positions[at["person"]][0]
    assert results.report["greatest_overlap"] == pytest.approx(0.25)
    promised = {"dem": 0.125, "nsm1": 1e-4, "nsm2": 0.01 * 1.3}[model]
    assert results.report["promised_overlap"] == pytest.approx(promised)
    (line,) = (line for line in results.quality_warnings if "overlapped" in line)
    assert "t = 0.00 s" in line
    apart = Simulation(load_case("square_room", model_of(model)))
    assert not any("overlapped" in line for line in run_ticks(apart, 100).results().quality_warnings)
